"""A frame that follows a motion which changes for good, such as that of a body with drag.

    {"frame": "follow"}        rates chosen anew every 100 steps
    {"frame": "follow 50"}     every 50 steps

At the start of each block of steps the rates are the least squares of the state there
(``frame_start``), and the frame begins to turn there: angles are counted from the start of the
block. What a block moves with is kept in the memory of the run, so that a stored run goes on with
the bits of an uninterrupted one.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...core.arguments import shown
from ...core.errors import InputError, StepFailed, Stopped
from ...core.exact_numbers import Number
from ...core.warnings import listening
from ..bindings.array_checks import as_positive_count
from ..bindings.inputs import Inputs, as_inputs
from ..tuning.frame_choice import asks_for_frame, start_frame, with_frame
from ..tuning.frame_pilots import AGREES, CLEAR, SMALL
from ..tuning.gamma_choice import PILOT_STEPS
from ..tuning.motion_distance import MotionError

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper
    from .step_loop import Run

__all__ = ["Follow", "followed"]

Array = NDArray[Any]

#: What ``parameters["frame"]`` begins with; steps of a block where nothing is said.
FOLLOW, _HOLD = "follow", 100
_FOLLOW = re.compile(rf"{FOLLOW}(?: +([1-9][0-9]{{0,17}}))?")
#: By how much a frame that stays must be better over short runs, which see little of a change.
_FAR = 3.0
#: Estimate of round-off, in ε of 1.
_ROUNDING = 8.0


@dataclass(frozen=True)
class Follow:
    """Rates that hold for so many steps, and then are chosen anew."""

    stepper: Stepper
    hold: int

    def __str__(self) -> str:
        return f"{FOLLOW} {self.hold}"

    def left(self, done: int) -> int:
        """Return how many steps of a block are left after so many of the run."""
        return self.hold - done % self.hold

    def parameters(self, run: Run, done: int, q: Array, p: Array, work: Any) -> Any:
        """Return what compiled code goes on with from (q, p), after so many steps of a run."""
        binding = self.stepper.binding
        made = binding.parameters(run.parameters, run.t0)
        if done % self.hold:
            binding.function("frame_parameters")(work, made)
            return made
        rates = {symmetry.name for symmetry in self.stepper.symmetries}
        others = {name: x for name, x in run.at_step(done).parameters.items() if name not in rates}
        found = start_frame(self.stepper, q, p, others, dt=run.dt, t0=run.t0 + done * run.dt,
                            warn=False)
        return binding.parameters(run.parameters | found, run.t0)


def followed(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, *, dt: Number, steps: Any, parameters: Any,
    t0: Number = 0.0, inputs: Any = None, hold: int = 1,
) -> tuple[Any, Follow | None]:
    """Return the parameters of a run, and how its frame follows its motion where they ask for it.

    Where forces act, "auto" follows if short runs show that to be better than no frame by 5 %. A
    frame that stays is taken where it is better by far, or following is not; but only if the short
    runs are as long as the run, for forces may take the motion where that frame harms.

    Raises
    ------
    InputError
        For a block of no steps.
    """
    if not isinstance(parameters, Mapping) or not asks_for_frame(stepper, parameters):
        return parameters, None
    given = any(symmetry.name in parameters for symmetry in stepper.symmetries)
    if parameters["frame"] == "auto" and stepper.binding.has_forces and not given:
        parameters = _of_forced(stepper, q, p, dt, as_positive_count("steps", steps), t0,
                                parameters, inputs, hold)
    return parameters, _said(stepper, parameters.get("frame"))


def _of_forced(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, dt: Number, steps: int, t0: Number,
    parameters: Mapping[str, Any], inputs: Any, hold: int,
) -> Mapping[str, Any]:
    """Return the parameters that "auto" stands for where forces act."""
    none = {name: x for name, x in parameters.items() if name != "frame"}
    follows = {**parameters, "frame": FOLLOW}
    choices = [none, follows]
    if steps <= PILOT_STEPS:
        choices.append(with_frame(stepper, q, p, dt=dt, steps=steps, parameters=parameters, t0=t0,
                                  inputs=inputs, hold=hold))
    run = min(max(steps, 8), PILOT_STEPS)
    fed = as_inputs(inputs, stepper.binding, steps, hold) if steps else None
    with listening():  # what is chosen says it again
        pilots = _Pilots(stepper, q, p, dt, run, t0, None if fed is None else fed.of_steps(run))
        errors, doubt = pilots.errors(choices)
    clear = [bool((CLEAR * (error + doubt) <= errors[0] - doubt).all()) for error in errors]
    if len(choices) > 2 and clear[2] and not (clear[1] and errors[1][0] <= _FAR * errors[2][0]):
        return choices[2]
    return follows if clear[1] else none


def _said(stepper: Stepper, frame: Any) -> Follow | None:
    if not isinstance(frame, str) or not frame.startswith(FOLLOW):
        return None
    found = _FOLLOW.fullmatch(frame)
    if found is None:
        raise InputError(f"frame = {shown(frame)} is no way to follow; write 'follow', or 'follow "
                         "50' for rates that are chosen anew every 50 steps.")
    return Follow(stepper, int(found[1] or _HOLD))


@dataclass(frozen=True)
class _Pilots:
    """Short runs in frames that follow, that stay, and without any."""

    stepper: Stepper
    q: ArrayLike
    p: ArrayLike
    dt: Number
    steps: int
    t0: Number
    inputs: Inputs | None

    def run(self, parameters: Any, finer: int = 1) -> Array | None:
        """Return q of a run, with steps so many times finer; None where a step failed."""
        numbers = {**parameters, **{name: "m" for name, x in parameters.items()
                                    if name != "frame" and isinstance(x, str)}}
        try:
            with listening():  # what is to be said is said of the run that is asked for
                return np.asarray(self.stepper.integrate(
                    self.q, self.p, dt=self.dt / finer, steps=self.steps * finer, every=finer,
                    t0=self.t0, parameters=numbers, hold=finer,
                    inputs=None if self.inputs is None else self.inputs.values[0]).q)
        except StepFailed:
            return None
        except Stopped as stopped:  # its trajectory is a pilot's
            raise Stopped("Stopped before the first step, while the frame was chosen.",
                          stopped.signal) from None

    def errors(self, choices: list[Any]) -> tuple[list[Array], float]:
        """Return the errors over all of the run and its second half, and that of the reference.

        It is that of a frame which follows with an eighth of the step, if it agrees with the one
        without a frame as far as that can tell; infinite errors where a run fails.
        """
        slow = {**choices[1], "frame": f"{FOLLOW} {8 * _HOLD}"}
        none, moved = ([self.run(choice, finer) for finer in (4, 8)] for choice in (choices[0],
                                                                                 slow))
        exact, change = none[1], math.inf
        if none[0] is not None and none[1] is not None:
            change = float(_sizes(MotionError(none[1], _as_floats(none[1])), none[0])[0])
        doubt = change
        if moved[0] is not None and moved[1] is not None:
            error = MotionError(moved[1], _as_floats(moved[1]))
            own = float(_sizes(error, moved[0])[0])
            apart, still = (_sizes(error, q)[0] for q in (exact, self.run(choices[0])))
            if exact is None or (own < change
                                 and apart <= max(AGREES * change, SMALL * still)):
                exact, doubt = moved[1], own
        if exact is None:
            return [np.zeros(2) for _ in choices], math.inf
        error = MotionError(exact, _as_floats(exact))
        return [_sizes(error, self.run(choice)) for choice in choices], (
            doubt / 2**self.stepper.order + _ROUNDING * self.stepper.binding.epsilon)


def _sizes(error: MotionError, q: Array | None) -> Array:
    """Return the root mean square error over all of a run and over its second half."""
    if q is None:
        return np.full(2, math.inf)
    squares = (error(q) ** 2).sum(axis=1)
    return np.sqrt([squares.mean(), squares[len(squares) // 2 :].mean()])


def _as_floats(q: Array) -> Array:
    return np.asarray(q, dtype=float)
