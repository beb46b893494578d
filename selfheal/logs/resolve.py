"""A map put to a log and a model: rules in; the channels to be converted out."""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError, UnknownNameError
from ..recording import KINDS, NO_ACTUATORS, ModelNames, Target
from ..recording.data import Kind, name_signal
from .base import Floats, Log, Stream
from .log_map import COMMAND, ColumnRule
from .units import find_unit, get_unit, list_units

_KINDS = {**KINDS, COMMAND: Kind("actuator", ())}


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
    """Find the columns and the targets of rules.

    Returns:
        Channels in the order of the rules. No target has two of one kind.

    Raises:
        InputError: a name that the log or the model lacks, a unit or a number of
            columns that does not fit.
    """
    found = dict[tuple[str, str], Channel]()
    for number, rule in enumerate(rules):
        place = f"{file}: signals[{number}] ({rule.kind})"
        try:
            for channel in _resolve_rule(rule, log, names):
                key = channel.kind, channel.target
                if key in found:
                    raise InputError(f"{channel.target!r} has columns already")
                found[key] = channel
        except InputError as error:
            raise InputError(f"{place}: {error}") from error
    return list(found.values())


def _resolve_rule(rule: ColumnRule, log: Log, names: ModelNames) -> Iterator[Channel]:
    """The channels of a rule, one for each target."""
    kind = _KINDS.get(rule.kind)
    if kind is None:
        raise UnknownNameError("kind", rule.kind, _KINDS)
    stream, columns, stars = _find_columns(rule.columns, log.streams)
    targets = list(rule.targets) or stars or [""]
    known: Collection[str] = names.targets[kind.target]
    if rule.kind == COMMAND:
        known = names.commands
        if not known:
            raise InputError(f"the model has no actuators; {NO_ACTUATORS}")
    for target in targets:
        if target not in known and not (kind.may_lack_target and not target):
            raise UnknownNameError(f"{kind.target} of the model", target, known)
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
    for target, width, end in zip(targets, widths, np.cumsum(widths), strict=True):
        part = slice(end - width, end)
        channel = Channel(
            kind=rule.kind,
            target=target,
            unit=rule.unit or _find_common_unit(stream, columns[part]),
            stream=stream.name if stream else "",
            columns=_order_columns(rule, columns[part]),
            factor=factors[part],
            offset=offsets[part],
            delay=rule.delay,
            missing=rule.missing,
            beside=tuple(columns),
        )
        yield _settle_unit(channel, rule, names)


def _settle_unit(channel: Channel, rule: ColumnRule, names: ModelNames) -> Channel:
    """A channel whose unit is as stated, in the recording's unit."""
    known = _find_target(channel.kind, channel.target, names)
    unit = known.units.get(channel.kind) if known else None
    fits = (unit,) if unit else _KINDS[channel.kind].units
    if rule.from_range or rule.to_range:
        ends = rule.to_range or (known.range if known else None)
        channel = replace(channel, unit=fits[0] if fits else channel.unit)
        return _map_range(channel, rule, ends)
    if channel.unit:
        stated = get_unit(channel.unit)
        if fits and stated.si not in fits:
            raise InputError(
                f"unit {channel.unit!r} does not fit {channel.target!r}; would fit: "
                f"{', '.join(list_units(fits[0]))}"
            )
        factor = channel.factor * stated.factor
        offset = channel.offset + channel.factor * stated.offset
        return replace(channel, unit=stated.si, factor=factor, offset=offset)
    assumed = bool(channel.columns) and rule.scale == 1
    return replace(channel, unit=fits[0] if fits else "", assumed=assumed)


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


def _find_target(kind: str, target: str, names: ModelNames) -> Target | None:
    """What the model says of a target; of a command, of its actuator."""
    if kind == COMMAND:
        target = names.controls[names.commands.index(target)].actuator
    return names.targets[_KINDS[kind].target].get(target)


def _find_width(kind: str, target: str, names: ModelNames) -> int:
    """Columns of a signal; 0 of a scalar one."""
    width = _KINDS[kind].width
    return (names.targets["sensor"][target].width or 0) if width is None else width


def _find_common_unit(stream: Stream | None, columns: Sequence[str]) -> str:
    """The unit that a log states for columns; "" where it states none that is known."""
    units = {stream.columns[name] for name in columns} if stream else set()
    if len(units) > 1:
        raise InputError(f"its columns have the units {', '.join(sorted(units))}")
    stated = units.pop() if units else ""
    return stated if find_unit(stated) else ""


def _map_range(
    channel: Channel, rule: ColumnRule, ends: tuple[float, float] | None
) -> Channel:
    """A channel whose columns are shares of a range, with the model's range.

    Args:
        ends: of the range in the model [its unit].
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
    offset = bottom - slope * low * channel.factor + channel.offset
    return replace(channel, factor=slope * channel.factor, offset=offset)


def _order_columns(rule: ColumnRule, columns: Sequence[str]) -> tuple[str, ...]:
    """Columns of a target, those of a quaternion in the order w x y z."""
    if rule.kind != "body_orientation" or rule.order == "wxyz":
        return tuple(columns)
    if rule.order == "xyzw":
        return (columns[3], *columns[:3])
    raise UnknownNameError("order", rule.order, ("wxyz", "xyzw"))


def _spread(what: str, values: float | Sequence[float], count: int) -> Floats:
    """One number for each column, (count)."""
    array = np.atleast_1d(np.asarray(values, dtype=float))
    if array.size not in (1, count):
        raise InputError(f"{what} has {array.size} values for {count} columns")
    return np.broadcast_to(array, count).copy()


def check_commands(channels: Sequence[Channel], names: ModelNames, file: str) -> None:
    """Refuse a map that leaves an actuator without its command.

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
