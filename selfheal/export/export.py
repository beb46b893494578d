"""Formats by name: a recording, and what a model predicts of it, in; a file out."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path

from ..errors import UnknownNameError
from ..files import atomic_path
from ..recording import Recording
from ..recording.table import build_table, find_unit
from .mcap import write_mcap
from .rerun import write_rrd

Writer = Callable[[Path, Recording, Recording | None], None]


def export_recording(
    recording: Recording,
    path: str | os.PathLike[str],
    *,
    to: str,
    predicted: Recording | None = None,
) -> None:
    """Write a recording for another program, whole or not at all.

    Args:
        to: a name of `FORMATS`.
        predicted: the same samples as a model predicts them, to stand beside.

    Raises:
        UnknownNameError: there is no such format.
        InputError: it needs a library that is not installed, or nothing can be written
            there.
    """
    if to not in FORMATS:
        raise UnknownNameError("format", to, FORMATS)
    with atomic_path(path) as temporary:
        FORMATS[to](temporary, recording, predicted)


def _write_csv(path: Path, recording: Recording, predicted: Recording | None) -> None:
    """A table as text, a column's unit in brackets behind its name."""
    from pyarrow import csv

    table = build_table(recording, predicted)
    names = [
        f"{field.name} [{unit}]" if (unit := find_unit(field)) else field.name
        for field in table.schema
    ]
    csv.write_csv(table.rename_columns(names), path)


def _write_parquet(
    path: Path, recording: Recording, predicted: Recording | None
) -> None:
    """A table whose fields have their units as metadata."""
    from pyarrow import parquet

    parquet.write_table(build_table(recording, predicted), path)


FORMATS: Mapping[str, Writer] = {
    "csv": _write_csv,
    "mcap": write_mcap,
    "parquet": _write_parquet,
    "rrd": write_rrd,
}
