"""Tangents along a run: the steps are kept piece by piece, and directions follow them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import shown
from ...core.errors import GyrosparkError, InputError
from ...core.warnings import warn
from ..integration.run_arguments import RunArguments
from ..results.tangent_rows import TangentRows
from .frame import FrameMotion
from .tangent_space import Start, Tangents, TangentSpace

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper
    from .binding import KeptSteps

__all__ = [
    "TangentRows",
    "pieces",
    "refuse_run",
    "singular",
    "tangents_of",
    "warn_of_growth",
    "with_tangents",
]

Array = NDArray[Any]

#: Steps that are kept at a time.
_PIECE = 512
#: Growth beyond which a derivative has lost its digits, in 1/ε.
_LOST = 1e-3


def tangents_of(stepper: Stepper, run: RunArguments, wanted: Tangents) -> TangentRows:
    """Return the tangents of a checked run at the states that it stores.

    Raises
    ------
    InputError
        For directions that are none.
    StepFailed
        As the run itself does.
    """
    refuse_run(run)
    binding, n = stepper.derivative_binding, stepper.n
    own = binding.own
    kept_run = binding.begin(run)
    space = TangentSpace(binding, kept_run.parameters, run.q, run.p, stepper.constraint_names)
    for name in wanted.parameters if run.inputs is not None else ():
        if name in own.input_names:
            raise InputError(f"Input {name!r} has a value for each step in this run, so that it is "
                             "no direction; take the gradient by \"inputs\".")
    start = Start(space, wanted)
    dz = np.ascontiguousarray(start.directions)
    count = dz.shape[1]
    tangents = dz[: 2 * n].copy()
    made = own.new(run.rows + 1, 2 * n, count)
    made[0] = tangents
    frame = FrameMotion(binding, stepper.symmetries, run)
    for steps in pieces(stepper, run, kept_run):
        first = steps.first // run.every
        rows = own.new((steps.first + steps.count) // run.every - first, 2 * n, count)
        status = binding.integrate_tangent(run, kept_run.parameters, steps, dz, run.every, rows,
                                           tangents)
        if status:
            raise singular(steps.first, status)
        for i, row in enumerate(rows):
            k = (first + 1 + i) * run.every
            made[first + 1 + i] = _in_space(frame, k, steps, row, dz)
        if steps.first + steps.count == run.steps and run.steps % run.every:
            made[-1] = _in_space(frame, run.steps, steps, tangents, dz)
    warn_of_growth(stepper, made[-1], dz[: 2 * n], start.names)
    return TangentRows(made[:, :n], made[:, n:], start.names, dz[: 2 * n])


def with_tangents(
    stepper: Stepper, run: RunArguments, wanted: Any, found: Trajectory
) -> Trajectory:
    """Return a trajectory with its tangents."""
    if not isinstance(wanted, Tangents):
        raise InputError(f"tangents = {shown(wanted)} are none; give gyrospark.Tangents(...).")
    if int(found.report.steps) != run.steps:
        raise InputError("A run that an event ends has no tangents; leave the terminal event out.")
    return replace(found, tangents=tangents_of(stepper, run, wanted))


def _in_space(frame: FrameMotion, k: int, steps: KeptSteps, row: Array, dz: Array) -> Array:
    if not frame.moves:
        return row
    z = np.concatenate([steps.q[k - steps.first], steps.p[k - steps.first]])
    found: Array = frame.matrix(k) @ row + frame.own_derivatives(k, z) @ dz
    return found


def pieces(stepper: Stepper, run: RunArguments, kept: Any) -> Any:
    """Yield the steps of a run, kept, a piece at a time."""
    while kept.done < run.steps:
        steps, status = kept.keep(min(_PIECE, run.steps - kept.done))
        if status:
            stepper.run(run)  # says why it fails, with everything before
            raise singular(kept.done, status)
        yield steps


def refuse_run(run: RunArguments) -> None:
    """Refuse runs whose steps are not all alike."""
    if run.follow is not None:
        raise InputError("A frame that follows the motion has no derivatives; give rates of the "
                         "frame, or frame = \"start\".")
    if run.stored_steps is not None:
        raise InputError("There are no derivatives at t_eval; leave t_eval out, and give every.")
    if run.solver == "python":
        raise InputError("solver = 'python' has no derivatives; choose auto, newton or "
                         "fixed-point.")
    if run.tolerance is not None:
        raise InputError(f"tolerance = {run.tolerance} stops a step before its equations hold, and "
                         "derivatives are those of the equations; leave tolerance out.")


def singular(step: int, status: int) -> GyrosparkError:
    """Return the error of a step whose equations cannot be linearised."""
    why = {2: "is singular", 3: "is not finite"}.get(status, f"fails with status {status}")
    return GyrosparkError(f"The Jacobian of a step from step {step} on {why}, so that there are no "
                          "derivatives; take a smaller dt.")


def warn_of_growth(stepper: Stepper, end: Array, start: Array, names: list[str]) -> None:
    """Warn where the tangents of the start have grown by more than their digits."""
    own = [k for k, name in enumerate(names) if name.startswith("start[")]
    if not own:
        return
    before, after = (np.linalg.norm(x[:, own].astype(float), axis=0) for x in (start, end))
    growth = float((after / np.where(before > 0, before, 1)).max())
    if growth * float(stepper.binding.epsilon) > _LOST:
        warn(f"Directions of the start have grown {growth:.1e} times: of these derivatives at most "
             f"{max(0, -int(np.log10(growth * float(stepper.binding.epsilon)))):d} digits are "
             "left. Take a shorter run, or real=\"float128\".")
