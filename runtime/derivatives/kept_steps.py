"""Steps of a run that are kept for their derivatives: piece by piece, or a single one."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.errors import GyrosparkError, InputError
from ...core.incompatibilities import refuse_together
from ...core.registry import function_of
from ...core.warnings import warn
from ..integration.run_arguments import RunArguments
from .binding import ImpactStep, KeptSteps
from .frame import FrameMotion

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["PIECE", "SingleStep", "linearisation_error", "multiplier_shape", "number_bytes",
           "part_sizes", "pieces", "refuse_run", "split", "step_bytes", "warn_of_growth",
           "warn_of_jumps"]

#: Steps that are kept at a time.
PIECE = 512
#: Growth beyond which a derivative has lost its digits, in 1/ε.
_LOST = 1e-3


def pieces(stepper: Stepper, run: RunArguments, kept_run: Any) -> Iterator[KeptSteps]:
    """Yield the steps of a run from the first on, at most ``PIECE`` at a time.

    ``kept_run``, a ``KeptRun`` at the start of the run, takes the steps before the first impact;
    after each step with impacts another one begins. Such a step is a piece of its own, an
    ``ImpactStep``. Raises StepFailed as the run itself does.
    """
    # impacts.py imports this module
    impact_step = function_of("runtime.derivatives.impacts", "impact_step")
    between_impacts = kept_run
    for step in [*run.impact_steps, run.steps]:
        while between_impacts.steps_done < step:
            steps, status = between_impacts.keep(min(PIECE, step - between_impacts.steps_done))
            if status:
                _raise_failure(stepper, run, between_impacts.steps_done, status)
            yield steps
        # a step with impacts consists of partial steps and jumps, which are linearised one by one
        if step < run.steps:
            state = between_impacts.state
            impacts = impact_step(stepper, run, step, state.q.copy(), state.p.copy())
            yield impacts
            (_, q_end), (_, p_end) = impacts.q, impacts.p
            between_impacts = kept_run.binding.begin(
                run.continue_from(step + 1, q_end, p_end), step + 1)


def _raise_failure(stepper: Stepper, run: RunArguments, step: int, status: int) -> NoReturn:
    """Raise the error of a step that failed: StepFailed with all before it, if the run fails."""
    stepper._run(run)
    raise linearisation_error(step, status)


def split(steps: KeptSteps, boundaries: Array) -> list[KeptSteps]:
    """Return kept steps in parts that begin at ``boundaries``, rising indices of the run's steps.

    Boundaries outside are left out. Parts share the memory of ``steps``, and the state between two
    of them is in both.
    """
    if isinstance(steps, ImpactStep):  # one step alone
        return [steps]
    inside = boundaries[(boundaries > steps.first)
                        & (boundaries < steps.first + steps.count)] - steps.first
    bounds = [0, *inside.tolist(), steps.count]
    return [KeptSteps(steps.first + a, steps.q[a : b + 1], steps.p[a : b + 1], steps.x[a:b])
            for a, b in pairwise(bounds)]


def refuse_run(run: RunArguments) -> None:
    """Refuse runs whose steps do not solve their equations."""
    refuse_together(derivatives="derivatives",
                    tolerance=run.tolerance is not None and f"tolerance = {run.tolerance}")


def number_bytes(stepper: Stepper) -> int:
    """Return the bytes of a number of the stepper's type."""
    binding = stepper.binding
    # arrays of float128 hold Python objects, whose numbers have 16 bytes in C as long doubles have
    is_wide = binding.c_type not in ("float", "double")
    return 16 if is_wide else np.dtype(binding.dtype).itemsize


def step_bytes(stepper: Stepper) -> int:
    """Return the bytes of a kept step: q, p and the unknowns x."""
    return (2 * stepper.binding.n + stepper.unknowns) * number_bytes(stepper)


def multiplier_shape(stepper: Stepper) -> tuple[int, ...]:
    """Return the shape of a step's multipliers: (nodes, m), or (nodes,) for one constraint.

    Raises InputError where the system has no constraints.
    """
    if not stepper.m:
        raise InputError("Derivatives of multipliers are asked for, and this system has no "
                         "constraints; leave multipliers out.")
    nodes = stepper.binding.multipliers // stepper.m
    return (nodes, stepper.m) if stepper.m > 1 else (nodes,)


def linearisation_error(step: int, status: int) -> GyrosparkError:
    """Return the error of a step whose equations cannot be linearised."""
    why = {2: "is singular", 3: "is not finite"}.get(status, f"fails with status {status}")
    return GyrosparkError(f"The Jacobian of a step from step {step} on {why}, so that there are no "
                          "derivatives; take a smaller dt.")


def part_sizes(z: Array) -> Array:
    """Return the Euclidean norms of the rows of q and of p, (2,) or (2, k), of (2 n,) or (2 n, k).
    """
    return np.array([np.linalg.norm(half.astype(float), axis=0) for half in np.split(z, 2)])


def warn_of_growth(stepper: Stepper, subject: str, before: Array, after: Array) -> None:
    """Warn where derivatives have grown by so much that few of their digits are left.

    ``before`` and ``after`` are ``part_sizes`` of them, ``subject`` the beginning of the sentence.
    Round-off grows with them, to growth · ε. The two parts have units of their own: the one that
    grows less counts.
    """
    ratios = np.divide(after, before, out=np.full(after.shape, np.inf), where=before > 0).min(0)
    growth = float(ratios[np.isfinite(ratios)].max(initial=0))
    lost = growth * float(stepper.binding.epsilon)
    if lost > _LOST:
        warn(f"{subject} grown {growth:.1e} times: of these derivatives at most "
             f"{max(0, -int(np.log10(lost))):d} digits are left. Take a shorter run, or "
             "real=\"float128\".")


def warn_of_jumps(stepper: Stepper, switched: int) -> None:
    """Warn of derivatives over ``switched`` > 0 steps with a switch in them, if forces jump."""
    jumps = stepper.manifest.system.jumps  # where forces jump, as text; "" if nowhere
    if switched and jumps:
        warn(f"A switch lies within {count_text(switched, 'step')}, and forces jump "
             f"at {jumps}: these derivatives are those of the discrete run, and lack what the time "
             "of a jump contributes.")


class SingleStep:
    """One step from a state in space, and its derivatives by all rows of a direction.

    Attributes
    ----------
    end : array, shape (2 n,)
        The state (q, p) after the step, in space.
    unknowns : array, shape (unknowns,)
        The solution x of its equations, in the frame.
    """

    def __init__(self, stepper: Stepper, run: RunArguments) -> None:
        """Take the one step of ``run``, and keep its end and unknowns for derivatives."""
        refuse_run(run)
        self._binding, self._run = stepper._derivative_binding(), run
        kept_run = self._binding.begin(run)
        (steps,) = pieces(stepper, run, kept_run)
        self.parameters = kept_run.parameters
        self.unknowns = steps.x[0].copy()
        # the step is solved in the frame, where it ends at z₁ (``_in_frame``); the frame
        # itself moves by the matrix S = S(1) in one step, so that the end in space is S z₁
        self._in_frame = np.concatenate([steps.q[1], steps.p[1]])
        self._frame = FrameMotion(self._binding, stepper.symmetries, run)
        self.end = (self._frame.matrix(k=1) @ self._in_frame if self._frame.moves
                    else self._in_frame.copy())

    def tangent(self, dz: Array, multipliers: bool = False) -> Array:
        """Return the directions of the end, shape (2 n, k), from directions dz, (rows, k).

        In space the end is S z₁, with S the motion of the frame in the step: its direction is
        S dz₁ + dS z₁. With ``multipliers`` the directions of the step's multipliers follow, as
        further rows.
        """
        run, binding = self._run, self._binding.module
        forces = binding.new(binding.multipliers if multipliers else 0, dz.shape[1])
        status, end_directions = self._binding.tangent(
            self.parameters, run.dt, run.q, run.p, self.unknowns, np.ascontiguousarray(dz), forces)
        if status:
            raise linearisation_error(step=0, status=status)
        if self._frame.moves:
            end_directions = (self._frame.matrix(k=1) @ end_directions
                              + self._frame.own_derivatives(k=1, z=self._in_frame) @ dz)
        directions: Array = np.concatenate([end_directions, forces])
        return directions

    def adjoint(self, w: Array, multipliers: Array | None = None) -> Array:
        """Return the cotangent z̄ = Φ'ᵀ Sᵀ w + (dS z₁)ᵀ w, (rows,), by the transpose of ``tangent``.

        Φ' is the derivative of the step in the frame, z₁ its end there, S the motion of the frame
        in the step. ``w``, (2 n,), is the cotangent of the end in space; ``multipliers`` is the
        cotangent of the step's multipliers, or None.
        """
        run = self._run
        # an empty array stands for no cotangents of multipliers
        if multipliers is None:
            multipliers = self._binding.module.new(0)
        else:
            self._frame.refuse_rotating_multipliers(run)
        w_in_frame = self._frame.matrix(k=1).T @ w if self._frame.moves else w
        status, z_bar = self._binding.adjoint(
            self.parameters, run.dt, run.q, run.p, self.unknowns,
            np.ascontiguousarray(w_in_frame), multipliers)
        if status:
            raise linearisation_error(step=0, status=status)
        if self._frame.moves:
            z_bar += self._frame.own_derivatives(k=1, z=self._in_frame).T @ w
        return z_bar
