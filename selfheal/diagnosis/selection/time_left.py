"""How much of a diagnosis is done: stages as they begin in, shares of its time out."""

import time
from collections.abc import Callable
from enum import IntEnum


class Stage(IntEnum):
    """What a diagnosis does, in this order; a search may go back."""

    READ = 0
    NOMINAL = 1
    DERIVATIVES = 2
    SEARCH = 3
    FITS = 4
    LAST_FIT = 5
    TESTS = 6


# What a stage takes, and what it takes more for each named effect. In units of what the
# nominal fit and the first derivatives by all candidates take together. Measured: of
# seven diagnoses of 14 to 154 s of CPU, what comes after these took 3 to 10 units, 5.2
# in the (geometric) mean. With these the whole is predicted within a factor of 1.7
# from a quarter of it on and of 1.5 from a half of it on
COSTS = {
    Stage.SEARCH: (1.7, 0.12),
    Stage.FITS: (0.5, 0.05),
    Stage.LAST_FIT: (0.9, 0.08),
    Stage.TESTS: (1.75, 0.15),
}
NOMINAL_SHARE = 1 / 4  # of that unit, the nominal fit's; measured: 1/4 to 1/14
LEFT_OF_LATE = 0.25  # of a stage's time, left at least until it ends; chosen


class TimeLeft:
    """Predicts how much longer a diagnosis takes from what its stages took so far.

    Attributes:
        named: how many effects have a name so far.
    """

    def __init__(
        self, begun: float | None = None, now: Callable[[], float] = time.monotonic
    ) -> None:
        """Begin.

        Args:
            begun: when all of it began [s]; None: now.
            now: gives the time [s].
        """
        self._now, self._since = now, now()
        self._begun = self._since if begun is None else begun
        self._stage, self._share = Stage.READ, 0.0
        self._nominal = self._unit = 0.0
        self.named = 0

    def enter(self, stage: Stage) -> float:
        """Know what is done from now on; the share (0 to 1) of the time that is over.

        It never falls. Before the nominal fit is done nothing is known, and it is 0.
        """
        now = self._now()
        if stage is not self._stage:
            took = now - self._since
            if self._stage is Stage.NOMINAL:
                self._nominal, self._unit = took, took / NOMINAL_SHARE
            if self._stage is Stage.DERIVATIVES and stage is Stage.SEARCH:
                self._unit = self._nominal + took
            self._stage, self._since = stage, now
        if self._unit:
            spent = now - self._begun
            self._share = max(self._share, spent / (spent + self._predict(now)))
        return self._share

    def _predict(self, now: float) -> float:
        """Time [s] that is left."""
        spent, expected = now - self._since, self._expect(self._stage)
        if self._stage <= Stage.DERIVATIVES:
            spent, expected = spent + self._nominal, self._unit
        left = max(expected - spent, LEFT_OF_LATE * expected)
        return left + sum(self._expect(s) for s in COSTS if s > self._stage)

    def _expect(self, stage: Stage) -> float:
        """Time [s] that a stage takes."""
        fixed, more = COSTS.get(stage, (0.0, 0.0))
        return self._unit * (fixed + more * max(self.named, 1))
