"""The Whipple bicycle: four bodies, three hinges and two rolling wheels, and its stability.

Parameters are those of the benchmark of Meijaard, Papadopoulos, Ruina and Schwab (2007), in axes
forward, left, up. ``eigenvalues`` linearises the equations of motion with multipliers,

    q̇ = H_p,   ṗ = −H_q − Rᵀν,   R = (g_q; A),   R H_p = 0,

about straight running, in axes that move with the wheels, and reduces them to the tangent space.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import NDArray
from scipy.linalg import null_space

import gyrospark as gs

TILT, WHEELBASE, TRAIL = math.pi / 10, 1.02, 0.08
REAR, FRONT = 0.3, 0.35  # radii
LEFT, STEERING = (0, 1, 0), (-math.sin(TILT), 0, math.cos(TILT))


def bicycle(speed: float = 5.0, lean_rate: float = 0.0) -> gs.Model:
    """Return a bicycle that runs straight ahead, and leans over at a rate in rad/s."""
    build = gs.Multibody("bicycle", dt=0.01, steps=500)
    spin = {"angular_velocity": (lean_rate, 0, 0)}
    frame = build.body("frame", mass=85, position=(0.3, 0, 0.9), inertia=[
        [9.2, 0, -2.4], [0, 11, 0], [-2.4, 0, 2.8]], **spin)
    fork = build.body("fork", mass=4, position=(0.9, 0, 0.7), inertia=[
        [0.05892, 0, 0.00756], [0, 0.06, 0], [0.00756, 0, 0.00708]])
    build.revolute("steering", frame, fork, axis=STEERING, at=(WHEELBASE + TRAIL, 0, 0))
    rear = build.rotor("rear", frame, mass=2, inertia=(0.12, 0.0603), axis=LEFT, at=(0, 0, REAR),
                       rate=speed / REAR)
    front = build.rotor("front", fork, mass=3, inertia=(0.28, 0.1405), axis=LEFT,
                        at=(WHEELBASE, 0, FRONT), rate=speed / FRONT)
    build.rolls("rear_tyre", rear, disc=REAR)
    build.rolls("front_tyre", front, disc=FRONT)
    return build.model()


@lru_cache
def equations(system: gs.System) -> Callable[..., list[float]]:
    """Return a function of q, p, ν and the parameters: the rates of q and p, g, and R H_p."""
    v, R = system.H_p, [*system.G, *system.A]
    nu = sp.symbols(f"nu0:{len(R)}")
    pushes = [-h - sp.Add(*(x * row[i] for x, row in zip(nu, R, strict=True)))
              for i, h in enumerate(system.H_q)]
    kept = [sp.Add(*(a * b for a, b in zip(row, v, strict=True))) for row in R]
    made: Callable[..., list[float]] = sp.lambdify(
        [*system.q, *system.p, *nu, *system.parameters],
        [*v, *pushes, *system.constraints, *kept], cse=True)
    return made


def eigenvalues(model: gs.Model) -> NDArray[np.complex128]:
    """Return the four eigenvalues of leaning and steering, largest real part first.

    The other six, of place, heading, angles of the wheels and speed, are 0.
    """
    system, n = model.system, model.system.n
    z0 = np.concatenate([model.q0, model.p0])
    constants = [model.parameters[str(s)] for s in system.parameters]

    def values(z: NDArray[Any], nu: NDArray[np.float64]) -> NDArray[Any]:
        found = equations(system)(*z, *nu, *constants)
        return np.array([np.broadcast_to(e, z.shape[1:]) for e in found])

    count = system.m + system.velocity_count
    rest = values(z0, np.zeros(count))[: 2 * n]
    rows = np.array([rest[n:] - values(z0, e)[n:2 * n] for e in np.eye(count)])  # R
    frame = np.zeros((2 * n, 2 * n))  # of axes that spin with a wheel: q̇ = ½ q (0, 0, 0, ω)
    for name in ("rear", "front"):
        first = next(system.q.index(b.q[0]) for b in system.bodies if b.name == name)
        half = rest[first + 3] / z0[first]
        for i in (first, n + first):  # and ṗ likewise
            for row, column, sign in ((0, 3, -1), (3, 0, 1), (1, 2, 1), (2, 1, -1)):
                frame[i + row, i + column] = sign * half
    pull = rest[n:] - (frame @ z0)[n:]
    held, *_ = np.linalg.lstsq(rows.T, pull, rcond=None)
    assert np.linalg.norm(rows.T @ held - pull) < 1e-9  # in its frame the motion is steady
    moved = z0[:, None] + 1e-100j * np.eye(2 * n)
    J = values(moved, held).imag * 1e100  # derivatives by z, Im f(z + iε e_k)/ε
    tangents = null_space(J[2 * n:])
    free = np.eye(2 * n)  # what no multiplier reaches
    free[n:, n:] -= np.linalg.pinv(rows) @ rows
    reduced, *_ = np.linalg.lstsq(free @ tangents, free @ (J[: 2 * n] - frame) @ tangents,
                                  rcond=None)
    growth = sorted(np.linalg.eigvals(reduced), key=abs)[6:]
    return np.array(sorted(growth, key=lambda x: (-x.real, -x.imag)))


if __name__ == "__main__":
    for speed in (0.0, 5.0):
        print(f"{speed} m/s:", *eigenvalues(bicycle(speed)))
