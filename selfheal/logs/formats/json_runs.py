"""JSON and JSON lines: takes documents of runs, rows or arrays, gives streams."""

import json
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from itertools import islice
from pathlib import Path

from ...errors import InputError
from ..base import Log, LogFormat, Values
from .common import (
    CUT_LINE,
    MAX_COLUMNS,
    MAX_ELEMENTS,
    convert_cells,
    explain_damage,
    get_size,
    pad_rows,
    read_start,
)
from .run_groups import are_runs
from .tables import (
    Blocks,
    Cell,
    Run,
    Table,
    TableLog,
    group_arrays,
    make_length_tables,
    make_table,
)

_MAX_SIZE = 256_000_000  # bytes of a document; chosen: read it takes ten times as much
_MAX_DEPTH = 16  # of objects in objects; chosen
_MAX_CELLS = 1_000_000  # of rows of which most lack most columns; chosen
_MAX_LINE = 16_000_000  # bytes of one of JSON lines; chosen
_SAMPLE, _PIECE = 1_000, 4_096  # JSON lines: in which columns are found; of a piece
_LABELS = ("label", "name", "id", "episode", "run", "motion", "type", "trajectory")
_ROBOTS = ("robot", "robot_name", "robot_type")
_TIMES = ("t", "time", "timestamp", "stamp", "time_s")
_PERIODS = ("dt", "timestep", "time_step", "sample_time", "sampling_time")
_RATES = (
    r"hz|fps|sampl(e|ing)_(rate|frequency)|control_freq(uency)?|"
    r"(action|control|sample|sampling|rate|log|record|frequency|loop)_hz"
)


class JsonFormat(LogFormat):
    """JSON documents and JSON lines."""

    name = "JSON (runs, rows or arrays; also JSON lines)"

    def recognizes(self, path: Path) -> bool:
        """Whether it begins as JSON does."""
        start = read_start(path, 4096).removeprefix(b"\xef\xbb\xbf").lstrip()
        is_named = path.suffix.lower() in (".json", ".jsonl", ".ndjson")
        return (
            start[:1] == b"{"
            or (start[:1] == b"[" and b"\0" not in start)
            or (is_named and bool(start))
        )

    def open(self, path: Path) -> Log:
        """Open a document."""
        with explain_damage(path, "JSON log"):
            if _is_lines(path):
                return TableLog(path, [_make_lines_table(path)], "JSON log")
            if get_size(path) > _MAX_SIZE:
                raise InputError(
                    f"{path}: {get_size(path)} bytes of JSON; at most {_MAX_SIZE} are "
                    "read; would fit: JSON lines, an object for each row"
                )
            document = json.loads(path.read_bytes())
            period = find_period(document)
            tables = [replace(t, period=period) for t in find_tables(document)]
            return TableLog(path, tables, robot=_find_robot(document))


def _is_lines(path: Path) -> bool:
    """Whether the first line of a file is an object, and the second one begins."""
    with path.open("rb") as file:
        first, second = file.readline(_MAX_LINE), file.readline(64)
    if not first.lstrip().startswith(b"{"):
        return False
    is_named = path.suffix.lower() in (".jsonl", ".ndjson")
    return is_named or (first.rstrip().endswith(b"}") and second.startswith(b"{"))


def find_tables(document: object) -> list[Table]:
    """The tables of a document: runs, rows or arrays, at its top or in its members."""
    if objects := _take_objects(document):
        return [_make_table(objects, "")]
    if not isinstance(document, dict):
        return []
    lists = {name: found for name, v in document.items() if (found := _take_objects(v))}
    if lists:
        names = {name: name if len(lists) > 1 else "" for name in lists}
        return [_make_table(lists[name], named) for name, named in names.items()]
    if runs := _find_named_runs(document):
        return [make_table(runs)]
    return make_length_tables(_list_arrays(document))


def _take_objects(value: object) -> list[dict[str, object]]:
    """A list of objects alone; an empty one of anything else."""
    if not isinstance(value, list) or not all(isinstance(m, dict) for m in value):
        return []
    return value


def _make_table(objects: Sequence[dict[str, object]], name: str) -> Table:
    """A table of objects that are runs each, or rows each."""
    if not _are_runs(objects):
        arrays = make_columns(objects)
        # BAM (github.com/Rhoban/bam) writes it in seconds
        is_bam = {"timestamp", "position", "goal_position"} <= arrays.keys()
        return replace(
            make_table([Run(arrays)], name), time="timestamp" if is_bam else ""
        )
    runs = [
        replace(run, label=_find_label(one))
        for one in objects
        for run in group_arrays(_list_arrays(one))[:1]
    ]
    return make_table(runs, name)


def _are_runs(objects: Sequence[dict[str, object]]) -> bool:
    """Whether each object holds the arrays of a run, not the vectors of a row."""
    lengths = [
        max(
            (len(v) for v in o.values() if isinstance(v, list) and len(v) > 1),
            default=0,
        )
        for o in objects
    ]
    if not min(lengths):
        return False
    if any(not isinstance(o.get(name, []), list) for name in _TIMES for o in objects):
        return False
    nested = any(_take_objects(v) for o in objects for v in o.values())
    return nested or len(set(lengths)) > 1 or max(lengths) > len(objects)


def _find_named_runs(document: Mapping[str, object]) -> list[Run]:
    """Runs of a document whose members are objects with the same arrays."""
    runs = [
        replace(run, label=name)
        for name, member in document.items()
        if isinstance(member, dict)
        for run in group_arrays(_list_arrays(member))[:1]
    ]
    alike = {tuple(run.arrays) for run in runs}
    labels, lengths = [run.label for run in runs], [run.count() for run in runs]
    are_alike = len(runs) > 1 and len(alike) == 1
    return runs if are_alike and are_runs(labels, lengths) else []


def _list_arrays(
    value: Mapping[str, object], path: str = "", depth: int = 0
) -> dict[str, Values]:
    """Arrays in an object and the objects in it, by their paths."""
    found = dict[str, Values]()
    for name, member in value.items():
        if isinstance(member, dict) and depth < _MAX_DEPTH:
            found |= _list_arrays(member, f"{path}{name}.", depth + 1)
        elif objects := _take_objects(member):
            found |= {path + k: v for k, v in make_columns(objects).items()}
        elif isinstance(member, list) and member:
            array = _make_array(member)
            if array is not None:
                found[path + name] = array
    return found


def _make_array(values: list[object]) -> Values | None:
    """A list as an array (T) or (T, d); None where it is none."""
    if not any(isinstance(value, list | dict) for value in values):
        return convert_cells(values)
    rows = [value for value in values if isinstance(value, list)]
    width = max(map(len, rows), default=0)
    if len(rows) < len(values) or not 0 < width <= MAX_ELEMENTS:
        return None
    is_flat = all(isinstance(cell, int | float | None) for row in rows for cell in row)
    return pad_rows(rows) if is_flat else None


def make_columns(rows: Sequence[Mapping[str, object]]) -> dict[str, Values]:
    """Columns (T) of rows that are objects; those of objects in them by their paths.

    Raises:
        InputError: they are too many, or most rows lack most of them.
    """
    found, count = dict[str, dict[int, object]](), 0
    for number, row in enumerate(rows):
        for name, cell in flatten(row):
            found.setdefault(name, {})[number] = cell
            count += 1
        if len(found) > MAX_COLUMNS or len(found) * number > _MAX_CELLS + 20 * count:
            raise InputError("its objects have too many members, or too few alike")
    numbers = range(len(rows))
    return {
        name: convert_cells([cells.get(number) for number in numbers])
        for name, cells in found.items()
    }


def flatten(
    value: object, path: str = "", depth: int = 0
) -> Iterator[tuple[str, object]]:
    """Paths and values of the numbers and texts in an object.

    Args:
        depth: of it; what is deeper than any log is left out.
    """
    if depth > _MAX_DEPTH:
        return
    if isinstance(value, dict):
        for name, member in value.items():
            yield from flatten(member, f"{path}.{name}" if path else name, depth + 1)
    elif isinstance(value, list):
        for place, member in enumerate(value[:MAX_ELEMENTS]):
            yield from flatten(member, f"{path}[{place}]", depth + 1)
    else:
        yield path, read_time(value) if isinstance(value, str) else value


def read_time(text: str) -> str | float:
    """A time of day that ISO 8601 writes as time since 1970 UTC [s]; else the text."""
    if len(text) < 16 or text[4] != "-" or not text[:4].isdigit():
        return text
    try:
        found = datetime.fromisoformat(text)
    except ValueError:
        return text
    return (found if found.tzinfo else found.replace(tzinfo=UTC)).timestamp()


def _find_label(run: Mapping[str, object]) -> str:
    """What a run calls itself."""
    for name in _LABELS:
        if isinstance(found := run.get(name), str) and found:
            return found
    return ""


def _find_robot(document: object) -> str | None:
    members = document if isinstance(document, dict) else {}
    found = [members[name] for name in _ROBOTS if isinstance(members.get(name), str)]
    return found[0] if found else None


def find_period(document: object) -> float | None:
    """The time [s] from row to row that a document states, at its top or below."""
    if not isinstance(document, dict):
        return None
    objects = [document, *(v for v in document.values() if isinstance(v, dict))]
    found = set[float]()
    for name, value in (item for o in objects for item in o.items()):
        if isinstance(value, int | float) and 0 < value < 1e9:
            if name.lower() in _PERIODS:
                found.add(float(value))
            elif re.fullmatch(_RATES, name.lower()):
                found.add(1 / value)
    return found.pop() if len(found) == 1 else None


def _make_lines_table(path: Path) -> Table:
    """The table of JSON lines, with the columns of the first rows."""
    losses = list[str]()
    rows = [row for _, row in islice(_read_rows(path, losses), _SAMPLE)]
    cells = dict.fromkeys(make_columns(rows), Cell())
    return Table(cells, partial(_read_lines, path, losses), losses)


def _read_lines(path: Path, losses: list[str], cells: Collection[str]) -> Blocks:
    """Some lines at a time."""
    rows, size = _read_rows(path, losses), get_size(path)
    while piece := list(islice(rows, _PIECE)):
        flat = [dict(flatten(row)) for _, row in piece]
        block = {name: convert_cells([row.get(name) for row in flat]) for name in cells}
        yield piece[-1][0] / size, block


def _read_rows(
    path: Path, losses: list[str]
) -> Iterator[tuple[int, dict[str, object]]]:
    """Place of the end [B] and object of each line; says what is cut off."""
    losses.clear()
    with path.open("rb") as file:
        number, place = 0, 0
        while line := file.readline(_MAX_LINE):
            number, place = number + 1, place + len(line)
            if not line.strip():
                continue
            try:
                row = json.loads(line)
            except ValueError as error:
                if not line.endswith(b"\n") and number > 1:
                    losses.append(CUT_LINE)  # the logger was killed
                    return
                raise InputError(
                    f"{path}: line {number} is no JSON ({error})"
                ) from error
            if not isinstance(row, dict):
                raise InputError(f"{path}: line {number} is no object")
            yield place, row
