"""The C of a stepper, compiled here and called: the bits that checks compare with."""

from __future__ import annotations

import ctypes
import re
import tempfile
from pathlib import Path

from ..core.arguments import few
from ..core.errors import GyrosparkError
from .artefact import Built, Options, Written, parameter_fields
from .tools import require, run_tool

__all__ = ["C_FLAGS", "DifferentBitsError", "native_bits", "refuse_difference"]

#: For all C of artefacts: compilers may contract a·b + c to one rounding, each in its own places.
C_FLAGS = ("-std=c11", "-O2", "-ffp-contract=off")


class DifferentBitsError(GyrosparkError):
    """An artefact whose numbers differ from the numbers of its C."""


def native_bits(stepper: Written, options: Options, steps: int) -> str:
    """Return q and p after some steps from the start: the bytes of each number, in hexadecimal.

    Raises InputError where there is no C compiler; GyrosparkError where the C does not compile, or
    a step fails.
    """
    name = stepper.name
    command = require("cc", "Checking an artefact")
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        for file, text in stepper.sources.items():
            (folder / file).write_text(text, encoding="utf-8")
        run_tool([*command, *C_FLAGS, "-shared", "-fPIC", f"{name}.c", "-o", f"{name}.so", "-lm"],
                 folder, "Compiling the stepper")
        library = ctypes.CDLL(str(folder / f"{name}.so"))
        return _bits(library, stepper, options, steps)


def _bits(library: ctypes.CDLL, stepper: Written, options: Options, steps: int) -> str:
    """Return q and p after some steps of the compiled control profile, as hexadecimal bytes."""
    name, manifest = stepper.name, stepper.manifest
    real = ctypes.c_float if manifest.real == "float" else ctypes.c_double
    fields = parameter_fields(manifest)
    parameters = (real * len(fields))(*(options.parameters[field] for field in fields))

    class Limits(ctypes.Structure):
        """The struct of options in the header of the control profile."""
        _fields_ = (("tolerance", real), ("max_iterations", ctypes.c_int))

    size = getattr(library, f"{name}_work_size")
    size.restype = ctypes.c_size_t
    # long doubles are aligned for every type of number
    work = (ctypes.c_longdouble * (size() // ctypes.sizeof(ctypes.c_longdouble) + 1))()
    q, p = (real * len(options.q))(*options.q), (real * len(options.p))(*options.p)
    limits = Limits(0, options.max_iterations)  # tolerance 0: iterate down to round-off
    if getattr(library, f"{name}_begin")(ctypes.byref(work), ctypes.byref(parameters),
                                         ctypes.byref(limits), real(options.dt), q, p) != 0:
        raise GyrosparkError(f"The start of {name} is not usable: dt = {options.dt:.6g}, q = "
                             f"{few(options.q)}, or a parameter.")
    for step in range(steps):
        status = getattr(library, f"{name}_advance")(ctypes.byref(work), q, p)
        if status > 1:  # 1: max_iterations reached while increments shrank
            raise GyrosparkError(f"Step {step + 1} of {name} with dt = {options.dt:.6g} failed: "
                                 f"status {status}; choose a smaller dt.")
    return (bytes(q) + bytes(p)).hex()


def refuse_difference(
    artefact: str, bits: str, built: Built, steps: int, stepper: Written | None = None
) -> str:
    """Compare bits of an artefact with bits of native C; return the sentence of a check.

    ``stepper`` is one of the artefact's steppers, by default the first. Raises DifferentBitsError
    if the bits differ.
    """
    stepper = built.stepper if stepper is None else stepper
    native = native_bits(stepper, built.options, steps)
    if bits.strip() != native:
        c_text = stepper.sources[f"{stepper.name}.c"]
        # C libraries round these functions differently; a square root is exact everywhere
        names = sorted({*re.findall(r"\b(a?(?:sin|cos|tan)h?|atan2|exp|log|pow)f?\(", c_text)})
        cause = (f" It calls {few(names)} of another C library, whose last places may differ."
                 if names else "")
        raise DifferentBitsError(f"{artefact} of {stepper.name} has other bits than the C after "
                                 f"{steps} steps: {bits.strip()[:200]!r} instead of "
                                 f"{native[:200]!r}.{cause}")
    return f"{artefact}: the bits of C after {steps} steps"
