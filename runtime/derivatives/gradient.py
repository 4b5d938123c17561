"""Gradients of functions of a run by the adjoint, backwards through its steps.

A run keeps its states and unknowns where they fit in memory; else checkpoints, from which pieces
are run again, with the same bits; or, with memory="none", nothing: the states are run backwards in
time from the end, and the start that this leads to must be the one of the run.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...core.arguments import as_items, as_mapping, choose, few, shown, unknown
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.exact_numbers import exact
from ...core.html import card, table
from ...core.incompatibilities import refuse_together
from ...core.records import dataclass
from ...core.registry import function_of
from ..bindings.array_checks import as_numbers, as_real
from ..bindings.run_memory import DEFAULT_MEMORY, RunState
from ..integration.run_arguments import RunArguments
from ..results.joint_motion import cotangents_of_multipliers, multipliers_at_states
from ..results.outputs import full_states
from .binding import KeptSteps
from .frame import FrameMotion
from .kept_steps import (
    PIECE,
    linearisation_error,
    multiplier_shape,
    number_bytes,
    part_sizes,
    pieces,
    refuse_run,
    split,
    step_bytes,
    warn_of_growth,
    warn_of_jumps,
)
from .points import Point, RunRows, cotangent_at
from .tangent_space import TangentSpace, null_space

if TYPE_CHECKING:
    from ..bindings.compiled_module import Compiled
    from ..results.trajectory import Trajectory
    from ..steppers.stepper import Stepper

__all__ = ["Cotangents", "Gradient", "as_bytes", "cotangents_of", "gradient_of", "names_of"]

#: Relative mismatch of a run and its way back, beyond which a gradient is refused.
_MISMATCH = 1e-6
_OTHER_END = "the run, done again, ends elsewhere than it did; give the solver that it had"
_UNITS = {"": 1, "b": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9,
          "kib": 2**10, "mib": 2**20, "gib": 2**30}


@explain_arguments
@dataclass(frozen=True)
class Gradient:
    """The gradient of a function of a run.

    Attributes
    ----------
    value : float or None
        The function, where ``loss`` computed it.
    q, p : array, shape (n,)
        By the start: of the function of (q, p) projected onto the constraints.
    start : array, shape (2 (n − m),)
        By coordinates y of the tangent space at the start, z0 + B y; ``basis`` is B.
    inputs : array, shape (rows, inputs)
        By each row of inputs as it was given: of a row that ``hold`` keeps for several steps, and
        of inputs that stay, the sum over their steps.
    wrt : tuple of str
        What was asked for; ``gradient[name]`` gives one of them, or any parameter, dt or t0.
    switched_steps : int
        Steps that end on another side of a switch of H or the forces (``Piecewise``, abs(x)) than
        they begin. Derivatives are taken on the sides where their stages are; where a force
        jumps, they belong to the discrete run, and not to the motion.
    """

    value: Any
    q: Array
    p: Array
    #: Derivatives of g and f by (q, p).
    _normals: Array
    inputs: Array
    wrt: tuple[str, ...]
    _numbers: dict[str, Any]
    switched_steps: int = 0

    @classmethod
    def of_cotangent(
        cls, space: TangentSpace, z_bar: Array, wrt: tuple[str, ...], value: Any = None,
        inputs: Array | None = None, switched_steps: int = 0,
    ) -> Gradient:
        """Return the gradient from the cotangent z̄ of all rows, q, p, parameters, Δt and t0.

        z̄ has 2n + parameters + 2 numbers. In scaled time the last coordinate is the time, so that
        its cotangent belongs to t0, and q and p are returned without it.
        q and p of z̄ are pulled back through the projection of the start. ``inputs`` has the
        derivatives by each row of inputs; by default the run is one step, whose inputs are
        parameters.
        """
        binding, n = space.binding.module, space.n
        z_bar = space.pulled_back(z_bar)
        names = [*binding.parameter_names, "dt", "t0"]
        if inputs is None:
            inputs = z_bar[[2 * n + names.index(u) for u in binding.input_names]][None]
        numbers = dict(zip(names, z_bar[2 * n :].tolist(), strict=True))
        if binding.clocked:
            numbers["t0"] = z_bar[n - 1 : n].tolist()[0]  # a number of Python, as the others
        # copies: views would keep the whole of z̄ alive
        q, p = z_bar[: binding.shown].copy(), z_bar[n : n + binding.shown].copy()
        return cls(value, q, p, space.normals, inputs, wrt, numbers, switched_steps)

    def __repr__(self) -> str:
        value = "" if self.value is None else f" of a function with the value {self.value:.6g}"
        return f"<Gradient{value} by {few(self.wrt)}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the value, and its derivative by each name of ``wrt``."""
        rows = [(name, few(f"{float(x):.6g}" for x in np.ravel(self[name]))) for name in self.wrt]
        value = [] if self.value is None else [("value", f"{self.value:.6g}")]
        return card("Gradient", table([*value, *rows]))

    @property
    def basis(self) -> Array:
        """An orthonormal basis of the tangent space at the start, shape (2 n, 2 (n − m))."""
        return null_space(self._normals)

    @property
    def start(self) -> Array:
        """By coordinates of the tangent space at the start."""
        components: Array = self.basis.T @ np.concatenate([self.q, self.p])
        return components

    def __getitem__(self, name: str) -> Any:
        """Return the derivative by a parameter, "dt", "t0", "q", "p", "start" or "inputs"."""
        if name in ("q", "p", "start", "inputs"):
            return getattr(self, name)
        if name not in self._numbers:
            raise unknown("name", name, [*self._numbers, "q", "p", "start", "inputs"])
        return self._numbers[name]

    def vector(self) -> Array:
        """Return the gradient as one vector, in the order of ``wrt``."""
        return np.concatenate([np.ravel(np.asarray(self[name])) for name in self.wrt])


def names_of(stepper: Stepper, wrt: str | Sequence[str] | None) -> tuple[str, ...]:
    """Return the checked variables of a gradient; by default the start and all parameters.

    Raises InputError for an unknown name, with the nearest.
    """
    parameters = [*stepper.parameter_domains, *(s.name for s in stepper.symmetries)]
    if wrt is None:
        # a rate of a frame may be among the parameters already
        return ("start", *dict.fromkeys(parameters))
    names = (wrt,) if isinstance(wrt, str) else tuple(as_items("wrt", wrt, "names"))
    if not names:
        raise InputError("wrt is empty; give names, such as [\"start\"], or leave it out.")
    inputs = ["inputs"] if stepper.binding.input_names else []
    allowed = ["start", "q", "p", "dt", "t0", *inputs, *dict.fromkeys(parameters)]
    for name in names:
        if not isinstance(name, str) or name not in allowed:
            raise unknown("name in wrt", name, allowed,
                          "; derivatives by angles and rates of joints follow from the start's, "
                          "as the page on derivatives shows")
    return names


def as_bytes(memory: Any) -> int | None:
    """Return a bound of memory in bytes; None for "none".

    Raises InputError unless it is a number with a unit, such as "256 MB", or "none".
    """
    if isinstance(memory, str) and memory == "none":
        return None
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([A-Za-z]*)\s*", str(memory))
    if match is None or match[2].lower() not in _UNITS:
        raise InputError(f"memory = {shown(memory)} is no size; give bytes, such as \"256 MB\", or "
                         "\"none\" to run backwards instead of keeping steps.")
    # at most 2⁶²: an infinite number of bytes has no int
    return int(min(float(match[1]) * _UNITS[match[2].lower()], 2.0**62))


class PointCotangents(NamedTuple):
    """A state within a step, and its cotangents."""

    point: Point
    state: Array  # shape (2 n,)
    time: Any
    multipliers: Array | None


@dataclass(frozen=True)
class Cotangents:
    """Derivatives of a function of a run by its stored states, and by the times of these.

    Attributes
    ----------
    rows, times : array, shapes (rows, 2 n) and (rows,)
        By the states after whole steps that the run stores, and by their times.
    multipliers : array, shape (rows, multipliers of a step)
        By the multipliers of the steps that end at these states; empty for a function without
        multipliers.
    points : list of PointCotangents
        By states within steps, their times and multipliers.
    """

    rows: Array
    times: Array
    multipliers: Array
    points: list[PointCotangents]
    #: Derivatives of the function by parameters at fixed states.
    parameters: Mapping[str, Any]

    @property
    def sizes(self) -> Array:
        """Euclidean norms (2,) of cotangents of q and of p, or of multipliers where these are 0."""
        states = np.concatenate([self.rows, *(within.state[None] for within in self.points)])
        forces = [self.multipliers.ravel(), *(within.multipliers for within in self.points
                                              if within.multipliers is not None)]
        size = np.linalg.norm(np.concatenate(forces).astype(float))
        return np.array([np.linalg.norm(half.astype(float)) or size
                         for half in np.split(states, 2, axis=1)])


def cotangents_of(stepper: Stepper, kinds: RunRows, cotangents: Mapping[str, Any]) -> Cotangents:
    """Return the checked cotangents of a trajectory, sorted by the kinds of its rows.

    ``cotangents`` are ∂L/∂x of a function L by x = "q", "p", "t", "multipliers", each with a row
    for each row of the trajectory; and "events" and "parameters" by their names. Ends of steps have
    ``rows`` of the result, states within steps and at events ``points``. Raises InputError for
    other names and shapes, for numbers that are not finite, for events without derivatives.
    """
    binding, step_rows = stepper.binding, len(kinds.of_steps)
    cotangents = as_mapping("cotangents", cotangents, "{'q': ...}")
    parameters = _parameter_cotangents(stepper, cotangents.get("parameters", {}))
    arrays = {name: array for name, array in cotangents.items()
              if name not in ("events", "parameters")}
    # rows of a trajectory are ends of steps first, then points within steps
    row_count = step_rows + len(kinds.points)
    of_states, of_times = _cotangents_of_states(stepper, row_count, arrays, where="")
    of_multipliers = _multiplier_cotangents(stepper, row_count, arrays)
    # the C stores the start and ``run.rows`` states; those that the trajectory lacks keep zeros
    stored_count = kinds.run.rows + 1
    rows, times = binding.new(stored_count, 2 * binding.n), binding.new(stored_count)
    rows[:step_rows], times[:step_rows] = of_states[:step_rows], of_times[:step_rows]
    multipliers = binding.new(stored_count if len(of_multipliers) else 0, binding.multipliers)
    multipliers[:step_rows] = of_multipliers[:step_rows]
    point_multipliers: Iterable[Array | None] = (
        of_multipliers[step_rows:] if len(of_multipliers) else [None] * len(kinds.points))
    points = [PointCotangents(*entries) for entries in zip(
        kinds.points, of_states[step_rows:], of_times[step_rows:], point_multipliers, strict=True)]
    points += _event_cotangents(stepper, kinds, cotangents.get("events", {}))
    return Cotangents(rows, times, multipliers, points, parameters)


def _parameter_cotangents(stepper: Stepper, cotangents: Any) -> dict[str, Any]:
    """Return checked derivatives by parameters at fixed states, name → number of the stepper."""
    binding = stepper.binding
    parameters = as_mapping("cotangents of parameters", cotangents, "{'m': 1.0}")
    for name in parameters:
        if name not in binding.parameter_names:
            raise unknown("parameter", name, binding.parameter_names)
    return {name: as_real(f"The cotangent of {name}", derivative, binding.number)
            for name, derivative in parameters.items()}


def _event_cotangents(stepper: Stepper, kinds: RunRows, cotangents: Any) -> list[PointCotangents]:
    """Return the points of events with their checked cotangents; events have no multipliers.

    ``cotangents`` has a dict of "q", "p" and "t", a row for each crossing, by the event's name.
    """
    points: list[PointCotangents] = []
    for name, event_cotangents in as_mapping("events", cotangents, "{'x': {'t': 1.0}}").items():
        event_names = [*kinds.events, *kinds.refused]
        if not event_names:
            raise InputError(f"There are cotangents of the event {name!r}, and this run has no "
                             "events; leave them out.")
        choose("event", name, event_names)
        crossings = kinds.event(name)
        of_states, of_times = _cotangents_of_states(
            stepper, len(crossings), event_cotangents, where=f" at the event {name}")
        points += [PointCotangents(*entries, multipliers=None)
                   for entries in zip(crossings, of_states, of_times, strict=True)]
    return points


def _multiplier_cotangents(stepper: Stepper, rows: int, cotangents: Mapping[str, Any]) -> Array:
    """Return the checked cotangents of multipliers, shape (rows, multipliers of a step).

    Without "multipliers" in ``cotangents`` there are no rows.
    """
    binding = stepper.binding
    if "multipliers" not in cotangents:
        return binding.new(0, binding.multipliers)
    of_multipliers = binding.new(rows, *multiplier_shape(stepper))
    # the first state is the end of no step: its row stays 0
    _fill(binding, "multipliers", cotangents["multipliers"], of_multipliers[1:], where="",
          row="step that is stored")
    return of_multipliers.reshape(rows, -1)


def _cotangents_of_states(
    stepper: Stepper, rows: int, cotangents: Mapping[str, Any], where: str
) -> tuple[Array, Array]:
    """Return cotangents of rows of (q, p), shape (rows, 2 n), and of their times, shape (rows,).

    In scaled time t is the last coordinate, and its cotangents are in that column. ``where`` is
    " at the event x" for the crossings of an event, which has no multipliers, else empty.
    """
    binding = stepper.binding
    n, coordinate_count = binding.n, binding.shown
    w, times = binding.new(rows, 2 * n), binding.new(rows)
    # views of w: in scaled time its columns of t and of e = −H are no columns of q and p
    targets = {"q": w[:, :coordinate_count], "p": w[:, n : n + coordinate_count], "t": times}
    for name, array in as_mapping("cotangents", cotangents, "{'q': ...}").items():
        if not where and name == "multipliers":
            continue  # ``_multiplier_cotangents`` takes them
        if name not in targets:
            kinds_of_rows = () if where else ("multipliers", "events", "parameters")
            raise unknown("kind of cotangents", name, [*targets, *kinds_of_rows])
        _fill(binding, name, array, targets[name], where, row="state")
    if binding.clocked:
        w[:, n - 1], times = times, 0 * times
    return w, times


def _fill(binding: Compiled, name: str, array: Any, target: Array, where: str, row: str) -> None:
    """Check cotangents and copy them into ``target``, shape (rows, ...), in the stepper's type.

    They have the shape of ``target``, or of its last row, and then the others are 0. ``name`` is
    "q", "p", "t" or "multipliers"; for errors, ``where`` names the event, and ``row`` the kind of a
    row: a state or a step.
    """
    numbers, row_shape = as_numbers(f"cotangents of {name}", array), target.shape[1:]
    if not np.isfinite(numbers.astype(float)).all():
        raise InputError(f"The cotangents of {name} are not finite; give numbers.")
    is_last_row = numbers.shape == row_shape
    if numbers.shape not in (row_shape, target.shape) or (is_last_row and not len(target)):
        raise InputError(f"The cotangents of {name}{where} have the shape {numbers.shape}; "
                         f"give {target.shape}, a row for each {row}, or {row_shape} for the last.")
    # a slice, as an array of one number would stay an array in arrays of objects
    target[-1 if is_last_row else 0 :] = binding.to_real(numbers)


def gradient_of(
    stepper: Stepper, run: RunArguments, cotangents: Cotangents, wrt: tuple[str, ...],
    memory: Any = DEFAULT_MEMORY, value: Any = None, end: tuple[Array, Array] | None = None,
) -> Gradient:
    """Return the gradient of a function of a checked run from its cotangents, by ``wrt``.

    ``value`` is the function's value, for the result. ``end`` is the state (q, p) at the end of the
    run, which the steps must lead to; None leaves the check out. Raises InputError for memory that
    is too little, with how much is needed, and for events without derivatives; StepFailed as the
    run itself does: there is no partial gradient.
    """
    memory_bytes = as_bytes(memory)
    if memory_bytes is None:
        _refuse_reversed(stepper, run)  # before derivatives are compiled
    adjoint = _AdjointRun(stepper, run, cotangents)
    w = adjoint.advance(memory_bytes, end)
    warn_of_growth(stepper, "On its way to the start the cotangent has", cotangents.sizes,
                   part_sizes(w))
    space = TangentSpace(adjoint.binding, adjoint.parameters, run.q, run.p,
                         stepper.constraint_names)
    warn_of_jumps(stepper, adjoint.switched)
    inputs_bar = adjoint.inputs_bar
    if run.inputs is not None:
        inputs_bar = _summed_over_hold(inputs_bar, run.inputs.hold)
    return Gradient.of_cotangent(space, adjoint.z_bar, wrt, value, inputs_bar, adjoint.switched)


class _AdjointRun:
    """A run from its last step to its first, with the cotangent of the state in the frame.

    Attributes
    ----------
    z_bar : array, shape (rows,)
        The cotangent of the start, parameters, Δt and t0 so far.
    inputs_bar : array, shape (steps, inputs)
        The cotangents of the inputs of each step; no rows if the run has no inputs.
    switched : int
        Steps so far across a switch of H or the forces.
    """

    def __init__(self, stepper: Stepper, run: RunArguments, cotangents: Cotangents) -> None:
        """Allocate z̄, with the derivatives by parameters and times beside those by states."""
        refuse_run(run)
        self.stepper, self.run, self.cotangents = stepper, run, cotangents
        self.binding = stepper._derivative_binding()
        self.module, n = self.binding.module, stepper.binding.n
        names = [*stepper.binding.parameter_names, "dt", "t0"]
        input_names = stepper.binding.input_names if run.inputs is not None else []
        self.input_columns = [2 * n + names.index(u) for u in input_names]
        points = cotangents.points
        self.steps_of_points = np.array([within.point.step for within in points], int)
        self.frame = FrameMotion(self.binding, stepper.symmetries, run)
        if len(cotangents.multipliers) or any(
                within.multipliers is not None for within in points):
            self.frame.refuse_rotating_multipliers(run)
        self.z_bar = self.module.new(self.binding.rows)
        for name, derivative in cotangents.parameters.items():
            self.z_bar[2 * n + names.index(name)] = derivative
        # t_k = t0 + k Δt: the cotangents of times are those of t0, and k times those of Δt
        self.z_bar[-1] = cotangents.times.sum()
        self.z_bar[-2] = (cotangents.times * run.steps_of_rows(run.steps)).sum()
        # a point after the last whole step lies in one more step, which has inputs of its own
        ends_within_step = bool(len(points)) and int(self.steps_of_points.max()) == run.steps
        self.inputs_bar: Array = self.module.new(
            (run.steps + ends_within_step) if input_names else 0, len(input_names))
        self.parameters = self.module.parameters(run.parameters, run.t0)
        self.switched = 0

    def advance(self, memory: int | None, end: tuple[Array, Array] | None) -> Array:
        """Take all steps backwards; return the cotangent of the start, which ``z_bar`` has too.

        At each state the cotangents of its row and of the points in the step after it are added.
        ``memory`` is the bound of memory in bytes, or None to keep nothing; ``end`` is the state
        that the run ends in, or None.
        """
        w: Array | None = None
        for kept_piece in backwards(self.stepper, self.run, memory, end):
            self.switched += self.binding.count_switches(self.run, self.parameters, kept_piece)
            # the C takes many steps at once: a piece is cut where cotangents of points are added
            for steps in reversed(split(kept_piece, np.unique(self.steps_of_points))):
                if w is None:
                    last_step = steps.first + steps.count
                    w_in_space = self.cotangents.rows[-1] + self._cotangent_of_points(
                        last_step, steps.q[-1], steps.p[-1])
                    w = _cotangent_in_frame(self.frame, steps, last_step, w_in_space, self.z_bar)
                w = self._take(steps, w)
        if w is None:  # a run of no steps
            w = self.cotangents.rows[0] + self._cotangent_of_points(
                step=0, q=self.run.q, p=self.run.p)
        self.z_bar[: len(w)] = w
        return w

    def _take(self, steps: KeptSteps, w: Array) -> Array:
        """Return the cotangent of the state before some steps, from w of the state after them.

        Both are of states in the frame, shape (2 n,); ``w`` is overwritten. The cotangents of
        parameters, times and inputs are added to ``z_bar`` and ``inputs_bar``.
        """
        run = self.run
        row_cotangents = _cotangents_of_rows(self.frame, run, steps, self.cotangents.rows,
                                             self.z_bar)
        multipliers = _cotangents_of_multipliers(self.stepper, run, steps,
                                                 self.cotangents.multipliers)
        # C writes the cotangents of inputs, and adds to those of parameters
        has_inputs = len(self.inputs_bar) > 0
        step_inputs_bar = self.module.new(steps.count if has_inputs else 0, len(self.input_columns))
        status = self.binding.integrate_adjoint(
            run, self.parameters, steps, cotangents=row_cotangents, every=run.every,
            multipliers=multipliers, w=w, z_bar=self.z_bar, inputs_bar=step_inputs_bar)
        if status:
            raise linearisation_error(steps.first, status)
        if has_inputs:
            self.inputs_bar[steps.first : steps.first + steps.count] += step_inputs_bar
        if (self.steps_of_points == steps.first).any():
            of_points = self._cotangent_of_points(steps.first, steps.q[0], steps.p[0])
            w += _cotangent_in_frame(self.frame, steps, steps.first, of_points, self.z_bar)
        return w

    def _cotangent_of_points(self, step: int, q: Array, p: Array) -> Array:
        """Return the cotangent, (2 n,), of the state before a step from the points within the step.

        (q, p) is the state in the frame, the cotangent is of the state in space. Cotangents of
        parameters and times are added to ``z_bar``, those of inputs to ``inputs_bar``.
        """
        cotangent: Array = self.module.new(self.binding.rows)
        z = np.concatenate([q, p])
        if self.frame.moves:
            z = self.frame.matrix(step) @ z
        for i in np.flatnonzero(self.steps_of_points == step):
            within = self.cotangents.points[i]
            cotangent += cotangent_at(self.stepper, self.run, within.point, z, within.state,
                                      within.time, within.multipliers)
        # the inputs of a step are parameters of its own
        if len(self.inputs_bar) and cotangent.any():
            self.inputs_bar[step] += cotangent[self.input_columns]
            cotangent[self.input_columns] = 0
        self.z_bar[len(z) :] += cotangent[len(z) :]
        return cotangent[: len(z)]


def _cotangent_in_frame(
    frame: FrameMotion, steps: KeptSteps, k: int, cotangent: Array, z_bar: Array
) -> Array:
    """Return the cotangent Sᵀ w, (2 n,), of the state z̃ in the frame after k steps.

    ``cotangent`` is w, the cotangent of the state S z̃ in space; step k begins or ends one of
    ``steps``. The cotangents of the frame's rates and of Δt, (dS z̃)ᵀ w, are added to ``z_bar``.
    """
    if not frame.moves:
        return cotangent
    z = np.concatenate([steps.q[k - steps.first], steps.p[k - steps.first]])
    z_bar[:] += frame.own_derivatives(k, z).T @ cotangent
    rotated: Array = frame.matrix(k).T @ cotangent
    return rotated


def _cotangents_of_rows(
    frame: FrameMotion, run: RunArguments, steps: KeptSteps, rows: Array, z_bar: Array
) -> Array:
    """Return the cotangents of the stored states before these steps, in the frame, (·, 2 n).

    ``rows``, (stored states, 2 n), has the cotangents of all stored states in space. Those of the
    frame's rates are added to ``z_bar``, (rows of a direction,).
    """
    first_row = steps.first // run.every
    # a copy, for it is changed below
    cotangents = rows[first_row : (steps.first + steps.count - 1) // run.every + 1].copy()
    if steps.first % run.every:
        cotangents[0] = 0  # the state is not stored: its row belongs to an earlier one
    for i in range(len(cotangents) if frame.moves else 0):
        k = (first_row + i) * run.every
        if k >= steps.first:
            cotangents[i] = _cotangent_in_frame(frame, steps, k, cotangents[i], z_bar)
    return cotangents


def _cotangents_of_multipliers(
    stepper: Stepper, run: RunArguments, steps: KeptSteps, multipliers: Array
) -> Array:
    """Return the cotangents of the multipliers of the kept steps, (steps, multipliers).

    ``multipliers`` has a row for each stored state, with the cotangents of the multipliers of the
    step that ends there, or no rows; then the result has none.
    """
    cotangents: Array = stepper.binding.new(
        steps.count if len(multipliers) else 0, stepper.binding.multipliers)
    if len(multipliers):
        # the start of these steps is the end of an earlier one
        step_indices = run.steps_of_rows(run.steps) - steps.first
        is_end = (step_indices > 0) & (step_indices <= steps.count)
        cotangents[step_indices[is_end] - 1] = multipliers[is_end]
    return cotangents


def _summed_over_hold(inputs_bar: Array, hold: int) -> Array:
    """Return the cotangent of each row of inputs: the sum over the steps that the row is held for.

    ``inputs_bar`` has the shape (steps, inputs). Each row is held for ``hold`` steps; 0 stands for
    all of them.
    """
    if hold == 0:
        sum_of_all: Array = inputs_bar.sum(axis=0, keepdims=True)
        return sum_of_all
    # the last row may be held for fewer steps, which a reshape would not allow
    starts = np.arange(0, len(inputs_bar), hold)
    sums: Array = np.add.reduceat(inputs_bar, starts, axis=0) if len(starts) else inputs_bar
    return sums


# ------------------------------------------------------------------ the steps, from the last on


def _refuse_reversed(stepper: Stepper, run: RunArguments) -> None:
    """Refuse runs that steps of −Δt do not lead back: they do not pass through jumps, for one."""
    refuse_together(reversed='memory = "none"', inputs=run.inputs is not None and "inputs",
                    frame=bool(stepper.symmetries) and "a co-moving frame",
                    impacts=bool(run.impact_steps) and "a run with impacts")


def backwards(
    stepper: Stepper, run: RunArguments, memory: int | None, end: tuple[Array, Array] | None
) -> Iterator[KeptSteps]:
    """Yield the steps of a run in pieces, the last piece first.

    All steps are kept where they fit into ``memory`` bytes; else checkpoints are, from which pieces
    run again; without ``memory``, None, states come of steps of −Δt. ``end`` is the state (q, p)
    that the run ended in and must lead to again, or None. Raises InputError for memory that is too
    little or another end.
    """
    if run.steps == 0:
        return
    if memory is None:
        yield from _iterate_backwards(stepper, run, end)
    elif run.impact_steps:
        yield from _back_through_impacts(stepper, run, memory, end)
    elif run.steps * step_bytes(stepper) <= memory:
        kept_run = stepper._derivative_binding().begin(run)
        steps, status = kept_run.keep(run.steps)
        _check(stepper, run, kept_run, status, end)
        yield steps
    else:
        yield from _back_from_checkpoints(stepper, run, memory, end)


def _back_from_checkpoints(
    stepper: Stepper, run: RunArguments, memory: int, end: tuple[Array, Array] | None
) -> Iterator[KeptSteps]:
    """Yield the steps of a run in pieces, the last first, each run again from its checkpoint.

    Two levels: n steps of b bytes with a checkpoint of c bytes at each s-th step keep n/s
    checkpoints and the s steps of one piece, least for s = √(n c/b).
    """
    kept_run = stepper._derivative_binding().begin(run)
    checkpoint_bytes = kept_run.state.nbytes(kept_run.binding.module)
    piece_steps = max(1, math.isqrt(run.steps * checkpoint_bytes // step_bytes(stepper)))
    piece_count = -(-run.steps // piece_steps)  # rounded up
    needed_bytes = piece_count * checkpoint_bytes + piece_steps * step_bytes(stepper)
    if needed_bytes > memory:
        raise InputError(f"memory = {memory:,} bytes are too few for {run.steps:,} steps; "
                         f"checkpoints need {needed_bytes:,}. Give these, or memory=\"none\".")
    checkpoints = list[RunState]()
    while kept_run.steps_done < run.steps:
        checkpoints.append(kept_run.state.copy(kept_run.binding.module))
        # forwards the steps themselves are dropped: only the state after them is needed
        _, status = kept_run.keep(min(piece_steps, run.steps - kept_run.steps_done))
        if status:
            _check(stepper, run, kept_run, status, end=None)
    _check(stepper, run, kept_run, status=0, end=end)
    for checkpoint in reversed(checkpoints):
        kept_run.state.assign(kept_run.binding.module, checkpoint)
        # the same steps as before, to the bit
        steps, status = kept_run.keep(min(piece_steps, run.steps - kept_run.steps_done))
        assert not status
        yield steps


def _back_through_impacts(
    stepper: Stepper, run: RunArguments, memory: int, end: tuple[Array, Array] | None
) -> Iterator[KeptSteps]:
    """Yield the steps of a run with impacts, all of which are kept, the last ones first.

    A step keeps q, p and its unknowns; one with impacts also the derivative of the state at its end
    by the direction at its start, (2 n, rows).
    """
    binding = stepper._derivative_binding()
    matrix_bytes = 2 * binding.n * binding.rows * number_bytes(stepper)
    needed_bytes = run.steps * step_bytes(stepper) + len(run.impact_steps) * matrix_bytes
    if needed_bytes > memory:
        raise InputError(f"memory = {memory:,} bytes are too few: a run with impacts keeps all its "
                         f"steps, {needed_bytes:,} bytes; give these.")
    steps_in_order = list(pieces(stepper, run, binding.begin(run)))
    if end is not None:
        last_steps = steps_in_order[-1]
        _refuse_mismatch((last_steps.q[-1], last_steps.p[-1]), end, _OTHER_END)
    yield from reversed(steps_in_order)


def _check(
    stepper: Stepper, run: RunArguments, kept_run: Any, status: int, end: tuple[Array, Array] | None
) -> None:
    """Raise the error of a kept run that failed, or that does not end at ``end`` as it did before.

    ``status`` is the status of the compiled code, 0 for success; ``end`` is (q, p), shapes (n,), or
    None if the end is not compared.
    """
    if status:
        stepper._run(run)  # raises the error that says why, with the states before it
        raise linearisation_error(kept_run.steps_done, status)
    # in a co-moving frame the kept state is in the frame, and ``end`` in space
    if end is not None and not stepper.symmetries:
        _refuse_mismatch((kept_run.state.q, kept_run.state.p), end, _OTHER_END)


def _refuse_mismatch(end: tuple[Array, Array], stored_end: tuple[Array, Array], why: str) -> None:
    """Refuse a gradient if the run, done again, does not end at ``stored_end``, (q, p) both.

    q and p are compared relative to their largest entry; ``why`` is for the error.
    """
    for x, stored_x in zip(end, stored_end, strict=True):
        size = float(np.abs(stored_x).max(initial=0)) or 1.0
        mismatch = float(np.abs(x - stored_x).max(initial=0)) / size
        # "not <=" refuses NaN too
        if not mismatch <= _MISMATCH:
            raise InputError(f"There is no gradient: {why} (mismatch {mismatch:.1e}).")


def _iterate_backwards(
    stepper: Stepper, run: RunArguments, end: tuple[Array, Array] | None
) -> Iterator[KeptSteps]:
    """Yield the steps from the last on; states come of steps of −Δt, and nothing is stored.

    ``end`` is the state (q, p) at the end of the run, which is integrated for it if None.
    """
    if end is None:
        trajectory = stepper._run(replace(run, every=max(run.steps, 1)))
        end = _last_state(trajectory)
    # (q, p) is the state after ``remaining`` steps of the run
    binding, (q, p), remaining = stepper._derivative_binding(), end, run.steps
    while remaining:
        # a step of −Δt is the inverse of one of Δt to round-off for the symmetric schemes: states
        # run back, and each piece forward again for its unknowns
        count = min(PIECE, remaining)
        reverse_run = stepper._run(replace(
            run, q=q.copy(), p=p.copy(), dt=-run.dt, steps=count, every=count,
            t0=run.t0 + remaining * run.dt))
        q, p = _last_state(reverse_run)
        remaining -= count
        forward = binding.begin(replace(run, q=q.copy(), p=p.copy(), steps=count,
                                        t0=run.t0 + remaining * run.dt))
        steps, status = forward.keep(count)
        if status:
            raise linearisation_error(remaining, status)
        yield replace(steps, first=remaining)
    _refuse_mismatch((q, p), (run.q, run.p), "running backwards does not lead to the start; give "
                     "memory=\"256 MB\", and the steps are kept")


def _last_state(trajectory: Trajectory) -> tuple[Array, Array]:
    """Return the last q and p, in scaled time with t and its momentum."""
    q, p = full_states(trajectory)
    return q[-1], p[-1]


def value_of(loss: Callable[..., Any], run: Trajectory) -> tuple[Any, Mapping[str, Any]]:
    """Return the value of a loss at a run, and its cotangents, {"q": array, ...}.

    Raises InputError where the loss returns anything but a number and a dict.
    """
    outcome = loss(run)
    if not isinstance(outcome, tuple) or len(outcome) != 2:
        raise InputError(f"The loss returned {shown(outcome)}; return its value and a dict of "
                         "cotangents, {'q': ..., 'p': ...}.")
    value, cotangents = outcome
    # ``item`` turns numbers of NumPy, PyTorch and JAX into Python's; arrays have none to turn
    is_number = np.ndim(value) == 0 and exact(
        value.item() if hasattr(value, "item") else value) is not None
    if not is_number:
        raise InputError(f"The loss returned the value {shown(value)}; return a number and a dict "
                         "of cotangents.")
    return value, as_mapping("the cotangents of the loss", cotangents, "{'q': ...}")


def loss_of(loss: Any) -> Callable[..., Any]:
    """Return a loss as a function of a trajectory that returns its value and a dict of cotangents.

    ``loss`` is such a function, or an expression of SymPy, which is summed over the states.
    """
    if hasattr(loss, "free_symbols"):  # an expression of SymPy
        return partial(function_of("generator.systems.run_functions", "sum_over_states"), loss,
                       multipliers_at_states, cotangents_of_multipliers)
    if not callable(loss):
        raise InputError(f"loss = {shown(loss)} is no function; give an expression of SymPy, or a "
                         "function of a trajectory that returns its value and a dict of "
                         "cotangents, {'q': ..., 'p': ...}.")
    function: Callable[..., Any] = loss
    return function
