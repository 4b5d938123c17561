"""Types of arrays in annotations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Floats"]

#: Of any type of numbers: those of a stepper are float, double, long double or pairs of doubles.
Array = NDArray[Any]
Floats = NDArray[np.float64]
