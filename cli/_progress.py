"""Progress of a long command: what is being done in, a bar and lines for a user out."""

import sys
import time

from selfheal.printable import make_printable

from ._streams import guard_streams, unwrap


class ProgressBar:
    """A bar and lines on standard error; the bar only where that is a terminal."""

    def __init__(self, what: str, *, quiet: bool) -> None:
        """Begin with what is being done; nothing is ever shown if quiet."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        self._console = Console(file=unwrap(sys.stderr), quiet=quiet)
        self._start = time.perf_counter()
        self._bar = Progress(
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.description}", markup=False),
            console=self._console,
            transient=True,
            disable=quiet or not self._console.is_terminal,
        )
        self._task = self._bar.add_task(make_printable(what), total=1.0)

    def __enter__(self) -> "ProgressBar":
        """Draw the bar."""
        self._bar.start()
        if not self._bar.disable:  # rich's streams print above the bar what they get
            guard_streams()
        return self

    def __exit__(self, *error: object) -> None:
        """Wipe the bar off."""
        if not self._bar.disable:  # rich ends even a bar that never was with a line
            self._bar.stop()

    @property
    def seconds(self) -> float:
        """Time since the beginning [s]."""
        return time.perf_counter() - self._start

    def show(self, what: str, share: float) -> None:
        """Show what is being done and how much of it is done, 0 to 1."""
        said = make_printable(what)
        self._bar.update(self._task, description=said, completed=share)

    def say(self, line: str, head: str = "") -> None:
        """Leave a line above the bar, with a bold head before it."""
        from rich.text import Text

        text = Text.assemble((head, "bold"), make_printable(line))
        self._console.print(text, soft_wrap=True)
