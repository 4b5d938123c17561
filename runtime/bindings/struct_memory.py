"""Memory for compiled code whose bytes mean the same wherever they lie.

Work memory holds the whole past of a run: compensation terms, the predictor's history. Compiled
code puts it at the next multiple of 64 bytes; memory that begins at one can be copied byte for
byte, kept in a file, and gone on with.

A long double of x87 has 10 bytes of its 16. What compilers leave in the others is whatever was
there, pieces of addresses for one: other bytes in every process, and none that a file may hold.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ALIGNMENT", "aligned", "without_padding"]

ALIGNMENT = 64
#: Bytes of an x87 number that count.
_X87_BYTES = 10


def aligned(size: int) -> NDArray[Any]:
    """Return that many zeroed bytes at a multiple of ``ALIGNMENT``."""
    room = np.zeros(size + ALIGNMENT, dtype=np.uint8)
    start = -room.ctypes.data % ALIGNMENT
    return room[start : start + size]


def without_padding(array: NDArray[Any]) -> NDArray[Any]:
    """Return an array with equal bytes for equal numbers: itself, or a copy."""
    if array.dtype != np.longdouble or np.finfo(np.longdouble).nmant != 63:
        return array
    kept = array.copy(order="C")
    kept.reshape(-1).view(np.uint8).reshape(-1, kept.itemsize)[:, _X87_BYTES:] = 0
    return kept
