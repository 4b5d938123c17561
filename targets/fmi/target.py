"""Targets fmu2 and fmu3: files, libraries and the check of an FMU for co-simulation."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...core.errors import GyrosparkError, InputError
from ...core.incompatibilities import refuse_together
from ...core.manifest import Manifest
from ..artefact import MARKER, Built, Options, refuse_names
from ..native import native_bits
from .archive import compile_fmu, library_of
from .description import (
    build_description,
    model_description,
    model_header,
    token,
)
from .slave import Slave
from .variables import variables_of

__all__ = ["Fmu"]

_HERE = Path(__file__).parent
#: Without arguments, of model.h and of what core.h includes beyond <float.h> and <math.h>.
_MACROS = frozenset([
    "GUID", "VARIABLES", "INITIAL", "EOF", "BUFSIZ", "FILENAME_MAX", "FOPEN_MAX", "TMP_MAX",
    "SEEK_CUR", "SEEK_END", "SEEK_SET", "stdin", "stdout", "stderr", "RAND_MAX", "EXIT_FAILURE",
    "EXIT_SUCCESS", "MB_CUR_MAX", "SIZE_MAX"])
#: Steps of a check.
_STEPS = 2000


def _end_from(slave: Slave, state: Any, dt: float, names: list[str]) -> list[float]:
    """Return variables after the steps of a check from a state; raise GyrosparkError if one fails.
    """
    slave.restore(state)
    for step in range(_STEPS):
        status = slave.step(step * dt, dt)
        if status not in ("OK", "Warning"):
            raise GyrosparkError(f"Step {step + 1} of the FMU returns {status}: "
                                 f"{' '.join(slave.messages[-1:])}")
    return slave.get(names)


class Fmu:
    """The functions of a target for a version of FMI, 2 or 3."""

    def __init__(self, version: int) -> None:
        self.version = version

    def files(
        self, manifest: Manifest, sources: Mapping[str, str], options: Options
    ) -> dict[str, str | bytes]:
        """Return descriptions, sources and a mark by their paths in the FMU.

        Raises InputError for another type than double, for numbers that an FMU cannot hold, and for
        a negative dt: communication points follow one another forwards.
        """
        refuse_together(fmu=f"an FMU of {manifest.name}", not_double=manifest.real != "double"
                        and f"numbers of type {manifest.real}")
        if options.dt < 0:
            raise InputError(f"dt = {options.dt:g} is negative, and the time of an FMU only grows; "
                             "give a positive dt.")
        refuse_names(manifest, _MACROS, "core.h of an FMU")
        version, name = self.version, manifest.name
        variables = variables_of(manifest, options)
        # the same for all steppers; model.h has what differs
        core_files = {file: (_HERE / file).read_text(encoding="utf-8")
                      for file in ("core.h", "export.h", "common.h", f"fmi{version}.h",
                                   f"fmi{version}.c")}
        code = {
            **{file: sources[file] for file in (f"{name}.c", f"{name}.h")}, **core_files,
            "model.h": model_header(manifest, options, variables, version),
            **({"buildDescription.xml": build_description(name)} if version == 3 else {}),
        }
        return {
            "modelDescription.xml": model_description(manifest, options, variables, version),
            f"resources/{MARKER}": manifest.text,
            **{f"sources/{file}": text for file, text in code.items()},
        }

    def compile(self, folder: Path, platforms: tuple[str, ...]) -> Path:
        """Compile the sources for platforms; return the FMU, a file in the folder."""
        manifest = Manifest.from_text((folder / "resources" / MARKER).read_text(encoding="utf-8"))
        return compile_fmu(folder, manifest.name, self.version, platforms)

    def check(self, built: Built) -> str:
        """Compare attitude and momenta of the FMU with native C, and with a repeated run.

        Raises InputError where it holds no library for this machine; GyrosparkError where the
        library does not load, or bits differ.
        """
        manifest, options = built.stepper.manifest, built.options
        variables = variables_of(manifest, options)
        names = [v.name for v in variables if v.member.startswith(("q[", "p["))]
        count = len(options.q)
        with tempfile.TemporaryDirectory() as folder_name:
            library = library_of(built.path, built.stepper.name, self.version, Path(folder_name))
            with Slave(library, token(manifest, variables, self.version), self.version,
                       {v.name: k for k, v in enumerate(variables)}) as slave:
                slave.start()
                state = slave.keep()
                # twice from one saved state: a state that does not hold all of the solver's memory
                # shows here
                first_end, second_end = (_end_from(slave, state, options.dt, names)
                                         for _ in range(2))
                slave.free(state)
        # native bits are q and then p; of a Lagrangian an FMU has velocities in place of p, so q
        # alone is compared
        expected_bits = native_bits(built.stepper, options, _STEPS)
        bits = struct.pack(f"={len(first_end)}d", *first_end).hex()
        if bits != expected_bits[:len(bits)] or len(first_end) < count:
            raise GyrosparkError(f"The FMU of {built.stepper.name} has other bits than the C after "
                                 f"{_STEPS} steps: {bits} instead of {expected_bits[:len(bits)]}.")
        if first_end != second_end:
            raise GyrosparkError(f"The FMU of {built.stepper.name} does not repeat {_STEPS} steps "
                                 f"from a state that was kept: {second_end} instead of "
                                 f"{first_end}.")
        return (f"FMI {self.version}.0: the bits of C after {_STEPS} steps, twice from one state "
                "that was kept")
