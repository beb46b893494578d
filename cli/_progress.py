"""Progress of a long command: what is done and how much of it in, a bar for a user out.

The bar and the time that is left go on between two reports. The share of the time that
was over at the last one gives how long the whole takes.
"""

import sys
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from selfheal.printable import make_printable

from ._streams import guard_streams, unwrap

if TYPE_CHECKING:
    from rich.progress import Progress

ShowProgress = Annotated[
    bool,
    typer.Option("--progress", help="Print progress even without a terminal."),
]
LEFT_OF_LATE = 0.05  # of the time that is over, left at least until the end; chosen
# what is said of a stage, by the first word of what is being done
_STAGES = {
    "trying": "trying every effect wherever it could be",
    "fitting": "fitting the best of them together with all nominal values",
}
_STEP = 0.05  # of the whole, after which a line says how far it is; chosen


class ProgressBar:
    """A bar and lines on standard error; the bar only where that is a terminal.

    With `--json` lines are shown only where there is a bar, or with `--progress`.
    """

    def __init__(self, what: str, *, as_json: bool, progress: bool) -> None:
        """Begin; with `progress` how far it is is said where there is no terminal, too.

        Args:
            as_json: whether a script reads the result.
        """
        from rich.console import Console

        console = Console(file=unwrap(sys.stderr))
        self._console = console
        self._is_quiet = as_json and not (console.is_terminal or progress)
        self._says_shares = progress and not console.is_terminal
        self._start = time.perf_counter()
        self._what, self._whole, self._most, self._said = what, 0.0, 0.0, 0.0
        self._bar = _make_bar(self) if console.is_terminal else None

    def __enter__(self) -> "ProgressBar":
        """Draw the bar."""
        if self._bar:  # rich's streams print above the bar what they get
            self._bar.start()
            guard_streams()
        return self

    def __exit__(self, *error: object) -> None:
        """Wipe the bar off."""
        if self._bar:
            self._bar.stop()

    @property
    def seconds(self) -> float:
        """Time since the beginning [s]."""
        return time.perf_counter() - self._start

    @property
    def share(self) -> float:
        """How much of the time is over now, 0 to 1; it never falls."""
        over = self.seconds
        if self._whole:
            left = max(self._whole - over, LEFT_OF_LATE * over)
            self._most = max(self._most, over / (over + left))
        return self._most

    @property
    def state(self) -> str:
        """The time that is over and the time left, in words, and what is being done."""
        over = self.seconds
        left = ""
        if self._whole:
            left = format_left(max(self._whole - over, LEFT_OF_LATE * over))
        minutes, seconds = divmod(int(over), 60)
        said = (f"{minutes}:{seconds:02d}", left, make_printable(self._what))
        return "  ".join(filter(None, said))

    def show(self, what: str, share: float) -> None:
        """Show what is being done and which share (0 to 1) of the time is over.

        A share of 0 says nothing new of the time that is left.
        """
        self._what = what
        if share > 0:
            self._whole = self.seconds / min(share, 1.0)
        if self._says_shares and share >= self._said + _STEP:
            self._said = share
            self.say(f"{100 * share:3.0f} %  {self.state}")

    def say(self, line: str, head: str = "") -> None:
        """Leave a line above the bar, with a bold head before it."""
        from rich.text import Text

        if not self._is_quiet:
            text = Text.assemble((head, "bold"), make_printable(line))
            self._console.print(text, soft_wrap=True)


def format_left(seconds: float) -> str:
    """A time [s] that is left, as exactly as it is known ("about 3 min left")."""
    if seconds >= 90:
        return f"about {seconds / 60:.0f} min left"
    step = 5 if seconds >= 10 else 1
    return f"about {max(step * round(seconds / step), 1)} s left"


def _make_bar(progress: ProgressBar) -> "Progress":
    """A bar that looks several times a second at how far a command is."""
    from rich.progress import Progress, ProgressColumn, Task
    from rich.progress_bar import ProgressBar as Drawn
    from rich.text import Text

    class Share(ProgressColumn):
        """The share of the time that is over."""

        def render(self, task: Task) -> Drawn:
            whole = 1.0 if progress.share else None  # it runs to and fro
            return Drawn(total=whole, completed=progress.share, width=24)

    class State(ProgressColumn):
        """The rest, in words."""

        def render(self, task: Task) -> Text:
            return Text(progress.state, no_wrap=True, overflow="ellipsis")

    bar = Progress(Share(), State(), console=progress._console, transient=True)
    bar.add_task("", total=None)
    return bar


class StageProgress:
    """Shares of stages, one after the other, made shares of what is done here.

    Attributes:
        weights: what each stage takes, in their order; in any unit. What is done when
            the last one is over may stand there, too, and stages may be added.
    """

    def __init__(self, weights: Mapping[str, float], start: float = 0.0) -> None:
        """`start`: what comes before the first stage, resumed or not, takes as well."""
        self.weights, self._start = weights, start
        self._begun: float | None = None

    def compute_share(self, stage: str, share: float) -> float:
        """Share that is done, from the first stage on that was begun here.

        Args:
            stage: those before it are done, here or earlier.
            share: of it that is done, 0 to 1.
        """
        names = list(self.weights)
        before = sum(self.weights[name] for name in names[: names.index(stage)])
        self._begun = before if self._begun is None else self._begun
        done = before + share * self.weights[stage] + self._start - self._begun
        return done / (sum(self.weights.values()) + self._start - self._begun)


class DiagnosisProgress:
    """Progress of a diagnosis: a line for each stage."""

    def __init__(self, live: ProgressBar) -> None:
        self.live, self.stage = live, ""

    def __call__(self, what: str, share: float) -> None:
        """Show what is being done and how much of that is done."""
        self.live.show(what, share)
        stage = what.partition(" ")[0]  # "trying this", "trying that": one stage
        if stage != self.stage:
            self.stage, said = stage, _STAGES.get(stage, what)
            self.live.say(f"{self.live.seconds:6.1f} s  {said}")
