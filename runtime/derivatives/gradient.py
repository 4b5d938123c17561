"""Gradients of functions of a run by the adjoint, backwards through its steps.

A run keeps its states and unknowns where they fit in memory; else checkpoints, from which pieces
are run again, with the same bits; or, with memory="none", nothing: the states are run backwards in
time from the end, and the start that this leads to must be the one of the run.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

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
from .binding import KeptSteps
from .frame import FrameMotion
from .kept_steps import (
    multiplier_shape,
    pieces,
    refuse_run,
    singular,
    split,
    warn_of_growth,
    warn_of_jumps,
)
from .points import Point, RunRows, cotangent_at
from .tangent_space import TangentSpace, null_space

if TYPE_CHECKING:
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
        they begin. Derivatives are those of the sides that their stages are on; where a force
        jumps, they are those of the discrete run, and not of the motion.
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
        its cotangent is that of t0, and q and p are those that a user sees, without it.
        q and p of z̄ are pulled back through the projection of the start. ``inputs`` has the
        derivatives by each row of inputs; by default the run is one step, whose inputs are
        parameters.
        """
        binding, n = space.binding.own, space.n
        z_bar = space.pulled_back(z_bar)
        names = [*binding.parameter_names, "dt", "t0"]
        if inputs is None:
            inputs = z_bar[[2 * n + names.index(u) for u in binding.input_names]][None]
        numbers = dict(zip(names, z_bar[2 * n :].tolist(), strict=True))
        if binding.clocked:
            numbers["t0"] = z_bar[n - 1 : n].tolist()[0]
        q, p = (z_bar[k : k + binding.shown].copy() for k in (0, n))
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
        raise InputError(f"memory = {shown(memory)} is none; give bytes, such as \"256 MB\", or "
                         "\"none\" to run backwards instead of keeping steps.")
    return int(min(float(match[1]) * _UNITS[match[2].lower()], 2.0**62))


@dataclass(frozen=True)
class Cotangents:
    """Derivatives of a function of a run by its stored states, and by the times of these.

    Attributes
    ----------
    rows, times : array, shapes (rows, 2 n) and (rows,)
        Of the states after whole steps that the run stores.
    multipliers : array, shape (rows, multipliers of a step)
        By the multipliers of the steps that end at these states; empty if it has none of them.
    points : list of (Point, array of shape (2 n,), number, array or None)
        The same of states within steps.
    """

    rows: Array
    times: Array
    multipliers: Array
    points: list[tuple[Point, Array, Any, Array | None]]
    #: Its derivatives by parameters at fixed states.
    parameters: Mapping[str, Any]

    @property
    def size(self) -> float:
        """Their norm."""
        parts = [self.rows.ravel(), self.multipliers.ravel(), *(w for _, w, *_ in self.points),
                 *(forces for *_, forces in self.points if forces is not None)]
        return float(np.linalg.norm(np.concatenate(parts).astype(float)))


def cotangents_of(stepper: Stepper, kinds: RunRows, cotangents: Mapping[str, Any]) -> Cotangents:
    """Return the checked cotangents of a trajectory, sorted by the kinds of its rows.

    Those of ends of steps become ``rows``, those of states within steps and of events ``points``.
    Raises InputError for other names and shapes, for what is not finite, for events without
    derivatives.
    """
    n, step_rows = stepper.binding.n, len(kinds.of_steps)
    cotangents = as_mapping("cotangents", cotangents, "{'q': ...}")
    events = cotangents.get("events", {})
    parameters = as_mapping("cotangents of parameters", cotangents.get("parameters", {}),
                            "{'m': 1.0}")
    for name in parameters:
        if name not in stepper.binding.parameter_names:
            raise unknown("parameter", name, stepper.binding.parameter_names)
    parameters = {name: as_real(f"The cotangent of {name}", slope, stepper.binding.number)
                  for name, slope in parameters.items()}
    arrays = {name: array for name, array in cotangents.items()
              if name not in ("events", "parameters")}
    # rows of a trajectory are ends of steps first, then the points behind them
    state_cotangents, time_cotangents = _arrays(stepper, step_rows + len(kinds.points), arrays, "")
    forces = _of_multipliers(stepper, step_rows + len(kinds.points), arrays)
    allocate, count = stepper.binding.new, kinds.run.rows + 1
    rows, times = allocate(count, 2 * n), allocate(count)
    rows[:step_rows], times[:step_rows] = state_cotangents[:step_rows], time_cotangents[:step_rows]
    multipliers = allocate(count if len(forces) else 0, stepper.binding.multipliers)
    multipliers[:step_rows] = forces[:step_rows]
    points: list[tuple[Point, Array, Any, Array | None]] = list(zip(
        kinds.points, state_cotangents[step_rows:], time_cotangents[step_rows:],
        forces[step_rows:] if len(forces) else [None] * len(kinds.points), strict=True))
    for name, event_cotangents in as_mapping("events", events, "{'x': {'t': 1.0}}").items():
        event_names = [*kinds.events, *kinds.refused]
        if not event_names:
            raise InputError(f"There are cotangents of the event {name!r}, and this run has no "
                             "events; leave them out.")
        choose("event", name, event_names)
        crossings = kinds.event(name)
        state_cotangents, time_cotangents = _arrays(stepper, len(crossings),
                                                    event_cotangents, f" at the event {name}")
        points += zip(crossings, state_cotangents, time_cotangents, [None] * len(crossings),
                      strict=True)
    return Cotangents(rows, times, multipliers, points, parameters)


def _of_multipliers(stepper: Stepper, rows: int, cotangents: Mapping[str, Any]) -> Array:
    """Return the cotangents of multipliers, a row for each state; empty if there are none.

    The first state is the end of no step: its row is 0.
    """
    binding = stepper.binding
    if "multipliers" not in cotangents:
        return binding.new(0, binding.multipliers)
    rows_of_w = binding.new(rows, *multiplier_shape(stepper))
    _fill("multipliers", cotangents["multipliers"], rows_of_w[1:], "", "step that is stored")
    return rows_of_w.reshape(rows, -1)


def _arrays(
    stepper: Stepper, rows: int, cotangents: Mapping[str, Any], where: str
) -> tuple[Array, Array]:
    """Return cotangents of rows of (q, p), shape (rows, 2 n), and of their times, shape (rows,).

    In scaled time t is the last coordinate, and its cotangents are in that column. ``where`` is
    " at the event x" for the crossings of an event, which has no multipliers.
    """
    binding = stepper.binding
    n, shown = binding.n, binding.shown
    w, times = binding.new(rows, 2 * n), binding.new(rows)
    for name, array in as_mapping("cotangents", cotangents, "{'q': ...}").items():
        if not where and name == "multipliers":
            continue
        if name not in ("q", "p", "t"):
            raise unknown("kind of cotangents", name, ["q", "p", "t", *(
                () if where else ("multipliers", "events", "parameters"))])
        target = {"q": w[:, :shown], "p": w[:, n : n + shown], "t": times}[name]
        _fill(name, array, target, where, "state")
    if binding.clocked:
        w[:, n - 1], times = times, 0 * times
    return w, times


def _fill(name: str, array: Any, target: Array, where: str, row: str) -> None:
    """Put cotangents of rows, or of the last one alone, into ``target``, (rows, ...).

    ``name`` is "q", "p", "t" or "multipliers"; ``where`` and ``row`` are for the errors: at which
    event, and what a row is of.
    """
    numbers, row_shape = as_numbers(f"cotangents of {name}", array), target.shape[1:]
    if not np.isfinite(numbers.astype(float)).all():
        raise InputError(f"The cotangents of {name} are not finite; give numbers.")
    is_last_row = numbers.shape == row_shape
    if numbers.shape not in (row_shape, target.shape) or (is_last_row and not len(target)):
        raise InputError(f"The cotangents of {name}{where} have the shape {numbers.shape}; "
                         f"give {target.shape}, a row for each {row}, or {row_shape} for the last.")
    target[slice(-1, None) if is_last_row else slice(None)] = numbers


def gradient_of(
    stepper: Stepper, run: RunArguments, cotangents: Cotangents, wrt: tuple[str, ...],
    memory: Any = DEFAULT_MEMORY, value: Any = None, end: tuple[Array, Array] | None = None,
) -> Gradient:
    """Return the gradient of a function of a checked run by its cotangents.

    ``end``, if given, is the last state of the run, which the steps must lead to. Raises InputError
    for memory that is too little, with how much is needed; for events without derivatives;
    StepFailed as the run itself does: there is no partial gradient.
    """
    adjoint = _AdjointRun(stepper, run, cotangents)
    w = adjoint.advance(as_bytes(memory), end)
    if cotangents.size > 0:
        warn_of_growth(stepper, "On its way to the start the cotangent has",
                       float(np.linalg.norm(w.astype(float))) / cotangents.size)
    space = TangentSpace(adjoint.binding, adjoint.parameters, run.q, run.p,
                         stepper.constraint_names)
    warn_of_jumps(stepper, adjoint.switched)
    inputs_bar = adjoint.inputs_bar
    return Gradient.of_cotangent(
        space, adjoint.z_bar, wrt, value, inputs_bar if run.inputs is None else _summed_over_hold(
            inputs_bar, run), adjoint.switched)


class _AdjointRun:
    """A run from its last step to its first, with the cotangent of the state in the frame.

    Attributes
    ----------
    z_bar : array
        The cotangent of the start, parameters, Δt and t0 so far.
    inputs_bar : array, shape (steps, inputs)
        Those of the inputs of each step; none if the run has no inputs.
    switched : int
        Steps so far across a switch of H or the forces.
    """

    def __init__(self, stepper: Stepper, run: RunArguments, cotangents: Cotangents) -> None:
        """Allocate z̄, with the derivatives by parameters and times beside those by states."""
        refuse_run(run)
        self.stepper, self.run, self.cotangents = stepper, run, cotangents
        self.binding = stepper._derivative_binding()
        self.own, n = self.binding.own, stepper.binding.n
        names = [*stepper.binding.parameter_names, "dt", "t0"]
        input_names = stepper.binding.input_names if run.inputs is not None else []
        self.input_columns = [2 * n + names.index(u) for u in input_names]
        points = cotangents.points
        self.steps_of_points = np.array([point.step for point, *_ in points], int)
        self.frame = FrameMotion(self.binding, stepper.symmetries, run)
        if len(cotangents.multipliers) or any(forces is not None for *_, forces in points):
            self.frame.refuse_rotating_multipliers(run)
        self.z_bar = self.own.new(self.binding.rows)
        for name, slope in cotangents.parameters.items():
            self.z_bar[2 * n + names.index(name)] = slope
        # t_k = t0 + k Δt: the cotangents of times are those of t0, and k times those of Δt
        self.z_bar[-1] = cotangents.times.sum()
        self.z_bar[-2] = (cotangents.times * run.steps_of_rows(run.steps)).sum()
        # a state behind the last whole step has inputs of its own
        beyond = bool(len(points)) and int(self.steps_of_points.max()) == run.steps
        self.inputs_bar: Array = self.own.new(
            (run.steps + beyond) if input_names else 0, len(input_names))
        self.parameters = self.own.parameters(run.parameters, run.t0)
        self.switched = 0

    def advance(self, memory: int | None, end: tuple[Array, Array] | None) -> Array:
        """Take all steps backwards; return the cotangent of the start, which ``z_bar`` has too.

        At each state the cotangents of its row and of the points in the step behind it are added.
        """
        w: Array | None = None
        for kept_piece in backwards(self.stepper, self.run, memory, end):
            self.switched += self.binding.count_switches(self.run, self.parameters, kept_piece)
            for steps in reversed(split(kept_piece, np.unique(self.steps_of_points))):
                if w is None:
                    last_step = steps.first + steps.count
                    w = _of_frame(self.frame, steps, last_step, self.cotangents.rows[-1]
                                  + self._of_points(last_step, steps.q[-1], steps.p[-1]),
                                  self.z_bar)
                w = self._take(steps, w)
        if w is None:  # a run of no steps
            w = self.cotangents.rows[0] + self._of_points(0, self.run.q, self.run.p)
        self.z_bar[: len(w)] = w
        return w

    def _take(self, steps: KeptSteps, w: Array) -> Array:
        """Return the cotangent of the state before some steps, from w of the state after them.

        ``w`` is overwritten; ``z_bar`` and ``inputs_bar`` gain what the steps add.
        """
        run = self.run
        row_cotangents = _of_stored(self.frame, run, steps, self.cotangents.rows, self.z_bar)
        forces = _of_steps(self.stepper, run, steps, self.cotangents.multipliers)
        has_inputs = len(self.inputs_bar) > 0
        own_bar = self.own.new(steps.count if has_inputs else 0, len(self.input_columns))
        status = self.binding.integrate_adjoint(run, self.parameters, steps, row_cotangents,
                                                run.every, forces, w, self.z_bar, own_bar)
        if status:
            raise singular(steps.first, status)
        if has_inputs:
            self.inputs_bar[steps.first : steps.first + steps.count] += own_bar
        if (self.steps_of_points == steps.first).any():
            w += _of_frame(self.frame, steps, steps.first, self._of_points(
                steps.first, steps.q[0], steps.p[0]), self.z_bar)
        return w

    def _of_points(self, step: int, q: Array, p: Array) -> Array:
        """Return the cotangent, in space, of a state of the frame by the points in the next step.

        What the points add to parameters and times goes to ``z_bar``, to inputs to ``inputs_bar``.
        """
        cotangent: Array = self.own.new(self.binding.rows)
        z = np.concatenate([q, p])
        if self.frame.moves:
            z = self.frame.matrix(step) @ z
        for i in np.flatnonzero(self.steps_of_points == step):
            point, *cotangents = self.cotangents.points[i]
            cotangent += cotangent_at(self.stepper, self.run, point, z, *cotangents)
        # the inputs of a step are parameters of its own
        if len(self.inputs_bar) and cotangent.any():
            self.inputs_bar[step] += cotangent[self.input_columns]
            cotangent[self.input_columns] = 0
        self.z_bar[len(z) :] += cotangent[len(z) :]
        return cotangent[: len(z)]


def _of_frame(
    frame: FrameMotion, steps: KeptSteps, k: int, cotangent: Array, z_bar: Array
) -> Array:
    """Return the cotangent Sᵀ w of the state z̃ in the frame after k steps.

    ``cotangent`` is w, the cotangent of the state S z̃ in space. The part of S's own rates and of
    Δt, (dS z̃)ᵀ w, is added to ``z_bar``.
    """
    if not frame.moves:
        return cotangent
    z = np.concatenate([steps.q[k - steps.first], steps.p[k - steps.first]])
    z_bar[:] += frame.own_derivatives(k, z).T @ cotangent
    rotated: Array = frame.matrix(k).T @ cotangent
    return rotated


def _of_stored(
    frame: FrameMotion, run: RunArguments, steps: KeptSteps, rows: Array, z_bar: Array
) -> Array:
    """Return the cotangents of the stored states before these steps, in the frame.

    ``rows`` has those of all stored states in space. ``z_bar`` gains the part of the frame's rates.
    """
    first_row = steps.first // run.every
    of_piece = rows[first_row : (steps.first + steps.count - 1) // run.every + 1].copy()
    if steps.first % run.every:
        of_piece[0] = 0  # the state is not stored: its row belongs to an earlier one
    for i in range(len(of_piece) if frame.moves else 0):
        k = (first_row + i) * run.every
        if k >= steps.first:
            of_piece[i] = _of_frame(frame, steps, k, of_piece[i], z_bar)
    return of_piece


def _of_steps(stepper: Stepper, run: RunArguments, steps: KeptSteps, multipliers: Array) -> Array:
    """Return the cotangents of the multipliers of each of these steps; empty if there are none.

    ``multipliers`` has a row for each stored state, which has those of the step that ends there.
    """
    step_multipliers: Array = stepper.binding.new(
        steps.count if len(multipliers) else 0, stepper.binding.multipliers)
    if len(multipliers):
        ends = run.steps_of_rows(run.steps) - steps.first
        is_stored = (ends > 0) & (ends <= steps.count)
        step_multipliers[ends[is_stored] - 1] = multipliers[is_stored]
    return step_multipliers


def _summed_over_hold(inputs_bar: Array, run: RunArguments) -> Array:
    """Return the cotangent of each row of inputs: the sum over the steps that the row is held for.

    ``inputs_bar`` has a row for each step.
    """
    hold = run.inputs.hold if run.inputs is not None else 1
    if hold == 0:  # one row of inputs serves all steps
        sum_of_all: Array = inputs_bar.sum(axis=0, keepdims=True)
        return sum_of_all
    starts = np.arange(0, len(inputs_bar), hold)
    sums: Array = np.add.reduceat(inputs_bar, starts, axis=0) if len(starts) else inputs_bar
    return sums


# ------------------------------------------------------------------ the steps, from the last on


def backwards(
    stepper: Stepper, run: RunArguments, memory: int | None, end: tuple[Array, Array] | None
) -> Iterator[KeptSteps]:
    """Yield the steps of a run in pieces, the last piece first.

    Three ways: all steps are kept; checkpoints are, from which pieces run again; or, without
    ``memory``, states come of steps of −Δt. ``end``, if given, is the state that the run ended in,
    which it must lead to again.
    """
    if run.steps == 0:
        return
    refuse_together(reversed=memory is None and 'memory = "none"', impacts=bool(run.impact_steps)
                    and "a run with impacts")
    if memory is None:
        yield from _reversed(stepper, run, end)
        return
    if run.impact_steps:
        yield from _back_through_impacts(stepper, run, memory, end)
        return
    binding = stepper.binding
    width = 16 if binding.c_type not in ("float", "double") else np.dtype(binding.dtype).itemsize
    step_bytes = (2 * binding.n + stepper.unknowns) * width
    kept_run = stepper._derivative_binding().begin(run)
    if run.steps * step_bytes <= memory:
        steps, status = kept_run.keep(run.steps)
        _check(stepper, run, kept_run, status, end)
        yield steps
        return
    # two levels: checkpoints every s = ``piece_steps`` steps, and the steps of one piece. n/s
    # checkpoints of c bytes and s steps of b bytes need the least memory with s = √(n c/b)
    checkpoint_bytes = kept_run.state.nbytes(kept_run.binding.own)
    piece_steps = max(1, math.isqrt(run.steps * checkpoint_bytes // step_bytes))
    piece_count = -(-run.steps // piece_steps)
    needed_bytes = piece_count * checkpoint_bytes + piece_steps * step_bytes
    if needed_bytes > memory:
        raise InputError(f"memory = {memory:,} bytes are too few for {run.steps:,} steps; "
                         f"checkpoints need {needed_bytes:,}. Give these, or memory=\"none\".")
    checkpoints = list[RunState]()
    while kept_run.steps_done < run.steps:
        checkpoints.append(kept_run.state.copy(kept_run.binding.own))
        _, status = kept_run.keep(min(piece_steps, run.steps - kept_run.steps_done))
        if status:
            _check(stepper, run, kept_run, status, None)
    _check(stepper, run, kept_run, 0, end)
    for checkpoint in reversed(checkpoints):
        kept_run.state.assign(kept_run.binding.own, checkpoint)
        yield kept_run.keep(min(piece_steps, run.steps - kept_run.steps_done))[0]


def _back_through_impacts(
    stepper: Stepper, run: RunArguments, memory: int, end: tuple[Array, Array] | None
) -> Iterator[KeptSteps]:
    """Yield the steps of a run with impacts, all of which are kept, the last ones first.

    A step keeps q, p and its unknowns; one with impacts also its matrix, (2 n, rows).
    """
    binding = stepper._derivative_binding()
    number_bytes = np.dtype(stepper.binding.dtype).itemsize
    step_bytes = (2 * binding.n + stepper.unknowns) * number_bytes
    matrix_bytes = 2 * binding.n * binding.rows * number_bytes
    needed_bytes = run.steps * step_bytes + len(run.impact_steps) * matrix_bytes
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
    """Raise where the run fails (``status``), or leads elsewhere than to ``end``, where it did."""
    if status:
        stepper._run(run)  # raises the error that says why, with the states before it
        raise singular(kept_run.steps_done, status)
    if end is not None and not stepper.symmetries:
        _refuse_mismatch((kept_run.state.q, kept_run.state.p), end, _OTHER_END)


def _refuse_mismatch(end: tuple[Array, Array], stored_end: tuple[Array, Array], why: str) -> None:
    """Refuse a gradient if the run, done again, does not end at ``stored_end``; ``why`` says it."""
    for x, y in zip(end, stored_end, strict=True):
        size = float(np.abs(y).max(initial=0)) or 1.0
        off = float(np.abs(x - y).max(initial=0)) / size
        if not off <= _MISMATCH:
            raise InputError(f"There is no gradient: {why} (mismatch {off:.1e}).")


def _reversed(
    stepper: Stepper, run: RunArguments, end: tuple[Array, Array] | None
) -> Iterator[KeptSteps]:
    """Yield the steps from the last on; states come of steps of −Δt, and nothing is stored.

    ``end`` is the state (q, p) at the end of the run, which is integrated for it if None.
    """
    refuse_together(reversed="memory = \"none\"", inputs=run.inputs is not None and "inputs",
                    frame=bool(stepper.symmetries) and "a co-moving frame")
    if end is None:
        trajectory = stepper._run(replace(run, every=max(run.steps, 1)))
        end = trajectory.q[-1], trajectory.p[-1]
    # ``state`` is the state after ``remaining`` steps of the run
    binding, state, remaining = stepper._derivative_binding(), end, run.steps
    while remaining:
        # a step of −Δt is the inverse of one of Δt to round-off for the symmetric schemes: states
        # run back, and each piece forward again for its unknowns
        count = min(512, remaining)
        reverse_run = stepper._run(replace(
            run, q=state[0].copy(), p=state[1].copy(), dt=-run.dt, steps=count, every=count,
            t0=run.t0 + remaining * run.dt))
        state = reverse_run.q[-1], reverse_run.p[-1]
        remaining -= count
        forward = binding.begin(replace(run, q=state[0].copy(), p=state[1].copy(), steps=count,
                                        t0=run.t0 + remaining * run.dt))
        steps, status = forward.keep(count)
        if status:
            raise singular(remaining, status)
        yield replace(steps, first=remaining)
    _refuse_mismatch(state, (run.q, run.p), "running backwards does not lead to the start; give "
                     "memory=\"256 MB\", and the steps are kept")


def value_of(loss: Callable[..., Any], run: Trajectory) -> tuple[Any, Mapping[str, Any]]:
    """Return the value of a loss and its cotangents.

    Raises InputError where it returns anything but a number and cotangents.
    """
    outcome = loss(run)
    if not isinstance(outcome, tuple) or len(outcome) != 2:
        raise InputError(f"The loss returned {shown(outcome)}; return its value and a dict of "
                         "cotangents, {'q': ..., 'p': ...}.")
    value, cotangents = outcome
    if np.ndim(value) or exact(getattr(value, "item", lambda: value)()) is None:
        raise InputError(f"The loss returned the value {shown(value)}; return a number and a dict "
                         "of cotangents.")
    return value, as_mapping("the cotangents of the loss", cotangents, "{'q': ...}")


def loss_of(loss: Any) -> Callable[..., Any]:
    """Return a function of a run that gives its value and cotangents."""
    if hasattr(loss, "free_symbols"):  # an expression of SymPy
        return partial(function_of("generator.systems.run_functions", "sum_over_states"), loss,
                       multipliers_at_states, cotangents_of_multipliers)
    if not callable(loss):
        raise InputError(f"loss = {shown(loss)} is no function; give an expression of SymPy, or a "
                         "function of a trajectory that returns its value and a dict of "
                         "cotangents, {'q': ..., 'p': ...}.")
    function: Callable[..., Any] = loss
    return function
