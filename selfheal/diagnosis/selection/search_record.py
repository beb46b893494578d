"""What a search has found so far, for whoever watches it or stops it."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager

from ..effects.base import Term
from ..simulation.cache import OutOfTime
from ..simulation.simulator import Simulator
from .search_state import SearchState
from .time_left import Stage, TimeLeft

Progress = Callable[[str, float], None]


class SearchRecord:
    """Passes progress on, with what is believed so far, and keeps the state reached.

    Attributes:
        state: the last one of the search; None: there is none yet.
        finish: fits what a search that was stopped had found since; None: nothing.
        stopped: what was being done when time was over; empty where it was not.
        is_search_stopped: whether that was so before the search was through.
        effects: how many could be somewhere in the robot.
        untried: names of those of which some candidate was never tried.
    """

    def __init__(
        self,
        progress: Progress | None = None,
        time_left: TimeLeft | None = None,
        is_over: Callable[[float], bool] = lambda share: False,
    ) -> None:
        """What is watched.

        Args:
            progress: called with a message and the share (0 to 1) of all that is done.
            is_over: whether a share (0 to 1) of the time is over.
        """
        self._progress = progress or (lambda what, share: None)
        self._time_left, self._is_over = time_left or TimeLeft(), is_over
        self.state: SearchState | None = None
        self.finish: Callable[[], SearchState] | None = None
        self._stage, self._belief, self.stopped = "beginning the search", "", ""
        self._tried: set[tuple] = set()
        self.is_search_stopped, self.effects = False, 0
        self.untried: list[str] = []

    def __call__(self, what: str, named: int) -> None:
        """Say what a search tries, with so many named effects."""
        self._time_left.named = named
        self.enter(Stage.SEARCH, what)

    def enter(self, stage: Stage, what: str) -> None:
        """Say what is being done from now on, and what is believed."""
        self._stage = what
        self._progress(what + self._belief, self._time_left.enter(stage))

    @contextmanager
    def limit(self, simulator: Simulator, share: float) -> Iterator[None]:
        """Leave what is entered once a share (0 to 1) of the time is over.

        What is stopped first counts.
        """
        try:
            with simulator.counter.limit(lambda: self._is_over(share)):
                yield
        except OutOfTime:
            self.stopped = self.stopped or self._stage

    def keep(self, state: SearchState) -> None:
        """Keep a state as the last one."""
        self.state, self._time_left.named = state, len(state.named)
        count = Counter(t.effect.name for t in state.named)
        each = [name if n == 1 else f"{n} {name}" for name, n in count.items()]
        self._belief = f" (so far: {', '.join(each)})" if each else ""

    def add_tried(self, terms: Iterable[Term]) -> None:
        """Know that terms were tried."""
        self._tried |= {t.key for t in terms}

    def end_search(self, candidates: Sequence[Term]) -> None:
        """Know that a search of these candidates is over.

        The state is forgotten, whose Jacobian is large, but not what is believed.
        """
        self.state = self.finish = None
        self.is_search_stopped = bool(self.stopped)
        self.effects = len({t.effect.name for t in candidates})
        left = (t.effect.name for t in candidates if t.key not in self._tried)
        self.untried = sorted(set(left))
