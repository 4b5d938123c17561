"""The checked arguments of an integration; of many, one column for each that may differ.

The parameters: all that the stepper needs, in their domains, γ and α by their rules. The number of
steps: as given, or the whole number of them that leads to a time.

What all runs of an ensemble pass together is not checked one by one, which costs a hundred times as
much. What one of them does not pass plainly (a number of mpmath, a start off the constraints, a γ
below 0) is checked as a single run is, so that the message names the value and the run.
"""

from __future__ import annotations

import itertools
import math
import operator
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from ...core.arguments import proposal, shown
from ...core.arrays import Array
from ...core.errors import ArgumentError, InputError
from ...core.event import Event, Impact
from ...core.exact_numbers import Rounded, as_double, exact
from ...core.frozen_dict import NO_PARAMETERS
from ...core.inertia import refuse_impossible_inertias
from ...core.manifest import ClockManifest
from ...core.records import dataclass, replace_fields
from ...core.registry import MEANS
from ...core.start import GAMMA_M, Rule
from ...core.warnings import warn
from ..bindings.array_checks import as_positive_count, as_real, as_step
from ..bindings.inputs import InputRows
from ..bindings.run_memory import RunConstants
from ..rigid_body.gamma_rules import gamma_by_rule, has_inertia, inertia_names, is_inertia_parameter
from .consistency import defects_of_starts
from .manifest_symmetries import Symmetry, refuse_asymmetric

if TYPE_CHECKING:
    from ..bindings.binding import Binding, SolverName
    from ..bindings.compiled_module import Compiled
    from ..steppers.stepper import Stepper

__all__ = ["IMMUTABLE", "OPEN", "EnsembleArguments", "Integration", "Origin", "ParameterCheck",
           "RawArguments", "RunArguments", "StartNumbers", "as_parameters", "checked_runs",
           "depends_on_time", "end_of_run", "has_searches", "in_scaled_time", "negative_parameters",
           "refuse_texts", "span_of", "step_argument", "step_count", "steps_until",
           "warn_of_late_start", "warn_of_negative", "with_rules"]

#: Largest number of steps of a run that an event ends: more than any run takes, and half the range
#: of 64-bit integers, so that sums with numbers of steps or rows do not overflow.
OPEN = 2**62
#: Numbers of moved states that are checked at a time: as many as a cache of the CPU holds.
_CHECKED = 2**16
#: Types of parameters that are the same as long as they are the same object.
IMMUTABLE = {float, np.float64, int, Rule, Rounded}


@dataclass(frozen=True)
class RunArguments:
    """The arguments of an integration, checked, in the stepper's own type of numbers.

    Each stage of a call takes this record and returns another: ``Stepper._run_arguments`` checks
    the caller's values, ``Stepper._resolve`` replaces searches among the parameters by numbers,
    ``Stepper._checked_run`` checks the parameters and the start.
    """

    q: Array
    p: Array
    dt: Any
    steps: int
    every: int
    parameters: dict[str, Any]
    solver: SolverName
    tolerance: Any
    max_iterations: int
    t0: Any = 0.0
    inputs: InputRows | None = None
    #: The steps whose states are stored, rising, up to the last; None: as ``every`` says.
    stored_steps: Array | None = None
    #: H + e at the start, in scaled time.
    excess: Any = 0.0
    #: Whether an event alone ends the run: its steps are not counted beforehand.
    open_end: bool = False
    #: For derivatives: index of a step → its impacts, in the order of time.
    hits: Mapping[int, Sequence[Any]] | None = None
    #: Time of the last state where it lies between two steps, and the part of a step to it.
    t_end: Any = None
    rest: Any = 0

    def constants(self, binding: Compiled) -> RunConstants:
        """Return the constant arguments of the compiled steps."""
        return RunConstants(
            binding.parameters(self.parameters, self.t0),
            binding.options(self.tolerance, self.max_iterations, self.solver), self.dt, self.inputs)

    @property
    def rows(self) -> int:
        """Stored states after the first; the last state is always stored."""
        # steps/every rounded up
        return -(-self.steps // self.every) if self.stored_steps is None else len(self.stored_steps)

    @property
    def impact_steps(self) -> list[int]:
        """The whole steps before each step with impacts."""
        return sorted(self.hits or ())

    @property
    def stored_states(self) -> int:
        """States in a store, with the start, and with that at t_end in place of the last step's."""
        return self.steps // self.every + 2 if self.rest else self.rows + 1

    def part_of_step(self, q: Array, p: Array, t: Any) -> RunArguments:
        """Return the last part of a step, from the state (q, p, t) of the last whole one."""
        return replace(self.at_step(self.steps), q=q.copy(), p=p.copy(), t0=t, dt=self.rest,
                       steps=1, every=1, inputs=None, stored_steps=None, rest=0, t_end=None)

    def continue_from(self, steps: int, q: Array, p: Array) -> RunArguments:
        """Return the run that begins in the state (q, p) after ``steps`` steps of this one."""
        inputs = self.inputs
        # hold = 0: one row is held throughout, and serves on
        if inputs is not None and inputs.hold:
            inputs = inputs.rows_of(runs=np.zeros(1, int), steps=np.array([steps]),
                                    count=max(1, self.steps - steps))
        return replace(self, q=q, p=p, t0=self.t0 + steps * self.dt, inputs=inputs)

    def pilot(self, steps: int) -> Self:
        """Return the arguments of a short run from the same start, with the default solver."""
        return replace(self, steps=steps, every=1, solver="auto", tolerance=None,
                       max_iterations=50, open_end=False,
                       inputs=None if self.inputs is None else self.inputs.of_steps(steps))

    def refine(self, factor: int) -> Self:
        """Return the same run with steps of dt/factor, stored as often as before."""
        return replace(self, dt=self.dt / factor, steps=self.steps * factor,
                       every=self.every * factor,
                       inputs=None if self.inputs is None else self.inputs.refine(factor))

    def with_inputs(self, inputs: InputRows | None) -> RunArguments:
        """Return the run with inputs; its parameters have those that stay, and nan for others."""
        if inputs is None:
            return self
        return replace(self, inputs=inputs, parameters=self.parameters | inputs.throughout)

    def at_step(self, step: int) -> RunArguments:
        """Return the run whose parameters have the inputs of a step."""
        if self.inputs is None or not self.steps:
            return self
        row = dict(zip(self.inputs.names, self.inputs.at(step).tolist(), strict=True))
        return replace(self, parameters=self.parameters | row)

    def until(self, steps: int) -> RunArguments:
        """Return its first steps as a run."""
        if self.stored_steps is None:
            return replace(self, steps=steps, open_end=False)
        stored_steps = np.unique(np.minimum(self.stored_steps, steps))
        return replace(self, steps=steps, stored_steps=stored_steps[stored_steps > 0],
                       open_end=False)

    def rows_after(self, step_count: int) -> int:
        """Return how many states after the first are stored once ``step_count`` steps are taken."""
        if self.stored_steps is not None:
            return int(np.searchsorted(self.stored_steps, step_count, side="right"))
        return self.rows if step_count == self.steps else step_count // self.every

    def steps_of_rows(self, step_count: int) -> Array:
        """Return the step number of each stored state, the start (0) first, (1 + rows,)."""
        row_count = self.rows_after(step_count)
        if self.stored_steps is not None:
            return np.concatenate([[0], self.stored_steps[:row_count]])
        rows = np.arange(row_count + 1)
        return rows if self.every == 1 else np.minimum(rows * self.every, step_count)


def in_scaled_time(binding: Binding, run: RunArguments) -> RunArguments:
    """Return a run with t and its momentum e = ``excess`` − H in its state, if time is scaled.

    Its own time is then τ, from 0. The parameters are numbers. Raises InputError where σ is not
    positive at the start.
    """
    if not binding.clocked or len(run.q) == binding.n:
        return run
    parameters = binding.parameters(run.parameters)
    q, p = binding.start_in_scaled_time(parameters, run.q, run.p, run.t0)
    scale = float(binding.time_scales(parameters, q[None], p[None])[0])
    if not scale > 0:
        raise InputError(f"The time_scale of the system is {scale:.6g} at the start, t = "
                         f"{float(run.t0):.6g} s: steps go forwards in time where it is positive. "
                         "Take another start, or another time_scale.")
    p[-1] += run.excess
    return replace_fields(run, q=q, p=p, t0=binding.number(Fraction(0)))


def step_argument(binding: Binding, dt: Any, dtau: Any) -> Any:
    """Return the step that a caller gives: dt, or dtau of a system in scaled time.

    Raises InputError for the other one, both or neither.
    """
    if binding.clocked and dt is not None:
        raise InputError(f"dt = {shown(dt)} is a step of t, and {binding.name} takes steps of the "
                         "scaled time τ, by which t adapts; give dtau.")
    if not binding.clocked and dtau is not None:
        raise InputError(f"dtau = {shown(dtau)} is a step of scaled time, and {binding.name} has "
                         "no time_scale; give dt.")
    name, step = ("dtau", dtau) if binding.clocked else ("dt", dt)
    if step is None:
        cure = ("the step of scaled time, such as dtau=1e-3." if binding.clocked else
                "the time step in seconds, such as dt=1e-3, or that of "
                "gyrospark.tune(step, start, step_error=1e-9, t_end=1).dt.")
        raise ArgumentError(f"{name} is not given; give {cure}")
    return step


def end_of_run(
    clock: ClockManifest, events: Sequence[Event], t0: Any, t_end: Any, dt: Any
) -> Event:
    """Return the event that ends a run in scaled time, t = t_end, under a name that no other has.

    Raises InputError for a t_end that dtau leads away from.
    """
    end, start, step = (_fraction(*named_number)
                        for named_number in (("t_end", t_end), ("t0", t0), ("dtau", dt)))
    if (end - start) * step <= 0:
        raise InputError(f"t_end = {_text(end)} is not {'after' if step > 0 else 'before'} the "
                         f"start, t = {_text(start)}, where dtau = {_text(step)} leads.")
    name = "t_end"
    while name in {event.name for event in events}:
        name += "_"
    return Event(clock.time, level=end, terminal=True, name=name)


@dataclass(frozen=True)
class Integration:
    """A checked run, its events or impacts, and the name of the event that ends it at t_end."""

    run: RunArguments
    #: The impacts, where there are some, which no other events go with.
    events: tuple[Event | Impact, ...] = ()
    impacts: tuple[Impact, ...] = ()
    end_event: str = ""
    #: Compiled constants of the run where an earlier call had the same ones.
    constants: RunConstants | None = None


@dataclass(frozen=True)
class Origin:
    """Origin of a trajectory: its run and events; ``between`` if its rows are at given times."""

    run: RunArguments
    events: tuple[Event, ...] = ()
    between: bool = False
    #: The part of a step from the last whole one to the last row; 0 where there is none.
    rest: Any = 0
    impacts: tuple[Impact, ...] = ()


@dataclass(frozen=True)
class EnsembleArguments:
    """Runs with equal steps, every, solver and tolerance; ``runs[i]`` is one of them."""

    #: The first of them, which says what all have in common.
    first: RunArguments
    q: Array
    p: Array
    dt: Array
    t0: Array
    parameters: dict[str, Array]
    inputs: InputRows | None = None
    #: The last part of a step of each, to t_end between two steps.
    rests: Array | None = None

    @classmethod
    def of(cls, runs: list[RunArguments], number_type: Any) -> EnsembleArguments:
        """Return checked runs as columns; numbers beside the states have this NumPy type."""
        def column(values: list[Any]) -> Array:
            """Return numbers of the runs as an array, (runs,)."""
            return np.array(values, dtype=number_type)

        return cls(runs[0], np.array([run.q for run in runs]), np.array([run.p for run in runs]),
                   column([run.dt for run in runs]), column([run.t0 for run in runs]),
                   {name: column([run.parameters[name] for run in runs])
                    for name in runs[0].parameters})

    def __len__(self) -> int:
        return len(self.q)

    def __getitem__(self, i: int) -> RunArguments:
        """Return the arguments of run i, as if it had been checked alone."""
        # numbers of Python, as a single run has them
        (dt,), (t0,) = (column[i : i + 1].tolist() for column in (self.dt, self.t0))
        parameters = {name: column[i : i + 1].tolist()[0]
                      for name, column in self.parameters.items()}
        inputs = None if self.inputs is None else self.inputs.of(i)
        run = replace(self.first, q=self.q[i], p=self.p[i], dt=dt, t0=t0, parameters=parameters,
                      rest=0 if self.rests is None else self.rests[i : i + 1].tolist()[0])
        return run.with_inputs(inputs)

    def to_end(self, binding: Binding, t_end: Any, rests: Sequence[Fraction]) -> EnsembleArguments:
        """Return the runs up to t_end, ``rests`` the parts of a step after their whole steps."""
        column = np.array([binding.number(rest) for rest in rests], binding.number_type)
        end = as_real("t_end", t_end, binding.number)
        return replace(self, first=replace(self.first, t_end=end),
                       rests=np.broadcast_to(column, len(self)))

    def last_parts(self, binding: Binding, q: Array, p: Array, status: Array) -> EnsembleArguments:
        """Return the last parts of a step as runs of one step, from the states after whole steps.

        ``q`` and ``p`` have the shape (runs, n), ``status`` (runs,). It is not 0 for runs that have
        failed; in their place is a step from the start, whose result is not used.
        """
        failed, steps = (status != 0)[:, None], self.first.steps
        parameters = dict(self.parameters)
        if self.inputs is not None:  # constant within this step, like its parameters
            rows = self.inputs.rows_of(np.arange(len(self)), np.full(len(self), steps)).values[:, 0]
            columns = np.broadcast_to(rows, (len(self), len(self.inputs.names))).T
            parameters |= dict(zip(self.inputs.names, columns, strict=True))
        t0 = binding.times(self.t0[:, None], self.dt[:, None], np.array([steps]))[:, 0]
        assert self.rests is not None
        first_part = replace(self.first, steps=1, every=1, inputs=None, rest=0, t_end=None)
        return EnsembleArguments(
            first_part, q=np.where(failed, self.q, q), p=np.where(failed, self.p, p),
            dt=self.rests.copy(), t0=t0.astype(self.t0.dtype), parameters=parameters)

    def columns(self, runs: slice) -> dict[str, Array]:
        """Return the parameters of some of the runs."""
        return {name: column[runs] for name, column in self.parameters.items()}


@dataclass(frozen=True)
class StartNumbers:
    """A state, all its parameters, and its time, as they were given; of many, rows of them."""

    q: Any
    p: Any
    parameters: Any
    t: Any
    #: H + e, which is not 0 of states that steps in scaled time have made.
    excess: Any = 0.0
    #: Impacts of the model from which the start comes.
    impacts: tuple[Impact, ...] = ()


@dataclass(frozen=True)
class RawArguments:
    """The arguments of many runs as a caller passed them, unchecked: rows, numbers, dicts."""

    q: Array
    p: Array
    dt: Array
    t0: Array
    #: H + e at the start, in scaled time.
    excess: Array
    #: A dict for each run; or a dict of numbers for all runs, and one of columns.
    parameters: list[dict[str, Any]] | tuple[dict[str, Any], dict[str, Array]]
    #: Steps, every and solver: the same for all.
    common: Mapping[str, Any]

    def parameters_of(self, i: int) -> dict[str, Any]:
        """Return the parameters of run i, name → number or rule."""
        if isinstance(self.parameters, list):
            return self.parameters[i]
        shared, columns = self.parameters
        return shared | {name: column[i] for name, column in columns.items()}


def checked_runs(stepper: Stepper, arguments: RawArguments) -> EnsembleArguments:
    """Return the checked runs, or raise InputError for the first that is unusable, with its number.

    All are checked at once, as columns; only if that finds something unusual, one by one.
    """

    def checked_run(i: int) -> RunArguments:
        """Return run i, checked as a single run is."""
        try:
            start = StartNumbers(arguments.q[i], arguments.p[i], arguments.parameters_of(i),
                                 t=arguments.t0[i], excess=arguments.excess[i])
            return stepper._checked_run(stepper._run_arguments(
                start, dt=arguments.dt[i], scaled=True, **arguments.common))
        except InputError as error:
            raise InputError(f"Trajectory {i}: {error}") from error

    first_run, size = checked_run(0), len(arguments.q)
    # in scaled time a start has an energy of its own, which columns have not
    has_columns = size > 1 and not stepper.binding.clocked
    runs = _runs_as_columns(stepper, arguments, first_run) if has_columns else None
    if runs is None or not _are_consistent(stepper, runs):
        runs = EnsembleArguments.of([first_run, *(checked_run(i) for i in range(1, size))],
                                    stepper.binding.number_type)
    return runs


def _runs_as_columns(
    stepper: Stepper, arguments: RawArguments, first_run: RunArguments
) -> EnsembleArguments | None:
    """Return the runs as columns if all their numbers are finite and of plain types, else None.

    ``first_run`` is the checked first run, with the arguments that all have in common. None sends
    the runs to the check of single runs, whose errors name the run.
    """
    binding, size = stepper.binding, len(arguments.q)
    number_type = binding.number_type
    # floats, integers and unsigned integers of NumPy
    has_objects = {arguments.q.dtype.kind, arguments.p.dtype.kind} - {*"fiu"}
    if number_type is object or has_objects:
        return None
    q, p = binding.to_real(arguments.q), binding.to_real(arguments.p)
    dt, t0 = _plain_column(arguments.dt, number_type), _plain_column(arguments.t0, number_type)
    parameters = _parameter_columns(stepper, arguments, first_run, size)
    if dt is None or t0 is None or parameters is None or not dt.all():
        return None
    if not (np.isfinite(q).all() and np.isfinite(p).all()):
        return None
    return EnsembleArguments(first_run, q, p, dt, t0, parameters)


def _plain_column(column: Array | list[Any], number_type: Any) -> Array | None:
    """Return a column in a NumPy type; None if an entry is not finite or of no plain type."""
    if isinstance(column, list):
        kinds = {*map(type, column)}
        # NumPy would turn bools, texts and mixed lists into numbers
        if not (kinds <= {float, np.float64} or kinds == {int}):
            return None
        column = np.array(column)
    if column.dtype.kind not in "fiu":
        return None
    with np.errstate(over="ignore"):
        converted = column.astype(number_type)
    return converted if np.isfinite(converted).all() else None


def _parameter_columns(
    stepper: Stepper, arguments: RawArguments, first_run: RunArguments, size: int
) -> dict[str, Array] | None:
    """Return a column (runs,) for each parameter; None if one must be checked run by run.

    ``size`` is the number of runs, ``first_run`` the first of them, checked.
    """
    column_of: dict[str, Array] = {}
    number_type = stepper.binding.number_type
    rates = {symmetry.name for symmetry in stepper.symmetries}
    if isinstance(arguments.parameters, tuple):
        columns: Mapping[str, Any] = arguments.parameters[1]
        if not columns:  # all runs have the parameters of the first
            return {name: np.full(size, value, number_type)
                    for name, value in first_run.parameters.items()}
    elif any({*run, *rates} != first_run.parameters.keys() for run in arguments.parameters):
        return None  # a name is missing or unknown: the check of single runs says which
    for name, domain in stepper.parameter_domains.items():
        column = _plain_column(_column_of(arguments, name, first_run, size, rates), number_type)
        if column is None or not _in_domain(column, domain):
            return None
        column_of[name] = column
    if not all(symmetry.holds_plainly(column_of) for symmetry in stepper.symmetries):
        return None  # the check of single runs decides, in exact arithmetic
    try:
        refuse_impossible_inertias(stepper._inertias, column_of)
    except InputError:
        return None  # the check of single runs names the run
    return column_of


def _column_of(
    arguments: RawArguments, name: str, first_run: RunArguments, size: int, rates: Collection[str]
) -> Array | list[Any]:
    """Return a parameter of all runs as a column, (runs,); γ and α by their rules.

    The ``rates`` of a co-moving frame are 0 where they are left out. A rule that does not apply
    stays in the column, which is then no column of numbers.
    """
    if isinstance(arguments.parameters, list):
        numbers_or_rules = [run.get(name, 0.0) if name in rates else run[name]
                            for run in arguments.parameters]
    else:
        common_values, columns = arguments.parameters
        if name in columns:
            return columns[name]
        if name in rates and name not in common_values:
            return np.zeros(size)
        # a rule gives one number for all runs unless moments of inertia differ between them
        inertia = itertools.chain(*inertia_names(name))
        if not isinstance(common_values[name], Rule) or columns.keys().isdisjoint(inertia):
            return np.full(size, first_run.parameters[name])
        numbers_or_rules = [common_values[name]] * size
    if not any(isinstance(number_or_rule, Rule) for number_or_rule in numbers_or_rules):
        return numbers_or_rules
    try:
        return [gamma_by_rule(name, number_or_rule, arguments.parameters_of(i))
                if isinstance(number_or_rule, Rule) else number_or_rule
                for i, number_or_rule in enumerate(numbers_or_rules)]
    except InputError:
        return numbers_or_rules  # no number: the check of single runs names the run


def _in_domain(column: Array, domain: str) -> bool:
    """Whether all entries of a column are above 0 ("positive"), or other than 0 ("nonzero").

    Any other domain holds all numbers.
    """
    usable = {"positive": column > 0, "nonzero": column != 0}
    return bool(usable[domain].all()) if domain in usable else True


def _are_consistent(stepper: Stepper, runs: EnsembleArguments) -> bool:
    """Whether every start is on the constraints; they are checked in blocks that fit in a cache."""
    binding = stepper.binding
    if not binding.conditions:
        return True
    keeps_f = stepper.manifest.scheme.keeps_momentum_constraint
    # one struct of parameters serves all runs that have equal ones
    varied = any((column != column[0]).any() for column in (runs.t0, *runs.parameters.values()))
    common_parameters = binding.parameters(runs.first.parameters, runs.first.t0)
    # each start of n coordinates is moved up to 2 n + 1 times
    at_once = max(_CHECKED // (binding.n * (2 * binding.n + 1)), 1)

    def is_consistent(block: slice) -> bool:
        """Return whether all starts of a block are on their constraints."""
        parameters = (binding.parameter_sets(runs.columns(block), runs.t0[block])
                      if varied else common_parameters)
        return bool(defects_of_starts(binding, keeps_f, parameters, runs.q[block], runs.p[block],
                                      runs.dt[block]).consistent.all())

    with np.errstate(over="ignore", invalid="ignore"):  # a step of what is not finite fails
        return all(is_consistent(slice(i, i + at_once)) for i in range(0, len(runs), at_once))


def as_parameters(
    parameters: Any, domains: Mapping[str, str], number: Callable[[Fraction], Any] = as_double,
    symmetries: Sequence[Symmetry] = (), bodies: Mapping[str, Sequence[str]] = NO_PARAMETERS,
) -> dict[str, Any]:
    """Return the parameters a stepper needs, each checked against its domain.

    The rates of a co-moving frame, those of ``symmetries``, are 0 where they are not given.
    ``bodies`` have the names of inertias, which are checked as builders check them. Raises
    InputError naming a missing, unknown or unusable parameter.
    """
    if not isinstance(parameters, Mapping):
        raise InputError(f"parameters = {shown(parameters)} is not a dict; give "
                         f"{', '.join(domains)}.")
    parameters = with_rules(parameters, domains)
    # the usual case, numbers for all names, without the checks below: a step takes microseconds
    plain_numbers = _as_plain_parameters(parameters, domains, number)
    if plain_numbers is not None:
        refuse_asymmetric(symmetries, plain_numbers)
        refuse_impossible_inertias(bodies, plain_numbers)
        return plain_numbers
    frame = {symmetry.name: 0 for symmetry in symmetries}
    needed = [name for name in domains if name not in frame]
    missing_names = [name for name in needed if name not in parameters]
    if missing_names:
        raise InputError(f"Parameter {missing_names[0]!r} is not given; needed are "
                         f"{', '.join(needed)}.")
    refuse_texts(parameters, domains)
    unknown = [str(name) for name in parameters if name not in domains]
    if unknown:
        raise InputError(f"Parameter {unknown[0]!r} is unknown; allowed are "
                         f"{', '.join(domains)}{proposal(unknown[0], domains)}.")
    all_numbers = {**frame, **parameters}
    checked_numbers = {name: _as_parameter(name, domain, all_numbers, number)
                       for name, domain in domains.items()}
    refuse_asymmetric(symmetries, checked_numbers)
    refuse_impossible_inertias(bodies, checked_numbers)
    return checked_numbers


def with_rules(parameters: Mapping[str, Any], domains: Mapping[str, str]) -> Mapping[str, Any]:
    """Return parameters with the rule γ_m, the mean of the moments, for each γ and α left out."""
    names = [name for name in _names_with_inertia(tuple(domains)) if name not in parameters]
    return {**parameters, **dict.fromkeys(names, GAMMA_M)} if names else parameters


class ParameterCheck:
    """``as_parameters`` of one stepper, with a memory of the last call.

    A control loop passes the same objects in every step, and a check takes longer than a step.
    """

    def __init__(self, *checks: Any) -> None:
        """Take the arguments of ``as_parameters`` after the first, the same for each call."""
        self._checks = checks
        #: Names, unchecked values and checked parameters of the last call.
        self._last: tuple[list[str], list[Any], dict[str, Any]] = [], [], {}

    def __call__(self, parameters: Any) -> dict[str, Any]:
        """Return checked parameters, or raise InputError, as ``as_parameters`` does.

        The result of the last call is returned again for the same objects.
        """
        names, values, last_checked = self._last
        if (type(parameters) is dict and last_checked and len(parameters) == len(names)
                and (all(map(operator.is_, parameters.values(), values))
                     or all(map(_is_unchanged, parameters.values(), values)))
                and [*parameters] == names):
            return last_checked.copy()
        checked = as_parameters(parameters, *self._checks)
        # an array may be changed in place between two calls: only immutable numbers are remembered
        if type(parameters) is dict and {*map(type, parameters.values())} <= IMMUTABLE:
            # one assignment, so that other threads see all three of one call
            self._last = [*parameters], [*parameters.values()], checked.copy()
        return checked


def _is_unchanged(value: Any, last: Any) -> bool:
    """Return whether two values are one object, or one rule for an inertia that is one object."""
    return value is last or (type(value) is type(last) is Rule and value.name == last.name
                             and value.inertia is last.inertia)


def _as_plain_parameters(
    parameters: Mapping[str, Any], domains: Mapping[str, str], number: Callable[[Fraction], Any]
) -> dict[str, Any] | None:
    """Return the parameters if all are finite floats in their domains, else None.

    That takes a tenth of the time of the full check, which matters to hundreds of bodies.
    """
    if number is not as_double or parameters.keys() != domains.keys():
        return None
    values = [*map(parameters.__getitem__, domains)]
    positive, nonzero = _domain_flags(tuple(domains.values()))
    if ({*map(type, values)} <= {float, np.float64, Rounded} and all(map(math.isfinite, values))
            and min(itertools.compress(values, positive), default=1.0) > 0
            and all(itertools.compress(values, nonzero))):
        return dict(zip(domains, map(float, values), strict=True))
    return None


@lru_cache(maxsize=16)
def _domain_flags(domains: tuple[str, ...]) -> tuple[list[bool], list[bool]]:
    """Return two flags a parameter: whether it must be positive, and whether it must not be 0."""
    return [x == "positive" for x in domains], [x == "nonzero" for x in domains]


def refuse_texts(parameters: Mapping[str, Any], domains: Mapping[str, str]) -> None:
    """Refuse text among parameters: searches and means are other calls.

    Raises InputError for "frame", and for text in place of γ or α.
    """
    for name, argument in parameters.items():
        if name == "frame" and name not in domains:
            raise InputError(f"Parameter frame = {shown(argument)} is unknown; the parameters= of "
                             "a run are numbers: rates of the frame, such as those of "
                             "gyrospark.tune(step, start, dt=..., frame='auto').parameters.")
        if isinstance(argument, str) and is_inertia_parameter(str(name)):
            raise InputError(f"Parameter {name} = {shown(argument)} is no number; give that of "
                             "gyrospark.gamma(inertia, 'h'), a mean of the moments, or of "
                             "gyrospark.tune(step, start, dt=..., gamma='auto').parameters. "
                             "Without one it is γ_m.")


def _as_parameter(
    name: str, domain: str, parameters: Mapping[str, Any], number: Callable[[Fraction], Any]
) -> Any:
    """Return one parameter in the stepper's type, γ and α by their rules.

    Raises InputError for a number outside its domain.
    """
    number_or_rule = parameters[name]
    if isinstance(number_or_rule, Rule):
        number_or_rule = gamma_by_rule(name, number_or_rule, parameters)
    real = as_real(f"Parameter {name}", number_or_rule, number)
    if domain == "positive" and real <= 0:
        raise InputError(f"Parameter {name} = {real} is not positive, as the system declares it; "
                         "give a number above 0. (Where 0 is meant, declare the symbol without "
                         "positive=True.)")
    if domain == "nonzero" and real == 0:
        raise InputError(f"Parameter {name} = 0 divides by zero; give a number other than 0.")
    return real


@lru_cache(maxsize=16)
def _names_with_inertia(parameters: tuple[str, ...]) -> list[str]:
    """Return the names of the parameters that are γ or α of a body."""
    names = dict.fromkeys(parameters)
    return [name for name in parameters if has_inertia(name, names)]


def has_searches(parameters: Any) -> bool:
    """Return whether a model leaves parameters to a search or to least squares."""
    return isinstance(parameters, Mapping) and any(
        type(value) is Rule and value.name not in MEANS for value in parameters.values())


def warn_of_negative(parameters: Mapping[str, Any]) -> None:
    """Warn of γ, α and dampings below 0; each parameter is one number, or one for each run."""
    for name, smallest in negative_parameters(parameters).items():
        warn(f"Parameter {name} = {smallest:.6g} is below 0. " + (
            "The motion does not depend on it, but its error does: several times that of a value "
            "near the moments of inertia, such as m." if is_inertia_parameter(name) else
            "Such a damper adds energy; give 0 or more, unless this is meant."))


def negative_parameters(parameters: Mapping[str, Any]) -> dict[str, float]:
    """Return the γ, α and dampings below 0, name → number; of a column the least number."""
    negative: dict[str, float] = {}
    for name in _usually_positive(tuple(parameters)):
        number_or_column = parameters[name]
        # floats alone are the usual case, and NumPy's minimum takes microseconds
        smallest = (number_or_column if type(number_or_column) is float
                    else float(np.min(number_or_column)))
        if smallest < 0:
            negative[name] = smallest
    return negative


@lru_cache(maxsize=16)
def _usually_positive(parameters: tuple[str, ...]) -> list[str]:
    """Return the names of γ and α of bodies, and of dampers, which joints and springs have."""
    return [*_names_with_inertia(parameters),
            *(name for name in parameters if name.endswith("_damping"))]


#: A start is late if it is that many durations of the run after t = 0.
_LATE = 1000


def depends_on_time(binding: Binding) -> bool:
    """Return whether H, g, forces or quantities have t."""
    return binding.time is not None or binding.quantities_take_time


def warn_of_late_start(binding: Binding, t0: Any, dt: Any, steps: int) -> None:
    """Warn if ε |t0|/|dt| > √ε in a system that depends on time, and the start is late.

    The rounding of times is then no small part of a step. ``t0`` and ``dt`` are numbers, or arrays
    with an entry for each of many runs. A start is late if it is ``_LATE`` durations of the run
    from t = 0, on either side.
    """
    if not steps or not depends_on_time(binding):
        return
    starts, sizes = np.broadcast_arrays(np.asarray(t0, float), np.abs(np.asarray(dt, float)))
    distances = np.abs(starts)
    with np.errstate(over="ignore"):  # a duration beyond all numbers makes no start late
        is_late = distances > _LATE * steps * sizes
        ratios = binding.epsilon * np.where(is_late, distances, 0) / sizes
    worst = int(np.argmax(ratios))
    if (ratio := float(ratios.flat[worst])) > np.sqrt(binding.epsilon):
        warn(f"t = {starts.flat[worst]:.6g} s of the start rounds times to {ratio:.1g} of a step. "
             "Sines, cosines and tangents of a t + b in H, g and F keep their digits; what else "
             "depends on t, quantities, and states between steps have errors of that size. Start "
             "at t = 0 to avoid them.")


#: Rounding of t_end, t0 and dt, in parts of their sizes: two roundings of a double each.
_ROUNDING = Fraction(1, 2**52)


def step_count(steps: Any, t_end: Any, t0: Any, dt: Any) -> int:
    """Return the number of steps, as ``span_of``, of a run that ends with a whole step.

    Raises InputError as ``span_of``, and for a time that no whole number of steps leads to.
    """
    count, remainder = span_of(steps, t_end, t0, dt)
    if not remainder:
        return count
    end, start, step = (_fraction(*named_number)
                        for named_number in (("t_end", t_end), ("t", t0), ("dt", dt)))
    # no steps at all are no cure
    times = " and ".join(_text(start + n * step) for n in (count, count + 1) if n)
    steps_of = " or ".join(_text((end - start) / n) for n in (count + 1, count) if n)
    raise InputError(f"t_end = {_text(end)} is no whole number of steps of dt = {_text(step)} from "
                     f"t = {_text(start)}, which is needed here. The nearest that fit: t_end = "
                     f"{times}, or dt = {steps_of}.")


def span_of(steps: Any, t_end: Any, t0: Any, dt: Any) -> tuple[int, Fraction]:
    """Return the number of whole steps, as given or up to t_end, and the time from there to t_end.

    (t_end − t0)/dt is a whole number n if |t_end − t0 − n dt| ≤ 2⁻⁵² (|t_end| + |t0| + n |dt|):
    decimals such as 0.1 are rounded before they come here. Raises InputError for both or neither of
    them, and for an end that dt leads away from.
    """
    if (steps is None) == (t_end is None):
        raise InputError("Give either steps, their number, or t_end, the time of the last state.")
    if t_end is None:
        return as_positive_count("steps", steps), Fraction(0)
    as_step(dt)
    end, start, step = (_fraction(*named_number)
                        for named_number in (("t_end", t_end), ("t", t0), ("dt", dt)))
    span = end - start
    if span * step < 0:
        raise InputError(f"t_end = {_text(end)} lies {'before' if span < 0 else 'after'} the "
                         f"start, t = {_text(start)}, and dt = {_text(step)} leads away from it; "
                         f"give dt = {_text(-step)}.")
    # exact: fractions of doubles round nowhere
    count, fits = _nearest_count(end, start, step)
    if not fits:
        count = math.floor(span / step)
    return as_positive_count("steps", count), Fraction(0) if fits else span - count * step


def steps_until(t: Any, t0: Any, dt: Any) -> int:
    """Return the largest n with t0 + n dt not beyond t, by the rounding of ``step_count``."""
    end, begin, step = _fraction("t", t), _fraction("t0", t0), _fraction("dt", dt)
    count, fits = _nearest_count(end, begin, step)
    return count if fits else math.floor((end - begin) / step)


def _nearest_count(end: Fraction, begin: Fraction, step: Fraction) -> tuple[int, bool]:
    """Return the number of steps that leads nearest to a time, and whether it leads there."""
    span = end - begin
    count = round(span / step)
    rounding = _ROUNDING * (abs(end) + abs(begin) + abs(count * step))
    return count, abs(span - count * step) <= rounding


def _fraction(name: str, value: Any) -> Fraction:
    """Return the exact value of a number of any type; InputError for anything else."""
    as_real(name, value)
    number = exact(value)
    assert isinstance(number, Fraction), shown(value)
    return number


def _text(value: Fraction) -> str:
    """Return the shortest decimal of the nearest double."""
    return repr(as_double(value))
