"""Prebuilt modules in a wheel for one platform, for machines without a C compiler.

They are compiled when such a wheel is built (RELEASE.md), for any processor of its architecture: a
compiler makes faster ones here, so they are taken only where there is none. ``modules.json`` beside
them says of each which text it was made of; another text has another digest, and finds none.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from .build_cache import digest
from .compiler import find_compiler
from .object_files import ModuleKind
from .verified_build import compile_verified

__all__ = ["prebuild", "prebuilt_module", "prebuilt_provenance"]

#: In the package as a platform's wheel installs it; nowhere else.
FOLDER = Path(__file__).resolve().parents[2] / "prebuilt"
#: cffi's modules keep to the limited API of Python: one for this version and all later ones.
_SUFFIX = ".abi3.so"


def prebuild(steppers: Mapping[str, dict[str, str]], folder: Path) -> None:
    """Compile the modules of some steppers, name → its files, for a wheel.

    Raises CompilerError: see ``compile_verified``.
    """
    compiler = replace(find_compiler(), portable=True)
    folder.mkdir(parents=True)
    modules = {}
    for name, files in steppers.items():
        # derivatives and impacts take a compiler where they run
        for module_kind in ("runs", "lanes"):
            with tempfile.TemporaryDirectory() as objects:
                module, record = compile_verified(name, files, compiler, Path(objects), module_kind)
                target = folder / f"{name}_{module_kind}{_SUFFIX}"
                shutil.move(module, target)
            modules[target.name] = {
                "source": digest(files), "part": module_kind, "sha256": _checksum(target),
                "compiler": compiler.version,
                "flags": " ".join([*compiler.flags, *record["flags"]])}
    (folder / "modules.json").write_text(json.dumps(modules, indent=1) + "\n", encoding="utf-8")


def prebuilt_module(files: dict[str, str], module_kind: ModuleKind) -> Path | None:
    """Return the path of this wheel's module of a stepper; None if it has none, or a damaged one.
    """
    for name, about in _modules().items():
        path = FOLDER / name
        # found by the text that it was made of, whatever the stepper is called
        if (about["source"], about["part"]) == (digest(files), module_kind) and path.is_file():
            return path if about["sha256"] == _checksum(path) else None
    return None


def prebuilt_provenance(files: dict[str, str]) -> dict[str, str] | None:
    """Return the compiler and flags of this wheel's module of a stepper; None if it has none."""
    for about in _modules().values():
        if about["source"] == digest(files):
            return {"compiler": about["compiler"], "flags": about["flags"]}
    return None


@cache
def _modules() -> dict[str, dict[str, Any]]:
    """Return the list of modules that this wheel was built with; empty in a source tree."""
    try:
        modules: dict[str, dict[str, Any]] = json.loads(
            (FOLDER / "modules.json").read_text(encoding="utf-8"))
    except FileNotFoundError:
        return {}
    return modules


def _checksum(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()
