"""One unit of all joints: takes a recording, finds readings or commands in another.

Software writes all joints of a robot in one unit. So what many columns show together
is tested first, before the sign or the unit of one.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...logs.motion import compare_command, find_step, measure_share_inside
from ...recording.data import Floats
from ..context import Context
from ..fault import COUNTED, ColumnCorrection, Fault, correct_factor, format_columns
from ..joints import JointColumns, shares_unit
from .ranges import TOLERANCE, TOLERANCE_SHARE, TURN

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
Change = tuple[float, float]  # value = factor * value + offset


@dataclass(frozen=True)
class _Columns:
    """What is read and commanded of joints of one unit.

    Attributes:
        joints: that are read.
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
        return np.array([
            measure_share_inside(values[j.name] / factor, *j.range)
            for j in self.joints
            if j.range and j.name in values
        ])  # fmt: skip

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
            yield _correct_factor(context, columns, divisors, name, seen)
            columns = _gather(context, unit)
        if unit == "rad" and (found := _find_shares(columns)):
            yield _correct_shares(context, columns, *found)


def _gather(context: Context, unit: str) -> _Columns:
    """The columns of joints whose positions have a unit of the contract."""
    episodes = context.recording.episodes.values()
    every = {n for e in episodes for n, s in e.signals.items() if s.unit == unit}
    chosen = [j for j in context.joints.values() if j.position in every]

    def read(name: str) -> Floats:
        parts = [
            e.signals[name].values.reshape(e.time.size)
            if name in e.signals else np.full(e.time.size, np.nan)
            for e in episodes
        ]  # fmt: skip
        return np.concatenate(parts)

    time, end = [], 0.0
    for e in episodes:
        time.append(e.time - e.time[0] + end)
        end = float(time[-1][-1]) + 1.0
    return _Columns(
        chosen,
        {j.name: read(j.position) for j in chosen},
        {
            j.name: j.servo.scale * np.concatenate(
                [e.ctrl[:, e.ctrl_names.index(j.servo.command)] for e in episodes])
            for j in chosen if j.servo
        },
        np.concatenate(time),
    )  # fmt: skip


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
    context: Context, columns: _Columns, divisors: Mapping[str, float], name: str,
    seen: str,
) -> Fault:  # fmt: skip
    """The fault of a factor, by what was seen; the recording is then without it."""
    by = next(iter(divisors.values()))
    signals, commands = list[str](), list[str]()
    for j in columns.joints:
        if "read" in divisors:
            signals.append(j.position)
            signals += [j.velocity] * shares_unit(context.recording, j)
        if "command" in divisors and j.servo:
            commands.append(j.servo.command)
    unit = name if by > 1 else f"divided by that of {name}"
    change = 1 / by, 0.0
    return _correct(
        context, columns, dict.fromkeys(signals, change),
        dict.fromkeys(commands, change), partial(correct_factor, factor=1 / by),
        f"{unit} ({seen})",
    )  # fmt: skip


def _correct(
    context: Context, columns: _Columns, signals: Mapping[str, Change],
    commands: Mapping[str, Change], correct: Callable[..., ColumnCorrection],
    said: str, p_value: float = 0.0, basis: str = COUNTED,
) -> Fault:  # fmt: skip
    """The fault of the unit of some columns; the recording is then without it."""
    episodes, names = {}, [*signals, *commands]
    for key, e in context.recording.episodes.items():
        ctrl, changed = e.ctrl.copy(), dict(e.signals)
        for name, (factor, offset) in commands.items():
            column = e.ctrl_names.index(name)
            ctrl[:, column] = factor * ctrl[:, column] + offset
        for name, (factor, offset) in signals.items():
            if name in changed:
                values = factor * changed[name].values + offset
                changed[name] = replace(changed[name], values=values)
        episodes[key] = replace(e, ctrl=ctrl, signals=changed)
    context.recording = replace(context.recording, episodes=episodes)
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return Fault(
        "unit", context.episodes, tuple(names), columns.joints[0].name,
        f"{format_columns(names[:3])}{more}: the unit is {said}", p_value, basis,
        (*map(correct, signals), *(correct(n, is_command=True) for n in commands)),
    )  # fmt: skip


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
    beyond = [
        j.name for j in limited
        if j.range and _measure_beyond(read[j.name], j.range) > _get_slack(j.range)
    ]  # fmt: skip
    found = {j.span: step for j in limited
             if (step := find_step(np.rad2deg(read[j.name])))}  # fmt: skip
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


def _measure_beyond(values: Floats, limits: tuple[float, float]) -> float:
    """How far values go beyond limits [their unit]."""
    low, high = limits
    return float(max(np.nanmax(values - high), np.nanmax(low - values)))


def _get_slack(limits: tuple[float, float]) -> float:
    return max(TOLERANCE["rad"], TOLERANCE_SHARE * (limits[1] - limits[0]))


def _is_gripper(joint: JointColumns) -> bool:
    return any(word in joint.name.lower() for word in ("gripper", "jaw", "finger"))


def _correct_shares(
    context: Context, columns: _Columns, said: str, p_value: float
) -> Fault:
    """The fault of shares of ranges, by what shows it; the recording is then right."""
    signals, commands = dict[str, Change](), dict[str, Change]()
    for j in columns.joints:
        if not j.range or _is_gripper(j):
            continue
        factor = np.rad2deg(j.span / (2 * FULL))
        middle = sum(j.range) / 2
        signals[j.position] = factor, middle
        if shares_unit(context.recording, j):
            signals[j.velocity] = factor, 0.0
        if j.servo:
            commands[j.servo.command] = factor, middle / j.servo.scale
    ends = {"from_range": [-FULL, FULL]}
    return _correct(
        context, columns, signals, commands, partial(ColumnCorrection, changes=ends),
        "a share of each joint's range, from -100 to 100, as LeRobot writes it: no "
        f"joint passes 100 degrees, {said}",
        p_value, SHARE_BASIS,
    )  # fmt: skip
