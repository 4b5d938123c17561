"""Interface of a device for ensembles: memory, compilation, launches."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ...core.arrays import Array
from ...core.records import dataclass

__all__ = ["Device", "Memory", "View", "is_on_card"]

#: Numbers of DLPack for memory of a CPU, and for such memory that a card can read.
_OF_CPU = (1, 3)


@dataclass(frozen=True)
class Memory:
    """An array in memory of a device.

    Attributes
    ----------
    handle
        Handle of the device.
    shape, dtype
        Of the array, whose last axis is contiguous.
    """

    handle: Any
    shape: tuple[int, ...]
    dtype: np.dtype[Any]


@dataclass(frozen=True)
class View:
    """An array of another library: ``memory``, its strides in numbers."""

    memory: Memory
    strides: tuple[int, ...]


class Device(Protocol):
    """A graphics card, or the host in its place (``HostDevice``)."""

    def load(self, name: str, text: str) -> Any:
        """Return the compiled kernels of a CUDA text, the stepper's name before each."""

    def zeros(self, shape: tuple[int, ...], dtype: Any) -> Memory:
        """Allocate zeroed memory."""

    def put(self, array: Array) -> Memory:
        """Return memory with the numbers of an array."""

    def get(self, memory: Memory) -> Array:
        """Return the numbers as an array, once all launches are done."""

    def launch(self, program: Any, kernel: str, threads: int, *arguments: Any) -> None:
        """Begin ``threads`` threads of a kernel; arguments are ``Memory`` and NumPy scalars."""

    def wait(self) -> None:
        """Return when all launches are done."""

    def view(self, array: Any) -> View:
        """Return an array of another library, which has ``__dlpack__``, without a copy."""

    def share(self, memory: Memory, shape: tuple[int, ...], strides: tuple[int, ...]) -> Any:
        """Return memory as an object with ``__dlpack__``, without a copy."""


def is_on_card(array: Any) -> bool:
    """Whether an array of any library lies in memory of a card."""
    # a class has the method too, unbound; NumPy's arrays, the usual ones, need no further look
    if isinstance(array, (np.ndarray, type)) or not hasattr(array, "__dlpack_device__"):
        return False
    return array.__dlpack_device__()[0] not in _OF_CPU
