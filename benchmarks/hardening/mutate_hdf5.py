"""Broken structure of HDF5: a file's content and a seed in; another content out."""

from collections.abc import Callable
from contextlib import suppress
from io import BytesIO
from typing import Any

import h5py
import numpy as np

from benchmarks.hardening.mutate_trees import ODD, Rng, choose, mutate_json

_HUGE = 2**40  # values that a dataset declares and does not hold
_MOST_VALUES = 10**6  # of a dataset that is changed
_POISON = (np.nan, np.inf, -np.inf, 1e307, -1e307, -1.0, 0.0, 1e12, 2.0**63)
_DTYPES = (
    *ODD["dtypes"],
    *([("x", "f8"), ("y", "i4")], h5py.string_dtype(), h5py.ref_dtype),
    *(h5py.vlen_dtype("f8"), h5py.enum_dtype({"a": 1, "b": 2})),
)
_NAMES = ("extra", "000", "time", "told", "é", "a" * 300)
_LINKS = (
    h5py.SoftLink("/"),
    h5py.SoftLink("/nowhere"),
    h5py.ExternalLink("other.h5", "/"),
    h5py.ExternalLink("/etc/passwd", "/"),
)
_MEMBERS = (1.0, np.zeros(3), "text", np.dtype("f8"), h5py.Empty("f8"), *_LINKS)
_ATTRIBUTES = (
    *(7, -1.5, np.nan, np.arange(3), "", "no such", 60_000 * "x", h5py.Empty("f8")),
    *(np.bytes_(b"\xff\xfe"), ["a", "b"], np.void(b"abc")),
    *("null", "[]", "{}", "[[", "1e999", np.zeros((2, 2)), True),
)
_TEXTS = (b"", b"null", b"[]", b"3", b'"text"', b"{")


def mutate_hdf5(content: bytes, seed: int) -> bytes:
    """Change the structure, the types or the values of a whole HDF5 file."""
    rng = np.random.default_rng(seed)
    buffer = BytesIO(content)
    with h5py.File(buffer, "r+") as file:
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            choose(_CHANGES, rng)(file, rng)
    return buffer.getvalue()


def _draw(file: h5py.File, rng: Rng, fits: Callable[[Any], bool]) -> Any:
    """A member that fits, at any depth; None where there is none."""
    names: list[str] = []
    file.visit(names.append)
    found = [x for n in sorted(names) if (x := file.get(n)) is not None and fits(x)]
    return choose(found, rng) if found else None


def _is_group(item: Any) -> bool:
    return isinstance(item, h5py.Group)


def _is_array(item: Any) -> bool:
    """Whether an item is a dataset whose values are there and not many."""
    return isinstance(item, h5py.Dataset) and not (
        item.is_virtual or item.external or (item.size or 0) > _MOST_VALUES
    )


def _is_text(item: Any) -> bool:
    return (
        _is_array(item)
        and item.shape is not None
        and bool(h5py.check_string_dtype(item.dtype))
    )


def _drop_member(file: h5py.File, rng: Rng) -> None:
    if (item := _draw(file, rng, lambda item: True)) is not None:
        del item.parent[item.name.rpartition("/")[2]]


def _add_member(file: h5py.File, rng: Rng) -> None:
    group = (_draw(file, rng, _is_group) if rng.random() < 0.8 else None) or file
    if (name := choose(_NAMES, rng)) not in group:
        group[name] = choose((*_MEMBERS, file["/"]), rng)


def _replace(file: h5py.File, rng: Rng) -> None:
    """Put something in a dataset's place, with its attributes where it takes them."""
    old = _draw(file, rng, _is_array)
    if old is None or old.shape is None:
        return
    parent, name, kept = old.parent, old.name.rpartition("/")[2], dict(old.attrs)
    values = np.asarray(old[()])
    del parent[name]
    choose(_SUBSTITUTES, rng)(parent, name, values, rng)
    if isinstance(made := parent.get(name), h5py.Dataset) or name in kept:
        made.attrs.update(kept)


def _reshape(parent: h5py.Group, name: str, values: Any, rng: Rng) -> None:
    flat = values.ravel()
    shapes = (values.T, flat, values[None], values[..., None], flat[:1], flat[:0])
    parent[name] = choose(shapes, rng)


def _cut_rows(parent: h5py.Group, name: str, values: Any, rng: Rng) -> None:
    twice = np.concatenate([np.atleast_1d(values)] * 2)
    parent[name] = twice[: int(rng.integers(len(twice) + 1))]


def _poison(parent: h5py.Group, name: str, values: Any, rng: Rng) -> None:
    poison: Any = choose(_POISON, rng)
    if values.dtype.kind in "iu":
        info = np.iinfo(values.dtype)
        poison = choose((info.min, info.max, -1 if info.min else 0, 99), rng)
    elif values.dtype.kind != "f":
        poison = values
    where = rng.random(values.shape) < rng.choice([0.02, 0.5, 1.0])
    with np.errstate(all="ignore"):
        parent[name] = np.where(where, poison, values).astype(values.dtype)


def _declare_huge(parent: h5py.Group, name: str, values: Any, rng: Rng) -> None:
    rows, width = int(choose((10**6, 10**8, _HUGE), rng)), values.shape[1:]
    if all(width):
        parent.create_dataset(
            name, (rows, *width), "f8", chunks=(64, *width), compression="gzip"
        )


def _store_elsewhere(parent: h5py.Group, name: str, values: Any, rng: Rng) -> None:
    if values.size and values.shape and rng.random() < 0.5:
        layout = h5py.VirtualLayout(values.shape, "f8")
        layout[...] = h5py.VirtualSource("other.h5", "x", values.shape)
        parent.create_virtual_dataset(name, layout)
    elif values.size and values.shape:
        other = [("other.bin", 0, h5py.h5f.UNLIMITED)]
        parent.create_dataset(name, values.shape, "f8", external=other)


def _set(parent: h5py.Group, name: str, values: Any, rng: Rng) -> None:
    """A group, a link, or an item of no values."""
    odd = choose((None, *_LINKS, h5py.Empty("f8"), parent.file["/"]), rng)
    if odd is None:
        parent.create_group(name)
    else:
        parent[name] = odd


_SUBSTITUTES: tuple[Callable[[h5py.Group, str, Any, Rng], None], ...] = (
    _set,
    _reshape,
    _cut_rows,
    _poison,
    _poison,
    _declare_huge,
    _store_elsewhere,
    lambda parent, name, values, rng: parent.create_dataset(
        name, values.shape, choose(_DTYPES, rng)
    ),
)


def _change_attribute(file: h5py.File, rng: Rng) -> None:
    """Change or drop an attribute; one that holds JSON by what it says, mostly."""
    item = (_draw(file, rng, lambda item: True) if rng.random() < 0.5 else None) or file
    if not (names := list(item.attrs)):
        return
    name = choose(names, rng)
    old = item.attrs[name]
    if isinstance(old, str) and old[:1] in ("{", "[") and rng.random() < 0.7:
        text = mutate_json(old.encode(), int(rng.integers(2**31))).decode()
        item.attrs[name] = text[:60_000]  # as long as an attribute may be
    elif rng.random() < 0.05:
        del item.attrs[name]
    else:
        item.attrs[name] = choose(_ATTRIBUTES, rng)


def _change_text(file: h5py.File, rng: Rng) -> None:
    """Change JSON that a dataset holds, or one row of such a dataset."""
    item = _draw(file, rng, _is_text)
    rows = np.atleast_1d([] if item is None else item[()]).astype(object).ravel()
    if not rows.size:
        _change_attribute(file, rng)
        return
    k, seed = int(rng.integers(rows.size)), int(rng.integers(2**31))
    is_json = rng.random() < 0.8
    rows[k] = mutate_json(rows[k], seed) if is_json else choose(_TEXTS, rng)
    with suppress(OSError):  # HDF5 does not convert every text to that of the dataset
        item[...] = rows.reshape(item.shape) if item.shape else rows[0]


_CHANGES = (
    _drop_member,
    _add_member,
    *5 * (_replace,),
    *2 * (_change_attribute,),
    *2 * (_change_text,),
)
