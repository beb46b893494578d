"""`selfheal recording import`: what it prints of a guess and of what was done."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from selfheal.printable import join_names

from ._print import print_document, print_line

if TYPE_CHECKING:
    from selfheal.logs.guessing.guess import Guess
    from selfheal.logs.import_report import ImportReport
    from selfheal.logs.offsets import Offset


def print_guess_as_json(guess: "Guess", path: Path) -> None:
    """A guess, and the path of the map that holds it."""
    columns = list[dict[str, object]]()
    for line in guess.lines:
        width = len(line.columns) // len(line.targets)
        columns += [
            {
                "columns": line.columns[k * width : (k + 1) * width],
                "kind": line.kind,
                "target": target,
                "unit": line.units[k].unit,
                "sign": line.units[k].sign,
                "sure": round(line.sure[k], 3),
                "why": line.why[k],
            }
            for k, target in enumerate(line.targets)
        ]
    said = {name: getattr(guess, name) for name in ("unused", "missing", "remarks")}
    print_document("map-guess", map=str(path), columns=columns, **said)


def print_import(report: "ImportReport", path: Path) -> None:
    """What was written, and what of the log was not taken as it is."""
    seconds = sum(episode.seconds for episode in report.episodes)
    rows = sum(episode.rows for episode in report.episodes)
    count = len(report.episodes)
    print_line(
        f"{path}: {count} episode{'s' * (count > 1)}, {seconds:.1f} s, {rows} rows."
    )
    rates = dict[str, list[float]]()
    for episode in report.episodes:
        for stream, rate in episode.rates.items():
            rates.setdefault(stream, []).append(rate)
    for stream, found in rates.items():
        ends = dict.fromkeys((f"{min(found):.4g}", f"{max(found):.4g}"))
        print_line(f"{stream or 'the log'}: {' to '.join(ends)} Hz")
    for line in _list_remarks(report):
        print_line(line)


def _list_remarks(report: "ImportReport") -> Iterator[str]:
    """What was assumed, corrected and left out."""
    for unit, names in report.assumed.items():
        yield (
            f"assumed to be in {unit}, for neither map nor log states a unit: "
            f"{join_names(names)}"
        )
    yield from map(_describe_offset, report.offsets)
    if report.lag:
        ends = dict.fromkeys(f"{1000 * seconds:.0f}" for seconds in report.lag)
        yield (
            f"all positions follow their commands {' to '.join(ends)} ms later: the "
            "drives' delay and lag, or one shift between the two clocks, which this "
            "log cannot tell apart."
        )
    for log, losses in report.losses.items():
        yield f"{log} is damaged: {'; '.join(losses)}; that was left out."
    for count, said in (
        (report.sorted, "rows stood behind later ones and were sorted in."),
        (report.dropped, "rows had no time, or one that another row has; left out."),
        (report.before_command, "rows before the first command: left out."),
    ):
        if count:
            yield f"{count} {said}"
    yield from (f"look: {remark}" for remark in report.remarks)


def _describe_offset(offset: "Offset") -> str:
    """By how much a clock is off, and what would correct it."""
    late, low, high = (1000 * s for s in (offset.seconds, offset.low, offset.high))
    said = (
        f"{offset.stream}: its clock is {late:.1f} ms ({low:.1f} to {high:.1f}) late "
        f"against that of {offset.reference}"
    )
    if low <= 0 <= high:
        return f"{said}: as good as none."
    stream = json.dumps(offset.stream)
    return f"{said}; in the map: [time.streams.{stream}] offset = {-late / 1000:.4f}"
