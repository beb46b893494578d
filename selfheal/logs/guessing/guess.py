"""A map proposed for a log: a log and a model in; lines, reasons and TOML out."""

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...printable import join_names
from ...recording import NO_ACTUATORS
from ..base import Log, Stream
from ..log_map import COMMAND, LogMap
from ..model_facts import Place, format_servo, group_places, list_places
from ..motion import (
    Relation,
    Sample,
    find_zero_rows,
    measure_share_inside,
    sample_log,
)
from ..units import get_unit
from .assignment import (
    Column,
    Match,
    assign_columns,
    group_scalars,
    group_vectors,
    list_columns,
    qualify,
)
from .clocks import TimeGuess, guess_times
from .content import find_kinds
from .conversions import Relations, guess_conversions
from .presets import apply_preset
from .unit_guesses import GuessedLine, GuessedTarget
from .vectors import match_vectors

if TYPE_CHECKING:
    import mujoco

# evidence of a perfect correlation, and of being within limits [nats]; chosen
_FOLLOWS, _INSIDE = 2.0, 1.0
_MOTION = ("joint_position", "joint_velocity", COMMAND)
_SCALARS = (*_MOTION, "joint_torque", "supply_voltage", "temperature")
_AS_COMMANDS = (
    "the log has no commands; the measured efforts are taken for the motors' commands: "
    "look whether they are torques, or currents"
)


@dataclass
class Guess:
    """A proposed map.

    Attributes:
        unused: columns that nothing was found for.
        missing: actuators that no command was found for.
        unread: joints that no position was found for.
    """

    time: TimeGuess
    streams: Sequence[Stream] = ()
    lines: list[GuessedLine] = field(default_factory=list)
    unused: list[str] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    unread: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)


def guess_map(log: Log, model: "mujoco.MjModel", preset: LogMap | None = None) -> Guess:
    """Propose which columns of a log are which signals of a model.

    Columns are matched by their names, their units and how they move. A speed is the
    derivative of its position, a position follows its command, and a reading is within
    the limits of its joint.

    Args:
        preset: what is known of the software that wrote the log.

    Raises:
        InputError: the log is damaged.
    """
    samples = sample_log(log)
    found = Guess(guess_times(log.streams, samples), log.streams)
    columns = list_columns(log.streams, samples, found.time.taken)
    places = list_places(model)
    by_kind = group_places(places)
    if preset is not None:
        columns = apply_preset(columns, preset)
    vectors = group_vectors(columns)
    several = len(log.streams) > 1
    inside = {id(c) for members in vectors.values() for c in members}
    scalars = [column for column in columns if id(column) not in inside]
    if all(kind not in _MOTION for kind, _, _ in group_scalars(scalars, places)):
        scalars = find_kinds(scalars, places)
    scalars, zeros = _leave_out_zeros(scalars, places)
    relations = Relations()
    matches = _match_scalars(scalars, places, by_kind, relations)
    matches, as_commands = _take_torques_as_commands(matches, by_kind)
    found.lines = [
        replace(line, missing=0.0 if zeros & {*line.columns} else None)
        for line in _make_scalar_lines(matches, several, relations)
    ]
    lines, notes = match_vectors(vectors, by_kind, several)
    found.lines += lines
    used = {name for line in found.lines for name in line.columns}
    found.unused = [name for c in columns if (name := qualify(c, several)) not in used]
    given = {m.place.name for m in matches if m.place.kind == COMMAND}
    found.missing = [p.name for p in by_kind.get(COMMAND, ()) if p.name not in given]
    read = {m.place.name for m in matches if m.place.kind == "joint_position"}
    joints = by_kind.get("joint_position", ())
    found.unread = [p.name for p in joints if p.name not in read]
    found.remarks = [*notes, *[_AS_COMMANDS] * as_commands]
    found.remarks += _list_remarks(found, matches, model, relations)
    found.remarks += _list_texts(found, samples)
    return found


def _list_texts(found: Guess, samples: Mapping[str, Sample]) -> list[str]:
    """A remark on columns of texts, where something of the model has no column."""
    texts = [
        name
        for stream, sample in samples.items()
        for name in sample.texts
        if f"{stream}:{name}" not in found.time.taken
    ]
    if not texts or not (found.missing or found.unread):
        return []
    return [f"columns that hold texts are not used: {join_names(texts)}"]


def _leave_out_zeros(
    columns: Sequence[Column], places: Sequence[Place]
) -> tuple[list[Column], set[str]]:
    """Columns without rows of zeros that no sensor has read, and who had some."""
    read = dict[int, Column]()
    for kind, _, members in group_scalars(columns, places):
        if kind != "joint_position" or len({c.values.size for c in members}) > 1:
            continue
        values = np.stack([c.values for c in members], axis=1)
        zeros = find_zero_rows(values)
        if np.isfinite(values[zeros]).any():
            values[zeros] = np.nan
            for column, own in zip(members, values.T, strict=True):
                read[id(column)] = replace(column, values=own)
    names = {name for c in read.values() for name in (qualify(c, True), c.name)}
    return [read.get(id(c), c) for c in columns], names


def _match_scalars(
    columns: Sequence[Column],
    places: Sequence[Place],
    by_kind: Mapping[str, Sequence[Place]],
    relations: Relations,
) -> list[Match]:
    """Whose each column of one number is, kind after kind."""
    groups = group_scalars(columns, places)
    found = list[Match]()
    for kind in _SCALARS:
        judge = partial(_judge_motion, _list_positions(found), relations)
        left = list(by_kind.get(kind, ()))
        for group_kind, ahead, members in groups:
            if group_kind != kind:
                continue
            got = (
                _assign_positions(members, left)
                if kind == "joint_position"
                else assign_columns(members, left, judge)
            )
            settled = min(1.0, 0.6 + ahead / 2)
            found += [Match(m.column, m.place, settled * m.sure, m.why) for m in got]
            taken = {m.place.name for m in got}
            left = [place for place in left if place.name not in taken]
    return found


def _list_positions(matches: Sequence[Match]) -> dict[int, Column]:
    """Columns of positions by their joints."""
    kind = "joint_position"
    return {m.place.joint: m.column for m in matches if m.place.kind == kind}


def _take_torques_as_commands(
    matches: list[Match], by_kind: Mapping[str, Sequence[Place]]
) -> tuple[list[Match], bool]:
    """Matches with torques as commands, where a log of torque motors has none.

    Returns:
        The matches, and whether torques became commands.
    """
    motors = {p.name: p for p in by_kind.get(COMMAND, ())}
    torques = {m.place.name for m in matches if m.place.kind == "joint_torque"}
    given = any(m.place.kind == COMMAND for m in matches)
    # servos are not commanded by torques
    if given or not motors or any(place.unit for place in motors.values()):
        return matches, False
    if torques != set(motors):
        return matches, False
    found = list[Match]()
    for match in matches:
        if match.place.kind == "joint_torque":
            place, why = (
                motors[match.place.name],
                f"{match.why}; the log has no commands",
            )
            found.append(Match(match.column, place, 0.5 * match.sure, why))
        else:
            found.append(match)
    return found, True


def _judge_motion(
    positions: Mapping[int, Column], relations: Relations, column: Column, place: Place
) -> tuple[float, str]:
    """Evidence of motion for a place [nats], and the reason."""
    position = positions.get(place.joint)
    if position is None or place.kind not in ("joint_velocity", COMMAND):
        return 0.0, ""
    found = abs(relations.find(column, position, place).correlation)
    return _FOLLOWS * found**2, "its motion" if found > 0.8 else ""


def _assign_positions(
    columns: Sequence[Column], places: Sequence[Place]
) -> list[Match]:
    """Give positions their joints, in the units in which most are within limits."""

    def judge(column: Column, place: Place) -> tuple[float, str]:
        if not np.isfinite(place.high - place.low):
            return 0.0, ""
        values = column.values * factors[place.unit]
        share = measure_share_inside(values, place.low, place.high)
        return _INSIDE * (2 * share - 1), ""

    best, most = list[Match](), -np.inf
    for angle, length in itertools.product(("rad", "deg"), ("m", "mm")):
        factors = {"rad": get_unit(angle).factor, "m": get_unit(length).factor}
        found = assign_columns(columns, places, judge)
        inside = sum(judge(match.column, match.place)[0] for match in found)
        if inside > most + 0.05:  # the first ones unless others fit better
            best, most = found, inside
    return best


def _make_scalar_lines(
    matches: Sequence[Match], several: bool, relations: Relations
) -> list[GuessedLine]:
    """Lines of a map: matches of one kind and one stream together."""
    units = guess_conversions(matches, relations)
    groups = dict[tuple[str, str], list[int]]()
    for k, match in enumerate(matches):
        groups.setdefault((match.place.kind, match.column.stream), []).append(k)
    lines = list[GuessedLine]()
    for (kind, _), members in groups.items():
        targets = list[GuessedTarget]()
        for k in members:
            match, unit = matches[k], units[k]
            names, why = [qualify(match.column, several)], f"{match.why}; {unit.why}"
            sure = match.sure * unit.sure
            targets.append(GuessedTarget(names, match.place.name, unit, sure, why))
        lines.append(GuessedLine(kind, targets))
    return lines


def _list_remarks(
    found: Guess,
    matches: Sequence[Match],
    model: "mujoco.MjModel",
    relations: Relations,
) -> Iterator[str]:
    """What a user should look at before he trusts the map.

    Args:
        matches: columns of one number and whose they are.
    """
    positions = _list_positions(matches)
    commands = [m for m in matches if m.place.kind == COMMAND]
    goals = [
        m.place.name
        for m in commands
        if m.place.unit not in ("rad", "m")
        and (position := positions.get(m.place.joint))
        and _is_goal(relations.find(m.column, position, m.place))
    ]
    if goals:
        yield (
            f"the commands of {join_names(goals)} are followed by the positions, but "
            "the model's actuators are no position servos: selfheal model prepare "
            "MODEL.xml --kp KP --kv KV makes servos of torque motors, and by hand it "
            f"is {format_servo(model, goals[0])} and so on, where KP and KV are the "
            "gains of the drive [N m/rad and N m s/rad; of a slide N/m and N s/m]"
        )
    if found.missing:
        yield (
            f"no command was found for {join_names(found.missing)}: without commands "
            "nothing can be diagnosed; a constant one is columns = [] and offset"
        )
    if not model.nactuator:
        yield f"the model has no actuators; {NO_ACTUATORS}"
    empty = [m.column.name for m in matches if not np.isfinite(m.column.values).any()]
    if empty:
        yield f"no number is in {join_names(empty)}"
    if found.unread:
        yield f"no position was found for {join_names(found.unread)}"
    kinds = Counter(
        line.kind for line in found.lines for t in line.targets if t.sure < 0.7
    )
    for kind, n in kinds.items():
        columns = f"{n} column{'s' * (n > 1)} of {kind}"
        yield f"{columns} less than 70 % sure: see LOOK above"


def _is_goal(relation: Relation) -> bool:
    """Whether a position follows a column as a servo follows its goal."""
    return relation.correlation > 0.9 and 0.5 < relation.slope < 2
