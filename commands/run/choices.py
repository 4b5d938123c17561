"""Choices of a run: time step, γ and α of ``--gamma`` and ``--alpha``, the ``--frame``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ...core.arguments import listed, proposal
from ...core.errors import InputError
from ...core.exact_numbers import Rounded, decimal
from ...core.registry import AIMS, MEANS, RULES
from ..options import real_number, whole_number

if TYPE_CHECKING:
    from ...core.registry import Aim
    from ...runtime.steppers.run_defaults import RunDefaults
    from ...runtime.steppers.stepper import Stepper
    from ...runtime.tuning.gamma_choice import GammaChoice

__all__ = ["ChosenFrame", "aim_of", "frame_for", "gamma_for", "parameters_for", "step_for"]


def parameters_for(
    step: Stepper, start: RunDefaults, gamma: str | None, alpha: str | None
) -> dict[str, float]:
    """Return the parameters, with γ and α of every body as the options say; auto starts from m.

    Without an option the model's own value or rule counts, and m where it has none.
    """
    given = {"gamma": gamma, "alpha": alpha}
    bodies = {name: inertia for name, inertia in start.bodies.items()
              if name in step.parameter_domains}
    kinds = {name: "alpha" if "alpha" in name else "gamma" for name in bodies}
    for kind, other in (("gamma", "alpha"), ("alpha", "gamma")):
        if given[kind] is not None and kind not in kinds.values():
            raise InputError(
                f"--{kind} does not go with --rep {other}; give --{other} instead." if kinds else
                f"--{kind} is given, and {start.name} has no body with a {kind}; leave it out."
            )
    known = {name: value for name, value in start.parameters.items()
             if name in step.parameter_domains}
    for name, inertia in bodies.items():
        option = given[kinds[name]]
        if option is not None or name not in known:
            rule = option or start.rules.get(name, "m")
            known[name] = inertia_parameter(kinds[name], "m" if rule in AIMS else rule, inertia)
    return known


def aim_of(
    start: RunDefaults, parameters: dict[str, float], option: str | None, *, unnamed: bool
) -> Aim | None:
    """Return what γ is searched for, if it is: by the option, else by the model's own rules.

    Where no scheme is named nothing is, and the best known is taken: γ of a single body by pilot
    runs, which stay with γ_m where they are not sure.
    """
    rules = (option,) if option else tuple(start.rules.values())
    free = set(start.bodies) & set(parameters) - set(start.parameters)
    if unnamed and not rules and len(free) == 1:
        return "motion"
    return next((AIMS[rule] for rule in rules if rule in AIMS), None)


def gamma_for(
    step: Stepper, start: RunDefaults, state: tuple[Any, Any, float], dt: float, steps: int,
    parameters: dict[str, float], aim: Aim | None,
) -> GammaChoice | None:
    """Return the choice of γ or α with this aim, made on pilot runs no longer than the run."""
    from ...runtime.tuning.gamma_choice import PILOT_STEPS, choose_gamma

    if aim is None:
        return None
    bodies = {name: inertia for name, inertia in start.bodies.items() if name in parameters}
    q0, p0, t0 = state
    return choose_gamma(step, q0, p0, dt=dt, t0=t0, parameters=parameters, bodies=bodies, aim=aim,
                        steps=min(max(steps, 2), PILOT_STEPS), run_steps=steps)


def inertia_parameter(name: str, text: str, inertia: Sequence[float]) -> float:
    """Return γ or α from the name of a mean, or a number."""
    if text in MEANS:
        from ...runtime.rigid_body.gamma_rules import mean_inertia

        return mean_inertia(inertia, text)
    value = decimal(text)
    if value is None:
        choices = listed([*RULES, "a number"])
        raise InputError(f"--{name} {text!r} is none of {choices}.")
    value = value if isinstance(value, float) else Rounded(value)
    if not math.isfinite(value) or value == 0:
        raise InputError(f"--{name} {text!r} is not usable; give a finite number other than 0.")
    return value


@dataclass(frozen=True)
class ChosenFrame:
    """The rates of a run, γ where it was searched for with them, and what is reported.

    The rates are those of the start where the frame follows the motion.
    """

    values: dict[str, Any]
    about: dict[str, Any]
    has_gamma: bool = False


def frame_for(
    step: Stepper, start: RunDefaults, state: tuple[Any, Any, float], dt: float, steps: int,
    parameters: dict[str, float], options: tuple[str, ...], aim: Aim | None,
) -> ChosenFrame | None:
    """Return the frame that the options ask for, or a model file without any.

    Raises
    ------
    InputError
        For what is no frame of the stepper.
    """
    if not step.symmetries:
        return None
    mode = options[0] if len(options) == 1 else "start" if not options else ""
    if mode not in ("auto", "start") and not mode.startswith("follow"):
        values = _rates(step, options)
        return ChosenFrame(values, {"frame": values})
    from ...runtime.integration.frame_following import follow_frame
    from ...runtime.tuning.frame_choice import choose_frame, start_frame
    from ...runtime.tuning.gamma_choice import PILOT_STEPS

    q0, p0, t0 = state
    asked = follow_frame(step, step.run_arguments(q0, p0, dt=dt, steps=steps, t0=t0,
                                                  parameters={**parameters, "frame": mode}))
    forced, follow = asked.parameters, asked.follow
    if follow is not None:  # the run says what is to be warned of
        return ChosenFrame({"frame": str(follow)}, {
            "frame": start_frame(step, q0, p0, parameters, dt=dt, t0=t0, quiet=True),
            "frame_reason": f"{follow} steps"})
    if mode == "start":
        values = start_frame(step, q0, p0, parameters, dt=dt, t0=t0)
        return ChosenFrame(values, {"frame": values})
    if "frame" not in forced:  # forces act
        values = {symmetry.name: forced.get(symmetry.name, 0.0) for symmetry in step.symmetries}
        return ChosenFrame(values, {"frame": values})
    bodies = {name: inertia for name, inertia in start.bodies.items()
              if name in parameters} if aim == "motion" else {}
    found = choose_frame(step, q0, p0, dt=dt, t0=t0, parameters=parameters, bodies=bodies,
                         steps=min(max(steps, 8), PILOT_STEPS))
    return ChosenFrame(found.values, {
        "frame": found.frame, "frame_expected_gain": found.expected_gain,
        "frame_measured_gain": found.measured_gain, "frame_reason": found.reason, **found.gammas,
    }, has_gamma=bool(found.gammas))


def _rates(step: Stepper, options: tuple[str, ...]) -> dict[str, float]:
    """Return the rates that options name."""
    names = [symmetry.name for symmetry in step.symmetries]
    found = {}
    for option in (part for text in options for part in text.split(",")):
        name, sign, value = option.partition("=")
        if not sign or name.strip() not in names:
            raise InputError(f"--frame {option!r} is no frame of {step.name}; write auto, start, "
                             f"follow or NAME=RATE with NAME among {listed(names)}"
                             f"{proposal(name.strip(), names)}.")
        found[name.strip()] = real_number(f"--frame {name.strip()}", value.strip())
    return found


def step_for(
    step: Stepper, start: RunDefaults, arguments: dict[str, Any], given: Mapping[str, str | None],
    nearest: bool,
) -> tuple[Any, int, dict[str, Any]]:
    """Return dt, the number of steps, and what was measured if --dt is auto.

    ``arguments`` are those of the run that are known, ``given`` the options dt, error, steps and
    t_end; ``nearest`` takes the step next to t_end.
    """
    if given["dt"] == "auto":
        return _chosen(step, arguments, given)
    if given["error"] is not None:
        raise InputError(f"--error {given['error']} is for --dt auto; give it as well, or leave "
                         "--error away.")
    dt = _step_size(given["dt"], start)
    return dt, _step_count(given["steps"], given["t_end"], start, dt,
                           arguments["t0"], nearest), {}


def _chosen(
    step: Stepper, arguments: dict[str, Any], given: Mapping[str, str | None],
) -> tuple[Any, int, dict[str, Any]]:
    """Return the step that pilot runs have found, without a frame and with the γ that there is."""
    from ...runtime.tuning.step_choice import choose_dt

    if given["steps"] is not None or given["error"] is None or given["t_end"] is None:
        raise InputError("--dt auto chooses the number of steps; give --error and --t-end, such as "
                         "--error 1e-9 --t-end 1, and no --steps.")
    if step.symmetries:
        raise InputError("--dt auto is measured without a frame, which allows larger steps; give "
                         "--dt with --frame.")
    found = choose_dt(step, **arguments, error=real_number("--error", given["error"]),
                      t_end=real_number("--t-end", given["t_end"]))
    return found.dt, found.steps, {
        "dt_error": found.error,
        "dt_pilots": [{"steps": pilot.steps, "error": pilot.error if pilot.converged else None}
                      for pilot in found.pilots],
    }


def _step_size(option: str | None, start: RunDefaults) -> float:
    """Return the time step of the option, or the model's own."""
    if option is None and start.dt is None:
        raise InputError(f"--dt is not given and {start.name} names none; write for example "
                         "--dt 1e-3.")
    return real_number("--dt", option) if option is not None else start.dt or 0.0


def _step_count(
    steps: str | None, t_end: str | None, start: RunDefaults, dt: float, t0: float, nearest: bool
) -> int:
    """Return the number of steps of the option, up to the time of the other, or the model's own."""
    from ...runtime.integration.run_arguments import step_count

    if t_end is not None:
        if steps is not None:
            raise InputError(f"--steps {steps} and --t-end {t_end} are both given; give one.")
        return step_count(None, real_number("--t-end", t_end), t0, dt, nearest)
    if nearest:
        raise InputError("--round is for --t-end, the time of the last state; give that, or leave "
                         "--round away.")
    if steps is None and start.steps is None:
        raise InputError(f"--steps is not given and {start.name} names none; write for example "
                         "--steps 1000, or --t-end 1.")
    return whole_number("--steps", steps) if steps is not None else int(start.steps or 0)
