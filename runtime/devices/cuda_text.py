"""The control profile of a stepper and its kernels as one CUDA text.

The text is C11, C++17 and CUDA at once: nvcc and NVRTC compile it for a card; with a few lines for
what CUDA adds, ``host_device.SHIMS``, any C compiler compiles it for a loop over the threads.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from ...engine.amalgamate import complete

__all__ = ["KERNELS", "THREADS", "cuda_text"]

#: Threads of a block. A multiprocessor has 65,536 registers and a thread at most 255, which G-L in
#: double needs (docs/cuda.md): in blocks of more than 256 threads it would spill.
THREADS = 128
#: Functions that a card runs, each with the prefix of its stepper.
KERNELS = ("measure", "gather_states", "begin_trajectories", "advance_trajectories")

#: What precedes the stepper: the C library where there is none, and what is compiled for a card.
_PRELUDE = f"""\
#ifdef __CUDACC_RTC__ /* NVRTC has no C library */
typedef decltype(sizeof 0) size_t;
typedef int int32_t;
typedef unsigned uint32_t;
typedef long long int64_t;
typedef unsigned long long uint64_t;
#define HUGE_VAL __builtin_bit_cast(double, 0x7ff0000000000000ULL)
#define NAN __builtin_bit_cast(double, 0x7ff8000000000000ULL)
#define DBL_EPSILON 2.2204460492503131e-16
#define DBL_MIN 2.2250738585072014e-308
#define FLT_EPSILON 1.1920928955078125e-7f
#define FLT_MIN 1.1754943508222875e-38f
#else
#include <float.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#endif

#define GS_DEVICE __device__
#ifdef __cplusplus
#define GS_KERNEL extern "C" __global__ void __launch_bounds__({THREADS})
#else
#define GS_KERNEL __global__ void
#endif
#ifdef __CUDACC__ /* -fmad=false keeps products from being contracted with sums */
#define ROUNDED(value) (value)
#endif

"""
#: Functions and tables that are "static", also behind the macro that begins a definition.
_STATIC = re.compile(r"^((?:#define \w+ )?)(static\b)", re.MULTILINE)
_INCLUDE = re.compile(r"^#include <\w+\.h>\n", re.MULTILINE)


def cuda_text(name: str, files: Mapping[str, str]) -> str:
    """Return the text of a stepper of profile control with a thread for each trajectory.

    Parameters
    ----------
    name : str
        Name of the stepper.
    files : mapping of str to str
        Its header and source by their names.
    """
    source = complete(files)[f"{name}.c"]
    # NVRTC compiles one text, without files beside it
    text = _INCLUDE.sub("", source.replace(f'#include "{name}.h"\n', files[f"{name}.h"]))
    of_card = Path(__file__).with_name("trajectories.cu").read_text(encoding="ascii")
    # public functions, declared or defined at the begin of a line: "int heavy_top_gl3_begin("
    functions = re.compile(
        rf"^((?:(?:\w+|NAME\(\w+\)) )+\**(?:NAME\(\w+\)|{name}_\w+)\()", re.MULTILINE)
    return _PRELUDE + functions.sub(r"GS_DEVICE \1", _STATIC.sub(r"\1GS_DEVICE \2", text)) + of_card
