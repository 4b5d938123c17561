"""The checked study from the arguments of ``sweep`` or of a study file."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from ..core.arguments import as_mapping, few, shown
from ..core.errors import InputError
from ..core.event import Impact
from ..core.incompatibilities import refuse_together
from ..core.inertia import refuse_impossible_inertias
from ..core.real_types import REALS
from ..core.warnings import warn
from ..generator.schemes.named_schemes import DEFAULT_SCHEME, DEFAULT_STAGES, SCHEMES
from ..generator.spec import Spec
from ..runtime.bindings.array_checks import as_positive_count
from ..runtime.integration.consistency import text_of_move
from ..runtime.integration.run_arguments import step_argument
from ..runtime.integration.starts import own_inertias
from ..runtime.steppers.run_defaults import RunDefaults
from .axes import SCHEME, START, Axis, list_axis, random_axis, value_axis
from .study import Study, checked_study
from .sweep_model import base_parameters, resolve, starts
from .tiles import cells_of, tiles_of

__all__ = ["plan"]


def plan(
    model: Any, over: Mapping[str, Any], *, scheme: str | None = None, stages: int | None = None,
    order: int | None = None, rep: str | None = None, real: str | None = None,
    frame: str | None = None, parameters: Mapping[str, Any] | None = None, dt: float | None = None,
    dtau: float | None = None, **options: Any,
) -> Study:
    """Return the checked study of a sweep; see ``sweep`` for the arguments.

    ``options`` are the fields of ``Study`` that all cells share: steps, every, solver, events, ...
    """
    over = as_mapping("over", over, '{"gamma": [4e-4, 8e-4]}')
    parameter_values = {} if parameters is None else as_mapping(
        "parameters", parameters, '{"mgl": 0.4}')
    schemes = _schemes(over, scheme, stages, order)
    refuse_together(  # before anything is compiled
        sweep="a sweep", float128=isinstance(real, str) and real in REALS
        and REALS[real].in_mpmath and "numbers of type float128")
    steppers, start = resolve(model, schemes, rep, real, frame)
    impacts = [event.name for event in getattr(start, "events", ()) if isinstance(event, Impact)]
    refuse_together(impacts=bool(impacts) and f"impacts of {few(impacts)}", other_runs="a sweep")
    binding = steppers[0].binding
    step_name = "dtau" if binding.clocked else "dt"
    names = {*steppers[0].parameter_domains, step_name, SCHEME}
    varied = _varied_names(over, names)
    _refuse_two_meanings(varied, {"dt": dt, "dtau": dtau}, step_name,
                         steppers[0].parameter_domains)
    axes, seed = _axes(over, names, start, parameter_values, varied, step_name)
    # a model may name dt, but has no Δτ
    if step_name not in varied or dt is not None or dtau is not None:
        dt = step_argument(binding, start.dt if dt is None and not binding.clocked else dt, dtau)
    common_parameters, means = base_parameters(steppers[0], start, parameter_values, varied)
    study = checked_study(Study(
        f"{start.name} over {', '.join(axis.name for axis in axes)}", steppers, axes,
        common_parameters, q=np.array(start.q0), p=np.array(start.p0), dt=dt, seed=seed,
        means=means, **options))
    _refuse_impossible_inertias(study, start.bodies)
    _warn_of_moved_start(study, common_parameters | study.parameters)
    _warn_of_ends(start)
    return study


def _varied_names(over: Mapping[str, Any], names: set[str]) -> set[str]:
    """Return the quantities that vary: keys of ``over``, and the columns of its tables of points.

    ``names`` are the keys that have an axis of their own: parameters, the step and the scheme.
    """
    varied = {key for key in over if key in names}
    for key, table in over.items():
        if key not in names and isinstance(table, Mapping):
            varied |= {*table}
    return varied


def _refuse_two_meanings(
    varied: set[str], common_steps: Mapping[str, Any], step_name: str, parameters: Collection[str]
) -> None:
    """Refuse a step that varies and is also given for all cells, and parameters named as step or
    scheme.

    ``varied`` are the quantities that vary, ``common_steps`` dt and dtau, None if left out. Numbers
    of parameters are those of a model, which an axis replaces.
    """
    for name in varied & {step_name, SCHEME} & {*parameters}:
        raise InputError(f"{name!r} is a parameter of this system, and in a sweep the "
                         f"{'scheme' if name == SCHEME else 'time step'}; rename the parameter.")
    for name, step in common_steps.items():
        if step is not None and name in varied:
            raise InputError(f"{name} = {shown(step)} is given for all cells, and {name} varies "
                             "along an axis; leave one of them out.")


def _axes(
    over: Mapping[str, Any], names: set[str], start: RunDefaults,
    parameter_values: Mapping[str, Any], varied: set[str], step_name: str
) -> tuple[list[Axis], int | None]:
    """Return an axis for each key of ``over``, and the seed of the first random axis, or None."""
    axes: list[Axis] = []
    seed: int | None = None
    for key, axis_values in over.items():
        if key in names:
            axes.append(value_axis(key, axis_values))
        elif key == START:
            axes.append(starts(axis_values, start, parameter_values, varied))
        else:
            axis, axis_seed = _points(key, axis_values, step_name)
            axes.append(axis)
            seed = axis_seed if seed is None else seed
    return axes, seed


def _schemes(over: Mapping[str, Any], scheme: str | None, stages: Any, order: Any) -> list[str]:
    """Return the schemes, such as "G-L 3": those of an axis, or the one of the arguments.

    Raises InputError if both are given, and for stages or an order that the scheme does not take.
    """
    if SCHEME in over:
        if (scheme, stages, order) != (None, None, None):
            raise InputError("scheme varies along an axis; leave out scheme, stages and order.")
        return list(value_axis(SCHEME, over[SCHEME]).labels)
    if isinstance(scheme, str) and " " in scheme and stages is None and order is None:
        return [scheme]
    method = DEFAULT_SCHEME if scheme is None and order is None else scheme
    has_stages = isinstance(method, str) and method in SCHEMES and SCHEMES[method].takes_stages
    if stages is None and has_stages:
        stages = DEFAULT_STAGES
    spec = Spec.from_arguments(method, stages, order=order)
    number = stages if spec.order is None else spec.order
    return [spec.scheme if number is None else f"{spec.scheme} {number}"]


def _refuse_impossible_inertias(study: Study, inertias: Mapping[str, Any]) -> None:
    """Refuse a study with a cell whose parameters are an inertia that no body has."""
    stepper = study.steppers[0]
    names_by_body = own_inertias(inertias, stepper.parameter_domains) | stepper._inertias
    # other inertias are equal in all cells, and were checked with the parameters
    varied = {body: names for body, names in names_by_body.items()
              if any(map(study.has_axis, names))}
    for tile in tiles_of(study) if varied else ():
        refuse_impossible_inertias(varied, cells_of(study, tile).parameters)


def _points(name: str, table: Any, step_name: str) -> tuple[Axis, int | None]:
    """Return the axis of a list of points, and the seed with which it was drawn, or None.

    ``table`` has a column for each quantity; with "count" and "seed", ranges to draw from.
    """
    if not isinstance(table, Mapping):
        raise InputError(f"{name!r} is neither a parameter, {step_name}, scheme nor start; a list "
                         "of points is a dict with a column for each quantity.")
    if "count" not in table:
        return list_axis(name, table), None
    seed = as_positive_count(f"{name}: seed", table.get("seed", 0))
    ranges = {key: column for key, column in table.items() if key not in ("count", "seed")}
    return random_axis(name, ranges, table["count"], seed), seed


def _warn_of_ends(start: RunDefaults) -> None:
    """Warn of terminal events of the model, at which its runs end and the cells of a sweep do not.
    """
    ends = [event.name for event in start.events if event.terminal]
    if ends:
        warn(f"Runs of {start.name} end at {few(ends)}, and cells of a sweep go on behind; give "
             "steps or t_end before such an event, or detect it without terminal=True (stop) and "
             "leave out the cells in which it happens.")


def _warn_of_moved_start(study: Study, parameters: dict[str, float]) -> None:
    """Warn if the model's start is off the constraints, at the model's own parameters.

    Cells move it onto the constraints of their parameters. States of an axis are the caller's.
    """
    if study.has_axis("q"):
        return
    stepper = study.steppers[0]
    # where a parameter varies and the model has none of its own: its first value
    own_parameters = {name: float(axis.columns[name][0]) for axis in study.axes
                      for name in axis.columns if name in stepper.parameter_domains}
    q, p = stepper.project(study.q, study.p, parameters=own_parameters | parameters, t=study.t0)
    system = stepper.manifest.system
    for start, projected, names in ((study.q, q, system.coordinates), (study.p, p, system.momenta)):
        if change := text_of_move(stepper.binding, start, projected, names):
            warn(change)
