"""Apache Parquet and LeRobot's folders of it: takes paths, gives one stream."""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import InputError
from ...limited_reading import explain_dangerous
from ..base import Log, LogFormat
from .arrow import convert_array, convert_vectors, find_width, is_list, is_readable
from .common import PIECE_VALUES, explain_damage, read_start
from .tables import Blocks, Cell, Table, TableLog

if TYPE_CHECKING:
    import pyarrow as pa

_SAMPLE = 1_000  # rows in which the vectors' length is found; chosen
_INFO = "meta/info.json"
_MAX_INFO = 10_000_000  # bytes; chosen: a hundred times those of any data set


class ParquetFormat(LogFormat):
    """One file."""

    name = "Parquet"

    def recognizes(self, path: Path) -> bool:
        """Whether it begins as Parquet does."""
        return read_start(path).startswith(b"PAR1")

    def open(self, path: Path) -> Log:
        """Open a file."""
        with explain_damage(path, "Parquet file"):
            return TableLog(path, [_make_table(path, [path], {})], "Parquet file")


class LeRobotFormat(LogFormat):
    """Data sets of LeRobot, version 2 and 3: https://github.com/huggingface/lerobot."""

    name = "LeRobot data set (a folder)"

    def recognizes(self, path: Path) -> bool:
        """Whether it is a folder with LeRobot's description."""
        return path.is_dir() and (path / _INFO).is_file()

    def open(self, path: Path) -> Log:
        """Open a folder."""
        with explain_damage(path, "LeRobot data set"):
            info = _read_info(path / _INFO)
            files = sorted(path.glob("data/*/*.parquet"))
            if not files:
                raise InputError(f"{path}: no data/chunk-*/*.parquet in it")
            table = _make_table(path, files, _list_names(info.get("features")))
            fps, robot = info.get("fps"), info.get("robot_type")
            rate = fps if isinstance(fps, int | float) and 0 < fps < 1e9 else None
            table = replace(
                table,
                time="timestamp",
                period=1 / rate if rate else None,
                episode="episode_index" if "episode_index" in table.cells else "",
            )
            named = robot if isinstance(robot, str) else None
            return TableLog(path, [table], "LeRobot data set", named)


def _read_info(path: Path) -> dict[str, object]:
    """LeRobot's description of a data set."""
    if path.stat().st_size > _MAX_INFO:
        raise InputError(f"{path}: more than {_MAX_INFO} bytes")
    info = json.loads(path.read_bytes())
    if not isinstance(info, dict):
        raise InputError(f"{path}: no object")
    version = str(info.get("codebase_version", ""))
    if not version.startswith(("v2", "v3")):
        raise InputError(
            f"{path}: codebase_version {version[:20]!r}; would fit: 'v2.0' to 'v3.0'"
        )
    return info


def _list_names(features: object) -> dict[str, Sequence[str]]:
    """Names of the elements of vectors, by the vectors' names."""
    found = dict[str, Sequence[str]]()
    for name, feature in features.items() if isinstance(features, dict) else ():
        names = feature.get("names") if isinstance(feature, dict) else None
        if isinstance(names, dict) and len(names) == 1:  # as {"motors": [...]}
            (names,) = names.values()
        if isinstance(names, list) and all(isinstance(n, str) for n in names):
            found[name] = names
    return found


def _make_table(
    path: Path, files: Sequence[Path], names: Mapping[str, Sequence[str]]
) -> Table:
    """The table of files that follow each other.

    Args:
        names: of the elements of vectors, by the vectors' names.
    """
    reader = f"{__name__}:read_sample"
    if reason := explain_dangerous(files[0], reader, "pyarrow.parquet"):
        raise InputError(f"{path}: {reason}")
    import pyarrow as pa

    cells, times = dict[str, Cell](), list[str]()
    sample = read_sample(files[0])
    for name, column in zip(sample.column_names, sample.columns, strict=True):
        if not is_list(column.type):
            is_time = pa.types.is_temporal(column.type)
            cells[name] = Cell(unit="s" if is_time else "")
            times += [name] * pa.types.is_timestamp(column.type)
        elif width := find_width(column):
            cells[name] = Cell(width, names=names.get(name))
    rows = sum(_open_file(file).metadata.num_rows for file in files)
    read = partial(_read_files, files, rows)
    time = times[0] if len(times) == 1 else ""
    return Table(cells, read, rows=rows, time=time)


def _read_files(files: Sequence[Path], total: int, cells: Collection[str]) -> Blocks:
    """Batches of rows of files."""
    step, done = min(65_536, max(1, PIECE_VALUES // max(1, len(cells)))), 0
    for file in files:
        for batch in _open_file(file).iter_batches(step, columns=sorted(cells)):
            table = _flatten(batch)
            done += len(table)
            yield (
                done / total,
                {
                    name: convert_vectors(array)
                    if is_list(array.type)
                    else convert_array(array)
                    for name, array in ((n, table[n].combine_chunks()) for n in cells)
                },
            )


def _open_file(path: Path) -> "pa.parquet.ParquetFile":
    from pyarrow import parquet

    return parquet.ParquetFile(path)


def read_sample(path: str | Path) -> "pa.Table":
    """The first rows of what is read of a file, a table without rows if it has none.

    Raises:
        OSError, pyarrow.ArrowException: it is damaged.
    """
    file = _open_file(Path(path))
    schema = _flatten(file.schema_arrow.empty_table()).schema
    wanted = [f.name for f in schema if is_list(f.type) or is_readable(f.type)]
    for batch in file.iter_batches(_SAMPLE, columns=wanted):  # without pictures
        return _flatten(batch).select(wanted)
    return schema.empty_table().select(wanted)


def _flatten(rows: "pa.RecordBatch | pa.Table") -> "pa.Table":
    """A table in which members of structures are columns, named by their paths."""
    import pyarrow as pa

    table = rows if isinstance(rows, pa.Table) else pa.Table.from_batches([rows])
    while any(map(pa.types.is_struct, table.schema.types)):
        table = table.flatten()
    return table
