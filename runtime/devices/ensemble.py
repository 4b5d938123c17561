"""Which device an ensemble runs on, what it refuses, and trajectories that stay on a card."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import field
from itertools import islice
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...core.arguments import choose, count_text
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.html import card, table
from ...core.incompatibilities import LARGEST, refuse_together
from ...core.records import dataclass
from ..bindings.binding import REASONS
from .device import Device, View, is_on_card
from .trajectories import Trajectories, Window

if TYPE_CHECKING:
    from ..steppers.stepper import Stepper

__all__ = ["DEVICES", "DeviceEnsemble", "DeviceName", "device_for", "ensemble_card",
           "refuse_on_device", "shared_ensemble", "views_of"]

#: Where ``integrate_ensemble`` runs.
DeviceName = Literal["cpu", "cuda"]
DEVICES: tuple[DeviceName, ...] = ("cpu", "cuda")


@explain_arguments
@dataclass(frozen=True, eq=False)
class DeviceEnsemble:
    """Trajectories in the memory of a card: ``integrate_ensemble`` of arrays on the card.

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
        Steps of each, a NumPy array.
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
        return (f"<DeviceEnsemble of {self._name}: {count_text(len(self), 'trajectory')} of "
                f"{count_text(self.t.shape[1], 'state')}, {len(self.failures):,} failed>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the number of trajectories, and the first failures."""
        return ensemble_card(f"DeviceEnsemble of {self._name}", self.t, self.failures)


def ensemble_card(title: str, t: Array, failures: Mapping[int, object]) -> str:
    """Return a card of trajectories: their numbers, and the first reasons of failures."""
    rows: list[tuple[str, object]] = [("trajectories", f"{len(t):,} of "
                                                       f"{count_text(t.shape[1], 'state')}"),
                                      ("failed", f"{len(failures):,}")]
    return card(title, table([*rows, *((f"trajectory {i}", failure) for i, failure in
                                       islice(failures.items(), 3))]))


def open_card(number: int | None) -> Device:
    """Return a card, by its number or the current one."""
    from .cuda_device import CudaDevice  # optional packages

    return CudaDevice(number)


def device_for(device: DeviceName | None, q: Any, p: Any) -> Device | None:
    """Return the card that trajectories run on; None for the CPU.

    Raises InputError for another name, for arrays in two places, and without a card;
    MissingDependencyError without cuda-core.
    """
    on_card = is_on_card(q), is_on_card(p)
    device_name = ("cuda" if any(on_card) else "cpu") if device is None else choose(
        "device", device, DEVICES)
    if on_card[0] != on_card[1]:
        raise InputError("Of q and p one lies in memory of a card and one does not; give both as "
                         "arrays of one library on one device.")
    if device_name == "cpu":
        if any(on_card):
            raise InputError("q and p lie in memory of a card, which device = 'cpu' cannot read; "
                             "leave device out, or copy them to NumPy arrays.")
        return None
    return open_card(q.__dlpack_device__()[1] if any(on_card) else None)


def refuse_on_device(stepper: Stepper, solver: str, **absent: Any) -> None:
    """Refuse features without an implementation on a card.

    ``absent`` are arguments of the call that a card does not know, name → value. Raises InputError
    with the refused argument and the cure.
    """
    manifest, n = stepper.manifest, stepper.n
    # an argument is not given if it is None or an empty sequence, such as no events
    arguments = {name: argument is not None and not (isinstance(argument, tuple | list)
                                                     and not argument)
             and name for name, argument in absent.items()}
    # a card has the fixed-point iteration and exact flows, and no Newton's method
    iterated = manifest.fast_path.available or not stepper.binding.solves
    refuse_together(
        cuda="device = 'cuda'", **arguments, newton=solver == "newton" and f"solver {solver!r}",
        long_numbers=manifest.real not in ("float", "double")
        and f"numbers of type {manifest.real}",
        large=n > LARGEST and f"systems of {n} coordinates",
        frame=bool(stepper.symmetries) and "co-moving frames",
        scaled=stepper.binding.clocked and "a time_scale",
        velocity_constraints=bool(stepper.binding.rows) and "velocity constraints",
        energy=bool(manifest.scheme.exact_energy) and "steps of exact energy",
        newton_only=not iterated and f"{stepper.name}: {manifest.fast_path.reason}")


def views_of(device: Device, stepper: Stepper, q: Any, p: Any) -> tuple[View, View]:
    """Return views of arrays in the memory of a card, without a copy.

    Raises InputError for other shapes, and for numbers of another type than the stepper's.
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
    stepper: Stepper, trajectories: Trajectories, like: Any, stop: Callable[[], bool]
) -> DeviceEnsemble:
    """Take all steps, or those before ``stop()`` is true; return arrays of ``like``'s library.

    Memory on the card has the trajectory as its fastest index; strides give its arrays the shape
    (trajectories, states, n) without a copy.
    """
    runs, device, windows = trajectories.runs, trajectories.device, list[Window]()
    # a window of all rows, the start's and the others: there is no second one
    step_count = trajectories.integrate(runs.first.rows + 1, windows.append, stop)
    states, (window,) = runs.first.rows_after(step_count) + 1, windows
    count, n = len(runs), stepper.n

    def as_array(memory: Any, shape: tuple[int, ...], strides: tuple[int, ...]) -> Any:
        """Return memory of the card as an array of the caller's library."""
        return _of_library(device.share(memory, shape, strides), like)

    q, p = (as_array(memory, (count, states, n), (1, n * count, count))
            for memory in (window.q, window.p))
    status = device.get(trajectories.status)
    return DeviceEnsemble(
        t=stepper.binding.times(runs.t0[:, None], runs.dt[:, None],
                                runs.first.steps_of_rows(step_count)),
        q=q, p=p, iterations=as_array(window.iterations, (count, states), (1, count)),
        steps=trajectories.steps_done,
        failures={i: REASONS[int(status[i])] for i in np.flatnonzero(status).tolist()},
        _name=stepper.name)


def _of_library(shared: Any, like: Any) -> Any:
    """Return memory as an array of the library of another array; unchanged if it has no library."""
    # the array is there, so its library is imported: cupy, torch or jax is not named here
    library = sys.modules.get(type(like).__module__.partition(".")[0])
    convert = getattr(library, "from_dlpack", None)
    return shared if convert is None else convert(shared)
