"""A frame that follows a motion with secular change, such as a body with drag.

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
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import shown
from ...core.errors import InputError, StepFailed
from ...core.interrupts import before_start
from ..tuning.frame_choice import asks_for_frame, start_frame, with_frame
from ..tuning.frame_search import AGREES, CLEAR, SMALL
from ..tuning.gamma_choice import PILOT_STEPS
from ..tuning.motion_distance import MotionError

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper
    from .run_arguments import RunArguments

__all__ = ["Follow", "follow_frame"]

Array = NDArray[Any]

#: What ``parameters["frame"]`` begins with; default number of steps of a block.
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

    def parameters(self, run: RunArguments, done: int, q: Array, p: Array, work: Any) -> Any:
        """Return what compiled code goes on with from (q, p), after so many steps of a run."""
        binding = self.stepper.binding
        made = binding.parameters(run.parameters, run.t0)
        if done % self.hold:
            binding.function("frame_parameters")(work, made)
            return made
        rates = {symmetry.name for symmetry in self.stepper.symmetries}
        others = {name: x for name, x in run.at_step(done).parameters.items() if name not in rates}
        found = start_frame(self.stepper, q, p, others, dt=run.dt, t0=run.t0 + done * run.dt,
                            quiet=True)
        return binding.parameters(run.parameters | found, run.t0)


def follow_frame(stepper: Stepper, run: RunArguments) -> RunArguments:
    """Return a run with a frame that follows its motion, where its parameters ask for one.

    Where forces act, "auto" follows if short runs show that to be better than no frame by 5 %. A
    frame that stays is taken where it is better by far, or following is not; but only if the short
    runs are as long as the run, for forces may take the motion where that frame harms.

    Raises
    ------
    InputError
        For a block of no steps.
    """
    parameters: Any = run.parameters
    if not isinstance(parameters, dict) or not asks_for_frame(stepper, parameters):
        return run
    given = any(symmetry.name in parameters for symmetry in stepper.symmetries)
    if parameters["frame"] == "auto" and stepper.binding.has_forces and not given:
        run = _of_forced(stepper, run)
    return replace(run, follow=_parsed_follow(stepper, run.parameters.get("frame")))


def _of_forced(stepper: Stepper, run: RunArguments) -> RunArguments:
    """Return a run with the frame that "auto" stands for where forces act."""
    none = {name: x for name, x in run.parameters.items() if name != "frame"}
    follows = {**run.parameters, "frame": FOLLOW}
    choices = [none, follows]
    if run.steps <= PILOT_STEPS:
        choices.append(with_frame(stepper, run).parameters)
    with before_start("the frame"):
        pilots = _Pilots(stepper, run.pilot(min(max(run.steps, 8), PILOT_STEPS)))
        errors, doubt = pilots.errors(choices)
    clear = [bool((CLEAR * (error + doubt) <= errors[0] - doubt).all()) for error in errors]
    if len(choices) > 2 and clear[2] and not (clear[1] and errors[1][0] <= _FAR * errors[2][0]):
        return replace(run, parameters=choices[2])
    return replace(run, parameters=follows if clear[1] else none)


def _parsed_follow(stepper: Stepper, frame: Any) -> Follow | None:
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
    arguments: RunArguments

    def run(self, parameters: Any, finer: int = 1) -> Array | None:
        """Return q of a run, with steps so many times finer; None where a step failed."""
        numbers = {**parameters, **{name: "m" for name, x in parameters.items()
                                    if name != "frame" and isinstance(x, str)}}
        run = replace(self.arguments.refined(finer), parameters=numbers)
        try:
            return np.asarray(self.stepper.run(self.stepper.resolved(run, quiet=True)).q)
        except StepFailed:
            return None

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
