"""Memory for compiled code whose bytes mean the same wherever they lie.

Work memory holds the whole past of a run: compensation terms, the predictor's history. Compiled
code puts it at the next multiple of 64 bytes; memory that begins at one can be copied byte for
byte, kept in a file, and gone on with.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["ALIGNMENT", "aligned"]

ALIGNMENT = 64


def aligned(size: int) -> NDArray[Any]:
    """Return that many zeroed bytes at a multiple of ``ALIGNMENT``."""
    room = np.zeros(size + ALIGNMENT, dtype=np.uint8)
    start = -room.ctypes.data % ALIGNMENT
    return room[start : start + size]
