"""Model of a sweep: a problem, a model or a model file, as steppers and numbers."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..core.arguments import choose, proposal
from ..core.arrays import Array
from ..core.errors import InputError
from ..core.inertia import REPS, tensor_of_inverse, unit_quaternions
from ..core.registry import MEANS, entry_named
from ..core.start import Rule
from ..generator.schemes.named_schemes import SCHEMES
from ..generator.spec import Spec, is_model_file
from ..runtime.integration.run_arguments import refuse_texts
from ..runtime.rigid_body.gamma_rules import gamma_by_rule, has_inertia, inertia_names
from ..runtime.rigid_body.problems import Problem
from ..runtime.rigid_body.quaternion import momentum
from ..runtime.steppers.run_defaults import RunDefaults
from .axes import Axis, as_rows, start_axis

if TYPE_CHECKING:
    from ..runtime.steppers.stepper import Stepper

__all__ = ["NamedModel", "base_parameters", "resolve", "starts"]


class NamedModel(NamedTuple):
    """Name of a built-in problem or model, and settings, the arguments that make it."""

    name: Any
    settings: Mapping[str, Any]


def resolve(
    model: Any, schemes: list[str], rep: str | None, real: str | None, frame: str | None = None,
) -> tuple[list[Stepper], RunDefaults]:
    """Return a stepper for each scheme ("EMS", "G-L 3") and the model's own numbers.

    ``model`` is the name of a built-in problem, a name with settings, a model file, a
    ``Problem`` or a ``gyrospark.Model``. Raises InputError.
    """
    settings: Mapping[str, Any] = {}
    if isinstance(model, NamedModel):
        model, settings = model
    if isinstance(model, (str, Path)) and not is_model_file(str(model)):
        model, rep = _look_up(str(model), settings, rep)
    elif settings:
        raise InputError("Settings belong to problems and models with names; change the model "
                         "itself.")
    steppers_and_starts = [_stepper(model, scheme, rep, real, frame) for scheme in schemes]
    return [stepper for stepper, _ in steppers_and_starts], steppers_and_starts[0][1]


def _look_up(name: str, settings: Mapping[str, Any], rep: str | None) -> tuple[Any, str | None]:
    """Return the problem or model of a name with its settings, and ``rep`` for a problem."""
    entry = entry_named(name, "model")
    for key in settings:
        if key not in entry.options:
            raise InputError(f"The setting {key!r} does not fit {name}; give "
                             f"{', '.join(entry.options) or 'none'}"
                            f"{proposal(key, entry.options)}.")
    if entry.kind == "problem":
        return entry.make(**settings), rep
    rep_argument = {} if rep is None else {"rep": choose("representation", rep, REPS)}
    # made with its representation: ``_stepper`` refuses one for a Model
    return entry.make(**settings, **rep_argument), None


def _stepper(
    model: Any, label: str, rep: str | None, real: str | None, frame: str | None
) -> tuple[Stepper, RunDefaults]:
    """Return the stepper of one scheme, and parameters and start of the model.

    ``label`` is the scheme's, "G-L 3"; ``rep`` and ``frame`` are for models without their own.
    """
    from ..api import model_stepper, stepper_of

    scheme = _scheme(label)
    if isinstance(model, (str, Path)):
        spec = Spec.from_arguments(**scheme, rep=rep, system=str(model),
                                   real=real).with_frame(frame)
        return model_stepper(spec)
    if isinstance(model, Problem):
        spec = Spec.from_arguments(**scheme, rep=rep, system=model.system,
                                   real=real).with_frame(frame)
        stepper = stepper_of(spec)
        return stepper, RunDefaults.of_problem(model)
    if not hasattr(model, "system") or not hasattr(model, "q0"):
        raise InputError(f"model = {model!r} is nothing to sweep; give a problem, a file or a "
                         "model, which of a system is gs.Model(system, parameters, q0, p0).")
    if rep is not None:
        raise InputError(f"rep = {rep!r} belongs to names and files; a Model brings its own H.")
    # a Model has its frame, unless the caller names another
    spec = Spec.from_arguments(**scheme, real=real).with_frame(frame or model.frame or None)
    return stepper_of(spec, model.system), RunDefaults.of(model)


def _scheme(label: str) -> dict[str, Any]:
    """Return the arguments of "EMS", of "G-L 3" with its stages, or of "splitting 4", its order."""
    scheme, _, number = label.partition(" ")
    if number and not (number.isascii() and number.isdigit() and len(number) < 4):
        raise InputError(f"{label!r} is no scheme; write for example EMS or G-L 3, the number of "
                         "stages last, or splitting 4 with its order.")
    composed = scheme in SCHEMES and SCHEMES[scheme].composed
    arguments: dict[str, Any] = {"scheme": scheme}
    if number:
        arguments["order" if composed else "stages"] = int(number)
    return arguments


def base_parameters(
    stepper: Stepper, start: RunDefaults, parameter_values: Mapping[str, Any], varied: set[str]
) -> tuple[dict[str, Any], dict[str, Rule]]:
    """Return the parameters that all cells share, and the rules of parameters that follow others.

    γ and α without a value are means by the model's rules, of the moments of each cell where these
    vary; the rates of a frame are 0.
    """
    refuse_texts(parameter_values, stepper.parameter_domains)
    parameters: dict[str, Any] = {symmetry.name: 0.0 for symmetry in stepper.symmetries
                                  if symmetry.name not in varied}
    parameters |= {name: number_or_rule for name, number_or_rule in start.parameters.items()
                   if name in stepper.parameter_domains}
    parameters |= parameter_values
    rules: dict[str, Rule] = {}
    for name in stepper.parameter_domains:
        number_or_rule = parameters.get(name, Rule(start.rules.get(name, "m")))
        if (name not in varied and isinstance(number_or_rule, Rule)
                and (name in start.bodies or has_inertia(name, stepper.parameter_domains))):
            parameters.pop(name, None)
            rules[name] = Rule(number_or_rule.name, start.bodies.get(name))
    for name, rule in rules.items():
        if rule.name not in MEANS:
            raise InputError(f"{name} = {rule.name!r} is chosen for the motion of one run, and a "
                             f"sweep has many; give {name} a number, such as "
                             "gyrospark.gamma(inertia, 'h'), or make it an axis.")
    means = {name: rule for name, rule in rules.items()
             if not varied.isdisjoint(chain(*inertia_names(name)))}
    return parameters | {name: gamma_by_rule(name, rule, parameters)
                         for name, rule in rules.items() if name not in means}, means


def starts(
    table: Any, start: RunDefaults, parameter_values: Mapping[str, Any], varied: set[str]
) -> Axis:
    """Return the axis of states: rows of q and p, or of angular velocities of one body.

    ``parameter_values`` may have another inertia than the model's.

    With ``angular_velocity`` (body axes, rad/s), ``quaternion`` is one for all, one for each, or
    the model's own.

    Raises
    ------
    InputError
    """
    if isinstance(table, tuple) and len(table) == 2:
        return start_axis(*table)
    if not isinstance(table, Mapping) or not (
            table.keys() == {"q", "p"} or {"angular_velocity"} <= table.keys() <= {
                "angular_velocity", "quaternion"}):
        raise InputError("start is no list of states; give q and p, a row each, or "
                         "angular_velocity and, if it varies, quaternion.")
    if "q" in table:
        return start_axis(table["q"], table["p"])
    # p = 2 L(q)ᵀ J Ω needs the inertia, one for all states
    # the name of γ of the first body, and its inertia; a start of several has more than 4 numbers
    name, inertia = next(iter(start.bodies.items()), ("", None))
    moments, inverse_entries = inertia_names(name)
    if inertia is None or len(start.q0) != 4 or varied & {*moments, *inverse_entries}:
        raise InputError("angular_velocity is for one rigid body whose moments of inertia do not "
                         "vary; give the states as q and p.")
    parameters = {**start.parameters, **parameter_values}
    if not parameter_values.keys().isdisjoint(moments):
        inertia = [parameters[moment] for moment in moments]
    elif not parameter_values.keys().isdisjoint(inverse_entries):
        inertia = tensor_of_inverse([parameters[entry] for entry in inverse_entries])
    omega = as_rows("angular_velocity", table["angular_velocity"], width=3)
    q = _quaternions(table.get("quaternion", start.q0))
    if len(q) not in (1, len(omega)):
        raise InputError(f"{len(q)} quaternions are given for {len(omega)} angular velocities; "
                         "give one, or one for each.")
    q = np.broadcast_to(unit_quaternions(q), (len(omega), 4))
    return start_axis(q, momentum(q, omega, inertia))


def _quaternions(quaternions: Any) -> Array:
    """Return quaternions as rows, shape (rows, 4), from one or several of them."""
    sequences = (list, tuple, np.ndarray)
    is_single = (isinstance(quaternions, sequences) and len(quaternions) > 0
                 and not isinstance(quaternions[0], sequences))
    return as_rows("quaternion", [quaternions] if is_single else quaternions, width=4)
