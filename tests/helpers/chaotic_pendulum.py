"""A plane double pendulum in Cartesian coordinates, and where it is released."""

from __future__ import annotations

import numpy as np

import gyrospark as gs
import systems

__all__ = ["PARAMETERS", "pendulum", "released"]

PARAMETERS = systems.case("two_rods").parameters


def pendulum(scheme: str = "G-L", stages: int | None = 2, real: str = "double") -> gs.Stepper:
    """Return the stepper of two unit masses on rods of lengths 1 and l, with derivatives."""
    return systems.differentiable("two_rods", scheme, stages, real)


def released(a: float, b: float, step: gs.Stepper | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Return the state at rest with these angles against the downward vertical."""
    q = [np.sin(a), -np.cos(a), np.sin(a) + np.sin(b), -np.cos(a) - np.cos(b)]
    return (step or pendulum()).project(q, np.zeros(4), parameters=PARAMETERS)
