"""Progress of a long command: what is being done in, a bar and lines for a user out."""

import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.text import Text


class ProgressBar:
    """A bar and lines on standard error; the bar only where that is a terminal."""

    def __init__(self, what: str, *, quiet: bool) -> None:
        """Begin with what is being done; nothing is ever shown if quiet."""
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        self._console = Console(stderr=True, quiet=quiet)
        self._start = time.perf_counter()
        self._bar = Progress(
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.description}", markup=False),
            console=self._console,
            transient=True,
            disable=quiet or not self._console.is_terminal,
        )
        self._task = self._bar.add_task(what, total=1.0)

    def __enter__(self) -> "ProgressBar":
        """Draw the bar."""
        self._bar.start()
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
        self._bar.update(self._task, description=what, completed=share)

    def say(self, line: "str | Text") -> None:
        """Leave a line above the bar."""
        self._console.print(line, highlight=False, markup=False, soft_wrap=True)
