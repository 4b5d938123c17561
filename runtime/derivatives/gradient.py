"""Gradients of functions of a run by the adjoint, backwards through its steps.

A run keeps its states and unknowns where they fit in memory; else checkpoints, from which pieces
are run again, with the same bits; or, with memory="none", nothing: the states are run backwards in
time from the end, and the start that this leads to must be the one of the run.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import shown, unknown
from ...core.errors import InputError
from ...core.warnings import warn
from ..bindings.array_checks import as_numbers
from ..integration.run_arguments import RunArguments
from .binding import KeptSteps
from .frame import FrameMotion
from .tangent_run import refuse_run, singular
from .tangent_space import TangentSpace, null_space

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["Gradient", "as_bytes", "gradient_of", "names_of"]

Array = NDArray[Any]

#: Bytes that the steps of a run may take.
DEFAULT_MEMORY = "256 MB"
#: Relative mismatch of a run and its way back, beyond which a gradient is refused.
_MISMATCH = 1e-6
_UNITS = {"": 1, "b": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9,
          "kib": 2**10, "mib": 2**20, "gib": 2**30}


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
    inputs : array, shape (steps, inputs)
        By the inputs of each step, where there are inputs.
    wrt : tuple of str
        What was asked for; ``gradient[name]`` gives one of them, or any parameter, dt or t0.
    """

    value: Any
    q: Array
    p: Array
    #: Derivatives of g and f by (q, p).
    _normals: Array
    inputs: Array
    wrt: tuple[str, ...]
    _numbers: dict[str, Any]

    @cached_property
    def basis(self) -> Array:
        """An orthonormal basis of the tangent space at the start, shape (2 n, 2 (n − m))."""
        return null_space(self._normals)

    @property
    def start(self) -> Array:
        """By coordinates of the tangent space at the start."""
        found: Array = self.basis.T @ np.concatenate([self.q, self.p])
        return found

    def __getitem__(self, name: str) -> Any:
        """Return the derivative by a parameter, "dt", "t0", "q", "p", "start" or "inputs"."""
        if name in ("q", "p", "start", "inputs"):
            return getattr(self, name)
        if name not in self._numbers:
            raise unknown("name", name, [*self._numbers, "q", "p", "start", "inputs"])
        return self._numbers[name]

    def vector(self) -> Array:
        """Return what was asked for as one vector, in the order of ``wrt``."""
        return np.concatenate([np.ravel(np.asarray(self[name])) for name in self.wrt])


def names_of(stepper: Stepper, wrt: str | Sequence[str] | None) -> tuple[str, ...]:
    """Return what a gradient is taken by; by default the start and all parameters.

    Raises
    ------
    InputError
        For an unknown name, with the nearest.
    """
    parameters = [*stepper.parameter_domains, *(s.name for s in stepper.symmetries)]
    if wrt is None:
        return ("start", *dict.fromkeys(parameters))
    names = (wrt,) if isinstance(wrt, str) else tuple(wrt)
    allowed = [*dict.fromkeys(parameters), "start", "q", "p", "dt", "t0", "inputs"]
    for name in names:
        if name not in allowed:
            raise unknown("name in wrt", name, allowed)
    return names


def as_bytes(memory: Any) -> int | None:
    """Return a bound of memory in bytes; None for "none".

    Raises
    ------
    InputError
        Unless it is a number with a unit, such as "256 MB", or "none".
    """
    if memory == "none":
        return None
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*([A-Za-z]*)\s*", str(memory))
    if match is None or match[2].lower() not in _UNITS:
        raise InputError(f"memory = {shown(memory)} is none; give bytes, such as \"256 MB\", or "
                         "\"none\" to run backwards instead of keeping steps.")
    return int(float(match[1]) * _UNITS[match[2].lower()])


def cotangents_of(stepper: Stepper, rows: int, given: Mapping[str, Any]) -> Array:
    """Return cotangents of the stored states, a row of q and p for each.

    Of shape (n,) they are those of the last state.
    """
    n, own = stepper.n, stepper.binding
    made: Array = own.new(rows, 2 * n)
    for name, array in given.items():
        if name not in ("q", "p"):
            raise unknown("kind of cotangents", name, ["q", "p"])
        part = made[:, :n] if name == "q" else made[:, n:]
        numbers = as_numbers(f"cotangents of {name}", array)
        if not np.isfinite(numbers.astype(float)).all():
            raise InputError(f"The cotangents of {name} are not finite; give numbers.")
        if numbers.shape == (n,):
            part[-1] = numbers
        elif numbers.shape == (rows, n):
            part[:] = numbers
        else:
            raise InputError(f"The cotangents of {name} have the shape {numbers.shape}; give "
                             f"({rows}, {n}), a row for each stored state, or ({n},) for the last.")
    return made


def gradient_of(
    stepper: Stepper, run: RunArguments, cotangents: Mapping[str, Any], wrt: tuple[str, ...],
    memory: Any = DEFAULT_MEMORY, value: Any = None, end: tuple[Array, Array] | None = None,
) -> Gradient:
    """Return the gradient of a function of a checked run by its cotangents at the stored states.

    ``end``, if given, is the last state of the run, which the steps must lead to.

    Raises
    ------
    InputError
        For cotangents that are none, and for memory that is too little, with how much is needed.
    StepFailed
        As the run itself does: there is no partial gradient.
    """
    refuse_run(run)
    binding, n = stepper.derivative_binding, stepper.n
    rows = cotangents_of(stepper, run.rows + 1, cotangents)
    frame = FrameMotion(binding, stepper.symmetries, run)
    z_bar = binding.own.new(binding.rows)
    inputs_bar: Array = binding.own.new(run.steps if stepper.binding.input_names else 0,
                                        len(stepper.binding.input_names))
    if run.inputs is None:
        inputs_bar = inputs_bar[:0]
    parameters = binding.own.parameters(run.parameters, run.t0)
    w = rows[-1].copy()
    last = float(np.linalg.norm(rows.astype(float)))
    is_last = True
    for steps in backwards(stepper, run, as_bytes(memory), end):
        w, rows_here = _of_frame(frame, run, steps, rows, w, z_bar, is_last)
        is_last = False
        part = inputs_bar[steps.first : steps.first + steps.count]
        own_bar = binding.own.new(*part.shape) if len(inputs_bar) else part
        status = binding.integrate_adjoint(run, parameters, steps, rows_here, run.every, w, z_bar,
                                           own_bar)
        if status:
            raise singular(steps.first, status)
        if len(inputs_bar):
            part[:] = own_bar
    if run.steps == 0:
        w = rows[0].copy()
    z_bar[: 2 * n] = w
    _warn_of_growth(stepper, w, last)
    space = TangentSpace(binding, parameters, run.q, run.p, stepper.constraint_names)
    z_bar = space.pulled_back(z_bar)
    names = [*stepper.binding.parameter_names, "dt", "t0"]
    numbers = dict(zip(names, z_bar[2 * n :].tolist(), strict=True))
    if run.inputs is not None:
        inputs_bar = _held(inputs_bar, run)
    return Gradient(value, z_bar[:n].copy(), z_bar[n : 2 * n].copy(), space.normals, inputs_bar,
                    wrt, numbers)


def _of_frame(
    frame: FrameMotion, run: RunArguments, steps: KeptSteps, rows: Array, w: Array, z_bar: Array,
    is_last: bool,
) -> tuple[Array, Array]:
    """Return w and the cotangents of earlier states of these steps, in the frame."""
    first = steps.first // run.every
    here = rows[first : (steps.first + steps.count - 1) // run.every + 1].copy()
    if steps.first % run.every:
        here[0] = 0  # the state is not stored: its row belongs to an earlier one
    if not frame.moves:
        return w, here

    def back(k: int, cotangent: Array) -> Array:
        z = np.concatenate([steps.q[k - steps.first], steps.p[k - steps.first]])
        z_bar[:] += frame.own_derivatives(k, z).T @ cotangent
        made: Array = frame.matrix(k).T @ cotangent
        return made

    if is_last:
        w = back(steps.first + steps.count, w)
    for i in range(len(here)):
        k = (first + i) * run.every
        if k >= steps.first:
            here[i] = back(k, here[i])
    return w, here


def _held(inputs_bar: Array, run: RunArguments) -> Array:
    """Return the sums over the steps that each row of inputs is held for."""
    hold = run.inputs.hold if run.inputs is not None else 1
    if hold == 0:
        whole: Array = inputs_bar.sum(axis=0, keepdims=True)
        return whole
    starts = np.arange(0, len(inputs_bar), hold)
    found: Array = np.add.reduceat(inputs_bar, starts, axis=0) if len(starts) else inputs_bar
    return found


def _warn_of_growth(stepper: Stepper, w: Array, last: float) -> None:
    growth = float(np.linalg.norm(w.astype(float))) / last if last > 0 else 0.0
    lost = growth * float(stepper.binding.epsilon)
    if lost > 1e-3:
        warn(f"The cotangent has grown {growth:.1e} times on its way to the start: this gradient "
             f"has at most {max(0, -int(math.log10(lost))):d} digits. Take a shorter run, or "
             "real=\"float128\".")


# ------------------------------------------------------------------ the steps, from the last on


def backwards(
    stepper: Stepper, run: RunArguments, memory: int | None, end: tuple[Array, Array] | None
) -> Iterator[KeptSteps]:
    """Yield the steps of a run in pieces, the last piece first."""
    if run.steps == 0:
        return
    if memory is None:
        yield from _reversed(stepper, run, end)
        return
    own = stepper.binding
    width = 16 if own.c_type not in ("float", "double") else np.dtype(own.dtype).itemsize
    a_step = (2 * stepper.n + stepper.unknowns) * width
    kept = stepper.derivative_binding.begin(run)
    if run.steps * a_step <= memory:
        steps, status = kept.keep(run.steps)
        _check(stepper, run, kept, status, end)
        yield steps
        return
    a_checkpoint = sum(np.asarray(x).nbytes for x in kept.image()[1:])
    piece = max(1, math.isqrt(run.steps * a_checkpoint // a_step))
    count = -(-run.steps // piece)
    needed = count * a_checkpoint + piece * a_step
    if needed > memory:
        raise InputError(f"memory = {memory:,} bytes are too few for {run.steps:,} steps; "
                         f"checkpoints need {needed:,}. Give these, or memory=\"none\".")
    images = []
    while kept.done < run.steps:
        images.append(kept.image())
        _, status = kept.keep(min(piece, run.steps - kept.done))
        if status:
            _check(stepper, run, kept, status, None)
    _check(stepper, run, kept, 0, end)
    for image in reversed(images):
        kept.restore(image)
        yield kept.keep(min(piece, run.steps - kept.done))[0]


def _check(
    stepper: Stepper, run: RunArguments, kept: Any, status: int, end: tuple[Array, Array] | None
) -> None:
    """Raise where the run fails, or leads elsewhere than it did."""
    if status:
        stepper.run(run)
        raise singular(kept.done, status)
    if end is not None and not stepper.symmetries:
        _refuse_mismatch((kept.q, kept.p), end, "the run, done again, ends elsewhere than it did; "
                         "give the solver that it had")


def _refuse_mismatch(found: tuple[Array, Array], wanted: tuple[Array, Array], why: str) -> None:
    for x, y in zip(found, wanted, strict=True):
        size = float(np.abs(y).max(initial=0)) or 1.0
        off = float(np.abs(x - y).max(initial=0)) / size
        if not off <= _MISMATCH:
            raise InputError(f"There is no gradient: {why} (mismatch {off:.1e}).")


def _reversed(
    stepper: Stepper, run: RunArguments, end: tuple[Array, Array] | None
) -> Iterator[KeptSteps]:
    """Yield the steps from the last on; states come of steps of −Δt, and nothing is stored."""
    if run.inputs is not None or stepper.symmetries:
        raise InputError("memory=\"none\" runs backwards, which runs with inputs or with a frame "
                         "cannot; give memory=\"256 MB\".")
    if end is None:
        last = stepper.run(replace(run, every=max(run.steps, 1)))
        end = last.q[-1], last.p[-1]
    binding, state, left = stepper.derivative_binding, end, run.steps
    while left:
        count = min(512, left)
        back = stepper.run(replace(
            run, q=state[0].copy(), p=state[1].copy(), dt=-run.dt, steps=count, every=count,
            t0=run.t0 + left * run.dt))
        state = back.q[-1], back.p[-1]
        left -= count
        forward = binding.begin(replace(run, q=state[0].copy(), p=state[1].copy(), steps=count,
                                        t0=run.t0 + left * run.dt))
        steps, status = forward.keep(count)
        if status:
            raise singular(left, status)
        yield replace(steps, first=left)
    _refuse_mismatch(state, (run.q, run.p), "running backwards does not lead to the start; give "
                     "memory=\"256 MB\", and the steps are kept")


def loss_of(loss: Any) -> Callable[..., Any]:
    """Return a function of a run that gives its value and cotangents."""
    if not callable(loss):
        raise InputError(f"loss = {shown(loss)} is no function; give one of a trajectory that "
                         "returns its value and a dict of cotangents, {'q': ..., 'p': ...}.")
    function: Callable[..., Any] = loss
    return function
