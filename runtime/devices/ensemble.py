"""Which device an ensemble runs on, what it refuses, and trajectories that stay on a card."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...core.arguments import choose
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ..bindings.binding import REASONS
from .device import Device, View, is_on_card
from .trajectories import Trajectories, Window

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["DEVICES", "DeviceEnsemble", "DeviceName", "device_for", "refuse_on_device",
           "shared_ensemble", "views_of"]

Array = NDArray[Any]

#: Where ``integrate_ensemble`` runs.
DeviceName = Literal["cpu", "cuda"]
DEVICES: tuple[DeviceName, ...] = ("cpu", "cuda")

#: Coordinates of the largest system that profile control is written for.
_LARGEST = 28


@explain_arguments
@dataclass(frozen=True, eq=False)
class DeviceEnsemble:
    """Trajectories that stay on a card: ``integrate_ensemble`` of arrays that lie there.

    Attributes
    ----------
    t : array, shape (trajectories, states)
        Times in seconds, a NumPy array.
    q, p : arrays of the caller's library, shape (trajectories, states, n)
        Coordinates and momenta; NaN after a failed step. Their memory has the trajectory as its
        fastest index.
    iterations : array of the caller's library, shape (trajectories, states)
        The most iterations of a step since the state before; 0 for the start.
    steps : array, shape (trajectories,)
        Steps that each has done, a NumPy array.
    failures : dict of int to str
        Number of a failed trajectory → the reason.
    """

    t: Array
    q: Any
    p: Any
    iterations: Any
    steps: Array
    failures: dict[int, str]
    _name: str = field(repr=False)

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return (f"<DeviceEnsemble of {self._name}: {len(self):,} trajectories of "
                f"{self.t.shape[1]:,} states, {len(self.failures):,} failed>")


def open_card(number: int | None) -> Device:
    """Return a card, by its number or the current one."""
    from .cuda_device import CudaDevice  # optional packages

    return CudaDevice(number)


def device_for(asked: DeviceName | None, q: Any, p: Any) -> Device | None:
    """Return the card that trajectories run on; None for the CPU.

    Raises
    ------
    InputError
        For another name, for arrays in two places, and without a card.
    MissingDependencyError
        Without cuda-core.
    """
    there = is_on_card(q), is_on_card(p)
    chosen = ("cuda" if any(there) else "cpu") if asked is None else choose(
        "device", asked, DEVICES)
    if there[0] != there[1]:
        raise InputError("Of q and p one lies in memory of a card and one does not; give both as "
                         "arrays of one library on one device.")
    if chosen == "cpu":
        if any(there):
            raise InputError("q and p lie in memory of a card, which device = 'cpu' cannot read; "
                             "leave device out, or copy them to NumPy arrays.")
        return None
    return open_card(q.__dlpack_device__()[1] if any(there) else None)


def refuse_on_device(stepper: Stepper, solver: str, **absent: Any) -> None:
    """Refuse what trajectories on a card do not have.

    Raises
    ------
    InputError
        In one sentence: what it is, and what to do instead.
    """
    cure = "leave device out, and the trajectories run on the CPU"
    manifest, n = stepper.manifest, stepper.n
    real, scheme = manifest.real, manifest.scheme
    for name, value in absent.items():
        if value is not None and not (isinstance(value, tuple | list) and not value):
            raise InputError(f"device = 'cuda' has no {name}; leave {name} out, or {cure}.")
    if solver not in ("auto", "fixed-point"):
        raise InputError(f"device = 'cuda' has no solver {solver!r}: a step is iterated to a fixed "
                         f"point there; choose auto or fixed-point, or {cure}.")
    refused = [
        (real not in ("float", "double"), f"numbers of type {real}: a card has float and double"),
        (n > _LARGEST, f"systems of {n} coordinates: the largest has {_LARGEST}"),
        (bool(stepper.symmetries), "co-moving frames"),
        (stepper.binding.clocked, "time_scale"),
        (bool(stepper.binding.rows), "velocity constraints"),
        (bool(scheme.exact_energy), "steps of exact energy"),
        (stepper.binding.solves and not manifest.fast_path.available,
         f"fixed-point iteration for {stepper.name}: {manifest.fast_path.reason}")]
    for holds, what in refused:
        if holds:
            raise InputError(f"device = 'cuda' has no {what}; {cure}.")


def views_of(device: Device, stepper: Stepper, q: Any, p: Any) -> tuple[View, View]:
    """Return arrays on a card as they lie there.

    Raises
    ------
    InputError
        For other shapes, and for numbers of another type than the stepper's.
    """
    views = device.view(q), device.view(p)
    for name, view in zip(("q", "p"), views, strict=True):
        shape, dtype = view.memory.shape, view.memory.dtype
        if len(shape) != 2 or shape[1] != stepper.n or not shape[0]:
            raise InputError(f"{name} has shape {shape}; give (trajectories, {stepper.n}).")
        if dtype != np.dtype(stepper.binding.dtype):
            raise InputError(f"{name} has numbers of type {dtype}, and {stepper.name} computes "
                             f"with {np.dtype(stepper.binding.dtype)}; convert it on the card.")
    if views[0].memory.shape != views[1].memory.shape:
        raise InputError(f"q and p have shapes {views[0].memory.shape} and "
                         f"{views[1].memory.shape}; give one shape for both.")
    return views


def shared_ensemble(
    stepper: Stepper, there: Trajectories, like: Any, stop: Callable[[], bool]
) -> DeviceEnsemble:
    """Take all steps, until they shall stop; return arrays of the library of ``like``."""
    runs, device, windows = there.runs, there.device, list[Window]()
    done = there.integrate(runs.first.rows + 1, windows.append, stop)
    states, (window,) = runs.first.stored(done) + 1, windows
    count, n = len(runs), stepper.n

    def passed(memory: Any, shape: tuple[int, ...], strides: tuple[int, ...]) -> Any:
        return _of_library(device.share(memory, shape, strides), like)

    q, p = (passed(memory, (count, states, n), (1, n * count, count))
            for memory in (window.q, window.p))
    status = device.get(there.status)
    return DeviceEnsemble(
        stepper.binding.times(runs.t0[:, None], runs.dt[:, None], runs.first.steps_of_rows(done)),
        q, p, passed(window.iterations, (count, states), (1, count)), there.done,
        {i: REASONS[int(status[i])] for i in np.flatnonzero(status).tolist()}, stepper.name)


def _of_library(shared: Any, like: Any) -> Any:
    """Return memory as an array of the library of another one; as it is, where that has none."""
    library = sys.modules.get(type(like).__module__.partition(".")[0])
    convert = getattr(library, "from_dlpack", None)
    return shared if convert is None else convert(shared)
