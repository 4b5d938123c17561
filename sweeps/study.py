"""A parameter sweep as data: steppers, axes and arguments common to all cells."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from ..core.arguments import choose, join_or, proposal
from ..core.arrays import Array
from ..core.errors import InputError
from ..core.event import Event, as_events, refuse_unusable_names, terminal_of
from ..core.incompatibilities import refuse_together
from ..core.real_types import REALS
from ..core.solver import Solver
from ..core.start import Rule
from ..runtime.bindings.array_checks import as_positive_count, as_real, as_step
from ..runtime.bindings.binding import SOLVERS, SolverName
from ..runtime.integration.manifest_symmetries import refuse_asymmetric
from ..runtime.integration.run_arguments import as_parameters, warn_of_negative
from .axes import SCHEME, START, Axis

if TYPE_CHECKING:
    from ..runtime.steppers.stepper import Stepper

__all__ = ["Study", "checked_study"]

#: Quantities of a cell besides the stepper's parameters.
_OWN = (SCHEME, "q", "p")
#: Most steps of a cell to t_end: quotients of doubles are exact whole numbers up to here.
_MOST_STEPS = 2**53


@dataclass(frozen=True, eq=False)
class Study:
    """A sweep.

    Attributes
    ----------
    name : str
    steppers : list of Stepper
        One, or one for each label of the axis ``scheme``.
    axes : list of Axis
        The dimensions of the result, in order.
    parameters : dict
        Those that no axis varies.
    means : dict of str to Rule
        γ and α that follow the moments of each cell.
    q, p : array, shape (n,)
        The start where no axis varies it.
    dt : float or None
        Where no axis varies it; in scaled time Δτ.
    steps : int or None
        Of every cell; or
    t_end : float or None
        Time of the end of every cell, whose steps are the nearest number.
    every : int or None
        Keep every so many states of each cell; None keeps none but the last.
    events : tuple of Event
        Events that are detected in every cell.
    seed : int or None
        With which random points were drawn.
    """

    name: str
    steppers: list[Stepper]
    axes: list[Axis]
    parameters: dict[str, float]
    q: Array
    p: Array
    dt: float | None = None
    steps: int | None = None
    t_end: float | None = None
    every: int | None = None
    solver: SolverName = "auto"
    tolerance: float | None = None
    max_iterations: int = 50
    t0: float = 0.0
    events: tuple[Event, ...] = ()
    seed: int | None = None
    means: Mapping[str, Rule] = field(default_factory=dict)

    @property
    def shape(self) -> tuple[int, ...]:
        """Length of each axis."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def size(self) -> int:
        """Number of cells."""
        return int(np.prod(self.shape, dtype=np.int64))

    @property
    def step_name(self) -> str:
        """Name of the step: "dt", in scaled time "dtau"."""
        return "dtau" if self.steppers[0].binding.clocked else "dt"

    def has_axis(self, name: str) -> bool:
        """Whether an axis varies this quantity."""
        return any(name in axis.columns for axis in self.axes)

    def steps_of(self, dt: Array) -> Array:
        """Return the number of steps of cells with these time steps."""
        if self.steps is not None:
            return np.full(dt.shape, self.steps, dtype=np.int64)
        return np.maximum(np.rint(((self.t_end or 0.0) - self.t0) / dt), 1).astype(np.int64)

    @property
    def time_steps(self) -> Array:
        """Δt of the cells: the values of the axis that varies it, or the one Δt of all cells."""
        name = self.step_name
        column = next((a.columns[name] for a in self.axes if name in a.columns), [self.dt])
        return np.array(column, dtype=float)

    @property
    def max_steps(self) -> int:
        """Most steps of a cell."""
        return int(self.steps_of(self.time_steps).max())


def checked_study(study: Study) -> Study:
    """Return a checked study, its numbers as doubles.

    Raises InputError naming what is missing, unknown, given twice or outside its domain, and the
    cure.
    """
    _refuse_repetition(study)
    _check_axes(study)
    parameters = _checked_parameters(study)
    study = _with_counts(study)
    name = study.step_name
    refuse_together(sweep="a sweep", open_end=name == "dtau" and study.t_end is not None
                    and "t_end in scaled time")
    dt = None if study.has_axis(name) else as_step(study.dt, name=name)
    t_end = _checked_end(replace(study, dt=dt))
    choose("solver for sweeps:", study.solver, SOLVERS)
    for stepper_of_scheme in study.steppers:
        refuse_together(sweep="a sweep", float128=REALS[stepper_of_scheme.manifest.real].in_mpmath
                        and "numbers of type float128")
        # tolerance and iterations may be for the other schemes of several
        stepper_of_scheme._refuse_solver(
            Solver(study.solver) if len(study.steppers) > 1 else
            Solver(study.solver, study.tolerance, study.max_iterations))
    return replace(study, parameters=parameters, dt=dt, t_end=t_end, events=_events(study))


def _check_axes(study: Study) -> None:
    """Refuse a column of an axis that no sweep can vary, and values outside of its domain."""
    names = list(study.steppers[0].parameter_domains)
    for axis in study.axes:
        for column, values in axis.columns.items():
            if column in ("q", "p") and axis.name != START:
                raise InputError(f"{column!r} along the axis {axis.name!r} is no parameter that a "
                                 "sweep can vary, for the results have the states under this name; "
                                 f"give states as the axis {START!r}, or rename the parameter.")
            if column == SCHEME and axis.name != SCHEME:
                raise InputError(f"{SCHEME!r} is a column of the axis {axis.name!r}; schemes vary "
                                 f"along an axis of their own, {SCHEME!r}.")
            _check_column(study, names, column, values)


def _with_counts(study: Study) -> Study:
    """Return a study whose steps, every and iterations are whole numbers; refuse unusable ones."""
    if (study.steps is None) == (study.t_end is None):
        raise InputError("Give a sweep either steps, the number for every cell, or t_end, the "
                         "time of the end of every cell.")
    counts: dict[str, Any] = {
        "max_iterations": as_positive_count("max_iterations", study.max_iterations, minimum=1)}
    for name in ("steps", "every"):
        if getattr(study, name) is not None:  # both may be left out
            counts[name] = as_positive_count(name, getattr(study, name), minimum=1)
    if study.tolerance is not None and as_real("tolerance", study.tolerance) <= 0:
        raise InputError(f"tolerance = {study.tolerance} is not positive; give none for round-off.")
    if study.every is not None and study.steps is None:
        raise InputError("every needs steps: with t_end cells have different numbers of them.")
    return replace(study, **counts)


def _checked_parameters(study: Study) -> dict[str, float]:
    """Return the parameters that all cells share as doubles, by name; refuse unusable ones."""
    stepper = study.steppers[0]
    domains = stepper.parameter_domains
    shared = {name: number for name, number in study.parameters.items() if not study.has_axis(name)}
    # the first cell stands for all: the columns of axes have been checked
    first_cell = shared | {name: float(axis.columns[name][0]) for axis in study.axes
                           for name in axis.columns if name in domains}
    doubles = as_parameters(first_cell, domains, symmetries=stepper.symmetries)
    warn_of_negative(doubles | {name: values for axis in study.axes
                                for name, values in axis.columns.items() if name in domains})
    _refuse_asymmetric_frames(study, doubles)
    return {name: doubles[name] for name in shared}


def _checked_end(study: Study) -> float | None:
    """Return t_end as a double; refuse one that the time step of a cell does not lead to."""
    if study.t_end is None:
        return None
    t_end = float(as_real("t_end", study.t_end))
    away = study.time_steps[(t_end - study.t0) * study.time_steps <= 0]
    if len(away):
        raise InputError(f"t_end = {t_end} is not {'after' if away[0] > 0 else 'before'} the "
                         f"start, t = {study.t0:g}, where dt = {away[0]:g} leads.")
    smallest = min(study.time_steps, key=abs)
    # as fractions: the quotient may have no place in int64, nor in a double
    if abs(Fraction(t_end) - Fraction(study.t0)) > _MOST_STEPS * abs(Fraction(float(smallest))):
        raise InputError(f"t_end = {t_end} is more than {_MOST_STEPS} steps of dt = {smallest:g} "
                         "away; give a longer step, or an earlier end.")
    return t_end


def _events(study: Study) -> tuple[Event, ...]:
    """Return the events; refuse terminal ones, and names that results cannot have."""
    events = as_events(study.events, study.steppers[0].manifest.system.event_quantities)
    refuse_together(sweep="a sweep", terminal=terminal_of(events))
    refuse_unusable_names(events, "results of a sweep")
    return events


def _refuse_asymmetric_frames(study: Study, shared_parameters: Mapping[str, float]) -> None:
    """Refuse cells whose co-moving frame turns about an axis of no symmetry at their parameters.

    ``symmetry.name`` is the parameter with the rate of the frame; ``shared_parameters`` are
    those that no axis varies.
    """
    for symmetry in study.steppers[0].symmetries:
        if not symmetry.condition:
            continue
        names = {symmetry.name, *symmetry.condition_parameters}
        # of each axis that varies one of them, its points: name → value
        axes = []
        for axis in study.axes:
            columns = {name: x for name, x in axis.columns.items() if name in names}
            if columns:
                axes.append([{name: float(x[i]) for name, x in columns.items()}
                             for i in range(len(axis))])
        for points in product(*axes):
            refuse_asymmetric([symmetry], {**shared_parameters, **ChainMap(*points)})


def _refuse_repetition(study: Study) -> None:
    """Refuse axes of one name, and a column on two axes."""
    axis_of_column: dict[str, str] = {}
    for axis in study.axes:
        if sum(axis.name == other_axis.name for other_axis in study.axes) > 1:
            raise InputError(f"Two axes are named {axis.name!r}; give each its own name.")
        for column in axis.columns:
            if column in axis_of_column:
                raise InputError(f"{column!r} varies along {axis_of_column[column]!r} and along "
                                 f"{axis.name!r}; let one of them do.")
            axis_of_column[column] = axis.name
    if not study.axes:
        raise InputError("Nothing varies in this sweep; give an axis, for example "
                         '{"gamma": [4e-4, 8e-4, 16e-4]}.')


def _check_column(study: Study, names: Sequence[str], column: str, values: Array) -> None:
    """Refuse values of a column of an axis that no run can have, and columns that are no arguments.
    """
    stepper = study.steppers[0]
    if column in ("q", "p"):
        if values.shape[1] != stepper.n:
            raise InputError(f"The starts have {values.shape[1]} numbers each in {column}; "
                             f"{stepper.name} has {stepper.n} coordinates.")
        if not np.isfinite(values).all():
            raise InputError(f"The starts have a {column} that is not finite; mend it.")
    elif column == study.step_name:
        for unusable in (values[values == 0], values[~np.isfinite(values)]):
            if len(unusable):
                as_step(float(unusable[0]), name=column)  # raises, as of a single run
    elif column not in (*_OWN, *names):
        choices = [*names, study.step_name, SCHEME, START]
        raise InputError(f"{column!r} is nothing that a sweep of {stepper.name} can vary; choose "
                         f"{join_or(choices)}{proposal(column, choices)}.")
    elif column in names:
        domain = stepper.parameter_domains[column]
        # a real parameter takes every number but NaN, which differs from itself
        outside_domain = {"positive": values <= 0, "nonzero": values == 0}.get(
            domain, values != values)
        if outside_domain.any():
            raise InputError(f"Parameter {column} = {values[outside_domain][0]} is not {domain}; "
                             "an axis that holds it cannot be swept.")


def as_table(value: Any, name: str) -> Mapping[str, Any]:
    """Return a mapping, or raise InputError that names it."""
    if not isinstance(value, Mapping):
        raise InputError(f"{name} = {value!r} is no table; write name = value pairs.")
    return value
