"""What two columns of a joint say of it: velocity and position, position and command.

A velocity is the derivative of its position, whatever the physics. A servo's joint
follows its command: late, weakly or with an offset, but not to the other side.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..recording import Recording
from ..recording.data import Floats
from .joints import JointColumns
from .relations import (
    SAME,
    Relation,
    correlation_p_value,
    find_exchanges,
    measure_spread,
    relate,
)
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
SHORT_ROWS = 100  # of an episode that is judged with other such; chosen: a second


@dataclass(frozen=True)
class Disagreement:
    """Two columns of a joint that contradict each other.

    Attributes:
        what: "velocity" or "command": what was compared with the position.
        kind: "sign", "unit", "exchange", "delay" or "derivative".
        joint: its name.
        partner: the other joint of an exchange; else "".
        episodes: ids in which it is so.
        relation: of the two columns there.
        p_value: of no such relation.
        lag: [s] by which the second comes late.
    """

    what: str
    kind: str
    joint: str
    partner: str
    episodes: tuple[str, ...]
    relation: Relation
    p_value: float
    lag: float = 0.0


Key = tuple[str, str, str]  # kind, joint and partner of a disagreement


@dataclass(frozen=True)
class Comparison:
    """What is compared, and how.

    Attributes:
        what: "velocity" or "command": what is compared with the position.
        series: of the recording.
        first: (N) by joint: the derivative of the position, or what is commanded.
        second: (N) by joint: what should be the same.
        lags: in rows that are searched.
        max_lag: in rows that physics may cause.
        weakest: ratio below which the second may be weak.
        moves: joints whose first column measures a motion.
    """

    what: str
    series: Series
    first: Mapping[str, Floats]
    second: Mapping[str, Floats]
    lags: range
    max_lag: int
    weakest: float
    moves: frozenset[str] = frozenset()

    def relate(self, one: str, other: str, rows: np.ndarray) -> Relation:
        """How the second column of `other` follows the first of `one`.

        Args:
            rows: (n) those that are compared.
        """
        x = self.first[one]
        if not measure_spread(x[rows]) > LIVELY * measure_spread(x):
            return Relation(len(rows), 0, np.nan, np.nan, 0.0, np.nan)
        episode = self.series.episode[rows]
        return relate(x[rows], self.second[other][rows], episode, self.lags)

    def relate_own(self, joint: str, numbers: Iterable[int]) -> Relation:
        """How both columns of a joint follow each other in episodes of some numbers."""
        return self.relate(joint, joint, self.series.select([*numbers]))


def compare_velocities(
    recording: Recording, joints: Mapping[str, JointColumns], series: Series
) -> Comparison:
    """Velocities against the derivatives of positions."""
    both = [j for j in joints.values() if j.position and j.velocity]
    most = series.count_rows(SEARCHED_LAG)
    return Comparison(
        "velocity", series,
        {j.name: series.signals[j.position][:, 0, 1] for j in both},
        {j.name: series.signals[j.velocity][:, 0, 0] for j in both},
        range(-most, most + 1), series.count_rows(MAX_VELOCITY_LAG), 1.0,
        frozenset(j.name for j in both if _moves(recording, j.position)),
    )  # fmt: skip


def compare_commands(joints: Mapping[str, JointColumns], series: Series) -> Comparison:
    """Positions against what position servos are sent."""
    led = [(j, j.servo) for j in joints.values() if j.position and j.servo]
    return Comparison(
        "command", series,
        {j.name: series.ctrl[s.command][:, 0] * s.scale for j, s in led},
        {j.name: series.signals[j.position][:, 0, 0] for j, _ in led},
        range(series.count_rows(SEARCHED_LAG) + 1), series.count_rows(MAX_COMMAND_LAG),
        WEAKEST_SERVO,
    )  # fmt: skip


def _moves(recording: Recording, signal: str) -> bool:
    """Whether a column measures a motion, and not noise alone, in most episodes."""
    moves = []
    for e in recording.episodes.values():
        if signal in e.signals:
            x = e.signals[signal].values
            x = x[np.isfinite(x)]
            if x.size > 2:
                moves.append(np.std(x) > MOVES * np.std(np.diff(x)) / np.sqrt(2))
    return bool(moves) and float(np.mean(moves)) > 0.5


def find_disagreements(comparison: Comparison) -> list[Disagreement]:
    """The joints whose two columns contradict each other, and how."""
    found: dict[Key, list[int]] = {}
    for numbers in _group_episodes(comparison.series):
        own, exchanges = _compare_all(comparison, numbers)
        for joint, relation in own.items():
            for kind in _classify(relation, comparison):
                found.setdefault((kind, joint, ""), []).extend(numbers)
        for key in exchanges:
            found.setdefault(key, []).extend(numbers)
        exchanged = _list_exchanged(found)
        for joint, relation in own.items():
            unlike = relation.is_different and joint not in exchanged
            if unlike and joint in comparison.moves:
                found.setdefault(("derivative", joint, ""), []).extend(numbers)
    numbers = list(range(len(comparison.series.ids)))
    whole, exchanges = _compare_all(comparison, numbers)
    for key in exchanges:
        found.setdefault(key, []).extend(numbers)
    for joint, relation in whole.items():
        if _is_late(relation, comparison):
            found["delay", joint, ""] = numbers
    # joints of an exchange may look flipped where both move alike
    exchanged = _list_exchanged(found)
    made = [
        _make(key, set(numbers), comparison)
        for key, numbers in found.items()
        if key[0] == "exchange"
        or not (
            key[1] in exchanged
            or (key[0] == "derivative" and _is_noisy(key[1], numbers, comparison))
            or (key[0] == "unit" and _has_stopped(key[1], numbers, comparison))
        )
    ]
    return [d for d in made if d is not None]


def _group_episodes(series: Series) -> list[list[int]]:
    """Numbers of each episode that is long enough, or of all that are not."""
    rows = np.bincount(series.episode, minlength=len(series.ids))
    short = [i for i, count in enumerate(rows) if count <= SHORT_ROWS]
    long = [[i] for i, count in enumerate(rows) if count > SHORT_ROWS]
    return long + [short] * bool(short)


def _compare_all(
    comparison: Comparison, numbers: Sequence[int]
) -> tuple[dict[str, Relation], list[Key]]:
    """The relations of each joint's columns in some episodes, and exchanges of two."""
    rows = comparison.series.select(numbers)
    own, pairs = find_exchanges(
        [*comparison.first], lambda one, other: comparison.relate(one, other, rows)
    )
    return own, [("exchange", one, other) for one, other, _ in pairs]


def _list_exchanged(found: Iterable[Key]) -> set[str]:
    return {joint for kind, *pair in found if kind == "exchange" for joint in pair}


def _classify(relation: Relation, comparison: Comparison) -> list[str]:
    """Kinds of disagreement that one relation shows."""
    found = ["sign"] if relation.is_flipped else []
    ratio = abs(relation.ratio)
    if relation.has_other_unit and (ratio > 1 or ratio < comparison.weakest):
        found.append("unit")
    return found


def _is_late(relation: Relation, comparison: Comparison) -> bool:
    """Whether the second column comes later than physics has it."""
    if not relation.is_known or relation.r < LATE_SAME:
        return False
    late = (1 - relation.here**2) / max(1 - relation.r**2, 1e-9) > LATE_RATIO
    return abs(relation.lag) > comparison.max_lag and late


def _is_noisy(joint: str, numbers: Sequence[int], comparison: Comparison) -> bool:
    """Whether a velocity is as far from the slope in the other episodes as in these.

    Slow noise then hides a small motion in these.
    """
    is_here = np.isin(comparison.series.episode, numbers)
    squares = (comparison.second[joint] - comparison.first[joint]) ** 2
    if not np.isfinite(squares[~is_here]).any():
        return False
    here, elsewhere = (np.nanmean(squares[rows]) for rows in (is_here, ~is_here))
    return bool(here < FAR_OFF**2 * elsewhere)


def _has_stopped(joint: str, numbers: Sequence[int], comparison: Comparison) -> bool:
    """Whether a joint hardly moves that moved as commanded in an earlier episode.

    It jammed: no unit changes while a robot is recorded.
    """
    if not abs(comparison.relate_own(joint, numbers).ratio) < comparison.weakest:
        return False
    earlier = (comparison.relate_own(joint, [i]) for i in range(min(numbers)))
    return any(abs(relation.ratio) > comparison.weakest for relation in earlier)


def _make(key: Key, numbers: set[int], comparison: Comparison) -> Disagreement | None:
    """The disagreement over all episodes in which it was seen."""
    from scipy.stats import norm

    kind, joint, partner = key
    series = comparison.series
    relation = comparison.relate(joint, partner or joint, series.select(numbers))
    if not relation.is_known:
        return None
    independent = series.independent_seconds / series.step
    p = correlation_p_value(relation.r, relation.rows, independent)
    if kind == "derivative":
        # Fisher's z of the correlation that the columns of a joint would have
        n = max(relation.rows / independent - 3, 0.1)
        z = np.arctanh(np.sqrt(SAME)) - np.arctanh(min(abs(relation.r), 0.999))
        p = float(norm.sf(z * np.sqrt(n)))
    ids = tuple(dict.fromkeys(series.ids[i] for i in sorted(numbers)))
    lag = relation.lag * series.step
    return Disagreement(
        comparison.what, kind, joint, partner, ids, relation, max(p, 1e-300), lag
    )
