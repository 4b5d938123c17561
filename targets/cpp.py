"""Target cpp: ``NAME.hpp``, a class of C++17 by value, beside the C, an example and CMake."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .._version import __version__
from .artefact import Built, Option, Options, filled
from .native import C_FLAGS, refuse_difference, start_values
from .tools import require, run_tool

OPTIONS: tuple[Option, ...] = ()

#: Of the example, and of the check.
_STEPS = 2000


def files(
    manifest: Mapping[str, Any], sources: Mapping[str, str], options: Options
) -> dict[str, str | bytes]:
    """Return the files of a C++ library."""
    values = {
        "name": manifest["name"], "version": __version__,
        "klass": class_name(manifest["system"]["name"]), "n": len(options.q),
        "about": f"{manifest['scheme']['method']} for {manifest['system']['name']}",
        "real": manifest["real"], "dt": repr(options.dt), "steps": _STEPS,
        "max_iterations": options.max_iterations, **start_values(options, manifest)}
    return {**sources, f"{manifest['name']}.hpp": filled("stepper.hpp", **values),
            "main.cpp": filled("main.cpp", **values),
            "CMakeLists.txt": filled("CMakeLists.txt", **values)}


def class_name(name: str) -> str:
    """Return e.g. ``HeavyTop`` for ``heavy_top``."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_"))


def compile(folder: Path, platforms: tuple[str, ...]) -> Path:
    """Return the folder: text is all there is."""
    return folder


def check(built: Built) -> str:
    """Compile the example as C++17 without a warning, run it, and compare its bits."""
    name = built.stepper.name
    c, cpp = (require(tool, "Checking target cpp") for tool in ("cc", "c++"))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        here = str(built.path.resolve())
        run_tool([*c, *C_FLAGS, "-c", f"{here}/{name}.c", "-o", "stepper.o"], folder,
                 "Compiling the stepper")
        run_tool([*cpp, "-std=c++17", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror",
                  "-I", here, f"{here}/main.cpp", "stepper.o", "-lm", "-o", "example"], folder,
                 "Compiling the example")
        found = run_tool([str(folder / "example"), "bits"], folder, "The example")
    return refuse_difference("C++", found, built.stepper, built.options, _STEPS)
