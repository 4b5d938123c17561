"""Options of a run as arguments: γ, α, rates of a frame, the time step and the number of steps."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ...core.arguments import join_or, proposal
from ...core.errors import InputError
from ...core.exact_numbers import Rounded, decimal
from ...core.registry import AIMS, RULES
from ..options import real_number, whole_number

if TYPE_CHECKING:
    from ...core.start import Start
    from ...runtime.steppers.run_defaults import RunDefaults
    from ...runtime.steppers.stepper import Stepper
    from ...runtime.tuning.tune import Tuned

__all__ = ["check_span", "numbers_of_run", "steps_for", "with_options"]


def with_options(
    step: Stepper, start: RunDefaults, gamma: str | None, alpha: str | None,
    frames: tuple[str, ...],
) -> tuple[RunDefaults, dict[str, Any]]:
    """Return the numbers and rules of a run, and the arguments of ``gs.tune``.

    An option such as "auto" searches a number: it is an argument of ``gs.tune`` then.
    """
    texts = {"gamma": gamma, "alpha": alpha}
    # parameter, such as upper_gamma, → its kind
    kinds = {name: "alpha" if "alpha" in name else "gamma" for name in start.bodies
             if name in step.parameter_domains}
    # the representation of the stepper has γ or α, never both
    for kind, partner in (("gamma", "alpha"), ("alpha", "gamma")):
        if texts[kind] is not None and kind not in kinds.values():
            raise InputError(
                f"--{kind} does not go with --rep {partner}; give --{partner} instead."
                if kinds else
                f"--{kind} is given, and {start.name} has no body with a {kind}; leave it out."
            )
    numbers: dict[str, Any] = dict(start.parameters)
    rules, search = dict(start.rules), dict[str, Any]()
    for name, kind in kinds.items():
        option = texts[kind]
        if option in RULES:
            numbers.pop(name, None)  # a rule takes the place of the model's number
            rules[name] = option
        elif option is not None:
            numbers[name] = _inertia_parameter(kind, option)
        if option in AIMS:
            search |= {"gamma": "auto", "aim": AIMS[option]}
    if len(frames) == 1 and frames[0] in ("auto", "start"):
        search["frame"] = frames[0]
    else:
        numbers |= _rates(step, frames)
    return replace(start, parameters=numbers, rules=rules), search


def _inertia_parameter(name: str, text: str) -> float:
    """Return γ or α from the text of a number; InputError for 0 and for other texts.

    ``name`` is the option, gamma or alpha.
    """
    number = decimal(text)
    if number is None:
        raise InputError(f"--{name} {text!r} is none of {join_or([*RULES, 'a number'])}.")
    # all digits that are typed, for steppers of a type with more than a double has
    number = number if isinstance(number, float) else Rounded(number)
    if not math.isfinite(number) or number == 0:
        raise InputError(f"--{name} {text!r} is not usable; give a finite number other than 0.")
    return number


def _rates(step: Stepper, options: tuple[str, ...]) -> dict[str, float]:
    """Return the rates of a frame by name, in rad/s, from texts such as "omega_x=1,omega_y=2"."""
    names = [symmetry.name for symmetry in step.symmetries]
    rates = {}
    for option in (rate for text in options for rate in text.split(",")):
        name, sign, rate_text = option.partition("=")
        if not sign or name.strip() not in names:
            raise InputError(f"--frame {option!r} is no frame of {step.name}; write auto, start or "
                             f"NAME=RATE with NAME among {join_or(names)}"
                             f"{proposal(name.strip(), names)}.")
        rates[name.strip()] = real_number(f"--frame {name.strip()}", rate_text.strip())
    return rates


class RunNumbers(NamedTuple):
    """The start, the step and the length of a run."""

    start: Start
    step_size: Any  # dt, in scaled time dtau
    length: dict[str, Any]  # {"steps": ...} or {"t_end": ...}
    tuning: Tuned | None  # the result of ``gs.tune``, if it chose numbers


def numbers_of_run(
    step: Stepper, state: Start, defaults: RunDefaults, t0: float,
    options: Mapping[str, str | None], search: Mapping[str, Any]
) -> RunNumbers:
    """Return the numbers of a run, with those that ``gs.tune`` chooses if it is asked for.

    ``options`` has dt, dtau, step_error, steps and t_end as text, ``search`` has arguments of
    ``gs.tune``; without them and step_error there is no search.
    """
    from ...runtime.integration.run_arguments import step_argument
    from ...runtime.tuning.tune import tune

    clocked = step.binding.clocked
    if options["step_error"] is not None:  # gs.tune chooses dt
        numbers: dict[str, Any] = {}
        for name, text in options.items():
            if text is not None:
                number = whole_number if name == "steps" else real_number
                numbers[name] = number(f"--{name.replace('_', '-')}", text)
        tuning = tune(step, state, **numbers, **search)
        dt, span = tuning.dt, {"t_end": numbers["t_end"]}
    else:
        if clocked or options["dtau"] is not None:
            options = {**options, "dt": step_argument(step.binding, options["dt"], options["dtau"])}
        dt, span = _span(defaults, options)
        if not search:
            return RunNumbers(state, dt, span if clocked else _whole_steps(span, t0, dt), None)
        tuning = tune(step, state, dt=dt, steps=steps_of(span, t0, dt), **search)
    return RunNumbers(state.replace(parameters={**state.parameters, **tuning.parameters}), dt,
                      span if clocked else _whole_steps(span, t0, dt), tuning)


def steps_for(
    start: RunDefaults, t0: float, options: Mapping[str, str | None]
) -> tuple[float, int]:
    """Return dt and the number of steps of the options dt, steps and t_end, or the model's own."""
    from ...runtime.integration.run_arguments import step_count

    dt, span = _span(start, options)
    return dt, step_count(span.get("steps"), span.get("t_end"), t0, dt)


def steps_of(span: Mapping[str, Any], t0: Any, dt: Any) -> int:
    """Return the whole steps of a run of ``steps`` or to ``t_end``; 0 to t_end without a dt."""
    from ...runtime.integration.run_arguments import span_of

    if dt is None and "t_end" in span:
        return 0
    whole_steps, _ = span_of(span.get("steps"), span.get("t_end"), t0, dt)
    return whole_steps


def _whole_steps(span: dict[str, Any], t0: float, dt: Any) -> dict[str, Any]:
    """Return {"steps": N} where whole steps lead to the end of the run, else ``span`` as it is."""
    from ...runtime.integration.run_arguments import span_of

    count, remainder = span_of(span.get("steps"), span.get("t_end"), t0, dt)
    return span if remainder else {"steps": count}


def check_span(problem: str, options: Mapping[str, str | None]) -> None:
    """Refuse a run of a URDF or SDF without a step and a span, before the file is derived."""
    timed = options["dtau"] is not None or options["step_error"] is not None
    # these formats have no place for a step; a TOML file or an MJCF names one, once it is read
    if problem.endswith((".urdf", ".sdf")) and Path(problem).is_file() and not timed:
        _require_span(Path(problem).name, dt=None, steps=None, options=options)


def _require_span(
    name: str, dt: float | None, steps: int | None, options: Mapping[str, str | None]
) -> None:
    """Refuse options with which a model has no dt, or no number of steps.

    ``dt`` and ``steps`` are the model's own, None if it names none.
    """
    unset = (options["steps"], options["t_end"], steps) == (None, None, None)
    if options["dt"] is None and dt is None:
        raise InputError(f"--dt is not given and {name} names none; write for example "
                         f"--dt 1e-3{' --t-end 1' if unset else ''}.")
    if unset:
        raise InputError(f"--steps is not given and {name} names none; write for example "
                         "--steps 1000, or --t-end 1.")


def _span(start: RunDefaults, options: Mapping[str, str | None]) -> tuple[float, dict[str, Any]]:
    """Return the time step in s, and {"t_end": …} or {"steps": …}; options win over the model's.

    Raises InputError if neither the options nor the model have them, or --steps and --t-end do.
    """
    _require_span(start.name, start.dt, start.steps, options)
    dt, steps, t_end = options["dt"], options["steps"], options["t_end"]
    if dt == "auto":
        raise InputError("--dt auto is --step-error E now, with --t-end and without --dt.")
    size = real_number("--dt", dt) if dt is not None else start.dt or 0.0
    if t_end is not None:
        if steps is not None:
            raise InputError(f"--steps {steps} and --t-end {t_end} are both given; give one.")
        return size, {"t_end": real_number("--t-end", t_end)}
    return size, {"steps": whole_number("--steps", steps) if steps is not None
                  else int(start.steps or 0)}
