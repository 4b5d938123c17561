"""Diagnosis of a failed step: the reason, and a time step that succeeds.

The failed step is tried once more by Newton alone, for the size of its last increment; then with
half the time step, a quarter, and so on, until one succeeds. Where the constraints depend on each
other at the state itself no step leads on, and that is said instead.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.manifest import Manifest
from ...core.records import dataclass
from ..bindings.binding import REASONS, Binding, CompiledConstraints

__all__ = ["Diagnosis", "diagnose"]

#: Status codes of the C.
_NOT_CONVERGED, _SINGULAR, _NOT_FINITE, _STAGNATED, _DIVERGED, _TIME_STOPPED = 1, 2, 3, 4, 5, 7
#: The square of a larger parameter or momentum leaves the range of doubles.
_LARGE = 1e150
#: How often the time step is halved.
_HALVINGS = 30
#: Slopes of constraints are difference quotients, right to nine digits.
_DEPENDENT = 1e-7


@dataclass(frozen=True)
class Diagnosis:
    """The reason, details and cure of a ``StepFailed``, as parts of its sentence.

    ``increment`` is Newton's last increment relative to the state, ``dt`` a step that succeeds;
    None where there is none.
    """

    reason: str
    detail: str
    cure: str
    increment: float | None = None
    dt: float | None = None

    @classmethod
    def bare(cls, status: int) -> Diagnosis:
        """Return the description of a status code, without the state."""
        return cls(REASONS[status], REASONS[status], "A smaller time step usually cures it")


def diagnose(
    binding: Binding, manifest: Manifest, run: Any, status: int, q: Array, p: Array, t: Any
) -> Diagnosis:
    """Return why a step from q, p, shapes (n,), at time t ended with ``status``, and the cure.

    In turn: constraints that depend on each other there, a smaller step that succeeds, parameters
    out of range.
    """
    # the step once more by Newton's method: its increments say more than those of the fixed-point
    # iteration
    newton_status, increment = status, None
    if run.solver != "fixed-point" and binding.solves:
        newton_status, increment = _tried_by_newton(binding, run, q, p, t)
    # otherwise Newton's method has no better reason: it converged, or had no next iteration
    if newton_status in (_NOT_CONVERGED, _STAGNATED, _DIVERGED):
        status = newton_status
    diagnosis = Diagnosis(REASONS[status], _detail(status, increment, run.max_iterations), cure="",
                          increment=increment)
    dependent = _dependent_constraints(binding, manifest, run, q)
    if dependent:
        return replace(
            diagnosis,
            detail=f"{diagnosis.detail}, where the constraints {dependent} depend on each other",
            cure="That is a change point of the mechanism, from which no step is determined: start "
                 "beside it, or pass it with another time step")
    cure, dt = _cure_of_step(binding, run, status, q, p, t)
    return replace(diagnosis, cure=cure, dt=dt)


def _cure_of_step(
    binding: Binding, run: Any, status: int, q: Array, p: Array, t: Any
) -> tuple[str, Any]:
    """Return the cure of a failed step, and its Δt or Δτ if the cure is a smaller step."""
    # has a smaller step from the same state a solution?
    dt, smallest = _smaller_step(binding, run, q, p, t)
    name = "dtau" if binding.clocked else "dt"
    if dt is not None:
        return f"From there a step of {name} = {dt:.9g} does", dt
    largest = max(run.parameters, key=lambda name: abs(float(run.parameters[name])), default=None)
    if status == _NOT_FINITE and largest is not None and (
            abs(float(run.parameters[largest])) > _LARGE):
        return (f"{largest} = {float(run.parameters[largest]):.6g} leads out of the range of "
                "floating-point numbers; take other units"), None
    if status == _TIME_STOPPED:
        return ("Steps must go forwards in time: take a time_scale that is positive wherever the "
                "motion comes"), None
    return f"From there no step down to {name} = {smallest:.3g} does", None


def _detail(status: int, increment: float | None, iterations: int) -> str:
    """Return the reason of a status, with Newton's last increment if it is known."""
    reason = REASONS[status]
    if increment is None:
        return reason
    return reason + {
        _NOT_CONVERGED: f": after {count_text(iterations, 'iteration')} increments still shrank, "
                        f"the last one to {increment:.1e} of the state (max_iterations is too "
                        "small)",
        _STAGNATED: f" above round-off: increments stayed at {increment:.1e} of the state",
        _DIVERGED: f": the last increment was {increment:.1e} of the state",
    }.get(status, "")


def _tried_by_newton(
    binding: Binding, run: Any, q: Array, p: Array, t: Any
) -> tuple[int, float | None]:
    """Return the status of the step from q, p by full Newton, and its last relative increment.

    q and p have the shape (n,); the status is 0 if Newton's method converges.
    """
    options = binding.options(run.tolerance, run.max_iterations, solver="newton")
    return binding.first_half(binding.parameters(run.parameters, t), options, run.dt, q, p,
                              binding.work())


def _smaller_step(
    binding: Binding, run: Any, q: Array, p: Array, t: Any
) -> tuple[float | None, float]:
    """Return the first of Δt/2, Δt/4, ... that succeeds, or None, and the smallest one tried.

    Every step starts from q, p, shapes (n,), at time t.
    """
    parameters, dt = binding.parameters(run.parameters, t), run.dt
    options = binding.options(run.tolerance, run.max_iterations, run.solver)
    for _ in range(_HALVINGS):
        # the state is not advanced: each try starts from it
        dt = dt / 2
        if not binding.step(parameters, options, dt, q, p, binding.work())[0]:
            return float(dt), float(dt)
    return None, float(dt)


def _dependent_constraints(binding: Binding, manifest: Manifest, run: Any, q: Array) -> str:
    """Return the names of constraints whose gradients are dependent at q; empty if none are.

    Of G with rows of length 1, the left singular vector of the least singular value says which
    combination of the rows vanishes.
    """
    if binding.m < 2:
        return ""
    # in scaled time the last coordinate is t; else t is not read
    constraints = CompiledConstraints(binding, manifest, binding.parameters(run.parameters, run.t0),
                                      t=q[-1])
    G = constraints.G(q[: binding.shown].astype(float))
    lengths = np.linalg.norm(G, axis=1, keepdims=True)
    if not np.all(np.isfinite(G)) or not np.all(lengths > 0):
        return ""
    U, sizes, _ = np.linalg.svd(G / lengths)
    if len(sizes) == binding.m and sizes[-1] > _DEPENDENT * sizes[0]:
        return ""
    # the combination of the gradients that vanishes
    weights = np.abs(U[:, -1])
    names = [name for name, weight in zip(constraints.constraint_names, weights, strict=True)
             if weight > 0.01]
    return ", ".join(repr(name) for name in names)
