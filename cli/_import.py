"""`selfheal recording import`: what it prints of a guess and of what was done."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from selfheal.logs.guessing.guess import Guess
    from selfheal.logs.import_report import ImportReport
    from selfheal.logs.offsets import Offset


def print_guess(guess: "Guess") -> None:
    """A table of the columns that were matched, and what to look at."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    from selfheal.logs.guessing.map_text import describe_unit

    console = Console()
    table = Table()
    for title in ("column", "kind", "of", "unit", "sure", "because of"):
        table.add_column(title, overflow="fold")
    for line in guess.lines:
        width = len(line.columns) // len(line.targets)
        for k, target in enumerate(line.targets):
            cells = (
                ", ".join(line.columns[k * width : (k + 1) * width]),
                line.kind,
                target,
                describe_unit(line.units[k]),
                f"{line.sure[k]:.0%}",
                line.why[k],
            )
            table.add_row(*map(Text, cells))
    console.print(table)
    for stream, (sure, why) in guess.time.notes.items():
        name = f"time of {stream}" if stream else "time"
        console.print(Text(f"{name}: {why} ({sure:.0%} sure)"), soft_wrap=True)
    if guess.unused:
        console.print(Text(f"not used: {', '.join(guess.unused)}"), soft_wrap=True)
    for remark in guess.remarks:
        console.print(Text(f"look: {remark}"), soft_wrap=True)


def summarize_guess(guess: "Guess", path: Path) -> dict[str, Any]:
    """A guess as JSON.

    Args:
        guess: what was proposed.
        path: of the map that holds it.
    """
    columns = []
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
    return {
        "format": "selfheal-map-guess",
        "version": 1,
        "map": str(path),
        "columns": columns,
        "unused": guess.unused,
        "missing": guess.missing,
        "remarks": guess.remarks,
    }


def print_import(report: "ImportReport", path: Path) -> None:
    """What was written, and what of the log was not taken as it is."""
    from rich.console import Console
    from rich.text import Text

    console = Console()

    def say(line: str) -> None:
        console.print(Text(line), soft_wrap=True)

    seconds = sum(episode.seconds for episode in report.episodes)
    rows = sum(episode.rows for episode in report.episodes)
    count = len(report.episodes)
    say(f"{path}: {count} episode{'s' * (count > 1)}, {seconds:.1f} s, {rows} rows.")
    rates = dict[str, list[float]]()
    for episode in report.episodes:
        for stream, rate in episode.rates.items():
            rates.setdefault(stream, []).append(rate)
    for stream, found in rates.items():
        ends = dict.fromkeys((f"{min(found):.4g}", f"{max(found):.4g}"))
        say(f"{stream or 'the log'}: {' to '.join(ends)} Hz")
    for unit, names in report.assumed.items():
        say(f"assumed to be in {unit}, for neither map nor log states a unit: "
            f"{', '.join(names)}")  # fmt: skip
    for offset in report.offsets:
        say(_describe_offset(offset))
    if report.lag:
        say(
            f"all positions follow their commands {1000 * report.lag[0]:.0f} to "
            f"{1000 * report.lag[1]:.0f} ms later: the drives' delay and lag, or one "
            "shift between the two clocks, which this log cannot tell apart."
        )
    if report.sorted:
        say(f"{report.sorted} rows stood behind later ones and were sorted in.")
    if report.dropped:
        say(f"{report.dropped} rows had no time, or one that another row has; they "
            "were left out.")  # fmt: skip
    if report.before_command:
        say(f"{report.before_command} rows before the first command were left out.")


def _describe_offset(offset: "Offset") -> str:
    """By how much a clock is off, and what would mend it."""
    late, low, high = (1000 * s for s in (offset.seconds, offset.low, offset.high))
    said = (
        f"{offset.stream}: its clock is {late:.1f} ms ({low:.1f} to {high:.1f}) late "
        f"against that of {offset.reference}"
    )
    if low <= 0 <= high:
        return f"{said}: as good as none."
    stream = json.dumps(offset.stream)
    return f"{said}; in the map: [time.streams.{stream}] offset = {-late / 1000:.4f}"


def summarize_import(report: "ImportReport", path: Path) -> dict[str, Any]:
    """An import as JSON.

    Args:
        report: of it.
        path: of the recording.
    """
    from dataclasses import asdict

    return {
        "format": "selfheal-import",
        "version": 1,
        "recording": str(path),
        **asdict(report),
    }
