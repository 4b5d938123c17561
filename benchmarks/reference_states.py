"""Where the tops are at t = 1, 10, 100 and 1000 s: ``reference.json``, made by make_reference.py.

The numbers are a Taylor integration in long double. They agree with gyrospark's own long-double
stepper at t = 10 s (the file says how closely); at t = 1000 s they are good to about 3e-13.
"""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np

from .attitudes import Array
from .tops import LEVER, axis

__all__ = ["PATH", "TIMES", "about", "distance", "has", "reference_axes"]

PATH = Path(__file__).resolve().parent / "reference.json"
#: Times of the reference, in seconds.
TIMES = (1, 10, 100, 1000)


@functools.cache
def _content() -> dict[str, Any]:
    content: dict[str, Any] = json.loads(PATH.read_text(encoding="utf-8"))
    return content


def about() -> dict[str, Any]:
    """Return how the reference was made and checked."""
    about: dict[str, Any] = _content()["about"]
    return about


def has(t_end: float) -> bool:
    """Return whether the reference has this time."""
    return t_end in TIMES


def reference_axes(t_end: float) -> Array:
    """Return the third axis of each of the eight tops in space, in long double, shape (8, 3)."""
    rows = _content()["axes"][f"{t_end:g}"]
    return np.array([[np.longdouble(x) for x in row] for row in rows])


def distance(q: Array, t_end: float) -> Array:
    """Return how far the mass centres are from the reference in metres; q has shape (N, 4)."""
    expected_axes = reference_axes(t_end)
    expected_axes = expected_axes[np.arange(len(q)) % len(expected_axes)]
    difference = axis(np.asarray(q).astype(np.longdouble)) - expected_axes
    sizes: Array = LEVER * np.sqrt((difference**2).sum(axis=-1)).astype(np.float64)
    return sizes
