"""A map put to a log and a model: rules in; the channels to be converted out."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, UnknownNameError
from ..recording import KINDS, NO_ACTUATORS, ModelNames
from ..recording.data import name_signal
from .base import Log, Stream
from .log_map import COMMAND, ColumnRule
from .units import find_unit, get_unit, list_units

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Channel:
    """Columns of one stream that become one signal, or one command.

    Attributes:
        kind: of the contract, or "command".
        target: name in the model; "" where the kind may lack one.
        unit: of the values in the recording; "" of a command whose unit is not known.
        stream: of the columns.
        columns: one, or each of a vector; none for a constant command.
        factor: (d) from a column's number to the recording's unit.
        offset: (d) [unit] added to that.
        delay: [s] by which the columns are late.
        missing: what stands for no reading where all of `beside` hold it; None where
            nothing does.
        beside: the columns of the rule.
        assumed: whether nothing states the unit of the columns: map, log or scale.
    """

    kind: str
    target: str
    unit: str
    stream: str
    columns: tuple[str, ...]
    factor: Floats
    offset: Floats
    delay: float = 0.0
    missing: float | None = None
    beside: tuple[str, ...] = ()
    assumed: bool = False

    def convert(self, values: Floats) -> Floats:
        """Columns (T, d) of the log in the recording's unit, (T, d)."""
        return values * self.factor + self.offset


def resolve_rules(
    rules: Sequence[ColumnRule], log: Log, names: ModelNames, file: str
) -> list[Channel]:
    """Find the columns and the targets that rules speak of.

    Args:
        file: name of the map, for messages.

    Returns:
        Channels in the order of the rules. No target has two of one kind.

    Raises:
        InputError: a name that the log or the model lacks, a unit or a number of
            columns that does not fit.
    """
    found, seen = list[Channel](), dict[tuple[str, str], str]()
    for number, rule in enumerate(rules):
        place = f"{file}: signals[{number}] ({rule.kind})"
        try:
            for channel in _resolve_rule(rule, log, names):
                key = channel.kind, channel.target
                if key in seen:
                    raise InputError(f"{channel.target!r} has columns already")
                seen[key] = place
                found.append(channel)
        except InputError as error:
            raise InputError(f"{place}: {error}") from error
    return found


def _resolve_rule(rule: ColumnRule, log: Log, names: ModelNames) -> Iterator[Channel]:
    if rule.kind not in KINDS and rule.kind != COMMAND:
        raise UnknownNameError("kind", rule.kind, (*KINDS, COMMAND))
    stream, columns, stars = _find_columns(rule.columns, log.streams)
    targets = list(rule.targets) or stars or [""]
    sort = "actuator" if rule.kind == COMMAND else KINDS[rule.kind].target
    known: Collection[str] = names.targets[sort]
    if rule.kind == COMMAND and not names.controls:
        raise InputError(f"the model has no actuators; {NO_ACTUATORS}")
    if rule.kind == COMMAND:
        known = names.commands
    for target in targets:
        may_lack = rule.kind != COMMAND and KINDS[rule.kind].may_lack_target
        if target not in known and not (may_lack and not target):
            raise UnknownNameError(f"{sort} of the model", target, known)
    if not columns and rule.kind != COMMAND:
        raise InputError("it has no columns; only a command can be a constant")
    widths = [max(1, _find_width(rule.kind, t, names)) for t in targets]
    if columns and sum(widths) != len(columns):
        raise InputError(
            f"{len(columns)} columns do not fit {len(targets)} targets, which need "
            f"{sum(widths)}"
        )
    spread = len(columns) or len(targets)
    signs = _spread("sign", rule.sign, spread)
    if not np.isin(signs, (-1, 1)).all():
        raise InputError("sign must be 1 or -1")
    factors = signs * _spread("scale", rule.scale, spread)
    offsets = _spread("offset", rule.offset, spread)
    start = 0
    for target, width in zip(targets, widths, strict=True):
        part = slice(start, start + width)
        start += width
        made = _make_channel(
            rule, target, names, stream, columns[part], factors[part], offsets[part]
        )
        yield replace(made, missing=rule.missing, beside=tuple(columns))


def _make_channel(
    rule: ColumnRule,
    target: str,
    names: ModelNames,
    stream: Stream | None,
    columns: list[str],
    factor: Floats,
    offset: Floats,
) -> Channel:
    """One channel of a rule; its units settled."""
    fits = _list_fitting_units(rule.kind, target, names)
    stated = rule.unit or _find_common_unit(stream, columns)
    unit, assumed = fits[0] if fits else stated, False
    if rule.from_range or rule.to_range:
        ends = rule.to_range or _find_range(rule.kind, target, names)
        factor, offset = _map_range(rule, ends, factor, offset)
    elif stated:
        known = get_unit(stated)
        if fits and known.si not in fits:
            raise InputError(
                f"unit {stated!r} does not fit {target!r}; would fit: "
                f"{', '.join(list_units(fits[0]))}"
            )
        unit = known.si
        offset = offset + factor * known.offset
        factor = factor * known.factor
    else:
        assumed = bool(columns) and rule.scale == 1
    if rule.kind == "body_orientation":
        columns = _order_quaternion(rule.order, columns)
    return Channel(
        rule.kind, target, unit, stream.name if stream else "", tuple(columns),
        factor, offset, rule.delay, assumed=assumed,
    )  # fmt: skip


def _find_columns(
    wanted: str | list[str], streams: Sequence[Stream]
) -> tuple[Stream | None, list[str], list[str]]:
    """The stream and the columns of a rule, and what stands for its star."""
    if wanted == []:
        return None, [], []
    texts = [wanted] if isinstance(wanted, str) else wanted
    found, stars, streams_found = list[str](), list[str](), dict[str, Stream]()
    for text in texts:
        stream, name = _find_stream(text, streams)
        streams_found[stream.name] = stream
        if "*" in name and name not in stream.columns:
            pattern = "(.+)".join(map(re.escape, name.split("*", 1)))
            matches = [m for c in stream.columns if (m := re.fullmatch(pattern, c))]
            if not matches:
                raise UnknownNameError("column", name, stream.columns)
            found += [match[0] for match in matches]
            stars += [match[1] for match in matches]
        elif name in stream.columns:
            found.append(name)
        else:
            raise UnknownNameError("column", name, stream.columns)
    if len(streams_found) > 1:
        raise InputError(
            f"its columns are of the streams {', '.join(streams_found)}; would fit: "
            "one rule for each"
        )
    return stream, found, stars if len(stars) == len(found) else []


def _find_stream(text: str, streams: Sequence[Stream]) -> tuple[Stream, str]:
    """The stream that a column's name names, and the rest of the name."""
    for stream in sorted(streams, key=lambda s: -len(s.name)):
        if stream.name and text.startswith(f"{stream.name}:"):
            return stream, text[len(stream.name) + 1 :]
    if len(streams) == 1:
        return streams[0], text
    holders = [stream for stream in streams if text in stream.columns]
    if len(holders) == 1:
        return holders[0], text
    if holders:
        raise InputError(
            f"column {text!r} is in the streams "
            f"{', '.join(s.name for s in holders)}; would fit: "
            f"{holders[0].name + ':' + text!r}"
        )
    raise UnknownNameError("stream", text.partition(":")[0], (s.name for s in streams))


def _find_width(kind: str, target: str, names: ModelNames) -> int:
    """Columns of a signal; 0 of a plain one."""
    if kind == COMMAND:
        return 0
    width = KINDS[kind].width
    return (names.targets["sensor"][target].width or 0) if width is None else width


def _list_fitting_units(kind: str, target: str, names: ModelNames) -> tuple[str, ...]:
    """SI units of a target's signal; empty where any may be."""
    if kind == COMMAND:
        return ()
    known = names.targets[KINDS[kind].target].get(target)
    unit = known.units.get(kind) if known else None
    return (unit,) if unit else KINDS[kind].units


def _find_common_unit(stream: Stream | None, columns: Sequence[str]) -> str:
    """The unit that a log states for columns; "" where it states none that is known."""
    units = {stream.columns[name] for name in columns} if stream else set()
    if len(units) > 1:
        raise InputError(f"its columns have the units {', '.join(sorted(units))}")
    stated = units.pop() if units else ""
    return stated if find_unit(stated) else ""


def _find_range(
    kind: str, target: str, names: ModelNames
) -> tuple[float, float] | None:
    """Limits of a target's joint in the model [rad or m]; None where it has none.

    Args:
        kind: of the signal, or "command".
    """
    if kind == COMMAND:
        kind, target = (
            "joint_torque", names.controls[names.commands.index(target)].actuator
        )  # fmt: skip
    known = names.targets[KINDS[kind].target].get(target)
    return known.range if known else None


def _map_range(
    rule: ColumnRule, ends: tuple[float, float] | None, factor: Floats, offset: Floats
) -> tuple[Floats, Floats]:
    """Factor (d) and offset (d) of a range of the log and one of the model.

    Args:
        rule: that states the range of the log.
        ends: of the range in the model [its unit].
        factor: (d) signs and scales.
        offset: (d) [the model's unit].
    """
    if not rule.from_range:
        raise InputError("to_range needs from_range")
    if ends is None:
        raise InputError(
            "from_range needs to_range, for the model states no range of it"
        )
    if rule.unit:
        raise InputError("from_range and to_range leave nothing to convert by a unit")
    (low, high), (bottom, top) = rule.from_range, ends
    if low == high:
        raise InputError("from_range must have two values that differ")
    slope = (top - bottom) / (high - low)
    return slope * factor, bottom - slope * low * factor + offset


def _order_quaternion(order: str, columns: list[str]) -> list[str]:
    """Columns of a quaternion in the order w x y z."""
    if order == "wxyz":
        return columns
    if order == "xyzw":
        return [columns[3], *columns[:3]]
    raise UnknownNameError("order", order, ("wxyz", "xyzw"))


def _spread(what: str, values: float | Sequence[float], count: int) -> Floats:
    """One number for each column, (count)."""
    array = np.atleast_1d(np.asarray(values, dtype=float))
    if array.size not in (1, count):
        raise InputError(f"{what} has {array.size} values for {count} columns")
    return np.broadcast_to(array, count).copy()


def check_commands(channels: Sequence[Channel], names: ModelNames, file: str) -> None:
    """Refuse a map that leaves an actuator without its command.

    Args:
        file: name of the map, for messages.

    Raises:
        InputError: names the actuators.
    """
    given = {c.target for c in channels if c.kind == COMMAND}
    if missing := [name for name in names.commands if name not in given]:
        raise InputError(
            f"{file}: no columns for the command of {', '.join(missing)}; would fit: "
            f'[[signals]] kind = "{COMMAND}", with columns, or with columns = [] and '
            "offset = the constant"
        )


def name_signals(channels: Sequence[Channel]) -> Mapping[int, str]:
    """Names of the signals of channels, by number; commands have none."""
    names = dict[str, int]()
    for number, channel in enumerate(channels):
        if channel.kind != COMMAND:
            names[name_signal(channel.kind, channel.target, names)] = number
    return {number: name for name, number in names.items()}
