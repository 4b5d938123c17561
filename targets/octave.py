"""Target octave: one function of Octave and MATLAB, compiled from one mex file."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path

from ..core.manifest import Manifest
from ..runtime.compilation.body_columns import bodies_of
from .artefact import EXAMPLE_STEPS, Built, Options, fill_template, template_values
from .native import refuse_difference
from .tools import require, run_tool

__all__ = ["check", "compile", "files"]


def files(
    manifest: Manifest, sources: Mapping[str, str], options: Options
) -> dict[str, str | bytes]:
    """Return files by name: the stepper's C, NAME_mex.c, which calls it, and NAME.m, its help."""
    template_fields = template_values(manifest, sources, options)
    names = [*options.parameters]
    # inputs are members of the parameters' struct, which the mex file fills by position
    template_fields["places"] = [names.index(name) for name in template_fields["inputs"]]
    template_fields["quaternions"] = [body.q for body in bodies_of(manifest).values()]
    name = manifest.name
    return {**sources, f"{name}_mex.c": fill_template("mex.c", **template_fields),
            f"{name}.m": fill_template("stepper.m", **template_fields)}


def compile(folder: Path, platforms: tuple[str, ...]) -> Path:
    """Return the folder: Octave, or MATLAB, compiles it."""
    return folder


def check(built: Built) -> str:
    """Compile a copy in Octave, call the function, and compare the bits."""
    octave = require("octave", "Checking target octave")
    require("mkoctfile", "Checking target octave")
    name = built.stepper.name
    kind = "single" if built.stepper.manifest.real == "float" else "double"
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        for file in built.files:
            shutil.copy(built.path / file, folder / file)
        bits = run_tool(
            [*octave, "--no-gui", "--norc", "--quiet", "--eval",
             f"[q, p] = {name}([], [], {EXAMPLE_STEPS}); "
             # the bytes of the last state, in hexadecimal
             f"printf('%02x', typecast({kind}([q(:, end); p(:, end)]), 'uint8'))"],
            folder, "Octave")
    return refuse_difference("Octave", bits, built, EXAMPLE_STEPS)
