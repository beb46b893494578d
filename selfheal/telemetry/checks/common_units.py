"""One unit of all joints: takes a recording, finds readings or commands in another.

Software writes all joints of a robot in one unit. So what many columns show together
is tested first, before the sign or the unit of one.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...logs.motion import compare_command, find_step, measure_share_inside
from ...recording.data import Floats
from ..context import Context
from ..fault import COUNTED, Changes, ColumnCorrection, Fault, format_columns, multiply
from ..joints import JointColumns, shares_unit
from .ranges import TURN, get_slack

# units of the contract: what is written instead, and times how much
OTHERS = {"rad": ("degrees", 180 / np.pi), "m": ("thousandths", 1e3)}
MIN_JOINTS, MOST = 2, 0.75  # joints of a group, and share of them that agree; chosen
FOLLOWS = 0.7  # correlation of a position with its command, that shows a ratio; chosen
GAIN = 3.0  # that a servo may be weak by; chosen: as of the check of one joint
# share of values within the joints' ranges, in a unit that is right and in a wrong one
INSIDE, OUTSIDE = 0.9, 0.6
FAR = 2 * TURN  # [rad or m] that no joint reaches; chosen
FULL, WHOLE = 100.0, 100.5  # a whole share of a range [%], and with rounding
SHARE_BASIS = (
    "one half for each joint that ends within 100 degrees by chance, times the F test "
    "of the steps of encoders in degrees and in shares"
)


class _Edit(NamedTuple):
    """A column that is right once it is multiplied and shifted."""

    name: str
    factor: float
    offset: float
    is_command: bool


@dataclass(frozen=True)
class _Columns:
    """What is read and commanded of joints of one unit.

    Attributes:
        read: (n) positions of each, of all episodes [rad or m].
        command: (n) to what each is commanded, where a servo is.
        time: (n) [s] in which the episodes follow each other.
    """

    joints: Sequence[JointColumns]
    read: Mapping[str, Floats]
    command: Mapping[str, Floats]
    time: Floats

    def fits(self, values: Mapping[str, Floats], factor: float) -> Floats:
        """Share (k) of each limited joint's values (n) within limits, over a factor."""
        inside = (
            measure_share_inside(values[j.name] / factor, *j.range)
            for j in self.joints
            if j.range and j.name in values
        )
        return np.array([*inside])

    def is_large(self, values: Mapping[str, Floats], factor: float) -> bool:
        """Whether most are within limits divided by a factor, and not as they are."""
        asis, divided = self.fits(values, 1.0), self.fits(values, factor)
        if not len(asis):
            return self.goes_far(values)
        is_large = (asis < OUTSIDE) & (divided > INSIDE)
        return bool(is_large.sum() >= MIN_JOINTS and is_large.mean() >= MOST)

    def goes_far(self, values: Mapping[str, Floats]) -> bool:
        """Whether values are larger than any of a joint, two turns or 12 m."""
        ends = [float(np.nanmax(np.abs(x), initial=0)) for x in values.values()]
        return max(ends) > FAR

    def measure_ratio(self) -> float | None:
        """By how much positions follow their commands, where most joints agree."""
        lines = [
            compare_command((self.time, u), (self.time, self.read[name]))
            for name, u in self.command.items()
        ]
        slopes = [abs(x.slope) for x in lines if abs(x.correlation) > FOLLOWS]
        if len(slopes) < MIN_JOINTS:
            return None
        usual = float(np.median(slopes))
        agree = np.abs(np.log(slopes) - np.log(usual)) < np.log(GAIN)
        return usual if agree.mean() >= MOST else None


def find(context: Context) -> Iterator[Fault]:
    """Columns of all joints that are in another unit.

    The recording of the context is then in the right one.
    """
    for unit, (name, factor) in OTHERS.items():
        columns = _gather(context, unit)
        if len(columns.joints) < MIN_JOINTS:
            continue
        divisors, seen = _find_divisors(columns, factor)
        if divisors:
            yield _correct_factor(context, columns, divisors, f"{name} ({seen})")
            columns = _gather(context, unit)
        if unit == "rad" and (found := _find_shares(columns)):
            yield _correct_shares(context, columns, *found)


def _gather(context: Context, unit: str) -> _Columns:
    """The columns of joints whose positions have a unit of the contract."""
    episodes = context.recording.episodes
    chosen = [j for j in context.joints.values() if j.position and j.unit == unit]
    unread = {k: (e.time, np.full(e.time.size, np.nan)) for k, e in episodes.items()}
    read, command, time = dict[str, Floats](), dict[str, Floats](), [-np.ones(1)]
    for e in episodes.values():
        time.append(e.time - e.time[0] + time[-1][-1] + 1.0)
    for j in chosen:
        parts = unread | context.read(j.position)
        read[j.name] = np.concatenate([values for _, values in parts.values()])
        if s := j.servo:
            sent = [e.ctrl[:, e.ctrl_names.index(s.command)] for e in episodes.values()]
            command[j.name] = s.scale * np.concatenate(sent)
    return _Columns(chosen, read, command, np.concatenate(time[1:]))


def _find_divisors(columns: _Columns, factor: float) -> tuple[dict[str, float], str]:
    """By what "read" and "command" are to be divided, and what was seen.

    Another unit is larger by a factor.
    """
    ratio, read, command = columns.measure_ratio(), columns.read, columns.command
    if ratio is None and command:
        return {}, ""
    step = 0 if ratio is None else round(np.log(ratio) / np.log(factor))
    if abs(step) > 1 or (ratio and abs(np.log(ratio / factor**step)) > np.log(GAIN)):
        return {}, ""
    is_read_large = columns.is_large(read, factor)
    asis = columns.fits(read, 1.0)
    found = dict[str, float]()
    if step > 0:
        found = {"read": factor} if is_read_large else {"command": 1 / factor}
    elif step < 0:
        is_large = columns.is_large(command, factor)
        found = {"command": factor} if is_large else {"read": 1 / factor}
    elif is_read_large and len(asis) and columns.goes_far(read):
        found = {"read": factor} | ({"command": factor} if command else {})
    seen = [f"positions follow their commands by {ratio:.3g}"] if step else []
    if len(asis):
        seen.append(f"{asis.mean():.0%} of the readings are within the joints' ranges")
    return found, ", ".join([*seen, f"so of all {len(columns.joints)} joints"])


def _correct_factor(
    context: Context, columns: _Columns, divisors: Mapping[str, float], said: str
) -> Fault:
    """The fault of a factor, by what was seen; the recording is then without it."""
    by = next(iter(divisors.values()))
    edits = list[_Edit]()
    for j in columns.joints:
        if "read" in divisors:
            edits.append(_Edit(j.position, 1 / by, 0.0, is_command=False))
            if shares_unit(context.recording, j):
                edits.append(_Edit(j.velocity, 1 / by, 0.0, is_command=False))
        if "command" in divisors and j.servo:
            edits.append(_Edit(j.servo.command, 1 / by, 0.0, is_command=True))
    said = said if by > 1 else f"divided by that of {said}"
    return _correct(context, columns, edits, multiply(1 / by), said, (0.0, COUNTED))


def _correct(
    context: Context,
    columns: _Columns,
    edits: list[_Edit],
    change: Changes,
    said: str,
    test: tuple[float, str],
) -> Fault:
    """The fault of the unit of some columns; the recording is then without it.

    Args:
        change: of each column's rule in a map.
        test: the p-value [1], and of which test.
    """
    episodes = {}
    for key, e in context.recording.episodes.items():
        ctrl, signals = e.ctrl.copy(), dict(e.signals)
        for name, factor, offset, is_command in edits:
            if is_command:
                column = e.ctrl_names.index(name)
                ctrl[:, column] = factor * ctrl[:, column] + offset
            elif name in signals:
                values = factor * signals[name].values + offset
                signals[name] = replace(signals[name], values=values)
        episodes[key] = replace(e, ctrl=ctrl, signals=signals)
    context.recording = replace(context.recording, episodes=episodes)
    edits = sorted(edits, key=lambda one: one.is_command)
    names = tuple(one.name for one in edits)
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    seen = f"{format_columns(names[:3])}{more}: the unit is {said}"
    rules = tuple(ColumnCorrection(one.name, change, one.is_command) for one in edits)
    target = columns.joints[0].name
    return Fault("unit", context.episodes, names, target, seen, *test, rules)


def _find_shares(columns: _Columns) -> tuple[str, float] | None:
    """What shows that hinges are in shares of their ranges, read as degrees; its p.

    LeRobot writes joints from -100 to 100. No joint then passes 100 degrees, joints of
    less pass their ranges, and encoders that are alike take unequal steps.
    """
    limited = [j for j in columns.joints if j.range and not _is_gripper(j)]
    read = {j.name: columns.read[j.name] for j in limited}
    ends = {n: float(np.nanmax(np.abs(x), initial=0)) for n, x in read.items()}
    most = np.rad2deg(max(ends.values(), default=0.0))
    if len(limited) < MIN_JOINTS or most > WHOLE:
        return None
    beyond = [j for j in limited if _measure_beyond(read[j.name], j) > get_slack(j)]
    every = [(j.span, find_step(np.rad2deg(read[j.name]))) for j in limited]
    found = {span: step for span, step in every if step}
    spans, steps = np.array([*found]), np.array([*found.values()])
    p = 0.5 ** len(limited)
    said = [f"{len(beyond)} of {len(limited)} joints pass their ranges"]
    if len(steps) > MIN_JOINTS:
        from scipy.stats import f

        unequal, alike = (float(np.var(np.log(x))) for x in (steps, steps * spans))
        p *= float(f.sf(unequal / max(alike, 1e-12), len(steps) - 1, len(steps) - 1))
        said.append(f"encoders step by {steps.min():.3g} to {steps.max():.3g} degrees")
        if unequal < 4 * alike:
            return None
    elif len(beyond) < MIN_JOINTS or most < FULL / 2:
        return None
    return " and ".join(said), p


def _measure_beyond(values: Floats, joint: JointColumns) -> float:
    """How far values (n) go beyond a joint's range [their unit]."""
    low, high = joint.range or (-np.inf, np.inf)
    return float(max(np.nanmax(values - high), np.nanmax(low - values)))


def _is_gripper(joint: JointColumns) -> bool:
    return any(word in joint.name.lower() for word in ("gripper", "jaw", "finger"))


def _correct_shares(
    context: Context, columns: _Columns, said: str, p_value: float
) -> Fault:
    """The fault of shares of ranges, by what shows it; the recording is then right."""
    edits = list[_Edit]()
    for j in columns.joints:
        if not j.range or _is_gripper(j):
            continue
        factor, middle = np.rad2deg(j.span / (2 * FULL)), sum(j.range) / 2
        edits.append(_Edit(j.position, factor, middle, is_command=False))
        if shares_unit(context.recording, j):
            edits.append(_Edit(j.velocity, factor, 0.0, is_command=False))
        if j.servo:
            zero = middle / j.servo.scale
            edits.append(_Edit(j.servo.command, factor, zero, is_command=True))
    said = (
        "a share of each joint's range, from -100 to 100, as LeRobot writes it: no "
        f"joint passes 100 degrees, {said}"
    )
    ends = Changes(from_range=(-FULL, FULL))
    return _correct(context, columns, edits, ends, said, (p_value, SHARE_BASIS))
