"""Logs to recordings: paths, a map and a model in; a file and a report out."""

import os
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError
from ..printable import join_names
from ..recording import (
    NO_ACTUATORS,
    Episode,
    ModelNames,
    list_model_names,
    open_writer,
)
from .base import Log, check_rows
from .converter import Converter, Report
from .import_report import ImportReport
from .log_map import COMMAND, LogMap
from .offsets import estimate_offsets, find_common_lag
from .resolve import Channel, check_commands, name_signals, resolve_rules
from .spool import open_spool

if TYPE_CHECKING:
    import mujoco

# bytes of logs from which a recording is not compressed; chosen: above, that would take
# longer than all else
_LARGE = 200_000_000
# of the time that an import takes, that of reading; the rest converts and compresses:
# chosen: reading and converting take about the same
READING_SHARE = 0.5


def import_logs(
    logs: Sequence[Log],
    log_map: LogMap,
    model: "mujoco.MjModel",
    path: str | os.PathLike[str],
    *,
    map_name: str = "map",
    report: Report | None = None,
) -> ImportReport:
    """Write the recording of logs.

    Args:
        logs: of one robot; each holds one or more episodes.
        model: compiled.
        report: called with the file that is read and the share of all, from 0 to 1.

    Returns:
        What was written, and what of the logs was not taken as it is.

    Raises:
        InputError: log, map and model do not fit together, or nothing can be written.
        RecordingError: a converted value breaks the contract.
    """
    made, names = ImportReport(), list_model_names(model)
    resolved = [_resolve_log(log, log_map, names, map_name) for log in logs]
    for channel in resolved[0]:
        if channel.assumed:
            unit = channel.unit or "the model's unit"
            what = f"{channel.kind} of {channel.target}"
            made.assumed.setdefault(unit, []).append(what)
    robot = next((log.robot for log in logs if log.robot), None)
    source = ", ".join(log.path.name for log in logs)
    sizes = [_measure_size(log.path) for log in logs]
    compression = "gzip" if sum(sizes) < _LARGE else None
    rows, read = 0, set[tuple[str, str]]()
    with open_writer(path, robot, source, compression=compression) as writer:
        for k, (log, channels) in enumerate(zip(logs, resolved, strict=True)):
            prefix = f"{log.path.stem}_" if len(logs) > 1 else ""
            with open_spool(Path(os.path.realpath(path)).parent) as spool:
                converter = Converter(log, log_map, channels, spool, prefix)
                converter.read_log(report and _scale_report(report, sizes, k))
                rows += max(spool.rows.values(), default=0)
                if log.losses:
                    made.losses[str(log.path)] = list(dict.fromkeys(log.losses))
                for episode_id, parts in converter.convert(made):
                    for part in parts:
                        writer.append(episode_id, part)
                        if not made.offsets:
                            _compare_clocks(part, channels, model, made)
                made.remarks += converter.remarks
                read |= {(channels[i].kind, channels[i].target) for i in converter.read}
        check_rows(logs[0].path, rows)
        if not made.episodes:
            raise InputError(
                f"{', '.join(str(log.path) for log in logs)}: no row is left to import"
            )
    made.remarks += _list_remarks(resolved, read, names)
    return made


def _resolve_log(
    log: Log, log_map: LogMap, names: ModelNames, map_name: str
) -> list[Channel]:
    """The channels of a log, its commands in the order of the model's actuators."""
    channels = resolve_rules(log_map.signals, log, names, map_name)
    check_commands(channels, names, map_name)
    order = {name: k for k, name in enumerate(names.commands)}
    return sorted(channels, key=lambda c: order[c.target] if c.kind == COMMAND else -1)


def _list_remarks(
    resolved: Sequence[Sequence[Channel]],
    read: Collection[tuple[str, str]],
    names: ModelNames,
) -> Iterator[str]:
    """What a user should look at: signals without a number, a model without actuators.

    Args:
        read: kind and target of those in which there was a number.
    """
    signals = [c for channels in resolved for c in channels if c.kind != COMMAND]
    empty = [c for c in signals if (c.kind, c.target) not in read]
    if columns := dict.fromkeys(repr(n) for c in empty for n in c.columns):
        yield f"no number was taken from {join_names(columns)}: an empty signal"
    if not names.controls:
        yield f"the model has no actuators, as if nothing drove it; {NO_ACTUATORS}"


def _scale_report(report: Report, sizes: Sequence[int], k: int) -> Report:
    """A report of what is read of one log, as a share of what is done with all.

    Args:
        sizes: of the logs [bytes].
    """
    over, whole = sum(sizes[:k]), max(sum(sizes), 1)
    return lambda file, share: report(
        file, (over + READING_SHARE * share * sizes[k]) / whole
    )


def _measure_size(path: Path) -> int:
    """Bytes of a file, or of all files in a folder."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _compare_clocks(
    part: Episode,
    channels: Sequence[Channel],
    model: "mujoco.MjModel",
    made: ImportReport,
) -> None:
    """Note how the clocks of streams differ, as far as a part of an episode shows."""
    streams = {n: channels[k].stream for k, n in name_signals(channels).items()}
    made.offsets = estimate_offsets(part, streams, model)
    sources = {c.target: c.stream for c in channels if c.kind == COMMAND and c.columns}
    made.lag = find_common_lag(part, streams, sources, model)
