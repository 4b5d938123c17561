"""Systems whose Jacobian is sparse, in forms and dense: beads on rods."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
import sympy as sp

import budget
import gyrospark as gs
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.system import System
from gyrospark.runtime.steppers.stepper import Stepper

BEADS = {"k": 1.3, "c": 0.2, "f": 0.7, "omega": 2.1}


def beads(links: int = 2) -> System:
    """Return beads on rods whose mass depends on place, on a pivot and in a field that time moves.

    There are dampers between them, and a drive at the end.
    """
    q = sp.symbols(f"x0:{2 * links}", real=True)
    p = sp.symbols(f"y0:{2 * links}", real=True)
    k, c, f, omega = sp.symbols("k c f omega", positive=True)
    t = sp.Symbol("t", real=True)
    points = [(0, f * sp.sin(omega * t) / 5), *zip(q[::2], q[1::2], strict=True)]
    rods = [(b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 - 1 for a, b in pairwise(points)]
    H = sum(a**2 for a in p) / 2 + 9 * sum(q[1::2])
    H += sum(x**2 * (v**2 / 8 + f * sp.cos(t)) for x, v in zip(q[::2], p[1::2], strict=True))
    forces = [-k * a for a in p]
    for i in range(2 * links - 2):
        pull = c * (p[i + 2] - p[i]) * (1 + q[i] * q[i + 2] / 5)
        forces[i], forces[i + 2] = forces[i] + pull, forces[i + 2] - pull
    forces[-2] += f * sp.sin(omega * t) * q[-1]
    return System(q, p, (k, c, f, omega), H, rods, forces=forces, time=t, name="beads")


def start_of_beads(step: Stepper, t0: float) -> tuple[np.ndarray, np.ndarray]:
    """Return a state of four beads on the constraints."""
    positions = np.cumsum([[np.cos(a), -np.sin(a)] for a in (0.6, 1.1, 0.3, 0.9)], axis=0).ravel()
    state = step.consistent(positions, np.full(8, 0.3), parameters=BEADS, t=t0)
    return state.q, state.p


@cache
def made_beads(scheme: str, stages: int | None, structured: bool):
    """Return a stepper of four beads, in forms or dense."""
    with budget.shared():
        if structured:  # of eight coordinates, as of any system that is worth it
            return gs.stepper(scheme, stages, system=beads(4))
        source = generate(Spec.from_arguments(scheme, stages), system=beads(4),
                          structured=False).source
        return Stepper(source.name, source.files())
