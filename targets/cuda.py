"""Target cuda: ``NAME.cu``, kernels with a thread for each trajectory, and an example."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..core.errors import GyrosparkError
from ..core.manifest import Manifest
from ..runtime.devices.cuda_text import THREADS, cuda_text
from ..runtime.devices.host_device import HostDevice
from .artefact import EXAMPLE_STEPS, Built, Options, fill_template, template_values
from .native import refuse_difference
from .tools import require, run_tool

__all__ = ["check", "compile", "files"]

#: The architectures of A100 and H100, which the check compiles for.
_ARCHITECTURES = ("sm_80", "sm_90")


def files(
    manifest: Manifest, sources: Mapping[str, str], options: Options
) -> dict[str, str | bytes]:
    """Return the CUDA text, its header for programs on the host, an example and the manifest."""
    name = manifest.name
    template_fields = template_values(manifest, sources, options) | {"threads": THREADS}
    return {f"{name}.cu": cuda_text(name, sources) + fill_template("launch.cu", **template_fields),
            f"{name}_cuda.h": fill_template("trajectories.h", **template_fields),
            "main.cu": fill_template("main.cu", **template_fields),
            f"{name}.json": sources[f"{name}.json"]}


def compile(folder: Path, platforms: tuple[str, ...]) -> Path:
    """Return the folder: text is all there is."""
    return folder


def check(built: Built) -> str:
    """Compile the text as C and compare its bits; compile it by nvcc too, if installed."""
    require("cc", "Checking target cuda")
    name, artefact = built.stepper.name, built.path.resolve()
    comparison = refuse_difference("CUDA text as C", _bits(built), built, EXAMPLE_STEPS)
    nvcc = shutil.which("nvcc")
    if nvcc is None:
        return f"{comparison}; nvcc, which compiles it for a card, was not found"
    with tempfile.TemporaryDirectory() as folder_name:
        for architecture in _ARCHITECTURES:
            run_tool([nvcc, "-O2", "-fmad=false", f"-arch={architecture}",
                      str(artefact / "main.cu"), str(artefact / f"{name}.cu"), "-o", "many"],
                     Path(folder_name), "Compiling the example")
    return f"{comparison}; nvcc compiles it for {' and '.join(_ARCHITECTURES)}"


def _bits(built: Built) -> str:
    """Return the bits of q and p of the last of three equal trajectories, by the text compiled as
    C.

    Arrays have a column for each trajectory. Two launches show that a run can be continued.
    """
    options, device, name = built.options, HostDevice(), built.stepper.name
    real = np.float32 if built.stepper.manifest.real == "float" else np.float64
    program = device.load(name, (built.path / f"{name}.cu").read_text(encoding="ascii"))
    count, n, step_total = 3, len(options.q), EXAMPLE_STEPS

    def rows_on_device(numbers: Any) -> Any:
        """Return numbers on the device as rows, with an equal column for each trajectory."""
        return device.put(np.repeat(np.array([*numbers], real)[:, None], count, axis=1))

    # "measure" writes the words of memory that one trajectory needs, and the number of its
    # parameters, which the host knows
    sizes = device.zeros((2,), np.int64)
    device.launch(program, "measure", 1, sizes)
    words = device.zeros((int(device.get(sizes)[0]), count), np.uint32)
    state, status = rows_on_device((*options.q, *options.p)), device.zeros((count,), np.intc)
    steps, iterations = (device.zeros((count,), np.int64) for _ in range(2))
    # real(0), the tolerance: iterate down to round-off
    device.launch(program, "begin_trajectories", count, np.int64(count),
                  rows_on_device(options.parameters.values()), rows_on_device([options.dt]),
                  real(0), np.intc(options.max_iterations), state, words, status, steps, iterations)
    states = [device.zeros((2, n, count), real) for _ in range(2)]
    most_iterations = device.zeros((2, count), np.intc)
    # of all steps, ``total``, every total-th state is stored: the start and the end alone
    every, total, first_row = step_total, step_total, 0
    for first_step, end_step in ((0, step_total // 3), (step_total // 3, step_total)):
        device.launch(program, "advance_trajectories", count, np.int64(count), *map(np.int64, (
            first_step, end_step, every, total, first_row)), state, words, status, steps,
                      iterations, *states, most_iterations)
    failed = device.get(status).any()
    if failed:
        raise GyrosparkError(f"A step of {name} with dt = {options.dt:.6g} failed: status "
                             f"{device.get(status)[-1]}; choose a smaller dt.")
    end = np.concatenate([device.get(memory)[-1, :, -1] for memory in states])
    return str(end.astype(real).tobytes().hex())
