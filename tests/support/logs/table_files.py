"""Tables as files of every format that holds some: columns in, a file out."""

import gzip
import json
from collections.abc import Callable, Mapping
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.io import savemat

from tests.support.logs.torch_files import Tensor, save_archive

Columns = Mapping[str, np.ndarray]  # (T) or (T, d)


def write_text(path: Path, text: str | bytes) -> Path:
    """A file of a text, which a name that ends in .gz has gzip pack."""
    content = text.encode() if isinstance(text, str) else text
    path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


def write_csv(path: Path, columns: Columns) -> Path:
    """A table as text, a column for each element of a vector."""
    cells = dict[str, list[object]]()
    for name, values in columns.items():
        if values.ndim == 1:
            cells[name] = values.tolist()
        else:
            cells |= {f"{name}[{k}]": v.tolist() for k, v in enumerate(values.T)}
    rows = [list(cells), *zip(*cells.values(), strict=True)]
    return write_text(path, "".join(",".join(map(str, row)) + "\n" for row in rows))


def write_json(path: Path, document: object) -> Path:
    """A document, or arrays by name; with a text, that one."""
    if isinstance(document, dict):
        arrays = {k: v for k, v in document.items() if isinstance(v, np.ndarray)}
        document = document | {name: array.tolist() for name, array in arrays.items()}
    text = document if isinstance(document, str) else json.dumps(document)
    return write_text(path, text)


def write_json_lines(path: Path, columns: Columns) -> Path:
    """An object for each row."""
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    lines = [json.dumps(dict(zip(columns, row, strict=True))) for row in rows]
    return write_text(path, "\n".join([*lines, ""]))


def write_hdf5(path: Path, columns: Columns) -> Path:
    """Datasets, by the paths that their names are."""
    with h5py.File(path, "w") as file:
        for name, array in columns.items():
            packed = "gzip" if np.shape(array) else None
            file.create_dataset(name, data=array, compression=packed)
    return path


def write_mat73(path: Path, columns: Columns) -> None:
    """As MATLAB writes version 7.3: HDF5 behind a block of text, axes turned."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array in columns.items():
            file[name] = np.atleast_2d(np.transpose(array))
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


def write_parquet(path: Path, columns: Mapping[str, object], **settings: int) -> Path:
    """Columns of pyarrow, or arrays."""
    cells = {
        k: [*v] if isinstance(v, np.ndarray) and v.ndim > 1 else v
        for k, v in columns.items()
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(cells), path, **settings)
    return path


def write_lerobot(
    folder: Path, info: Mapping[str, object], *episodes: Mapping[str, object]
) -> Path:
    """A LeRobot data set.

    Args:
        info: what its description states; v3 has all episodes in one file.
        episodes: columns of each.
    """
    (folder / "meta").mkdir(parents=True)
    (folder / "meta/info.json").write_text(json.dumps(info))
    names = [f"episode_{k:06d}" for k in range(len(episodes))]
    if str(info["codebase_version"]).startswith("v3"):
        table = pa.concat_tables(map(pa.table, episodes))
        columns = zip(table.column_names, table.columns, strict=True)
        names, episodes = ["file-000"], (dict(columns),)
    for name, episode in zip(names, episodes, strict=True):
        write_parquet(folder / f"data/chunk-000/{name}.parquet", episode)
    return folder


def _write_torch(path: Path, columns: Columns) -> None:
    save_archive(path, {name: Tensor(values) for name, values in columns.items()})


_WRITERS: Mapping[str, Callable[[Path, Columns], object]] = {
    "log.csv": write_csv,
    "log.csv.gz": write_csv,
    "log.json": write_json,
    "log.jsonl": write_json_lines,
    "log.npz": lambda path, columns: np.savez(path, **columns),
    "log.h5": write_hdf5,
    "log.mat": lambda path, columns: savemat(path, columns, do_compression=True),
    "new.mat": write_mat73,
    "log.parquet": write_parquet,
    "log.pt": _write_torch,
}
TABLES = tuple(_WRITERS)  # names of files, one of each format


def write_table(path: Path, columns: Columns) -> Path:
    """Columns as a file whose name is one of `TABLES`."""
    _WRITERS[path.name](path, columns)
    return path
