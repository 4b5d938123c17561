"""Many trajectories at once: lanes of vector registers, threads over batches, no GIL."""

from __future__ import annotations

import os
import threading
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...errors import InputError, StepFailed, Stopped
from ...exact import Number
from ...naming import shown
from ..call.checks import as_numbers, as_positive_count
from ..interrupts import ctrl_c
from ..output.trajectory import Trajectory
from .parameters import refuse_auto

if TYPE_CHECKING:
    from .integration import Run
    from .lanes import Member
    from .stepper import Stepper

__all__ = ["Ensemble", "integrate_members"]

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Ensemble:
    """The trajectories of ``integrate_ensemble``; the leading axis is the trajectory.

    Attributes
    ----------
    t, q, p, multipliers, iterations : arrays
        As in ``Trajectory`` with a leading axis; NaN (0 iterations) after a failed step, and after
        Ctrl-C where the ensemble comes with ``Stopped``.
    failures : dict
        Number of a failed trajectory → its ``StepFailed``.
    members : list of Trajectory
        Each trajectory by itself, up to its failed step if it has one; with it ``work`` and
        ``quantity(name)``.
    """

    t: Array
    q: Array
    p: Array
    multipliers: Array
    iterations: Array
    failures: dict[int, StepFailed]
    members: list[Trajectory]

    def __len__(self) -> int:
        return len(self.members)

    def __repr__(self) -> str:
        name, states = self.members[0].manifest["name"], self.t.shape[1]
        return (f"<Ensemble of {name}: {len(self):,} trajectories of {states:,} states, "
                f"{len(self.failures):,} failed>")


def integrate_members(
    stepper: Stepper,
    q: ArrayLike,
    p: ArrayLike,
    dt: Number | ArrayLike,
    t0: Number | ArrayLike,
    parameters: Mapping[str, Any] | Sequence[Mapping[str, Number]],
    workers: int | None,
    **options: Any,
) -> Ensemble:
    """Integrate each row of q and p; see ``Stepper.integrate_ensemble``."""
    starts, momenta = _rows(stepper, "q", q), _rows(stepper, "p", p)
    threads = os.cpu_count() or 1
    if workers is not None:
        threads = as_positive_count("workers", workers, least=1)
    if starts.ndim != 2 or starts.shape != momenta.shape or not len(starts):
        raise InputError(f"q and p have shapes {starts.shape} and {momenta.shape}; give "
                         f"(trajectories, {stepper.n}) for both.")
    size = len(starts)
    steps = np.broadcast_to(_each("dt", dt, size), size)
    times = np.broadcast_to(_each("t0", t0, size), size)
    runs = _each_parameters(parameters, size)

    broken = threading.Event()

    def check(i: int) -> Run:
        try:
            return stepper.checked_run(starts[i], momenta[i], dt=steps[i], t0=times[i],
                                       parameters=runs[i], **options)
        except InputError as error:
            raise InputError(f"Trajectory {i}: {error}") from error

    batch = stepper.batch_size(options["solver"])
    batches = [range(i, min(i + batch, size)) for i in range(0, size, batch)]
    with ctrl_c() as interrupts, ThreadPoolExecutor(threads) as pool:

        def stop() -> bool:
            return broken.is_set() or interrupts.asked

        def work(members: range) -> list[Member]:
            return stepper.integrate_runs([check(i) for i in members], stop)

        futures = [pool.submit(work, members) for members in batches]
        try:
            ended, _ = wait(futures, return_when=FIRST_EXCEPTION)
            for future in filter(ended.__contains__, futures):
                future.result()  # raises for the first member that was refused
            results = [member for future in futures for member in future.result()]
        finally:  # after a refusal the other members are not finished for nobody
            broken.set()
            pool.shutdown(cancel_futures=True)
        found = _ensemble(stepper, results, -(-int(options["steps"]) // int(options["every"])) + 1)
    if interrupts.asked:
        done = sum(len(member) for member in found.members)
        raise Stopped(f"Stopped with {done:,} of {found.t.size:,} states; they are in .ensemble.",
                      interrupts.signal, ensemble=found)
    return found


def _ensemble(stepper: Stepper, results: list[Member], rows: int) -> Ensemble:
    """Return trajectories of up to so many states as one, the failures beside them."""
    members = [member for member, _ in results]
    failures = {i: failure for i, (_, failure) in enumerate(results) if failure is not None}
    no_number = stepper.binding.new(1)[0] + np.nan
    return Ensemble(
        _stack([m.t for m in members], rows, no_number if members[0].t.dtype == object else np.nan),
        _stack([m.q for m in members], rows, no_number),
        _stack([m.p for m in members], rows, no_number),
        _stack([m.multipliers for m in members], rows - 1, no_number),
        _stack([m.iterations for m in members], rows - 1, 0),
        failures,
        members,
    )


def _each(name: str, value: Any, size: int) -> Array:
    array = as_numbers(name, value)
    if array.shape not in ((), (size,)):
        raise InputError(f"{name} has shape {array.shape}; give one number or {size} of them.")
    return array


def _rows(stepper: Stepper, name: str, value: Any) -> Array:
    array = stepper.binding.numbers(name, value)
    if array.ndim != 2:
        raise InputError(f"{name} has shape {array.shape}; give one row for each trajectory.")
    return array


def _each_parameters(parameters: Any, size: int) -> list[dict[str, Any]]:
    if isinstance(parameters, Mapping):
        for name, value in parameters.items():
            refuse_auto(name, value)
        rules = {name: value for name, value in parameters.items() if isinstance(value, str)}
        columns = {name: np.broadcast_to(_each(f"Parameter {name}", value, size), size)
                   for name, value in parameters.items() if name not in rules}
        return [rules | {name: column[i] for name, column in columns.items()}
                for i in range(size)]
    if not isinstance(parameters, Sequence) or not all(isinstance(r, Mapping) for r in parameters):
        raise InputError(f"parameters = {shown(parameters)} is neither a dict nor a list of "
                         "dicts.")
    if len(parameters) != size:
        raise InputError(f"{len(parameters)} sets of parameters are given for {size} trajectories.")
    return [dict(run) for run in parameters]


def _stack(parts: list[Array], rows: int, fill: Any) -> Array:
    """Stack arrays of up to ``rows`` rows, the rest filled."""
    stacked = np.full((len(parts), rows, *parts[0].shape[1:]), fill, dtype=parts[0].dtype)
    for i, part in enumerate(parts):
        stacked[i, : len(part)] = part
    return stacked
