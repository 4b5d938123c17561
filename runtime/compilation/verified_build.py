"""Compile a stepper and compare its kernels with their statements, with safer flags if they differ.
"""

from __future__ import annotations

import importlib.machinery
import importlib.util
import shlex
import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...core.errors import CompilerError
from ...core.manifest import Manifest
from ...core.real_types import REALS
from ...core.warnings import warn
from .call_stack import frames_of
from .compiler import Compiler, compile_module, module_name
from .kernel_check import KernelMismatch, differences
from .newton_library import open_library
from .object_files import ModuleKind

__all__ = ["compile_verified", "import_module", "load_built"]

#: Flags behind all others, in turn, until compiled kernels agree with their statements.
SAFER_FLAGS: tuple[tuple[str, ...], ...] = (
    (), ("-fno-tree-vectorize", "-fno-tree-slp-vectorize", "-Wno-error"), ("-O1", "-Wno-error"),
    ("-O0", "-Wno-error"))  # each level of optimisation has warnings of its own
#: Held while sys.modules has a module under the name of its stepper.
_IMPORTS = threading.Lock()


def compile_verified(
    name: str, files: dict[str, str], compiler: Compiler, folder: Path, module_kind: ModuleKind
) -> tuple[Path, dict[str, Any]]:
    """Compile a module whose kernels agree with their statements.

    If they differ, the compiler erred: the module is compiled again with flags that make it
    optimise less, until they agree.

    Returns
    -------
    Path, dict
        The module, and what is recorded beside it: further flags; kernel → outputs compared; bytes
        of stack; kernels that were not checked, or not all outputs of which were → why.

    Raises
    ------
    CompilerError
        If kernels differ whatever the flags, naming them.
    """
    manifest = Manifest.from_text(files[f"{name}.json"])
    real = REALS[manifest.real]
    # names of kernels; a module of lanes has some of them, other modules have none to check
    expected = set(manifest.operations) if module_kind == "runs" else set()
    usual_mismatches: list[KernelMismatch] = []  # of the usual flags, for messages
    for number, flags in enumerate(SAFER_FLAGS):
        # a folder for each attempt: the module of the last one is loaded, its file must not change
        build_folder = folder / str(number)
        build_folder.mkdir()
        file, checks = compile_module(name, files, compiler, build_folder, module_kind, flags)
        # the module is loaded from its build folder, before it is published
        mismatches, compared, unchecked = differences(
            load_built(name, file, compiler, module_kind), checks, real)
        if not mismatches:
            if usual_mismatches:
                warn(f"The compiler {shlex.join(compiler.command)!r} made wrong code of {name}: "
                     f"{_summary(usual_mismatches)}. It was compiled again with {' '.join(flags)}, "
                     "and agrees. Another version of the compiler may need no such flags.")
            # a kernel may be in the text on lanes alone, with "lanes_" before its name
            listed = {*compared, *unchecked}
            absent = sorted(expected - listed - {k.removeprefix("lanes_") for k in listed})
            unchecked |= dict.fromkeys(absent, "it is not in the text as a kernel")
            _warn_of_unchecked(name, unchecked)
            return file, {"flags": list(flags), "kernels": compared,
                           "frames": frames_of(build_folder), "left_out": unchecked}
        usual_mismatches = usual_mismatches or mismatches
    raise CompilerError(
        f"The compiler {shlex.join(compiler.command)!r} makes wrong code of {name} with "
        f"{' '.join(SAFER_FLAGS[-1])} too: {_summary(usual_mismatches)}. Set CC to another "
        "compiler, or to another version of this one.", command=list(compiler.command))


def _warn_of_unchecked(name: str, unchecked: Mapping[str, str]) -> None:
    """Warn of kernels that were not checked in full, kernel → reason, if there are any."""
    if unchecked:
        reasons = "; ".join(f"{kernel} ({why})" for kernel, why in unchecked.items())
        warn(f"After its compilation {name} was not checked in full, so that an error of the "
             f"compiler in these kernels would stay: {reasons}.")


def _summary(mismatches: list[KernelMismatch]) -> str:
    """Return the first three mismatches and the number of the others, for a message."""
    suffix = f" and {len(mismatches) - 3} more kernels" if len(mismatches) > 3 else ""
    return "; ".join(map(str, mismatches[:3])) + suffix


def load_built(name: str, path: Path, compiler: Compiler, module_kind: ModuleKind) -> Any:
    """Return a module that was just compiled; raise ``CompilerError`` if it does not load."""
    try:
        return import_module(name, path, module_kind)
    except ImportError as error:
        raise CompilerError(
            f"The C compiler made a module that does not load: {error}. It may be one for another "
            "machine or Python; set CC to a compiler for this one.", command=list(compiler.command)
        ) from error


def import_module(name: str, path: Path, module_kind: ModuleKind = "runs") -> Any:
    """Return the extension module of a stepper in a file, or the library of Newton's method."""
    if module_kind == "newton":
        return open_library(name, path, f"{name}_object1_evaluate_numbers")
    loader = importlib.machinery.ExtensionFileLoader(module_name(name), str(path))
    spec = importlib.util.spec_from_file_location(module_name(name), path, loader=loader)
    if spec is None:
        raise ImportError(f"{path} is not an extension module.")
    # CPython loads a file again into the object that sys.modules has under its name: into another
    # kind of module, or that of another system, whose functions it would replace.
    with _IMPORTS:
        sys.modules.pop(spec.name, None)
        module = importlib.util.module_from_spec(spec)
        loader.exec_module(module)
        sys.modules.pop(spec.name, None)
    return module
