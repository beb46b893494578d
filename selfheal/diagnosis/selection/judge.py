"""The judge of fits: takes two, gives which predicts episodes better.

By the log predictive density of segments of several lengths, paired. A segment counts
by the logarithm of its error, so that a blow in one of them does not decide.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...recording.data import Floats
from ..data.segments import Segments
from ..estimation.fit import Fit
from ..estimation.marginalization import keep_informative
from ..estimation.problem import Problem
from ..estimation.reweighting import downweight_unscored
from ..estimation.settings import FIT
from ..simulation.dataset import (
    LONG_SEGMENTS,
    SHORT_SEGMENT,
    cut_readable_segments,
)
from ..simulation.score import log_errors
from ..simulation.simulator import Simulator

FEWEST_SEGMENTS = 3  # of which a standard error can be had
LEVEL = 0.05  # of the tests
MOST_NATS = 10.0  # of a segment, beyond any that a prediction may be better by


@dataclass(frozen=True, eq=False)
class Judge:
    """Segments of several lengths, most often of held-out episodes, to be replayed in.

    Attributes:
        simulator: of the episodes.
        horizons: as long as these inform: the longer ones show what builds up slowly.
    """

    simulator: Simulator
    horizons: tuple[Segments, ...]

    @classmethod
    def build(cls, simulator: Simulator, fit: Fit) -> "Judge":
        """The segments of these episodes over which a fit can predict the robot."""
        sigma = downweight_unscored(fit)
        problems = (
            Problem(simulator, cut_readable_segments(simulator, seconds), sigma)
            for seconds in (SHORT_SEGMENT, *LONG_SEGMENTS)
        )
        found = keep_informative(problems, fit.terms, fit.values)
        horizons = [p.segments for p in found if len(p.segments) >= FEWEST_SEGMENTS]
        return cls(simulator, tuple(horizons or [found[0].segments]))

    def log_errors(self, fit: Fit) -> list[Floats]:
        """Errors (W) [nats] of a fit's replay in the segments of each length."""
        return [
            log_errors(self.simulator.leapfrog, s, fit.terms, fit.values)
            for s in self.horizons
        ]

    def log_native_errors(self, fit: Fit) -> list[Floats]:
        """Errors (W) [nats] of each length where MuJoCo steps the given model."""
        simulator, count = self.simulator.native, self.simulator.coarsening
        return [
            log_errors(simulator, s.with_finer_steps(count), fit.terms, fit.values)
            for s in self.horizons
        ]


def compare(first: Sequence[Floats], second: Sequence[Floats]) -> Floats:
    """By how much one fit predicts better than another, in t statistics (h).

    One of each horizon, of paired differences of segments; they show the same episodes.

    Args:
        first: errors of one, from `Judge.log_errors`.
    """
    out = []
    for lead in _pair(first, second):
        spread = lead.std(ddof=1) if len(lead) > 1 else abs(lead[0])
        out.append(lead.mean() / (spread / np.sqrt(len(lead)) + FIT.tiny))
    return np.array(out)


def measure_lead(first: Sequence[Floats], second: Sequence[Floats]) -> float:
    """By how many nats of a segment one fit predicts better than another.

    The mean over horizons of the mean of paired differences.

    Args:
        first: errors of one, from `Judge.log_errors`.
    """
    return float(np.mean([lead.mean() for lead in _pair(first, second)]))


def _pair(first: Sequence[Floats], second: Sequence[Floats]) -> Iterator[Floats]:
    """Paired differences (W) [nats] of each horizon, positive where the first leads."""
    for a, b in zip(first, second, strict=True):
        yield np.clip(np.nan_to_num(b - a, nan=0.0), -MOST_NATS, MOST_NATS)


def is_clearly_better(first: Sequence[Floats], second: Sequence[Floats]) -> bool:
    """Whether one fit predicts better than another over some horizon, worse over none.

    By one-sided t tests.
    """
    statistic, limits = compare(first, second), _find_limits(first)
    return bool((statistic > limits).any() and (statistic > -limits).all())


def is_outdone(first: Sequence[Floats], second: Sequence[Floats]) -> bool:
    """Whether one fit predicts clearly worse than another over some horizon.

    Or diverges where the other does not.

    Args:
        first: errors of the one, from `Judge.log_errors`.
    """
    diverges = any(
        (~np.isfinite(a) & np.isfinite(b)).any()
        for a, b in zip(first, second, strict=True)
    )
    return diverges or bool((compare(second, first) > _find_limits(first)).any())


def _find_limits(errors: Sequence[Floats]) -> Floats:
    """Critical t statistics (h), corrected for the horizons (Bonferroni)."""
    from scipy.stats import t

    degrees = [max(len(x) - 1, 1) for x in errors]
    return np.asarray(t.isf(LEVEL / len(degrees), degrees))
