"""Drifting clocks: takes pairs of columns, finds delays that grow all along the log.

Two clocks that run at different rates part by the same time each second, in every
episode. A delay that physics causes stays, or changes once.
"""

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...recording.data import Floats
from ..comparisons import Comparison
from ..context import Context
from ..fault import Fault, format_columns
from ..relations import SAME, center
from ..series import Series
from ..states import thin

MAX_ROWS = 2000  # that are compared; chosen: some milliseconds
# delays that are tried first: growth in the longest episode [s], and grid rows; chosen
FIRST_GROWTHS, FIRST_ROWS = np.linspace(-0.45, 0.45, 7), 3
STEPS = 6  # of Gauss and Newton; chosen: a delay is found in four
MIN_BLOCKS = 10  # of a second each, that are compared; chosen: three unknowns
# [s] by which a delay grows in the longest episode; chosen: a velocity is filtered
# alike all the time, and a servo's lag changes with its speed and its load
MIN_GROWTH = {"velocity": 0.03, "command": 0.1}
# share of joints whose delays grow alike, to within a factor; chosen: one that wears
# or warms up does so alone
ALIKE_SHARE, ALIKE = 0.6, 2.0
MAX_P_VALUE = 1e-6  # times the number of pairs; chosen: one log in a million
BASIS = (
    "t test of a delay's slope over time, with the errors of blocks of a second "
    "(sandwich estimator, White 1980), times the number of joints"
)


class _Growth(NamedTuple):
    """How the delay of a joint's column grows: its slope [s/s], and p of no slope."""

    slope: float
    p_value: float
    seconds: float  # length of the longest episode


def find(context: Context) -> Iterator[Fault]:
    """One fault where the delays of most joints' velocities or positions grow alike."""
    for comparison in context.comparisons.values():
        yield from _compare_growths(comparison, context)


def _compare_growths(comparison: Comparison, context: Context) -> Iterator[Fault]:
    what = comparison.what
    every = {name: _measure_growth(comparison, name) for name in comparison.first}
    known = {name: g for name, g in every.items() if g is not None}
    sure = {
        n: g
        for n, g in known.items()
        if abs(g.slope) * g.seconds > MIN_GROWTH[what]
        and g.p_value * len(known) < MAX_P_VALUE
    }
    if not sure:
        return
    slope = float(np.median([g.slope for g in sure.values()]))
    alike = [n for n, g in known.items() if 1 / ALIKE < g.slope / slope < ALIKE]
    if len(alike) < ALIKE_SHARE * len(known):
        return
    if what == "velocity":
        names, other = [context.joints[n].velocity for n in alike], "positions"
    else:
        names, other = [context.joints[n].position for n in alike], "commands"
    first, said = next(iter(sure)), format_columns(names)
    seen = (
        f"{said} come {abs(1e3 * slope):.3g} ms "
        f"{'later' if slope > 0 else 'earlier'} against their {other} each second: "
        f"{abs(slope) * sure[first].seconds:.2g} s in an episode"
    )
    p = max(min(g.p_value for g in sure.values()) * len(known), 1e-300)
    correction = f"[time.streams.NAME] of {said}: stretch = {1 - slope:.6g}"
    where = context.series.episodes, tuple(names), first
    yield Fault("clock_drift", *where, seen, p, BASIS, (correction,))


def _measure_growth(comparison: Comparison, joint: str) -> _Growth | None:
    """How the delay of a joint's second column grows; None: not known."""
    from scipy.stats import t as student

    series, lags = comparison.series, comparison.lags
    pair = _Pair(comparison.first[joint], comparison.second[joint], series)
    if len(np.unique(pair.block)) < MIN_BLOCKS:
        return None
    first = [
        (lag * series.step, growth / pair.seconds)
        for growth in FIRST_GROWTHS
        for lag in lags[::FIRST_ROWS]
    ]
    delay, slope = max(first, key=lambda f: pair.correlate(*f))
    for _ in range(STEPS):
        moved, _ = pair.linearize(delay, slope)
        delay, slope = delay + moved[0], slope + moved[1]
        if not abs(slope) * pair.seconds < 2 * FIRST_GROWTHS[-1]:
            return None
    if pair.correlate(delay, slope) < np.sqrt(SAME):
        return None
    error = pair.linearize(delay, slope)[1]
    free = len(np.unique(pair.block)) - 3
    p = 2 * float(student.sf(abs(slope) / max(error, 1e-12), free))
    return _Growth(float(slope), p, pair.seconds)


class _Pair:
    """Two columns of which the second comes late, without the means of episodes."""

    def __init__(self, x: Floats, y: Floats, series: Series) -> None:
        self.known = np.isfinite(x).astype(float)
        self.step, self.every = series.step, np.arange(len(x))
        self.x = np.nan_to_num(center(x, series.episode))
        self.rows = thin(np.flatnonzero(np.isfinite(y)), MAX_ROWS)
        self.y = center(y, series.episode)[self.rows]
        self.block, episode = series.block[self.rows], series.episode[self.rows]
        numbers = np.arange(len(series.ids))
        first = np.searchsorted(series.episode, numbers)
        last = np.searchsorted(series.episode, numbers, side="right") - 1
        self.first, self.last = first[episode], last[episode]
        # since the middle of the episode, and of the longest one [s]
        self.since = (self.rows - (self.first + self.last) / 2) * self.step
        longest = float((last - first).max(initial=0) * self.step)
        self.seconds = max(longest, self.step)

    @cached_property
    def rate(self) -> Floats:
        """Slope (N) of the first column."""
        return np.gradient(self.x) / self.step

    def read(self, delay: float, slope: float) -> tuple[Floats, Floats, np.ndarray]:
        """The first column (n) that much earlier, its rate, and where they are known.

        The delay is that at the middle of an episode [s], its slope in s/s.
        """
        at = self.rows - (delay + slope * self.since) / self.step
        known, x, rate = (
            np.interp(at, self.every, c) for c in (self.known, self.x, self.rate)
        )
        return x, rate, (at >= self.first) & (at <= self.last - 1) & (known > 1 - 1e-9)

    def correlate(self, delay: float, slope: float) -> float:
        """Correlation at a delay that grows; -1 where too little is known."""
        x, _, ok = self.read(delay, slope)
        if ok.sum() < len(self.rows) / 2:
            return -1.0
        size = float(np.sqrt((x[ok] @ x[ok]) * (self.y[ok] @ self.y[ok])))
        return float(x[ok] @ self.y[ok]) / size if size > 0 else -1.0

    def linearize(self, delay: float, slope: float) -> tuple[Floats, float]:
        """Steps (2) of delay and slope that fit better, and the slope's error."""
        x, rate, ok = self.read(delay, slope)
        design = np.stack([x, -rate, -rate * self.since], axis=1)[ok]
        y, block = self.y[ok], self.block[ok]
        inverse = np.linalg.pinv(design.T @ design)
        found = inverse @ design.T @ y
        rest = (y - design @ found)[:, None] * design
        sums = np.stack([np.bincount(block, c) for c in rest.T], axis=1)
        spread = inverse @ (sums.T @ sums) @ inverse
        gain = found[0] if abs(found[0]) > 1e-9 else np.inf
        return found[1:] / gain, float(np.sqrt(spread[2, 2])) / abs(gain)
