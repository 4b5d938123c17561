"""The CUDA text compiled as C, its threads a loop: a device for tests where there is no card.

What CUDA adds to C is three macros and three variables here. The bits are those of a card as far as
both round as IEEE 754 says: sums, products, quotients, square roots, fused products and sums.
"""

from __future__ import annotations

import ctypes
import subprocess
from typing import Any

import numpy as np

from ...core.arrays import Array
from ...core.errors import CompilerError
from ..compilation.build_cache import build_folder
from ..compilation.compiler import find_compiler
from .cuda_text import THREADS
from .device import Memory, View

__all__ = ["SHIMS", "HostDevice"]

#: What CUDA adds to C.
SHIMS = f"""\
#define __global__
#define __device__
#define __launch_bounds__(threads)
typedef struct {{ unsigned x; }} gs_index;
#ifdef __cplusplus
extern "C" {{
#endif
extern gs_index blockIdx, blockDim, threadIdx;
gs_index blockIdx = {{ 0 }}, blockDim = {{ {THREADS} }}, threadIdx = {{ 0 }};
#ifdef __cplusplus
}}
#endif

"""
#: A card contracts nothing either.
FLAGS = ["-O1", "-ffp-contract=off", "-shared", "-fPIC"]


class HostDevice:
    """Memory is NumPy's; a launch calls the kernel for one thread after the other."""

    def __init__(self, command: list[str] | None = None) -> None:
        self._command = command or [*find_compiler().command, "-std=c11"]
        self._language = "c++" if "++" in self._command[0] else "c"
        self._programs: dict[str, Any] = {}

    def load(self, name: str, text: str) -> Any:
        """Return the compiled text as a library, and the name before each of its functions."""
        if text not in self._programs:
            with build_folder() as folder:
                source, library = folder / f"{name}.cu", folder / f"{name}.so"
                source.write_text(SHIMS + text, encoding="ascii")
                outcome = subprocess.run(
                    [*self._command, *FLAGS, "-x", self._language, str(source), "-o", str(library),
                     "-lm"], capture_output=True, text=True, check=False)
                if outcome.returncode:
                    raise CompilerError(f"The CUDA text of {name} is not {self._language}: "
                                        f"{outcome.stderr.strip()}")
                self._programs[text] = ctypes.CDLL(str(library)), name
        return self._programs[text]

    def zeros(self, shape: tuple[int, ...], dtype: Any) -> Memory:
        """Allocate zeroed memory."""
        return self.put(np.zeros(shape, dtype))

    def put(self, array: Array) -> Memory:
        """Return memory with the numbers of an array."""
        return Memory(np.array(array, order="C"), array.shape, array.dtype)

    def get(self, memory: Memory) -> Array:
        """Return the numbers."""
        return np.array(memory.handle)

    def launch(self, program: Any, kernel: str, threads: int, *arguments: Any) -> None:
        """Call the kernel for each thread, up to the end of the last block, as a card does."""
        library, name = program
        function = getattr(library, f"{name}_{kernel}")
        kernel_arguments = [ctypes.c_void_p(argument.handle.ctypes.data)
                            if isinstance(argument, Memory)
                            else np.ctypeslib.as_ctypes_type(argument.dtype)(argument)
                            for argument in arguments]
        block, thread = (ctypes.c_uint.in_dll(library, index)
                         for index in ("blockIdx", "threadIdx"))
        for i in range(-(-threads // THREADS) * THREADS):
            block.value, thread.value = divmod(i, THREADS)
            function(*kernel_arguments)

    def wait(self) -> None:
        """Return: every launch is done when it returns."""

    def view(self, array: Any) -> View:
        """Return an array with ``__dlpack__`` in memory of the CPU."""
        imported = np.from_dlpack(array)
        strides = tuple(step // imported.itemsize for step in imported.strides)
        return View(Memory(imported, imported.shape, imported.dtype), strides)

    def share(self, memory: Memory, shape: tuple[int, ...], strides: tuple[int, ...]) -> Array:
        """Return a NumPy array on the memory, which has ``__dlpack__``."""
        steps = [step * memory.dtype.itemsize for step in strides]
        return np.lib.stride_tricks.as_strided(memory.handle, shape, steps)
