"""Broken structure of HDF5: a file's content and a seed in; another content out."""

import json
from collections.abc import Callable
from io import BytesIO
from typing import Any

import h5py
import numpy as np

from benchmarks.hardening.mutate_json import mutate_json

_HUGE = 2**40  # values that a dataset declares and does not hold
_MOST_VALUES = 10**6  # of a dataset that is changed
_POISON = (np.nan, np.inf, -np.inf, 1e307, -1e307, -1.0, 0.0, 1e12, 2.0**63)
_DTYPES = ("i1", "u8", "i8", "f2", "f4", ">f8", "c16", "?", "S8", "V5",
           [("x", "f8"), ("y", "i4")], h5py.string_dtype(), h5py.ref_dtype,
           h5py.vlen_dtype("f8"), h5py.enum_dtype({"a": 1, "b": 2}))  # fmt: skip


def mutate_hdf5(content: bytes, seed: int) -> bytes:
    """Change the structure, the types or the values of a whole HDF5 file."""
    rng = np.random.default_rng(seed)
    buffer = BytesIO(content)
    with h5py.File(buffer, "r+") as file:
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            _CHANGES[rng.integers(len(_CHANGES))](file, rng)
    return buffer.getvalue()


def _draw(file: h5py.File, rng: np.random.Generator, kind: Any = object) -> Any:
    """A member of a kind, at any depth; None where there is none."""
    names: list[str] = []
    file.visititems(lambda name, item: names.append(name))
    found = [x for n in sorted(names) if isinstance(x := file.get(n), kind)
             and _is_handy(x)]  # fmt: skip
    return found[rng.integers(len(found))] if found else None


def _is_handy(item: Any) -> bool:
    """Whether an item is no dataset, or one whose values are there and not many."""
    return not isinstance(item, h5py.Dataset) or not (
        item.is_virtual or item.external or (item.size or 0) > _MOST_VALUES
    )


def _put(old: Any, make: Callable[[h5py.Group, str], Any]) -> None:
    """Put something in a dataset's place, with its attributes where it takes them."""
    if old is None:
        return
    parent, name = old.parent, old.name.rpartition("/")[2]
    kept = dict(old.attrs.items())
    del parent[name]
    made = make(parent, name)
    if isinstance(made, h5py.Dataset | h5py.Group):
        made.attrs.update(kept)


def _drop_member(file: h5py.File, rng: np.random.Generator) -> None:
    if (item := _draw(file, rng)) is not None:
        del item.parent[item.name.rpartition("/")[2]]


def _add_member(file: h5py.File, rng: np.random.Generator) -> None:
    group = (_draw(file, rng, h5py.Group) if rng.random() < 0.8 else None) or file
    name = ("extra", "000", "time", "told", "é", "a" * 300)[rng.integers(6)]
    values = (1.0, np.zeros(3), "text", np.dtype("f8"), h5py.Empty("f8"),
              h5py.SoftLink("/"), h5py.SoftLink("/nowhere"),
              h5py.ExternalLink("other.h5", "/"), file["/"])  # fmt: skip
    if name not in group:
        group[name] = values[rng.integers(len(values))]


def _replace_by_group_or_link(file: h5py.File, rng: np.random.Generator) -> None:
    def make(parent: h5py.Group, name: str) -> Any:
        chance = rng.integers(4)
        if chance == 0:
            return parent.create_group(name)
        links = (h5py.SoftLink("/"), h5py.ExternalLink("/etc/passwd", "/"), file["/"])
        parent[name] = links[chance - 1]
        return None

    _put(_draw(file, rng), make)


def _change_dtype(file: h5py.File, rng: np.random.Generator) -> None:
    dtype: Any = _DTYPES[rng.integers(len(_DTYPES))]
    old = _draw(file, rng, h5py.Dataset)
    shape = () if old is None or old.shape is None else old.shape
    _put(old, lambda parent, name: parent.create_dataset(name, shape, dtype))


def _change_shape(file: h5py.File, rng: np.random.Generator) -> None:
    old = _draw(file, rng, h5py.Dataset)
    if old is None or old.shape is None:
        return
    values, chance = np.asarray(old[()]), rng.integers(7)
    changed: Any = (
        values.T, values.ravel(), values[None], values[..., None], values.ravel()[:1],
        values.ravel()[:0], h5py.Empty("f8"),
    )[chance]  # fmt: skip
    dtype = old.dtype
    _put(old, lambda parent, name: parent.create_dataset(name, data=changed)
         if chance == 6 else parent.create_dataset(name, data=changed, dtype=dtype)
         )  # fmt: skip


def _cut_rows(file: h5py.File, rng: np.random.Generator) -> None:
    old = _draw(file, rng, h5py.Dataset)
    if old is not None and old.shape:
        values = np.concatenate([old[()]] * 2)[: int(rng.integers(2 * len(old) + 1))]
        dtype = old.dtype
        _put(old, lambda parent, name: parent.create_dataset(
            name, data=values, dtype=dtype))  # fmt: skip


def _poison_values(file: h5py.File, rng: np.random.Generator) -> None:
    item = _draw(file, rng, h5py.Dataset)
    if item is None or item.shape is None or item.dtype.kind not in "fiu":
        return
    values, poison = np.array(item[()]), _POISON[rng.integers(len(_POISON))]
    if item.dtype.kind != "f":
        info = np.iinfo(item.dtype)
        poison = (info.min, info.max, -1 if info.min else 0, 99)[rng.integers(4)]
    where = rng.random(values.shape) < rng.choice([0.02, 0.5, 1.0])
    item[...] = np.where(where, poison, values).astype(item.dtype)


def _declare_huge(file: h5py.File, rng: np.random.Generator) -> None:
    old = _draw(file, rng, h5py.Dataset)
    width = () if old is None or old.shape is None else old.shape[1:]
    rows = int(rng.choice([10**6, 10**8, _HUGE]))
    _put(old, lambda parent, name: parent.create_dataset(
        name, (rows, *width), "f8", chunks=(64, *width), compression="gzip"
    ))  # fmt: skip


def _store_elsewhere(file: h5py.File, rng: np.random.Generator) -> None:
    old = _draw(file, rng, h5py.Dataset)
    if old is None or not old.shape or not all(old.shape):
        return
    shape = old.shape
    if rng.random() < 0.5:
        layout = h5py.VirtualLayout(shape, "f8")
        layout[...] = h5py.VirtualSource("other.h5", "x", shape)
        _put(old, lambda parent, name: parent.create_virtual_dataset(name, layout))
    else:
        _put(old, lambda parent, name: parent.create_dataset(
            name, shape, "f8", external=[("other.bin", 0, h5py.h5f.UNLIMITED)]
        ))  # fmt: skip


def _change_attribute(file: h5py.File, rng: np.random.Generator) -> None:
    item = (_draw(file, rng) if rng.random() < 0.5 else None) or file
    names = list(item.attrs)
    if not names:
        return
    name = names[rng.integers(len(names))]
    old = item.attrs[name]
    values: tuple[Any, ...] = (
        None, 7, -1.5, np.nan, np.arange(3), "", "no such", 60_000 * "x",
        h5py.Empty("f8"), np.bytes_(b"\xff\xfe"), ["a", "b"], np.void(b"abc"),
        "null", "[]", "{}", "[[", "1e999", np.zeros((2, 2)), True,
    )  # fmt: skip
    value = values[rng.integers(len(values))]
    if isinstance(old, str) and old[:1] in ("{", "[") and rng.random() < 0.7:
        value = _shorten(mutate_json(old.encode(), int(rng.integers(2**31))))
    if value is None:
        del item.attrs[name]
    else:
        item.attrs[name] = value


def _shorten(text: bytes) -> str:
    """A text as long as an attribute may be: 64 kB."""
    return text.decode()[:60_000]


def _change_text(file: h5py.File, rng: np.random.Generator) -> None:
    """Change JSON that a dataset holds, or one row of such a dataset."""
    found: list[h5py.Dataset] = []
    file.visititems(lambda name, item: found.append(item) if _is_text(item) else None)
    if not found:
        _change_attribute(file, rng)
        return
    item = found[rng.integers(len(found))]
    rows = np.atleast_1d(item[()]).astype(object).ravel()
    if not rows.size:
        return
    k, seed = int(rng.integers(rows.size)), int(rng.integers(2**31))
    whole: tuple[str, ...] = ("", "null", "[]", "3", json.dumps("text"), "{")
    rows[k] = (mutate_json(rows[k], seed) if rng.random() < 0.8
               else whole[rng.integers(6)].encode())  # fmt: skip
    try:
        item[...] = rows.reshape(item.shape) if item.shape else rows[0]
    except OSError:  # HDF5 does not convert every text to that of the dataset
        _change_attribute(file, rng)


def _is_text(item: Any) -> bool:
    return isinstance(item, h5py.Dataset) and _is_handy(item) and (
        h5py.check_string_dtype(item.dtype) is not None and item.shape is not None
    )  # fmt: skip


_CHANGES = (_drop_member, _add_member, _replace_by_group_or_link, _change_dtype,
            _change_shape, _cut_rows, _poison_values, _poison_values, _declare_huge,
            _store_elsewhere, _change_attribute, _change_attribute,
            _change_text, _change_text)  # fmt: skip
