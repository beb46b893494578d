"""Apache Parquet and LeRobot's folders of it: takes paths, gives one stream."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ...errors import InputError
from ...limited_reading import explain_dangerous
from ..base import Log, LogFormat, Report, Rows, Stream
from .arrow import convert_array, find_width, is_list, is_readable, part_vectors
from .common import (
    MAX_COLUMNS,
    PIECE_VALUES,
    check_wanted,
    explain_damage,
    make_unique,
    name_elements,
    read_start,
)

_SAMPLE = 1_000  # rows that tell how long the vectors are; chosen
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
            return ParquetLog(path, [path])


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
            log = ParquetLog(path, files, _list_names(info.get("features")))
            (stream,) = log.streams
            columns, fps = stream.columns, info.get("fps")
            rate = fps if isinstance(fps, int | float) and 0 < fps < 1e9 else None
            log.streams = [Stream(
                name="",
                columns={name: "s" if name == "timestamp" else "" for name in columns},
                rows=stream.rows,
                time="timestamp" if "timestamp" in columns else "",
                period=1 / rate if rate else None,
                episode="episode_index" if "episode_index" in columns else "",
            )]  # fmt: skip
            robot = info.get("robot_type")
            log.robot = robot if isinstance(robot, str) else None
            return log


def _read_info(path: Path) -> dict[str, Any]:
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


def _list_names(features: Any) -> dict[str, Sequence[str]]:
    """Names of the elements of vectors, by the vectors' names."""
    found = dict[str, Sequence[str]]()
    for name, feature in features.items() if isinstance(features, dict) else ():
        names = feature.get("names") if isinstance(feature, dict) else None
        if isinstance(names, dict) and len(names) == 1:  # as {"motors": [...]}
            (names,) = names.values()
        if isinstance(names, list) and all(isinstance(n, str) for n in names):
            found[name] = names
    return found


class ParquetLog(Log):
    """Files of one table, one after the other.

    Attributes:
        path: of the file, or of the folder of several.
        streams: one.
    """

    def __init__(
        self,
        path: Path,
        files: Sequence[Path],
        names: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Open the files.

        Args:
            path: of the file or the folder.
            names: of the elements of vectors, by the vectors' names.

        Raises:
            InputError: the first file is damaged or has no columns that are read.
        """
        self.path, self._files = path, files
        reader = f"{__name__}:read_sample"
        if reason := explain_dangerous(files[0], reader, "pyarrow.parquet"):
            raise InputError(f"{path}: {reason}")
        import pyarrow as pa

        columns, places = list[str](), list[tuple[str, int | None]]()
        times, durations = list[str](), list[str]()
        for name, column in _list_columns(read_sample(files[0])):
            if is_list(column.type):
                width = find_width(column)
                columns += name_elements(name, (width,), (names or {}).get(name))
                places += [(name, element) for element in range(width)]
            elif is_readable(column.type):
                columns.append(name)
                places.append((name, None))
                times += [name] * pa.types.is_timestamp(column.type)
                durations += [name] * pa.types.is_temporal(column.type)
        if not 0 < len(columns) <= MAX_COLUMNS:
            raise InputError(f"{path}: {len(columns)} columns of numbers")
        columns = make_unique(columns)
        self._places = dict(zip(columns, places, strict=True))
        rows = sum(_open_file(file).metadata.num_rows for file in files)
        units = dict.fromkeys(columns, "") | dict.fromkeys(durations, "s")
        time = times[0] if len(times) == 1 else ""
        self.streams = [Stream("", units, rows, time)]

    def read(
        self, wanted: Mapping[str, Sequence[str]], report: Report | None = None
    ) -> Iterator[tuple[str, Rows]]:
        """Read columns, a batch of rows at a time."""
        check_wanted(self, wanted)
        columns = wanted.get("", ())
        step = min(65_536, max(1, PIECE_VALUES // max(1, len(columns))))
        done, total = 0, max(1, self.streams[0].rows or 0)
        with explain_damage(self.path, "Parquet file"):
            for file in self._files if columns else ():
                for batch in self._read_file(file, columns, step):
                    yield "", self._convert(batch, columns)
                    done += len(batch)
                    if report:
                        report(min(1.0, done / total))

    def _read_file(
        self, path: Path, columns: Sequence[str], step: int
    ) -> Iterator[Any]:
        """Batches of what holds some columns."""
        file = _open_file(path)
        needed = sorted({self._places[column][0] for column in columns})
        yield from file.iter_batches(batch_size=step, columns=needed)

    def _convert(self, batch: Any, columns: Sequence[str]) -> Rows:
        """Columns of a batch; those of a vector at once."""
        arrays = dict(_list_columns(batch))
        elements = dict[str, list[int]]()
        for name, element in (self._places[column] for column in columns):
            if element is not None:
                elements.setdefault(name, []).append(element)
        vectors = {
            name: dict(zip(wanted, part_vectors(arrays[name], wanted), strict=True))
            for name, wanted in elements.items()
        }
        rows = dict[str, Any]()
        for column in columns:
            name, element = self._places[column]
            if element is None:
                rows[column] = convert_array(arrays[name])
            else:
                rows[column] = vectors[name][element]
        return rows


def _open_file(path: Path) -> Any:
    from pyarrow import parquet

    return parquet.ParquetFile(path)


def read_sample(path: str | Path) -> Any:
    """The first rows of a file, as a RecordBatch without rows if it has none.

    Raises:
        OSError, pyarrow.ArrowException: it is damaged.
    """
    import pyarrow as pa

    file = _open_file(Path(path))
    paths = _list_paths(file.schema_arrow)  # without pictures, which are large
    for batch in file.iter_batches(batch_size=_SAMPLE, columns=paths):
        return batch
    return pa.RecordBatch.from_pylist([], file.schema_arrow)


def _list_paths(fields: Any, start: str = "") -> list[str]:
    """Paths of the numbers and texts in some fields of Arrow."""
    import pyarrow as pa

    found = list[str]()
    for field in fields:
        if pa.types.is_struct(field.type):
            found += _list_paths(field.type, f"{start}{field.name}.")
        elif is_list(field.type) or is_readable(field.type):
            found.append(start + field.name)
    return found


def _list_columns(batch: Any) -> list[tuple[str, Any]]:
    """Names and arrays of a RecordBatch; members of structures by their paths."""
    import pyarrow as pa

    found = list[tuple[str, Any]]()
    for name, array in zip(batch.schema.names, batch.columns, strict=True):
        if pa.types.is_struct(array.type):
            names = [f"{name}.{field.name}" for field in array.type]
            inner = pa.RecordBatch.from_arrays(array.flatten(), names)
            found += _list_columns(inner)
        else:
            found.append((name, array))
    return found
