"""What a file of ours may hold: members and JSON texts in, checked values out.

A run file may come from anywhere. Its size is checked from the headers before an array
is read, every array by an `ArraySchema`, every JSON text by a type. So what is read
fits what it is used for.
"""

import math
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field, TypeAdapter, ValidationError

from .documents import explain_misfit, load_json
from .errors import RunFileError
from .files import MAX_VALUES, count_values, open_run, walk_hdf5

if TYPE_CHECKING:
    import h5py

_LARGEST_NUMBER = 1e18  # also of an array; chosen: squares of its sums are finite
ROUNDING = 1e-6  # by which a sum of probabilities may be above 1


def _refuse_huge(value: float) -> float:
    """Refuse a whole number that no array holds; NaN and infinity may stand."""
    if abs(value) > _LARGEST_NUMBER and math.isfinite(value):
        raise ValueError(f"{value:g}; would fit: within {_LARGEST_NUMBER:g}")
    return value


# numbers of JSON texts
Probability = Annotated[float, Field(ge=0, le=1 + ROUNDING)]
Count = Annotated[int, Field(ge=0, lt=2**53)]
PositiveCount = Annotated[int, Field(ge=1, lt=2**53)]
Finite = Annotated[float, Field(ge=-_LARGEST_NUMBER, le=_LARGEST_NUMBER)]
Number = Annotated[float, AfterValidator(_refuse_huge)]  # or NaN, or infinite


@dataclass(frozen=True)
class ArraySchema:
    """What an array must be.

    Attributes:
        shape: length of each axis: a number; a name, which stands for one length, not
            0, wherever it stands; None for any length.
        kind: "float", "int" or "byte".
        low: smallest value.
        high: largest value.
        has_gaps: whether NaN and infinity may stand in it.
        is_tree: whether column i is the parent of part i + 1, 0 for the torso.
    """

    shape: tuple[int | str | None, ...] = ()
    kind: str = "float"
    low: float = -math.inf
    high: float = math.inf
    has_gaps: bool = False
    is_tree: bool = False

    def find_misfit(
        self, found: "np.ndarray | h5py.Dataset", sizes: dict[str, int]
    ) -> str:
        """What of an array, or of a dataset's header, does not fit; "" if all does.

        Args:
            found: (...) in any unit.
            sizes: length by name; names that stand here first are added.
        """
        kinds, widest = {"byte": ("u", 1), "int": ("iu", 8), "float": ("fiu", 8)}[
            self.kind
        ]
        if found.dtype.kind not in kinds or found.dtype.itemsize > widest:
            return f"of type {found.dtype}"
        if found.shape is None or len(found.shape) != len(self.shape):
            return f"of shape {found.shape}"
        for asked, length in zip(self.shape, found.shape, strict=True):
            known = asked
            if isinstance(asked, str):
                known = sizes.setdefault(asked, length)
                if not length:
                    return "empty"
            if known not in (None, length):
                return f"of shape {found.shape}"
        return ""

    def find_wrong_value(self, values: np.ndarray) -> str:
        """A value of an array that cannot stand there, in words; "" if there is none.

        Args:
            values: (...) whose type and shape fit.
        """
        if values.dtype.kind == "f":  # float16 overflows where it meets a large bound
            values = values.astype(float)
        if not self.has_gaps and not np.isfinite(values).all():
            return "not finite"
        high = values.shape[-1] if self.is_tree else self.high
        low = 0 if self.is_tree else self.low
        wrong = (values < low) | (values > high)
        wrong |= np.isfinite(values) & (np.abs(values) > _LARGEST_NUMBER)
        if wrong.any():
            return f"{values[wrong][0]:g} somewhere"
        if self.is_tree and not is_tree(values).all():
            return "a part that hangs on itself"
        return ""

    def convert(self, values: np.ndarray) -> np.ndarray:
        """Fitting values (...) as this program computes with them, (...)."""
        return values.astype({"byte": "u1", "int": "i8", "float": "f8"}[self.kind])

    def describe(self, sizes: Mapping[str, int]) -> str:
        """What would fit, in words."""
        words = {"byte": "bytes", "int": "whole numbers", "float": "numbers"}
        names = ["any" if k is None else str(k) for k in self.shape]
        axes = [f"{k} = {sizes[k]}" if k in sizes else k for k in names]
        said = (
            f"{words[self.kind]} of shape ({', '.join(axes)})" if axes else "a number"
        )
        said += "" if self.has_gaps else ", finite"
        if self.is_tree:
            return f"{said}, the parent of each part, 0 for the torso"
        if math.isfinite(self.low) or math.isfinite(self.high):
            said += f", from {self.low:g} to {self.high:g}"
        return said


def is_tree(parent: np.ndarray) -> np.ndarray:
    """(...) whether all parts (..., P) come to the torso, 0, by their parents."""
    at = whole = np.concatenate([np.zeros_like(parent[..., :1]), parent], axis=-1)
    for _ in range(parent.shape[-1]):
        at = np.take_along_axis(whole, at, axis=-1)
    return (at == 0).all(axis=-1)


@dataclass(frozen=True)
class Members:
    """The members of a group of an open file, each checked when it is read.

    Attributes:
        group: of the file.
        title: of every message: "PATH: a damaged run file".
        sizes: length by name, as `ArraySchema` has them; a group inside has a copy.
        place: name of the group in the file, with a slash; "" for the file itself.
    """

    group: "h5py.Group"
    title: str
    sizes: dict[str, int] = field(default_factory=dict)
    place: str = ""

    def make_error(self, member: str, found: str, fits: str = "") -> RunFileError:
        """The error of a member that does not fit.

        Args:
            fits: what it could be; "" says nothing of it.
        """
        end = fits and f"; would fit: {fits}"
        return RunFileError(f"{self.title}: {self.place}{member} is {found}{end}")

    def list_names(self) -> list[str]:
        """Names of the members, sorted."""
        return sorted(self.group)

    def open_group(self, name: str) -> "Members":
        """The members of a group inside."""
        import h5py

        found = self._find_member(name, "a group")
        if not isinstance(found, h5py.Group):
            raise self.make_error(name, "an array", "a group")
        place = f"{self.place}{name}/"
        return replace(self, group=found, sizes=dict(self.sizes), place=place)

    def read(self, name: str, kind: Any) -> Any:
        """A dataset.

        Args:
            kind: an `ArraySchema`; `str` for a text; else the type of a JSON text.

        Raises:
            RunFileError: it is missing or something else.
        """
        import h5py

        is_array = isinstance(kind, ArraySchema)
        fits = kind.describe(self.sizes) if is_array else "a text"
        found = self._find_member(name, fits)
        if not isinstance(found, h5py.Dataset):
            raise self.make_error(name, "a group", fits)
        if is_array:
            return self._read_array(name, kind, found)
        if h5py.check_string_dtype(found.dtype) is None or found.shape != ():
            raise self.make_error(name, _describe_header(found), fits)
        text = found.asstr()[()]
        return text if kind is str else self.parse(name, text, kind)

    def read_table(self, table: Mapping[str, object]) -> dict[str, Any]:
        """Datasets by name, each of its kind; see `read`."""
        return {name: self.read(name, kind) for name, kind in table.items()}

    def read_texts(self, name: str) -> list[str]:
        """A dataset (N) of texts."""
        import h5py

        found = self._find_member(name, "texts")
        if not isinstance(found, h5py.Dataset):
            raise self.make_error(name, "a group", "texts")
        shape = found.shape
        if h5py.check_string_dtype(found.dtype) is None or len(shape or ()) != 1:
            raise self.make_error(name, _describe_header(found), "texts, one a row")
        return list(found.asstr()[()])

    def read_attribute(self, name: str) -> str:
        """An attribute of the group that is a text."""
        import h5py

        if name not in self.group.attrs:
            raise self.make_error(f"attribute {name}", "missing", "a text")
        header = self.group.attrs.get_id(name)
        if h5py.check_string_dtype(header.dtype) is None or header.shape != ():
            found = _describe_header(header)
            raise self.make_error(f"attribute {name}", found, "a text")
        text = self.group.attrs[name]
        return text.decode() if isinstance(text, bytes) else str(text)

    def read_json(self, name: str, kind: object) -> Any:
        """What the JSON text of an attribute says, as a type has it."""
        return self.parse(f"attribute {name}", self.read_attribute(name), kind)

    def read_document(self, name: str, kind: object) -> dict[str, Any]:
        """A JSON object of an attribute that fits a type, as it stands; {} if empty."""
        place, text = f"attribute {name}", self.read_attribute(name)
        if not self.parse(place, text, dict[str, Any]):
            return {}
        self.parse(place, text, kind)
        try:
            return load_json(text)
        except ValueError as error:
            raise self.make_error(place, f"no JSON ({error})") from error

    def parse(self, member: str, text: str | bytes, kind: object) -> Any:
        """What a JSON text says, as a type has it.

        Args:
            member: that the text is of, for the message.
            kind: the type; a dataclass for an object with names.

        Raises:
            RunFileError: it is no JSON, or something else.
        """
        try:
            return _make_adapter(kind).validate_json(text, strict=True)
        except ValidationError as error:
            raise self.make_error(*explain_misfit(member, error, text)) from error

    def check_list(self, member: str, values: object, kind: ArraySchema) -> None:
        """Refuse a list of numbers of a document that does not fit.

        Args:
            member: that it is of, for the message.
            kind: what it must be, of shape (n) say.
        """
        found = np.array(values)
        wrong = kind.find_misfit(found, self.sizes) or kind.find_wrong_value(found)
        if wrong:
            raise self.make_error(member, wrong, kind.describe(self.sizes))

    def _find_member(self, name: str, fits: str) -> "h5py.HLObject":
        if name not in self.group:
            raise self.make_error(name, "missing", fits)
        return self.group[name]

    def _read_array(self, name: str, kind: ArraySchema, found: "h5py.Dataset") -> Any:
        """An array, or a number where the kind has no axes."""
        wrong = kind.find_misfit(found, self.sizes)
        values = np.zeros(0) if wrong else np.asarray(found[()])
        wrong = wrong or kind.find_wrong_value(values)
        if wrong:
            raise self.make_error(name, wrong, kind.describe(self.sizes))
        values = kind.convert(values)
        return values if kind.shape else values.item()


@contextmanager
def open_members(
    path: str | os.PathLike[str], what: str, *, form: str, version: int
) -> Iterator[Members]:
    """The members of a file, opened as `files.open_run` does, for checked reading.

    Raises:
        RunFileError: it cannot be read, keeps data elsewhere, declares more values
            than `MAX_VALUES`, or has a member that does not fit.
    """
    with open_run(path, what, form=form, version=version) as file:
        members = Members(file, f"{os.fspath(path)}: a damaged {what}")
        _check_headers(members)
        yield members


def _check_headers(members: Members) -> None:
    """Refuse links to elsewhere and more values than are read."""
    import h5py

    total = 0
    for name, item in walk_hdf5(members.group):
        if isinstance(item, h5py.Group):
            continue
        if not isinstance(item, h5py.Dataset):
            raise members.make_error(name, "a link to elsewhere", "data of this file")
        if item.is_virtual or item.external:
            raise members.make_error(name, "kept elsewhere", "data of this file")
        total += count_values(item) * max(1, item.dtype.itemsize // 8)
        if total > MAX_VALUES:
            found = f"of shape {item.shape}"
            fits = f"at most {MAX_VALUES:,} values in the file"
            raise members.make_error(name, found, fits)


@cache
def _make_adapter(kind: Any) -> TypeAdapter:
    """What checks a type; made once, for that takes milliseconds."""
    return TypeAdapter(kind)


def _describe_header(found: "h5py.Dataset | h5py.h5a.AttrID") -> str:
    """Type and shape of a dataset or an attribute, in words."""
    return f"of type {found.dtype} and shape {found.shape}"
