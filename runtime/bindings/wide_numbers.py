"""Numbers wider than a double as bytes: Zarr has neither long double nor binary128."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .struct_memory import without_padding

__all__ = ["WIDE_BYTES", "as_bytes", "from_bytes"]

Array = NDArray[Any]

WIDE_BYTES = 16


def as_bytes(array: Array) -> Array:
    """Return an array's numbers as bytes along a last axis, equal for equal numbers."""
    if array.dtype == object:
        from .binary128 import to_bytes  # mpmath costs time, and only float128 needs it

        return to_bytes(array)
    data = np.ascontiguousarray(without_padding(array)).view(np.uint8)
    return data.reshape(*array.shape, array.dtype.itemsize)


def from_bytes(data: Array, dtype: Any) -> Array:
    """Return the numbers that ``as_bytes`` gave the bytes of."""
    if dtype is object:
        from .binary128 import from_bytes as quads

        return quads(data)
    values: Array = np.ascontiguousarray(data).view(dtype)
    return values.reshape(data.shape[:-1])
