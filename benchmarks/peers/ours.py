"""gyrospark itself, by the solver it chooses and by dense Newton."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from gyrospark._version import __version__
from gyrospark.api import stepper
from gyrospark.core.arguments import choose
from gyrospark.core.errors import InputError
from gyrospark.core.inertia import RepName
from gyrospark.core.solver import Solver
from gyrospark.generator.schemes.named_schemes import SchemeName
from gyrospark.runtime.rigid_body.quaternion import angular_velocity
from gyrospark.runtime.steppers.stepper import SOLVERS as KNOWN

from ..tops import FREE_RATE, INERTIA, TopState, parameters, tops
from .entry import PeerEntry, Run
from .optional import Unavailable

__all__ = ["PACKAGE", "SOLVERS", "Method", "available", "entries", "prepare"]

PACKAGE = "gyrospark"
SOLVERS = ("auto", "newton", "fixed-point")


@dataclass(frozen=True)
class Method:
    """A scheme with its time step, its γ or α (None: γ_m) and tolerance (None: round-off).

    ``spin`` is the rate of a co-moving frame about the body's own axis, 0 for none.
    """

    scheme: SchemeName
    stages: int | None
    dt: float
    rep: RepName = "gamma"
    inertia: float | None = None
    note: str = ""
    tolerance: float | None = None
    spin: float = 0.0

    @property
    def text(self) -> str:
        """What the table says of it."""
        stages = "" if self.stages is None else f" s={self.stages}"
        return f"{self.scheme}{stages} Δt={self.dt:g}{self.note}"


_METHODS = (
    Method("G-L", 2, 1e-3),
    Method("G-L", 3, 1e-3),
    Method("G-L", 4, 1e-3),
    Method("G-L", 4, 1e-2),
    Method("G-L", 6, 1e-2),
    Method("G-L", 8, 1e-2),
    Method("G-L", 8, 2e-2),
    Method("G-L", 8, 2.5e-2, inertia=1.1 * INERTIA[2], note=" γ=1.1I₃"),
    Method("G-L", 8, 2.5e-2, inertia=1.1 * INERTIA[2], note=" γ=1.1I₃ tol 1e-14",
           tolerance=1e-14),
    Method("G-L", 8, 2.5e-2, inertia=1.1 * INERTIA[2], note=" γ=1.1I₃ tol 1e-12",
           tolerance=1e-12),
    Method("G-L", 3, 1e-2, inertia=INERTIA[0], note=" γ=I₁ in its frame", spin=FREE_RATE),
    Method("G-L", 8, 4e-2, inertia=INERTIA[0], note=" γ=I₁ in its frame", spin=FREE_RATE),
    Method("G-L", 8, 4e-2, inertia=INERTIA[0], note=" γ=I₁ in its frame, tol 5e-15",
           tolerance=5e-15, spin=FREE_RATE),
    Method("IMS", None, 1e-3, "alpha", sum(INERTIA) / 2, " α=½trJ"),  # pydykit's midpoint rule
)
_QUICK = _METHODS[:1]


def entries() -> list[PeerEntry]:
    """Return each method by the default solver and by dense Newton."""
    return [
        PeerEntry("gyrospark", __version__, f"{method.text} {solver}",
                  partial(prepare, method, solver), method.dt, method in _QUICK)
        for method in _METHODS for solver in ("auto", "newton")
    ]


def available(solver: str) -> bool:
    """Return whether this version's steppers know a solver."""
    return solver in KNOWN


def prepare(method: Method, solver: str) -> Run:
    """Return the run of one stepper.

    Raises
    ------
    Unavailable
        If this version has no such solver.
    """
    if not available(solver):
        raise Unavailable(f"not available: solver {solver!r}")
    step = stepper(method.scheme, method.stages, method.rep,
                   frame="symmetries" if method.spin else None)
    known = parameters(method.inertia) | {"omega_body": method.spin, "omega_space": 0.0}
    values = {name: known.get(name, known["gamma"]) for name in step.parameter_domains}
    top = tops()[0]
    chosen = Solver(choose("solver", solver, KNOWN), tolerance=method.tolerance)

    def run(t_end: float) -> TopState:
        steps = round(t_end / method.dt)
        if abs(steps * method.dt - t_end) > 1e-9 * t_end:
            raise InputError(f"t = {t_end:g} s is no whole number of steps of {method.dt:g} s.")
        end = step.integrate(top.q, top.p, dt=method.dt, steps=steps, every=max(steps, 1),
                             parameters=values, solver=chosen)
        q = np.asarray(end.q[-1], dtype=np.float64)
        return TopState(q, angular_velocity(q, end.p[-1], INERTIA))

    return run
