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

from ...errors import InputError, StepFailed, Stopped
from ...exact import Number
from ...naming import shown
from ...remarks import listening
from ..call.checks import as_positive_count
from ..choice.frame_choice import asks_for_frame, start_frame, with_frame
from ..choice.gamma_choice import PILOT_STEPS
from ..choice.motion_error import MotionError

if TYPE_CHECKING:
    from ..run.stepper import Stepper
    from .integration import Run

__all__ = ["Follow", "followed"]

Array = NDArray[Any]

#: What ``parameters["frame"]`` begins with; steps of a block where nothing is said.
FOLLOW, _HOLD = "follow", 100
_FOLLOW = re.compile(rf"{FOLLOW}(?: +([1-9][0-9]{{0,17}}))?")
#: By how much a frame that stays must be better over short runs, which see little of a change.
_FAR = 3.0


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
            binding.function("moving")(work, made)
            return made
        rates = {symmetry.name for symmetry in self.stepper.symmetries}
        others = {name: x for name, x in run.parameters.items() if name not in rates}
        return binding.parameters(run.parameters | start_frame(self.stepper, q, p, others), run.t0)


def followed(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, *, dt: Number, steps: Any, parameters: Any,
    t0: Number = 0.0,
) -> tuple[Any, Follow | None]:
    """Return the parameters of a run, and how its frame follows its motion where they ask for it.

    Where forces act, "auto" follows unless short runs show a frame that does not to be better by
    far: it sees no more of the motion than they do.

    Raises
    ------
    InputError
        For a block of no steps.
    """
    if not isinstance(parameters, Mapping) or not asks_for_frame(stepper, parameters):
        return parameters, None
    given = any(symmetry.name in parameters for symmetry in stepper.symmetries)
    if parameters["frame"] == "auto" and stepper.binding.has_forces and not given:
        fixed = with_frame(stepper, q, p, dt=dt, steps=steps, parameters=parameters, t0=t0)
        follows = {**parameters, "frame": FOLLOW}
        run = min(max(as_positive_count("steps", steps), 8), PILOT_STEPS)
        errors = _errors(stepper, q, p, dt, run, t0, [follows, fixed])
        parameters = follows if errors[0] <= _FAR * errors[1] else fixed
    return parameters, _said(stepper, parameters.get("frame"))


def _said(stepper: Stepper, frame: Any) -> Follow | None:
    if not isinstance(frame, str) or not frame.startswith(FOLLOW):
        return None
    found = _FOLLOW.fullmatch(frame)
    if found is None:
        raise InputError(f"frame = {shown(frame)} is no way to follow; write 'follow', or 'follow "
                         "50' for rates that are chosen anew every 50 steps.")
    return Follow(stepper, int(found[1] or _HOLD))


def _errors(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, dt: Number, steps: int, t0: Number,
    choices: list[Any],
) -> list[float]:
    """Return the errors of short runs beside one of an eighth of the step; infinite if one fails.
    """
    def run(parameters: Any, finer: int = 1) -> Array | None:
        numbers = {**parameters, **{name: "m" for name, x in parameters.items()
                                    if name != "frame" and isinstance(x, str)}}
        try:
            with listening():  # what is to be said is said of the run that is asked for
                return np.asarray(stepper.integrate(
                    q, p, dt=dt / finer, steps=steps * finer, every=finer, t0=t0,
                    parameters=numbers).q)
        except StepFailed:
            return None
        except Stopped as stopped:  # its trajectory is a pilot's
            raise Stopped("Stopped before the first step, while the frame was chosen.",
                          stopped.signal) from None

    exact = run({**choices[0], "frame": f"{FOLLOW} {8 * _HOLD}"}, 8)
    if exact is None:
        return [0.0 for _ in choices]
    error = MotionError(exact, np.asarray(exact, dtype=float))
    found = [run(parameters) for parameters in choices]
    return [math.inf if one is None else float(np.sqrt((error(one) ** 2).sum(axis=1).mean()))
            for one in found]
