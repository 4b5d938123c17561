"""Target cpp: ``NAME.hpp``, a class of C++17 by value, beside the C, an example and CMake."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

from ..core.manifest import Manifest
from ..generator.parsing.reserved_names import is_taken
from .artefact import EXAMPLE_STEPS, Built, Options, fill_template, refuse_names, template_values
from .native import C_FLAGS, refuse_difference
from .tools import require, run_tool

__all__ = ["KEYWORDS", "check", "class_name", "compile", "files"]

# Words of C++20 that C does not have.
_WORDS = (
    "and and_eq bitand bitor catch char8_t char16_t char32_t class co_await co_return co_yield "
    "compl concept const_cast consteval constinit decltype delete dynamic_cast explicit export "
    "friend mutable namespace new noexcept not not_eq operator or or_eq private protected public "
    "reinterpret_cast requires static_cast template this throw try typeid typename using virtual "
    "wchar_t xor xor_eq")
KEYWORDS = frozenset(_WORDS.split())

#: Types in the class, which cannot have its name, and the type of <cstdio>.
_TYPES = ("State", "Parameters", "Options", "Status", "Velocity", "Quantities", "FILE")


def files(
    manifest: Manifest, sources: Mapping[str, str], options: Options
) -> dict[str, str | bytes]:
    """Return the header, the C, an example and CMakeLists.txt."""
    refuse_names(manifest, KEYWORDS, "C++")
    template_fields = template_values(manifest, sources, options)
    template_fields["klass"] = class_name(manifest.system.name)
    return {**sources, f"{manifest.name}.hpp": fill_template("stepper.hpp", **template_fields),
            "main.cpp": fill_template("main.cpp", **template_fields),
            "CMakeLists.txt": fill_template("CMakeLists.txt", **template_fields)}


def class_name(name: str) -> str:
    """Return e.g. ``HeavyTop`` for ``heavy_top``; ``StateStepper`` for ``state``, a type in it."""
    words = "".join(word[:1].upper() + word[1:] for word in name.split("_"))
    if not words.isidentifier():  # of "_" or "_1"
        return f"Stepper{words}"
    return f"{words}Stepper" if words in _TYPES or is_taken(words) else words


def compile(folder: Path, platforms: tuple[str, ...]) -> Path:
    """Return the folder: text is all there is."""
    return folder


def check(built: Built) -> str:
    """Compile the example as C++17 without a warning, run it, and compare its bits."""
    name, artefact = built.stepper.name, built.path.resolve()
    c, cpp = (require(tool, "Checking target cpp") for tool in ("cc", "c++"))
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        run_tool([*c, *C_FLAGS, "-c", str(artefact / f"{name}.c"), "-o", "stepper.o"], folder,
                 "Compiling the stepper")
        run_tool([*cpp, "-std=c++17", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror",
                  str(artefact / "main.cpp"), "stepper.o", "-lm", "-o", "example"], folder,
                 "Compiling the example")
        bits = run_tool([str(folder / "example"), "bits"], folder, "The example")
    return refuse_difference("C++", bits, built, EXAMPLE_STEPS)
