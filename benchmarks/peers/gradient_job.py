"""Timed jobs of a program with derivatives: the gradient of a loss, and the run alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..attitudes import Array
from ..tops import INERTIA, MGL, state_of, tops

__all__ = ["TOP_VALUES", "GradientJob", "Job", "of_euler", "top_start"]

#: I1, I2, I3 and mgl of the top, in the order of ``tops.euler_equations``.
TOP_VALUES = np.array([*INERTIA, MGL])


@dataclass(frozen=True)
class GradientJob:
    """A gradient by (q, p) of the start and by parameters; None: the program has none by these."""

    q: Any
    p: Any
    parameters: Any = None


@dataclass(frozen=True)
class Job:
    """Two timed functions: value with gradient, and the run alone."""

    gradient: Callable[[], GradientJob]
    primal: Callable[[], object]


def top_start() -> Array:
    """Return (q, Ω) of the top at t = 0."""
    start = state_of(tops()[0])
    return np.concatenate([start.q, start.omega])


def of_euler(by_state: Array, by_parameters: Array | None) -> GradientJob:
    """Return a gradient by (q, Ω) and (I1, I2, I3, mgl) by (q, p) and these: 2 J Ω = L(q) p."""
    top = tops()[0]
    (q0, q1, q2, q3), (p0, p1, p2, p3) = top.q, top.p
    L = np.array([[-q1, q0, q3, -q2], [-q2, -q3, q0, q1], [-q3, q2, -q1, q0]])
    jacobian = np.array([[p1, -p0, -p3, p2], [p2, p3, -p0, -p1], [p3, -p2, p1, -p0]])
    by_spin = by_state[4:] / INERTIA / 2
    if by_parameters is not None:
        by_parameters = np.asarray(by_parameters, dtype=float).copy()
        by_parameters[:3] -= by_state[4:] * top_start()[4:] / INERTIA
    return GradientJob(by_state[:4] + jacobian.T @ by_spin, L.T @ by_spin, by_parameters)
