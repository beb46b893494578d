"""What two columns of a joint say of it: velocity and position, position and command.

A velocity is the derivative of its position, whatever the physics. A servo's joint
follows its command: late, weakly or with an offset, but not to the other side.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..recording.data import Floats
from .pairs import SAME, Relation, correlation_p_value, measure_spread, relate
from .series import Series

# [s] by which one column of a joint may come after the other in a log that is right;
# chosen: more than a filter or a bus, and as diagnose grants a command
MAX_VELOCITY_LAG, MAX_COMMAND_LAG = 0.12, 0.3
SEARCHED_LAG = 0.6  # [s] of all; chosen: twice that
# unexplained at no lag over that at the best, beyond which a column is late; chosen
LATE_RATIO = 2.5
# a joint that follows its command by less than this may be weak; chosen
WEAKEST_SERVO = 0.05
# standard deviations of a column over those of its steps, beyond which it moves;
# chosen: twenty, where noise that remembers twenty samples has five
MOVES = 20.0
# share of a column's spread over the whole log that it has in an episode that counts;
# chosen: what stands still says nothing
LIVELY = 0.3
# times as far off, a velocity that is no derivative, as in episodes where it is; chosen
FAR_OFF = 2.0
LATE_SAME = 0.85  # correlation over the whole log of what is late; chosen
INDEPENDENT_KERNELS = 4.0  # between independent rows; the width of a Gaussian's overlap


@dataclass(frozen=True)
class Disagreement:
    """Two columns of a joint that contradict each other.

    Attributes:
        kind: "sign", "unit", "exchange", "delay" or "derivative".
        joint: its name.
        partner: the other joint of an exchange; else "".
        episodes: ids in which it is so.
        relation: of the two columns there.
        p_value: of no such relation.
        lag: [s] by which the second comes late.
    """

    kind: str
    joint: str
    partner: str
    episodes: tuple[str, ...]
    relation: Relation
    p_value: float
    lag: float = 0.0


@dataclass(frozen=True)
class Comparison:
    """What is compared, and how.

    Attributes:
        first: (N) by joint: the derivative of the position, or what is commanded.
        second: (N) by joint: what should be the same.
        lags: (low, high) in rows that are searched.
        max_lag: in rows that physics may cause.
        weakest: ratio below which the second may be weak.
        moves: joints whose first column tells a motion.
    """

    first: Mapping[str, Floats]
    second: Mapping[str, Floats]
    lags: tuple[int, int]
    max_lag: int
    weakest: float
    moves: frozenset[str] = frozenset()

    def relate(
        self, one: str, other: str, series: Series, rows: np.ndarray
    ) -> Relation:
        """How the second column of `other` follows the first of `one`.

        Args:
            one: name of a joint.
            other: of the other one.
            series: with the episodes.
            rows: (n) those that are compared.
        """
        low, high = self.lags
        x = self.first[one]
        if not measure_spread(x[rows]) > LIVELY * measure_spread(x):
            return Relation(len(rows), 0, np.nan, np.nan, 0.0, np.nan)
        return relate(
            self.first[one][rows], self.second[other][rows], series.episode[rows],
            range(low, high + 1),
        )  # fmt: skip


def find_disagreements(comparison: Comparison, series: Series) -> list[Disagreement]:
    """The joints whose two columns contradict each other, and how."""
    found: dict[tuple[str, str, str], list[int]] = {}
    for rows, numbers in _list_parts(series):
        own = {j: comparison.relate(j, j, series, rows) for j in comparison.first}
        for joint, relation in own.items():
            for kind in _classify(relation, comparison):
                found.setdefault((kind, joint, ""), []).extend(numbers)
        lost = [j for j, r in own.items() if r.is_different]
        for key in _find_exchanges(lost, comparison, series, rows):
            found.setdefault(key, []).extend(numbers)
        exchanged = {j for k in found if k[0] == "exchange" for j in k[1:]}
        for joint in set(lost) - exchanged:
            if joint in comparison.moves:
                found.setdefault(("derivative", joint, ""), []).extend(numbers)
    rows, numbers = np.arange(len(series.episode)), list(range(len(series.ids)))
    whole = {j: comparison.relate(j, j, series, rows) for j in comparison.first}
    lost = [joint for joint, relation in whole.items() if relation.is_different]
    for key in _find_exchanges(lost, comparison, series, rows):
        found.setdefault(key, []).extend(numbers)
    for joint, relation in whole.items():
        if _is_late(relation, comparison):
            found["delay", joint, ""] = numbers
    # joints of an exchange may look flipped where both move alike
    exchanged = {j for k in found if k[0] == "exchange" for j in k[1:]}
    found = {
        k: n
        for k, n in found.items()
        if k[0] == "exchange"
        or (
            k[1] not in exchanged
            and not _is_as_far_off_elsewhere(k, n, comparison, series)
            and not _has_stopped(k, n, comparison, series)
        )
    }
    made = [_make(key, set(n), comparison, series) for key, n in found.items()]
    return [d for d in made if d is not None]


def _is_as_far_off_elsewhere(
    key: tuple[str, str, str],
    numbers: list[int],
    comparison: Comparison,
    series: Series,
) -> bool:
    """Whether a velocity is as far from the slope in the other episodes as in these.

    Slow noise then hides a small motion in these.

    Args:
        key: kind, joint and partner of a disagreement.
        numbers: of the episodes in which it was seen.
        comparison: of the columns.
        series: with the episodes.
    """
    if key[0] != "derivative":
        return False
    is_here = np.isin(series.episode, numbers)
    squares = (comparison.second[key[1]] - comparison.first[key[1]]) ** 2
    if not np.isfinite(squares[~is_here]).any():
        return False
    here, elsewhere = (np.nanmean(squares[rows]) for rows in (is_here, ~is_here))
    return bool(here < FAR_OFF**2 * elsewhere)


def _has_stopped(
    key: tuple[str, str, str],
    numbers: list[int],
    comparison: Comparison,
    series: Series,
) -> bool:
    """Whether a joint hardly moves that moved as it was told in an earlier episode.

    It jammed: no unit changes while a robot is recorded.

    Args:
        key: kind, joint and partner of a disagreement.
        numbers: of the episodes in which it was seen.
        comparison: of the columns.
        series: with the episodes.
    """
    joint, episode = key[1], series.episode

    def relate_in(chosen: list[int]) -> Relation:
        rows = np.flatnonzero(np.isin(episode, chosen))
        return comparison.relate(joint, joint, series, rows)

    if key[0] != "unit" or not abs(relate_in(numbers).ratio) < comparison.weakest:
        return False
    earlier = [abs(relate_in([i]).ratio) for i in range(min(numbers))]
    return any(ratio > comparison.weakest for ratio in earlier)


def _is_late(relation: Relation, comparison: Comparison) -> bool:
    """Whether the second column comes later than physics has it."""
    if not relation.is_known or relation.r < LATE_SAME:
        return False
    late = (1 - relation.here**2) / max(1 - relation.r**2, 1e-9) > LATE_RATIO
    return abs(relation.lag) > comparison.max_lag and late


def _list_parts(series: Series) -> list[tuple[np.ndarray, list[int]]]:
    """Rows of each episode that is long enough, or of all that are not."""
    every = [np.flatnonzero(series.episode == i) for i in range(len(series.ids))]
    long = [(rows, [i]) for i, rows in enumerate(every) if len(rows) > 100]
    short = [i for i, rows in enumerate(every) if len(rows) <= 100]
    if short:
        long.append((np.concatenate([every[i] for i in short]), short))
    return long


def _classify(relation: Relation, comparison: Comparison) -> list[str]:
    """Kinds of disagreement that one relation shows."""
    found = []
    if relation.is_flipped:
        found.append("sign")
    if relation.has_other_unit and (
        abs(relation.ratio) > 1 or abs(relation.ratio) < comparison.weakest
    ):
        found.append("unit")
    return found


def _find_exchanges(
    lost: Sequence[str], comparison: Comparison, series: Series, rows: np.ndarray
) -> list[tuple[str, str, str]]:
    """Pairs of joints of which each one's second column follows the other's first.

    Args:
        lost: joints whose columns do not fit each other.
        comparison: of the columns.
        series: with the episodes.
        rows: that are compared.
    """
    found = []
    for i, one in enumerate(lost):
        for other in lost[i + 1 :]:
            across = [
                comparison.relate(a, b, series, rows)
                for a, b in ((one, other), (other, one))
            ]
            if all(r.is_same and r.r > 0 for r in across):
                found.append(("exchange", one, other))
    return found


def _make(
    key: tuple[str, str, str], numbers: set[int], comparison: Comparison, series: Series
) -> Disagreement | None:
    """The disagreement over all episodes in which it was seen."""
    kind, joint, partner = key
    rows = np.flatnonzero(np.isin(series.episode, list(numbers)))
    relation = comparison.relate(joint, partner or joint, series, rows)
    if not relation.is_known:
        return None
    independent = INDEPENDENT_KERNELS * series.kernel / series.step
    p = correlation_p_value(relation.r, relation.rows, independent)
    if kind == "derivative":
        # Fisher's z of the correlation that the columns of a joint would have
        n = max(relation.rows / independent - 3, 0.1)
        from scipy.stats import norm

        z = np.arctanh(np.sqrt(SAME)) - np.arctanh(min(abs(relation.r), 0.999))
        p = float(norm.sf(z * np.sqrt(n)))
    ids = tuple(dict.fromkeys(series.ids[i] for i in sorted(numbers)))
    return Disagreement(
        kind, joint, partner, ids, relation, max(p, 1e-300), relation.lag * series.step
    )
