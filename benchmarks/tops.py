"""The problem: the paper's fast top (80), and seven more with another tilt and spin.

Peers integrate the equations that need the fewest operations, with Ω in body axes:

    q' = ½ q ∘ (0, Ω),    J Ω' = J Ω × Ω + mgl (R23, −R13, 0)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

import gyrospark as gs

from .attitudes import Array, angular_velocity, left_matrix

__all__ = ["FREE_RATE", "INERTIA", "LANES", "LEVER", "MGL", "Top", "TopState", "axis", "energy",
           "euler_equations", "parameters", "spin_of", "state_of", "tops"]

#: Distance of the mass centre from the fixed point, in metres.
LEVER = 0.04
INERTIA = gs.problems.fast_top().inertia
MGL = gs.problems.fast_top().parameters["mgl"]
#: (1/I₃ − 1/I₁) I₃ Ω₃: the rate of a free body about its own axis beside l, for frames.
FREE_RATE = (1 - INERTIA[2] / INERTIA[0]) * 40 * math.pi
#: Tops in the ensemble; the first is the paper's.
LANES = 8


@dataclass(frozen=True, eq=False)
class TopState:
    """Attitude q and angular velocity Ω in body axes; leading axes are trajectories."""

    q: Array
    omega: Array


@dataclass(frozen=True, eq=False)
class Top:
    """A start (q, p) at t = 0, in double; every contestant begins with these numbers."""

    q: Array
    p: Array


def tops(count: int = 1) -> list[Top]:
    """Return the paper's top and others like it, each 2° more tilted and 2 % faster than the last.

    More than eight repeat the first eight.
    """
    first = gs.problems.fast_top()
    starts = [Top(first.q0, first.p0)]
    for i in range(1, LANES):
        half = (math.pi / 6 + math.radians(2 * i)) / 2
        q = np.array([math.cos(half), math.sin(half), 0.0, 0.0])
        spin = np.array([0.0, 0.0, 40 * math.pi * (1 + 0.02 * i)])
        starts.append(Top(q, 2 * left_matrix(q).T @ (np.array(INERTIA) * spin)))
    return [starts[i % LANES] for i in range(count)]


def parameters() -> dict[str, float]:
    """Return the heavy top's parameters with γ_m."""
    return gs.problems.fast_top().parameters | {"gamma": gs.gamma(INERTIA)}


def spin_of(top: Top, real: Any = np.float64) -> Array:
    """Return Ω = ½ J⁻¹ L(q) p of a start, in any floating-point type."""
    return angular_velocity(top.q.astype(real), top.p.astype(real), np.array(INERTIA, dtype=real))


def state_of(top: Top) -> TopState:
    """Return a start as peers take it."""
    return TopState(top.q, spin_of(top))


def euler_equations(
    q0: Any, q1: Any, q2: Any, q3: Any, w1: Any, w2: Any, w3: Any,
    I1: Any, I2: Any, I3: Any, mgl: Any,
) -> tuple[Any, ...]:
    """Return (q', Ω') for numbers or for symbols of any kind."""
    return (
        (-q1 * w1 - q2 * w2 - q3 * w3) / 2,
        (q0 * w1 + q2 * w3 - q3 * w2) / 2,
        (q0 * w2 + q3 * w1 - q1 * w3) / 2,
        (q0 * w3 + q1 * w2 - q2 * w1) / 2,
        (I2 - I3) / I1 * (w2 * w3) + 2 * mgl / I1 * (q2 * q3 + q0 * q1),
        (I3 - I1) / I2 * (w3 * w1) - 2 * mgl / I2 * (q1 * q3 - q0 * q2),
        (I1 - I2) / I3 * (w1 * w2),
    )


def axis(q: Array) -> Array:
    """Return the body's third axis in space in the type of q; the mass centre is LEVER × this."""
    q0, q1, q2, q3 = np.moveaxis(np.asarray(q), -1, 0)
    return np.stack([2 * (q1 * q3 + q0 * q2), 2 * (q2 * q3 - q0 * q1),
                     q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3], axis=-1)


def energy(state: TopState) -> Array:
    """Return H = ½ ΩᵀJΩ + mgl R33, in joules."""
    kinetic = (np.array(INERTIA) * state.omega**2).sum(axis=-1) / 2
    total: Array = kinetic + MGL * axis(state.q)[..., 2]
    return total
