"""What two columns of a joint say of it: velocity and position, position and command.

A velocity is the derivative of its position, whatever the physics. A servo's joint
follows its command: late, weakly or with an offset, but not to the other side.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
EPISODIC = ("sign", "unit", "exchange", "derivative")  # kinds that one episode shows
SHORT_ROWS = 100  # of an episode that is judged with other such; chosen: a second


@dataclass(frozen=True)
class Disagreement:
    """Two columns of a joint that contradict each other.

    Attributes:
        what: "velocity" or "command": what was compared with the position.
        kind: "sign", "unit", "exchange", "delay" or "derivative".
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
    lag: float

    @property
    def is_late_servo(self) -> bool:
        """Whether a position follows its command too late."""
        return self.what == "command" and self.kind == "delay"


Key = tuple[str, str, str]  # kind, joint and partner of a disagreement


@dataclass(frozen=True)
class Comparison:
    """What is compared, and how.

    Attributes:
        what: "velocity" or "command": what is compared with the position.
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
        """How the second column of `other` follows the first of `one` in rows (n)."""
        x = self.first[one]
        if not measure_spread(x[rows]) > LIVELY * measure_spread(x):
            return Relation(len(rows))
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
        "velocity",
        series,
        {j.name: series.signals[j.position][:, 0, 1] for j in both},
        {j.name: series.signals[j.velocity][:, 0, 0] for j in both},
        range(-most, most + 1),
        series.count_rows(MAX_VELOCITY_LAG),
        1.0,
        frozenset(j.name for j in both if _moves(recording, j.position)),
    )


def compare_commands(joints: Mapping[str, JointColumns], series: Series) -> Comparison:
    """Positions against what position servos are sent."""
    led = [(j, j.servo) for j in joints.values() if j.position and j.servo]
    return Comparison(
        "command",
        series,
        {j.name: series.ctrl[s.command][:, 0] * s.scale for j, s in led},
        {j.name: series.signals[j.position][:, 0, 0] for j, _ in led},
        range(series.count_rows(SEARCHED_LAG) + 1),
        series.count_rows(MAX_COMMAND_LAG),
        WEAKEST_SERVO,
    )


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
    found, series = defaultdict[Key, list[int]](list), comparison.series
    parts = [(numbers, EPISODIC) for numbers in _group_episodes(series)]
    for numbers, kinds in (*parts, ([*range(len(series.ids))], ("exchange", "delay"))):
        for key in _compare_all(comparison, numbers):
            if key[0] in kinds:
                found[key] += numbers
    # joints of an exchange may look flipped where both move alike
    exchanged = {name for kind, *pair in found if kind == "exchange" for name in pair}
    made = (
        _make(key, set(numbers), comparison)
        for key, numbers in found.items()
        if key[0] == "exchange"
        or (key[1] not in exchanged and _is_sure(key, numbers, comparison))
    )
    return [d for d in made if d is not None]


def _group_episodes(series: Series) -> list[list[int]]:
    """Numbers of each episode that is long enough, or of all that are not."""
    rows = np.bincount(series.episode, minlength=len(series.ids))
    short = [i for i, count in enumerate(rows) if count <= SHORT_ROWS]
    long = [[i] for i, count in enumerate(rows) if count > SHORT_ROWS]
    return long + [short] * bool(short)


def _compare_all(comparison: Comparison, numbers: Sequence[int]) -> Iterator[Key]:
    """Disagreements of all joints in episodes of some numbers."""
    rows = comparison.series.select(numbers)
    own, pairs = find_exchanges(
        [*comparison.first], lambda one, other: comparison.relate(one, other, rows)
    )
    yield from (("exchange", one, other) for one, other, _ in pairs)
    for joint, relation in own.items():
        ratio = abs(relation.ratio)
        kinds = {
            "sign": relation.is_flipped,
            "unit": relation.has_other_unit
            and (ratio > 1 or ratio < comparison.weakest),
            "derivative": relation.is_different and joint in comparison.moves,
            "delay": _is_late(relation, comparison),
        }
        yield from ((kind, joint, "") for kind, is_so in kinds.items() if is_so)


def _is_late(relation: Relation, comparison: Comparison) -> bool:
    """Whether the second column comes later than physics has it."""
    if not relation.is_known or relation.r < LATE_SAME:
        return False
    late = (1 - relation.here**2) / max(1 - relation.r**2, 1e-9) > LATE_RATIO
    return abs(relation.lag) > comparison.max_lag and late


def _is_sure(key: Key, numbers: Sequence[int], comparison: Comparison) -> bool:
    """Whether neither noise nor a joint that jammed explains what is seen."""
    kind, joint, _ = key
    if kind == "derivative":
        # slow noise hides a motion if the velocity is as far from the slope elsewhere
        is_here = np.isin(comparison.series.episode, numbers)
        squares = (comparison.second[joint] - comparison.first[joint]) ** 2
        if not np.isfinite(squares[~is_here]).any():
            return True
        here, elsewhere = (np.nanmean(squares[rows]) for rows in (is_here, ~is_here))
        return bool(here >= FAR_OFF**2 * elsewhere)
    if kind == "unit":
        # it hardly moves, and moved as commanded earlier: no unit changes meanwhile
        least = comparison.weakest
        if abs(comparison.relate_own(joint, numbers).ratio) < least:
            earlier = (comparison.relate_own(joint, [i]) for i in range(min(numbers)))
            return not any(abs(relation.ratio) > least for relation in earlier)
    return True


def _make(key: Key, numbers: set[int], comparison: Comparison) -> Disagreement | None:
    """The disagreement over all episodes in which it was seen."""
    from scipy.stats import norm

    kind, joint, partner = key
    series = comparison.series
    relation = comparison.relate(joint, partner or joint, series.select(numbers))
    if not relation.is_known:
        return None
    independent = series.independent_seconds / series.step
    p = correlation_p_value(relation, independent)
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
