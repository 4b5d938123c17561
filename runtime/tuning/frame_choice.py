"""The rates of a co-moving frame, and γ with them, chosen by measurement.

``parameters["frame"]`` may be "start", the least squares of the start, "auto", a search, or
"follow", the least squares of each block of steps (``integration/frame_following.py``).

    frame_start     least squares
    frame_search    the runs, their errors, lines of the spectrum, and what is chosen
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from ...core.arguments import as_mapping, choose, shown
from ...core.errors import InputError
from ...core.exact_numbers import Number
from ...core.frozen_dict import NO_PARAMETERS
from ...core.interrupts import before_start
from ...core.registry import AIMS
from ...core.warnings import warn
from ..bindings.array_checks import as_positive_count
from ..rigid_body.gamma_rules import gamma_by_rule, known_inertia, mean_inertia, principal_moments
from .frame_search import FrameChoice, FramePilots, FrameSearch
from .frame_start import Velocities, directions_of, start_rates
from .gamma_choice import PILOT_STEPS, with_gamma

if TYPE_CHECKING:
    from ..integration.run_arguments import RunArguments
    from ..steppers.stepper import Stepper

__all__ = ["FRAME_CHOICES", "asks_for_frame", "choose_frame", "choose_parameters",
           "search_frame", "start_frame", "with_frame"]

#: What ``parameters["frame"]`` may say.
FRAME_CHOICES = ("start", "auto", "follow")


def choose_frame(
    stepper: Stepper,
    q: ArrayLike,
    p: ArrayLike,
    *,
    dt: Number,
    parameters: Mapping[str, Any] = NO_PARAMETERS,
    bodies: Mapping[str, Sequence[float]] | None = None,
    steps: int = PILOT_STEPS,
    t0: Number = 0.0,
    inputs: Any = None,
    hold: int = 1,
) -> FrameChoice:
    """Return the rates of the co-moving frame that makes the error of runs from (q, p) smallest.

    Parameters
    ----------
    stepper : Stepper
        Made with ``frame="symmetries"``.
    q, p : array_like, shape (n,)
        The start; the choice is for this motion.
    dt : float
        The time step the choice is for, in s.
    parameters : mapping
        The stepper's other parameters; rates among them are not looked at.
    bodies : mapping of str to three floats, optional
        Name of each γ to choose as well → I₁, I₂, I₃ of its body in kg m². By default the
        parameters whose value is ``"auto"``, with the moments that stand beside them.
    steps : int
        Length of the pilot runs, at least 8. They should see the motion's slowest period.
    t0 : float
        Time at the start, for forces that depend on it.
    inputs, hold
        Those of ``integrate`` for as many steps; pilots run with them.

    Raises
    ------
    InputError
        For a stepper without symmetries, or unusable arguments.
    StepFailed
        If the steps converge with nothing that was tried.

    Examples
    --------
    >>> import gyrospark as gs
    >>> step = gs.stepper("G-L", stages=3, frame="symmetries")
    >>> top = gs.problems.fast_top()
    >>> parameters = top.parameters | {"gamma": gs.gamma(top.inertia)}
    >>> choice = gs.choose_frame(step, top.q0, top.p0, dt=1e-3, parameters=parameters)
    >>> parameters = parameters | choice.values
    """
    _usable(stepper, parameters)
    count = as_positive_count("steps", steps, least=8)
    return search_frame(stepper, stepper.run_arguments(
        q, p, dt=dt, steps=count, parameters=parameters, t0=t0, inputs=inputs, hold=hold), bodies)


def search_frame(
    stepper: Stepper, run: RunArguments, bodies: Mapping[str, Sequence[float]] | None = None
) -> FrameChoice:
    """Return the choice for a run by pilots as long as it is; see ``choose_frame``."""
    rates = {symmetry.name for symmetry in stepper.symmetries}
    known = {name: value for name, value in _usable(stepper, run.parameters).items()
             if name not in rates}
    if bodies is None:
        bodies = {name: known_inertia(name, known) for name, value in known.items()
                  if isinstance(value, str) and value in AIMS}
    bodies = as_mapping("bodies", bodies, "{'gamma': (I1, I2, I3)}")
    for name in bodies:
        if name not in stepper.parameter_domains or name in rates:
            raise InputError(f"{stepper.name} has no parameter {name!r} to choose; it has "
                             f"{', '.join(stepper.parameter_domains)}.")
    numbers = {**known, **{name: "m" if name in known and known[name] in AIMS else
                           _mean_of(name, inertia) for name, inertia in bodies.items()}}
    run = replace(run.pilot(run.steps), parameters=numbers)
    stepper.checked_run(run)
    numbers = _without_rules(numbers)
    pilots = FramePilots(stepper, replace(run, parameters=numbers),
                         directions_of(stepper, run.q, run.p, numbers), bodies)
    return FrameSearch(pilots, Velocities(stepper, numbers, run.t0)).choice()


def start_frame(
    stepper: Stepper, q: ArrayLike, p: ArrayLike, parameters: Mapping[str, Any], *, dt: Number,
    t0: Number = 0.0, quiet: bool = False,
) -> dict[str, float]:
    """Return the rates of the least squares of a start, without a run.

    Directions along which the frame is faster than the motion have rate 0, with a warning.

    Raises
    ------
    InputError
        For a stepper without symmetries.
    """
    known = _without_rules(_usable(stepper, parameters))
    found = {symmetry.name: 0.0 for symmetry in stepper.symmetries}
    directions = directions_of(stepper, q, p, known)
    if not directions:
        return found
    rates, left_out = start_rates(Velocities(stepper, known, t0), directions, q, p, dt)
    for rate, direction in zip(rates.tolist(), directions, strict=True):
        for name, weight in direction.weights.items():
            found[name] += rate * weight
    if left_out and not quiet:
        names = ", ".join(name for i in left_out for name in directions[i].weights)
        warn(f"The state is so near an axis of symmetry that a frame along {names} would turn "
             "faster than the motion and enlarge its error: the rate is 0. frame = 'auto' "
             "chooses rates by measured errors; a rate that is given is used as it is.")
    return found


def with_frame(stepper: Stepper, run: RunArguments, *, quiet: bool = False) -> RunArguments:
    """Return a run with ``"frame"`` among its parameters replaced by the rates it stands for."""
    parameters: Any = run.parameters
    if not isinstance(parameters, dict) or not asks_for_frame(stepper, parameters):
        return run
    asked = parameters["frame"]
    follows = isinstance(asked, str) and asked.startswith("follow ")  # so many steps each
    mode = choose("frame among the parameters:", "follow" if follows else asked, FRAME_CHOICES)
    others = {name: value for name, value in parameters.items() if name != "frame"}
    given = [symmetry.name for symmetry in stepper.symmetries if symmetry.name in others]
    if given:
        raise InputError(f"Parameter {given[0]} is given besides frame = {mode!r}, which chooses "
                         "it; give one.")
    if mode in ("start", "follow"):
        rates = start_frame(stepper, run.q, run.p, others, dt=run.dt, t0=run.t0, quiet=quiet)
    else:
        pilot = run.pilot(min(max(run.steps, 8), PILOT_STEPS))
        with before_start("the frame"):
            rates = search_frame(stepper, replace(pilot, parameters=others)).values
    return replace(run, parameters=others | rates)


def choose_parameters(
    stepper: Stepper, run: RunArguments, *, quiet: bool = False
) -> RunArguments:
    """Return a run with all parameters that it leaves to be chosen: frame, then γ."""
    return with_gamma(stepper, with_frame(stepper, run, quiet=quiet))


def asks_for_frame(stepper: Stepper, parameters: Mapping[str, Any]) -> bool:
    """Whether ``"frame"`` among parameters asks for a choice: it is no parameter of the system."""
    return "frame" in parameters and "frame" not in stepper.parameter_domains


# ---------------------------------------------------------------- arguments


def _usable(stepper: Stepper, parameters: Any) -> dict[str, Any]:
    """Return the parameters, or refuse a stepper without a frame."""
    if not hasattr(stepper, "symmetries"):
        raise InputError(f"stepper = {shown(stepper)} is no stepper; make one with "
                         "gyrospark.stepper.")
    if not stepper.symmetries:
        raise InputError(f"{stepper.name} has no co-moving frame; make the stepper with "
                         "frame='symmetries'.")
    return dict(as_mapping("parameters", parameters, "{'mgl': 0.4}"))


def _without_rules(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters with numbers for rules, and γ_m for "auto"."""
    return {name: gamma_by_rule(name, "m" if value in AIMS else value, parameters)
            if isinstance(value, str) else value for name, value in parameters.items()}


def _mean_of(name: str, inertia: Any) -> float:
    return float(mean_inertia(principal_moments(inertia)))


