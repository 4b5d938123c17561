"""Target arduino: a library of Arduino and PlatformIO, with a sketch."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping
from pathlib import Path

from ..core.manifest import Manifest
from .artefact import EXAMPLE_STEPS, Built, Options, fill_template, refuse_names, template_values
from .cpp import KEYWORDS
from .native import C_FLAGS, refuse_difference
from .tools import require, run_tool

__all__ = ["check", "compile", "files", "program_of"]

# Macros of Arduino.h, and registers of AVR.
_WORDS = (
    "HIGH LOW INPUT OUTPUT INPUT_PULLUP PI HALF_PI TWO_PI DEG_TO_RAD RAD_TO_DEG EULER SERIAL "
    "DISPLAY LSBFIRST MSBFIRST CHANGE FALLING RISING DEFAULT EXTERNAL INTERNAL LED_BUILTIN SDA "
    "SCL SS MOSI MISO SCK DEC HEX OCT BIN SP SPL SPH SREG")
# and the binary constants B0 to B11111111 of binary.h; the AVR has no port I
_MACROS = frozenset(_WORDS.split()) | {
        f"B{value:0{digits}b}" for digits in range(1, 9) for value in range(2**digits)} | {
        f"{register}{port}" for register in ("PORT", "DDR", "PIN", "P") for port in "ABCDEFGHJKL"
        } | {f"P{port}{bit}" for port in "ABCDEFGHJKL" for bit in range(8)}


def files(
    manifest: Manifest, sources: Mapping[str, str], options: Options
) -> dict[str, str | bytes]:
    """Return the files of the library: sources, an example sketch, and two manifests.

    library.properties is for the Arduino IDE, library.json for PlatformIO.
    """
    refuse_names(manifest, KEYWORDS | _MACROS, "Arduino")
    template_fields = template_values(manifest, sources, options)
    name = manifest.name
    # the sketch assigns its number to each input, in every step
    template_fields["parameter_values"] = dict(template_fields["parameters"])
    library_json = {"name": name, "version": "0.1.0",
                    "description": f"{template_fields['about']}, one step at a "
                    "time", "keywords": "rigid body, symplectic", "authors": {"name": "gyrospark"},
                    "frameworks": "*", "platforms": "*", "headers": f"{name}.h",
                    # gcc contracts a·b + c by default where the processor has fma: other bits
                    "build": {"flags": "-ffp-contract=off"},
                    # files beside these, such as the manifest, are not part of the library
                    "export": {"include": ["src", "examples", "library.properties"]}}
    # the manifest is no source: it goes to extras/
    return {**{f"src/{file}": text for file, text in sources.items() if not file.endswith("json")},
            f"extras/{name}.json": sources[f"{name}.json"],
            "library.json": json.dumps(library_json, indent=2) + "\n",
            "library.properties": fill_template("library.properties", **template_fields),
            f"examples/{name}/{name}.ino": fill_template("sketch.ino", **template_fields)}


def compile(folder: Path, platforms: tuple[str, ...]) -> Path:
    """Return the folder: Arduino, or PlatformIO, compiles it."""
    return folder


def program_of(sketch: Path, steps: int) -> str:
    """Return a program that runs a sketch and prints its bits, for texts/Arduino.h."""
    return (f'#include "Arduino.h"\n#include "{sketch}"\nint main()\n{{\n    setup();\n'
            f"    for (int k = 0; k < {steps}; ++k)\n        loop();\n"
            "    print_bits(q, sizeof q);\n    print_bits(p, sizeof p);\n}\n")


def check(built: Built) -> str:
    """Compile the sketch here, with a serial port that prints, and compare the bits."""
    name, artefact = built.stepper.name, built.path.resolve()
    c, cpp = (require(tool, "Checking target arduino") for tool in ("cc", "c++"))
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        (folder / "Arduino.h").write_text(fill_template("Arduino.h"), encoding="utf-8")
        sketch = artefact / "examples" / name / f"{name}.ino"
        (folder / "main.cpp").write_text(program_of(sketch, EXAMPLE_STEPS), encoding="utf-8")
        run_tool([*c, *C_FLAGS, "-c", str(artefact / "src" / f"{name}.c"), "-o", "stepper.o"],
                 folder, "Compiling the stepper")
        # C++11 is the standard that Arduino's AVR core is compiled with
        run_tool([*cpp, "-std=c++11", "-O2", "-Wall", "-Wextra", "-pedantic", "-Werror",
                  "-I", str(artefact / "src"), "main.cpp", "stepper.o", "-lm", "-o", "sketch"],
                 folder, "Compiling the sketch")
        bits = run_tool([str(folder / "sketch")], folder, "The sketch")
    return refuse_difference("Sketch", bits, built, EXAMPLE_STEPS)
