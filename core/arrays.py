"""Types of arrays in annotations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Floats"]

#: An array of any number type; a stepper's is float, double, long double or pairs of doubles.
Array = NDArray[Any]
Floats = NDArray[np.float64]
