"""Columns of Apache Arrow: takes arrays of any type, gives numbers and texts."""

from typing import TYPE_CHECKING

import numpy as np

from ..base import Floats, Values
from .common import MAX_ELEMENTS, convert_cells

if TYPE_CHECKING:
    import pyarrow as pa

_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def convert_array(array: "pa.Array") -> Values:
    """An Arrow array (n) of numbers, times or texts; NaN where it has none."""
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = array.type
    if pa.types.is_dictionary(kind):
        array = array.dictionary_decode()
        kind = array.type
    if pa.types.is_date(kind):
        array = pc.cast(array, pa.timestamp("ms"))
        kind = array.type
    scale = 1.0
    if pa.types.is_temporal(kind):
        scale = _PER_SECOND[kind.unit]
        array = pc.cast(array, pa.int32() if pa.types.is_time32(kind) else pa.int64())
    elif not is_numeric(kind):
        texts = ["" if cell is None else str(cell) for cell in array.to_pylist()]
        return convert_cells(texts)
    numbers = pc.cast(array, pa.float64(), safe=False)
    values: Floats = numbers.to_numpy(zero_copy_only=False)
    return values if scale == 1 else values / scale


def is_numeric(kind: "pa.DataType") -> bool:
    """Whether an Arrow type is of numbers that float64 can stand for."""
    import pyarrow as pa

    t = pa.types
    tests = (t.is_integer, t.is_floating, t.is_boolean, t.is_decimal, t.is_null)
    return any(test(kind) for test in tests)


def is_readable(kind: "pa.DataType") -> bool:
    """Whether values of an Arrow type become one column."""
    import pyarrow as pa

    if pa.types.is_dictionary(kind):
        return is_readable(kind.value_type)
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return True
    is_time = pa.types.is_temporal(kind) and not pa.types.is_interval(kind)
    return is_time or is_numeric(kind)


def is_list(kind: "pa.DataType") -> bool:
    """Whether values of an Arrow type are vectors of numbers."""
    import pyarrow as pa

    lists = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    return any(test(kind) for test in lists) and is_numeric(kind.value_type)


def find_width(array: "pa.Array | pa.ChunkedArray") -> int:
    """Elements of the longest vector of an array (n); 0 where they are too many."""
    import pyarrow.compute as pc

    width = pc.max(pc.list_value_length(array)).as_py() or 0
    return width if width <= MAX_ELEMENTS else 0


def convert_vectors(array: "pa.Array") -> Floats:
    """Vectors of an Arrow array as (n, d), NaN where one lacks elements."""
    import pyarrow.compute as pc

    array = pc.list_slice(array, 0, MAX_ELEMENTS, return_fixed_size_list=False)
    lengths = pc.fill_null(pc.list_value_length(array), 0)
    lengths = lengths.to_numpy(zero_copy_only=False)[:, None]
    found = np.full((len(array), lengths.max(initial=0)), np.nan)
    found[np.arange(found.shape[1]) < lengths] = convert_array(array.flatten())
    return found
