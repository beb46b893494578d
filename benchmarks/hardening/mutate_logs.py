"""Broken logs: a file's content and a seed in; another content out."""

import gzip
import io
import warnings
import zipfile
from typing import Any

import numpy as np

from benchmarks.hardening.log_files import (
    ENCODERS,
    Columns,
    decode_mcap,
    encode_mcap,
    make_columns,
)
from benchmarks.hardening.mutate_bytes import mutate_bytes
from benchmarks.hardening.mutate_trees import (
    ODD,
    Mutate,
    Rng,
    choose,
    make_mutation,
    mutate_text,
)

_NUMBERS = (np.nan, np.inf, -np.inf, 1e308, -1e308, 0.0, -1.0, 1e300, 5e-324, 2.0**63)
_NAMES = ("", "t", "q_elbow", "é", "a/b", "a:b", "[0]", "a\nb", "\0", 5_000 * "n")
_TEXTS = ("", "x", "\0", "é", "2026-01-01T00:00:00", "1,5", 1000 * "long ")
_CODINGS = (*ODD["codings"], 9_000 * "x")
_TIMES = (0, 1, 2**63, 2**64 - 1)  # [ns]


def mutate_gzip(content: bytes, seed: int) -> bytes:
    """Change the text that gzip packed."""
    return gzip.compress(mutate_text(gzip.decompress(content), seed), mtime=0)


def _unzip(content: bytes) -> dict[str, bytes]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def _zip(tree: Any) -> bytes:
    buffer = io.BytesIO()
    with (
        warnings.catch_warnings(action="ignore"),  # of a name that is there already
        zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive,
    ):
        for name, inner in tree.items():
            archive.writestr(name or "a.npy", inner)
    return buffer.getvalue()


def _draw_odd_member(value: Any, rng: Rng) -> Any:
    """Damaged bytes, another time, or another name of a type or a coding."""
    if isinstance(value, bytes):
        damage = mutate_text if value.isascii() and rng.random() < 0.5 else mutate_bytes
        return damage(value, int(rng.integers(2**31)))
    return choose(_TIMES if isinstance(value, int) else _CODINGS, rng)


mutate_zip = make_mutation("mutate_zip", _unzip, _zip, _draw_odd_member)
mutate_mcap = make_mutation("mutate_mcap", decode_mcap, encode_mcap, _draw_odd_member)


def make_column_mutation(name: str) -> Mutate:
    """What changes the columns of a log before they are written as its format does."""

    def mutate_columns(content: bytes, seed: int) -> bytes:
        rng = np.random.default_rng(seed)
        columns = make_columns()
        for _ in range(rng.choice((1, 1, 2, 3))):
            columns = _change_column(columns, rng)
        return ENCODERS[name](columns)

    return mutate_columns


def _change_column(columns: Columns, rng: Rng) -> Columns:
    """Columns of which one has other values, another type, or another name."""
    name, kind = choose(list(columns), rng), rng.integers(9)
    column, rows = columns[name], len(columns[name])
    if kind == 0 and len(columns) > 1:
        return {n: c for n, c in columns.items() if n != name}
    if kind == 1:
        return {choose(_NAMES, rng) if n == name else n: c for n, c in columns.items()}
    if kind in (2, 3):
        order = (
            rng.permutation(rows) if kind == 3 else np.arange(rng.integers(rows + 1))
        )
        return {n: c[order] for n, c in columns.items()}
    if kind == 4:
        texts = np.array(_TEXTS, dtype=object)
        return {**columns, name: rng.choice(texts, rows)}
    numbers = np.zeros(rows) if column.dtype.kind == "O" else column
    if kind == 5:
        with np.errstate(all="ignore"):
            new = np.nan_to_num(numbers).astype(
                choose(("i1", "?", "f4", "f2", "i8", "c16"), rng)
            )
        return {**columns, name: new}
    where = rng.random(rows) < rng.choice([0.02, 0.5, 1.0])
    return {**columns, name: np.where(where, choose(_NUMBERS, rng), numbers)}
