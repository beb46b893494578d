"""Two columns that should be alike: takes them, says how they are related."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ..recording.data import Floats

MIN_ROWS = 40  # of a comparison; chosen: 0.4 s of motion, some periods of its noise
DEPENDENT_ROWS = 10.0  # from one independent row to the next; chosen: a tenth of a s
# squared correlation above which two columns are alike, and below which they do
# not; chosen: what is left between is not judged
SAME, DIFFERENT = 0.8, 0.4
# share of the unexplained that a corrected column may leave; chosen: half the error
FAR_BETTER = 0.25
# ratio of two columns beyond which one has another unit; chosen: diagnose grants a
# gain of 0.3 to 3
UNIT_RATIO = 3.5
# names of ratios: what was written over what the format has; exact by definition
UNITS = {
    "degrees": 180 / np.pi,
    "revolutions": 1 / (2 * np.pi),
    "revolutions per minute": 30 / np.pi,
    "thousandths": 1e3,
    "hundredths or percent": 1e2,
    "thousands": 1e-3,
    "radians where degrees were expected": np.pi / 180,
    **{
        f"counts of {n} a turn": n / (2 * np.pi)
        for n in (1000, 1024, 2048, 4096, 8192, 16384, 32768, 65536)
    },
}
# names of shares of a joint's range: what is written at its upper end; chosen: LeRobot
# writes grippers in percent, Robotiq and others as a byte
SHARES = {"percent of the range": 100.0, "bytes, 0 to 255 over the range": 255.0}
UNIT_TOLERANCE = 0.2  # of a ratio to one of `UNITS`; chosen: gains are that far off


Name = TypeVar("Name", str, int)


@dataclass(frozen=True)
class Relation:
    """How column y follows column x.

    Attributes:
        rows: that both have.
        lag: at which y follows x best [rows].
        r: correlation there [1].
        here: correlation at no lag [1].
        opposite: strongest correlation of the other sign, at any lag [1].
        ratio: standard deviation of y over that of x, with the sign of r [1].
    """

    rows: int
    lag: int = 0
    r: float = np.nan
    here: float = np.nan
    opposite: float = 0.0
    ratio: float = np.nan

    @property
    def is_known(self) -> bool:
        """Whether there was enough to compare."""
        return self.rows >= MIN_ROWS and np.isfinite(self.r)

    @property
    def is_same(self) -> bool:
        """Whether the columns are alike, but for sign and unit."""
        return self.is_known and self.r**2 > SAME

    @property
    def is_different(self) -> bool:
        """Whether the columns are different things."""
        return self.is_known and self.r**2 < DIFFERENT

    @property
    def is_flipped(self) -> bool:
        """Whether y follows the opposite of x, and x itself far worse."""
        left = (1 - self.r**2) / max(1 - self.opposite**2, 1e-12)
        return self.is_same and self.r < 0 and left < FAR_BETTER

    @property
    def has_other_unit(self) -> bool:
        """Whether y is a large multiple of x, or a small one."""
        return self.is_same and abs(np.log(abs(self.ratio))) > np.log(UNIT_RATIO)


def relate(x: Floats, y: Floats, episode: NDArray[np.int_], lags: range) -> Relation:
    """How y follows x, in the rows that both have.

    Args:
        x: (N), NaN where unknown.
        y: (N), the same.
        episode: (N) number of the episode of each row; means are taken in each.
        lags: in rows, by which y may come later.
    """
    both = np.isfinite(x) & np.isfinite(y)
    rows = int(both.sum())
    if rows < MIN_ROWS:
        return Relation(rows)
    x, y = center(x, episode), center(y, episode)
    found, nothing = {}, 1e-9
    for lag in lags:
        if len(x) - abs(lag) < MIN_ROWS:
            continue
        early = slice(max(-lag, 0), len(x) - max(lag, 0))
        late = slice(max(lag, 0), len(x) - max(-lag, 0))
        a, b = x[early], y[late]
        one = np.isfinite(a) & np.isfinite(b) & (episode[early] == episode[late])
        if one.sum() < max(MIN_ROWS, rows // 2):
            continue
        a, b = np.nan_to_num(a) * one, np.nan_to_num(b) * one
        size = np.sqrt((a @ a) * (b @ b))
        found[lag] = float(a @ b / size) if size > 0 else 0.0
    spread = measure_spread(x), measure_spread(y)
    if not found or min(spread) < nothing:
        return Relation(rows)
    lag = max(found, key=lambda k: (abs(found[k]), -abs(k)))
    r = found[lag]
    opposite = max((abs(v) for v in found.values() if v * r < 0), default=0.0)
    ratio = measure_spread(y[both]) / measure_spread(x[both]) * float(np.sign(r))
    return Relation(rows, lag, r, found.get(0, np.nan), opposite, ratio)


def find_exchanges(
    names: Sequence[Name], relate_two: Callable[[Name, Name], Relation]
) -> tuple[dict[Name, Relation], list[tuple[Name, Name, Relation]]]:
    """How each column follows what it should be, and pairs that follow each other's.

    `relate_two` says how the column of its second argument follows what that of the
    first should be; of a pair, its relation in this order is given.
    """
    own = {name: relate_two(name, name) for name in names}
    lost, found = [n for n, r in own.items() if r.is_different], []
    for one, other in combinations(lost, 2):
        across = relate_two(one, other), relate_two(other, one)
        if all(r.is_same and r.r > 0 for r in across):
            found.append((one, other, across[0]))
    return own, found


def measure_spread(x: Floats) -> float:
    """Standard deviation of what is known of a column (N) [unit]; 0 of nothing."""
    known = x[np.isfinite(x)]
    return float(np.std(known)) if known.size else 0.0


def center(x: Floats, episode: NDArray[np.int_]) -> Floats:
    """Values (N) without the mean of each episode."""
    known = np.isfinite(x)
    count = np.bincount(episode[known], minlength=episode.max(initial=0) + 1)
    total = np.bincount(episode[known], x[known], minlength=len(count))
    return x - (total / np.maximum(count, 1))[episode]


def name_unit(ratio: float, span: float = 0.0) -> str:
    """What a column is in, by its ratio to what it should be; "" where unknown.

    It may be a share of a joint's range of that span; 0 where it has none.
    """
    size, units = abs(ratio), list_units(span)
    near = min(units, key=lambda n: abs(np.log(size / units[n])))
    return near if abs(np.log(size / units[near])) < np.log(1 + UNIT_TOLERANCE) else ""


def list_units(span: float = 0.0) -> dict[str, float]:
    """Ratios by the names of units, shares of a joint's range of that span too."""
    shares = {n: full / span for n, full in SHARES.items()} if span > 0 else {}
    return {**UNITS, **shares}


def correlation_p_value(relation: Relation, independent: float) -> float:
    """Probability of such a correlation by chance (Fisher's z).

    Args:
        independent: rows from one independent reading to the next.
    """
    from scipy.stats import norm

    n = relation.rows / independent
    z = np.arctanh(min(abs(relation.r), 1 - 1e-12)) * np.sqrt(max(n - 3, 0.1))
    return float(2 * norm.sf(z))


def f_test(given: float, left: float, *counts: float) -> float:
    """Probability of such mean squares, of so many rows each, by chance (F test)."""
    from scipy.stats import f

    return float(f.sf(given / max(left, 1e-12), *counts))
