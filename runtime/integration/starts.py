"""Starts of integrations: what a caller gave beside a start's own numbers, in one record."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.arguments import as_mapping, count_text, few, shown
from ...core.arrays import Array
from ...core.errors import ArgumentError, InputError
from ...core.event import Event, Impact
from ...core.inertia import as_inertia, refuse_impossible_inertias
from ...core.start import Rule, Start, as_start, has_start
from ...core.warnings import capture_warnings, warn
from ..rigid_body.gamma_rules import inertia_names
from .consistency import project_start
from .run_arguments import StartNumbers, span_of, step_argument, step_count

if TYPE_CHECKING:
    from ..bindings.binding import Binding
    from ..steppers.evaluation import Evaluation

__all__ = ["Span", "after_start", "events_or_own", "merged_start", "merged_starts",
           "own_inertias", "span_or_own", "start_parameters", "steps_of_all"]


class Span(NamedTuple):
    """Step and length of a run as callers give them; None where they leave it to a model."""

    dt: Any
    #: In place of dt in scaled time.
    dtau: Any
    t_end: Any = None
    #: In place of t_end.
    steps: Any = None


def merged_start(
    stepper: Evaluation, start: Any, p: Any, parameters: Any, t: Any = None, *, frame: bool = True,
    impacts: bool = False, as_it_is: bool = False,
) -> StartNumbers:
    """Return the numbers that a run starts from; ``parameters`` and t win over those of the start.

    With ``frame`` the rates of a model with a co-moving frame are left to least squares. The state
    of a model is moved onto the constraints of the run, unless it is taken ``as_it_is``. Raises
    InputError for what is no start, one of another number of coordinates, and, unless the caller
    has ``impacts``, one of a model with impacts.
    """
    if p is not None:
        _refuse_second_state(start, p)
        return StartNumbers(start, p, {} if parameters is None else parameters,
                            0.0 if t is None else t)
    if isinstance(start, (Sequence, np.ndarray)):
        raise InputError("p is not given beside q; give both, or a start: a model, a problem, "
                         "run[-1], gs.Start(q, p, parameters).")
    state = as_start(start)
    shape = stepper.binding.numbers("q", state.q).shape
    if len(shape) == 1 and shape != (stepper.n,):
        raise InputError(f"The start has {shape[0]} coordinates, and {stepper.name} has "
                         f"{stepper.n}: it is a start of another system.")
    if not impacts:
        _refuse_impacts(state)
    values = start_parameters(stepper.parameter_domains, state, parameters)
    rates = [symmetry.name for symmetry in stepper.symmetries]
    # a rule for the frame holds for all rates together: it gives way where one of them is given
    if frame and "frame" in state._rules and values.keys().isdisjoint(rates):
        values |= dict.fromkeys(rates, Rule(state._rules["frame"]))
    t0 = state.t if t is None else t
    q, p = state.q, state.p
    if state._nominal and not as_it_is:
        q, p, warning = project_start(stepper, q, p, values, t0)
        if warning:
            warn(warning)
    return StartNumbers(q, p, values, t0, state._excess, _impacts_of(state))


def events_or_own(
    starts: Any, events: Event | Impact | Sequence[Event | Impact] | None
) -> Event | Impact | Sequence[Event | Impact]:
    """Return the caller's events, or those of a model, or of a list of starts, if there are none.

    Raises InputError for starts with different events.
    """
    if events is not None:
        return events
    start_list = starts if isinstance(starts, Sequence) else [starts]
    model_events = [start.start._events for start in start_list if has_start(start)]
    if any(events_of_start != model_events[0] for events_of_start in model_events):
        raise InputError("The starts have different events; give starts of one model, or "
                         "events=[...] for all.")
    return model_events[0] if model_events else ()


def _impacts_of(start: Start) -> tuple[Impact, ...]:
    """Return the impacts among the events of a start's model."""
    return tuple(event for event in start._events if isinstance(event, Impact))


def span_or_own(binding: Binding, start: Any, span: Span) -> tuple[Any, Any]:
    """Return the step and the number of steps of the caller, or a model's if they are not given.

    Raises InputError as ``step_argument``.
    """
    own_dt, own_steps = start.start._span if has_start(start) else (None, None)
    # a model's own step is a dt, which a stepper in scaled time does not take
    dt = own_dt if span.dt is None and not binding.clocked else span.dt
    steps = own_steps if span.steps is None and span.t_end is None else span.steps
    return step_argument(binding, dt, span.dtau), steps


def _refuse_second_state(start: Any, p: Any) -> None:
    """Refuse an argument p in addition to a start, which has momenta."""
    if has_start(start):
        raise ArgumentError(f"p = {shown(p)} is given beside a start, which has its own momenta; "
                            "leave it out, and give other arguments by name, such as dt=1e-3.")


def _refuse_impacts(start: Start) -> None:
    """Refuse the start of a model with impacts, which its motion would miss."""
    if impacts := _impacts_of(start):
        raise InputError(f"The start has impacts of {few(x.name for x in impacts)}, which "
                         "runs of step.integrate have, and others have not; integrate, or give "
                         "gs.Start(q, p, parameters), which has none.")


def start_parameters(names: Collection[str], start: Start, parameters: Any) -> dict[str, Any]:
    """Return the parameters of a start and those that win over them, γ and α by their rules.

    ``names`` are the parameters of the system. Raises InputError for parameters that are the
    inertia of no body, if the model's own are the inertia of a body.
    """
    # ``_spare`` are parameters that a stepper may ignore
    values: dict[str, Any] = {name: number_or_rule
                              for name, number_or_rule in start.parameters.items()
                              if name in names or name not in start._spare}
    values |= start.inputs
    values |= as_mapping("parameters", {} if parameters is None else parameters, "{'m': 1.0}")
    for name, inertia in start._inertias.items():
        if name in names and name not in values:
            values[name] = Rule(start._rules.get(name, "m"), inertia)
    if parameters and start._inertias:
        _refuse_impossible(own_inertias(start._inertias, names), values, parameters)
    return values


def own_inertias(inertias: Mapping[str, Any], names: Collection[str]) -> dict[str, Sequence[str]]:
    """Return label of a body → those of the parameters ``names`` that are its inertia.

    ``inertias`` has the inertia that each γ or α belongs to, in kg m²: {"gamma": [2e-4, 2e-4,
    8e-5]} with the parameters I1, I2, I3, mgl gives {"body": ("I1", "I2", "I3")}. A body whose
    inertia is no parameter is left out, as are effective moments, which no body has.
    """
    bodies: dict[str, Sequence[str]] = {}
    for name, inertia in inertias.items():
        # tuples, as ``_body_of`` is cached by them; starts from JSON have lists
        label, alternatives = _body_of(name, tuple(
            tuple(x) if isinstance(x, list) else x for x in inertia))
        # three moments, or six entries of a matrix: the first whose names are all parameters
        for moment_names in alternatives:
            if all(map(names.__contains__, moment_names)):
                bodies[label] = moment_names
                break
    return bodies


@lru_cache(maxsize=1024)
def _body_of(name: str, inertia: Any) -> tuple[str, Sequence[Sequence[str]]]:
    """Return the label of the body of a γ or α, and the names that its inertia may have.

    There are no names where no body can have that inertia. γ of "arm_gamma" has the label "arm".
    """
    label = name.removesuffix("gamma").removesuffix("alpha").rstrip("_") or "body"
    with contextlib.suppress(InputError), capture_warnings():
        as_inertia(inertia, label)
        return label, inertia_names(name)
    return label, ()


def _refuse_impossible(
    bodies: Mapping[str, Sequence[str]], values: Mapping[str, Any], changes: Mapping[str, Any]
) -> None:
    """Refuse moments of inertia that no body has, if ``changes`` has one of its body.

    ``bodies`` are label → names of moments, ``values`` all parameters. Moments that are no numbers
    or not positive are left to other checks.
    """
    for label, moment_names in bodies.items():
        if changes.keys().isdisjoint(moment_names) or not {*moment_names} <= values.keys():
            continue
        values_of_body = {name: values[name] for name in moment_names}
        if {*map(type, values_of_body.values())} == {float}:  # arrays take longer
            if min(values_of_body.values()) > 0:
                refuse_impossible_inertias({label: moment_names}, values_of_body)
            continue
        try:
            columns = np.broadcast_arrays(*(np.asarray(x, float) for x in values_of_body.values()))
        except (TypeError, ValueError):
            continue
        if min(column.min() for column in columns) > 0:
            refuse_impossible_inertias({label: moment_names},
                                       dict(zip(moment_names, columns, strict=True)))


def after_start(names: str, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return (p, *arguments) of a call by q and p, (None, *arguments) of a call by a start.

    ``arguments`` are those without a name after the first, ``names`` is such as "dq, dp". Raises
    InputError for another number of arguments.
    """
    count = len(names.split(", "))
    if len(arguments) == count:
        return (None, *arguments)
    if not arguments:
        raise InputError(f"{names} must follow the start: give start, {names}, or q, p, {names}.")
    if len(arguments) != count + 1:
        raise InputError(f"{len(arguments) + 1} arguments are given without a name; give start, "
                         f"{names}, or q, p, {names}.")
    return arguments


def merged_starts(
    stepper: Evaluation, starts: Any, p: Any, parameters: Any, *, impacts: bool = False
) -> StartNumbers:
    """Return the numbers of many runs: rows of q and p, parameters as an ensemble takes them.

    Raises InputError as ``merged_start``; for starts of models with different impacts.
    """
    parameter_sets = {} if parameters is None else parameters
    if p is not None:
        _refuse_second_state(starts, p)
        return StartNumbers(starts, p, parameter_sets, t=0.0)
    if has_start(starts):
        start = as_start(starts)
        if not impacts:
            _refuse_impacts(start)
        return _rows_of_start(stepper, start, parameter_sets)
    _refuse_without_starts(starts)
    if isinstance(parameter_sets, Mapping):
        parameter_sets = [_parameters_of(parameter_sets, i, len(starts))
                          for i in range(len(starts))]
    if len(parameter_sets) != len(starts):
        raise InputError(f"{len(parameter_sets)} sets of parameters are given for {len(starts)} "
                         "starts.")
    rows = [merged_start(stepper, start, p=None, parameters=own_parameters, frame=False,
                         impacts=impacts)
            for start, own_parameters in zip(starts, parameter_sets, strict=True)]
    if any(row.impacts != rows[0].impacts for row in rows):
        raise InputError("The starts have different impacts; give starts of one model.")
    return StartNumbers(
        q=np.array([row.q for row in rows]), p=np.array([row.p for row in rows]),
        parameters=[row.parameters for row in rows], t=np.array([row.t for row in rows]),
        excess=np.array([row.excess for row in rows]), impacts=rows[0].impacts)


def _refuse_without_starts(starts: Any) -> None:
    """Refuse an argument that is no list of starts: q without p, an empty list, another object."""
    # an array, or a list of rows, is q, and its p is missing
    if isinstance(starts, np.ndarray) or (isinstance(starts, Sequence) and len(starts)
                                          and isinstance(starts[0], (Sequence, np.ndarray))):
        raise InputError("p is not given beside q; give both, a row for each trajectory, or a list "
                         "of starts.")
    if not isinstance(starts, Sequence) or not starts or not all(
            has_start(start) for start in starts):
        raise InputError(f"starts = {shown(starts)} are no starts; give a list of starts, one "
                         "start with columns of parameters, or q and p, a row for each trajectory.")


def _rows_of_start(stepper: Evaluation, start: Start, parameter_sets: Any) -> StartNumbers:
    """Return one start for all trajectories, which differ in parameters or time.

    ``parameter_sets`` is a list with a dict for each trajectory, or one dict of numbers and
    columns; then the number of trajectories is the length of any column.
    """
    parameter_rows: Any
    if isinstance(parameter_sets, Sequence) and all(
            isinstance(own_parameters, Mapping) for own_parameters in parameter_sets):
        parameter_rows = [start_parameters(stepper.parameter_domains, start, own_parameters)
                          for own_parameters in parameter_sets]
        size = len(parameter_rows)
    else:
        parameter_rows = start_parameters(stepper.parameter_domains, start, parameter_sets)
        size = max((len(x) for x in (*parameter_rows.values(), start.t) if np.ndim(x) == 1),
                   default=1)
    # one state serves all rows, which share its memory
    q, p = (np.broadcast_to(x, (size, x.size)) if x.ndim == 1 else x
            for x in (stepper.binding.numbers("q", start.q), stepper.binding.numbers("p", start.p)))
    if start._nominal:
        q, p = _rows_on_constraints(stepper, q, p, parameter_rows, start.t)
    return StartNumbers(q, p, parameter_rows, start.t, start._excess, _impacts_of(start))


def _rows_on_constraints(
    stepper: Evaluation, q: Array, p: Array, parameters: Any, t: Any
) -> tuple[Array, Array]:
    """Return rows of q and p, (rows, n) each, of a model's start, moved onto their constraints.

    Constraints depend on the parameters and the time of the row. One projection serves all rows if
    nothing that constraints depend on differs between them.
    """
    size, constraint_parameters = len(q), stepper.manifest.system.start_parameters
    if isinstance(parameters, list):
        varied = any(row.get(name) != parameters[0].get(name)
                     for name in constraint_parameters for row in parameters)
    else:
        varied = any(np.ndim(parameters.get(name, 0.0)) for name in constraint_parameters)
    varied = varied or bool(np.ndim(t) and stepper.binding.is_timed)
    times = np.broadcast_to(np.asarray(t, dtype=object), size)
    starts = []
    for i in range(size if varied else 1):
        row_parameters = (parameters[i] if isinstance(parameters, list)
                          else _parameters_of(parameters, i, size))
        starts.append(project_start(stepper, q[i], p[i], row_parameters, times[i]))
    if warnings := [start.warning for start in starts if start.warning]:
        warn(warnings[0])  # one warning, of the first row that has moved
    return (np.broadcast_to(np.array([start.q for start in starts]), q.shape),
            np.broadcast_to(np.array([start.p for start in starts]), p.shape))


def _parameters_of(columns: Mapping[str, Any], i: int, size: int) -> dict[str, Any]:
    """Return the parameters of trajectory i of ``size``, from numbers and columns (size,).

    Raises InputError for a column of another length.
    """
    for name, column in columns.items():
        if np.ndim(column) and np.shape(column) != (size,):
            raise InputError(f"Parameter {name} has shape {np.shape(column)}; give one number or "
                             f"{size} of them.")
    return {name: column[i] if np.ndim(column) else column for name, column in columns.items()}


def steps_of_all(
    steps: Any, t_end: Any, t: Any, dt: Any, *, whole_steps: bool = True
) -> tuple[int, list[Fraction]]:
    """Return the number of whole steps of an ensemble, and the times from there to t_end.

    t and dt are numbers, or arrays with an entry for each trajectory. The list has one time for all
    trajectories, or one for each; with ``whole_steps`` they are 0. Raises the errors of
    ``step_count``, and InputError if trajectories need different numbers of steps.
    """
    # (t, dt) of each trajectory; without t_end they do not count
    starts_and_steps = [(0.0, dt)] if t_end is None else [
        *np.broadcast(np.asarray(t, dtype=object), np.asarray(dt, dtype=object))]
    spans: list[tuple[int, Fraction]] = []
    for start_time, step in starts_and_steps:
        if whole_steps or t_end is None:
            spans.append((step_count(steps, t_end, start_time, step), Fraction(0)))
        else:
            spans.append(span_of(steps, t_end, start_time, step))
    if len({(count, bool(remainder)) for count, remainder in spans}) > 1:
        fewest, most = (f"{count_text(count, 'step')}{' and a shorter one' * bool(remainder)}"
                        for count, remainder in (min(spans), max(spans)))
        raise InputError(f"t_end = {shown(t_end)} is after {fewest} of one trajectory and after "
                         f"{most} of another; give steps, or runs of their own.")
    # all spans have the same number of steps
    (count, _), *_ = spans
    return count, [remainder for _, remainder in spans]
