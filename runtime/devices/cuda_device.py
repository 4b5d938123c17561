"""A card, by cuda-core and NVRTC."""

from __future__ import annotations

from functools import lru_cache
from types import SimpleNamespace
from typing import Any

import numpy as np

from ...core.arrays import Array
from ...core.errors import GyrosparkError, InputError, MissingDependencyError
from ...core.extras import install
from .cuda_text import THREADS
from .device import Memory, View

__all__ = ["CudaDevice", "compile_cubin"]


def _cuda() -> Any:
    """Return cuda-core and the driver's functions that it lacks, imported at the first use."""
    try:
        from cuda import core
        from cuda.bindings import driver
        from cuda.core.utils import StridedMemoryView
    except ImportError as error:
        raise MissingDependencyError(
            f"device = 'cuda' needs cuda-core; {install('cuda')} brings it.") from error
    return SimpleNamespace(core=core, driver=driver, view=StridedMemoryView)


def compile_cubin(name: str, text: str, architecture: str) -> Any:
    """Return the machine code of a CUDA text for an architecture such as ``"sm_90"``, by NVRTC.

    No product is contracted with a sum, so that a CPU gives the same bits.
    """
    core = _cuda().core
    options = core.ProgramOptions(name=f"{name}.cu", arch=architecture, std="c++17", fma=False)
    cuda_program = core.Program(text, "c++", options)
    return cuda_program.compile("cubin")


@lru_cache(maxsize=64)
def _kernels(name: str, text: str, architecture: str, card: int) -> Any:
    """Return the machine code; NVRTC takes a second or two.

    ``card`` is in the key of the cache alone: loaded code belongs to the context of one card.
    """
    return compile_cubin(name, text, architecture)


class CudaDevice:
    """The current card, or the one with a number; all launches are on one stream of its own."""

    def __init__(self, number: int | None = None) -> None:
        """Open card ``number``, by default the current one, with a new stream."""
        self._cuda = _cuda()
        try:
            self._card = self._cuda.core.Device(number)
            self._card.set_current()
            self._stream = self._card.create_stream()
        except Exception as error:  # no driver, no card: each has an error of its own
            raise InputError(
                f"device = 'cuda' finds no NVIDIA card ({str(error).splitlines()[0]}); leave "
                "device out, and the trajectories run on the CPU.") from error

    def load(self, name: str, text: str) -> Any:
        """Return the compiled kernels."""
        capability = self._card.compute_capability
        architecture = f"sm_{capability.major}{capability.minor}"
        return name, _kernels(name, text, architecture, self._card.device_id)

    def zeros(self, shape: tuple[int, ...], dtype: Any) -> Memory:
        """Allocate zeroed memory."""
        memory = self._new(shape, np.dtype(dtype))
        memory.handle.fill(0, stream=self._stream)
        return memory

    def put(self, array: Array) -> Memory:
        """Return memory with the numbers of an array."""
        contiguous = np.ascontiguousarray(array)
        memory = self._new(contiguous.shape, contiguous.dtype)
        self._copy("cuMemcpyHtoDAsync", int(memory.handle.handle), contiguous.ctypes.data,
                   contiguous.nbytes)
        return memory

    def get(self, memory: Memory) -> Array:
        """Return the numbers."""
        host_array = np.empty(memory.shape, memory.dtype)
        self._copy("cuMemcpyDtoHAsync", host_array.ctypes.data, int(memory.handle.handle),
                   host_array.nbytes)
        return host_array

    def launch(self, program: Any, kernel: str, threads: int, *arguments: Any) -> None:
        """Begin ``threads`` threads in whole blocks; kernels leave the threads beyond idle."""
        name, code = program
        kernel_arguments = [int(argument.handle.handle)
                            if isinstance(argument, Memory) else argument
                            for argument in arguments]
        core = self._cuda.core
        config = core.LaunchConfig(grid=-(-threads // THREADS), block=THREADS)
        core.launch(self._stream, config, code.get_kernel(f"{name}_{kernel}"), *kernel_arguments)

    def wait(self) -> None:
        """Return when all launches are done."""
        self._stream.sync()

    def view(self, array: Any) -> View:
        """Return an array of another library, after its pending operations on the card."""
        foreign = self._cuda.view.from_any_interface(array, stream_ptr=int(self._stream.handle))
        # in numbers, not in bytes
        strides = foreign.strides
        if strides is None:  # C order
            strides = tuple(int(np.prod(foreign.shape[k + 1:])) for k in range(len(foreign.shape)))
        size = foreign.size * foreign.dtype.itemsize
        handle = self._cuda.core.Buffer.from_handle(foreign.ptr, size, owner=foreign)
        return View(Memory(handle, tuple(foreign.shape), foreign.dtype), tuple(strides))

    def share(self, memory: Memory, shape: tuple[int, ...], strides: tuple[int, ...]) -> Any:
        """Return memory as an object with ``__dlpack__``."""
        return self._cuda.view.from_buffer(memory.handle, shape, strides, dtype=memory.dtype)

    def _new(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> Memory:
        """Allocate memory of the card, or raise InputError if it has none."""
        size = int(np.prod(shape)) * dtype.itemsize
        try:
            handle = self._card.allocate(max(size, 1), stream=self._stream)
        except Exception as error:
            if "OUT_OF_MEMORY" not in str(error):
                raise
            raise InputError(f"The card has no memory for {size:,} bytes more; take fewer "
                             "trajectories at a time, or keep fewer of their states with a larger "
                             "every.") from error
        return Memory(handle, shape, dtype)

    def _copy(self, function: str, target: int, source: int, size: int) -> None:
        """Copy ``size`` bytes between host and card, from address ``source`` to ``target``; wait.

        ``function`` is the driver's name of the copy in one of the two directions.
        """
        (status,) = getattr(self._cuda.driver, function)(target, source, size,
                                                         int(self._stream.handle))
        if status != self._cuda.driver.CUresult.CUDA_SUCCESS:
            raise GyrosparkError(f"The CUDA driver refuses a copy of {size:,} bytes: "
                                 f"{status.name}.")
        self.wait()
