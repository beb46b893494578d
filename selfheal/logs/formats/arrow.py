"""Columns of Apache Arrow: takes arrays of any type, gives numbers and texts."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..base import Values
from .common import MAX_ELEMENTS, convert_cells

_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}


def convert_array(array: Any) -> Values:
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
    values: Values = numbers.to_numpy(zero_copy_only=False)
    return values if scale == 1 else values / scale


def is_numeric(kind: Any) -> bool:
    """Whether an Arrow type is of numbers that float64 can stand for."""
    import pyarrow as pa

    return any(
        (
            pa.types.is_integer(kind),
            pa.types.is_floating(kind),
            pa.types.is_boolean(kind),
            pa.types.is_decimal(kind),
            pa.types.is_null(kind),
        )
    )


def is_readable(kind: Any) -> bool:
    """Whether values of an Arrow type become one column."""
    import pyarrow as pa

    if pa.types.is_dictionary(kind):
        return is_readable(kind.value_type)
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        return True
    return is_numeric(kind) or (
        pa.types.is_temporal(kind) and not pa.types.is_interval(kind)
    )


def is_list(kind: Any) -> bool:
    """Whether values of an Arrow type are vectors of numbers."""
    import pyarrow as pa

    lists = (pa.types.is_list, pa.types.is_large_list, pa.types.is_fixed_size_list)
    return any(test(kind) for test in lists) and is_numeric(kind.value_type)


def find_width(array: Any) -> int:
    """Elements of the longest vector of an Arrow array; 0 where they are too many."""
    import pyarrow.compute as pc

    width = pc.max(pc.list_value_length(array)).as_py() or 0
    return width if width <= MAX_ELEMENTS else 0


def part_vectors(array: Any, wanted: Sequence[int]) -> list[Values]:
    """Elements of the vectors of an Arrow array (n): one (n) for each that is wanted.

    An element that a vector lacks is NaN.
    """
    import pyarrow.compute as pc

    lengths = pc.fill_null(pc.list_value_length(array), 0)
    lengths = lengths.to_numpy(zero_copy_only=False).astype(np.int64)
    flat = convert_array(array.flatten())  # without those of vectors that are null
    starts = np.cumsum(lengths) - lengths
    columns = list[Values]()
    for k in wanted:
        column = np.full(len(lengths), np.nan)
        has = lengths > k
        column[has] = flat[starts[has] + k]
        columns.append(column)
    return columns
