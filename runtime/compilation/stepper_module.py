"""From the text of a stepper to its loaded module, through the cache."""

from __future__ import annotations

import contextlib
import hashlib
import json
from functools import partial
from pathlib import Path
from typing import Any

from ...core.errors import CompilerError
from ...core.progress import log_task
from .build_cache import (
    binary_key,
    build_folder,
    cache_folder,
    cpu_description,
    digest,
    is_trusted,
    publish,
)
from .compiler import Compiler, extension_suffix, find_compiler, is_whole
from .newton_library import connect
from .object_files import ModuleKind
from .prebuilt import prebuilt_module, prebuilt_provenance
from .verified_build import compile_verified, import_module, load_built

__all__ = ["load_module", "provenance"]

def load_module(name: str, files: dict[str, str], module_kind: ModuleKind = "runs") -> Any:
    """Return one of the compiled modules of a stepper: from the cache, or compiled into it.

    Without a compiler it is a module of a platform's wheel, if there is one.

    A cached file that is not as it was written (a damaged disk, say), or that another user could
    have written, is compiled anew; loading it could end the process, so its checksum, recorded
    beside it, is compared first. A module is cached when its kernels agree with their statements
    (``kernel_check``). Raises CompilerError or CacheError: see ``compile_module`` and
    ``build_folder``.
    """
    try:
        compiler = find_compiler()
    except CompilerError:
        if path := prebuilt_module(files, module_kind):
            return import_module(name, path)
        raise
    # at -O0 one module has all functions
    in_runs = module_kind == "lanes" and is_whole()
    module = _load_compiled(name, files, compiler, "runs" if in_runs else module_kind)
    return module if module_kind == "newton" else connect(
        module, name, partial(load_module, name, files, "newton"))


def _load_compiled(
    name: str, files: dict[str, str], compiler: Compiler, module_kind: ModuleKind
) -> Any:
    """Return a module from the cache, or compile, check and publish it there.

    A record is published beside it: its checksum, further flags, compared kernels, bytes of stack.
    """
    path = _path_of(name, files, compiler, module_kind)
    if record := _record(path):
        with contextlib.suppress(ImportError):  # another system's library is gone, say
            return _with_frames(import_module(name, path, module_kind), record)
    label = name + {"runs": "", "lanes": " for ensembles", "newton": ": Newton's method",
                    "derivatives": ": derivatives",
                    "second": ": second derivatives", "motion": ": accelerations",
                    "impacts": ": impacts", "jumps": ": derivatives of impacts"}[module_kind]
    with log_task(f"compiling {label}", f"compiled {label}"), build_folder() as folder:
        file, record = compile_verified(name, files, compiler, folder, module_kind)
        record_file = folder / "record.json"
        record_file.write_text(json.dumps({"sha256": _checksum(file), **record}), encoding="utf-8")
        # the module first: one whose record is missing, after a crash say, is compiled again
        path = publish(file, path.name)  # elsewhere, if the folder cannot be used
        publish(record_file, _record_of(path).name)
    return _with_frames(load_built(name, path, compiler, module_kind), record)


def _with_frames(module: Any, record: dict[str, Any]) -> Any:
    """Return the module with ``frames``, the bytes of stack of its calls, or None if unknown."""
    module.frames = record.get("frames")
    return module


def provenance(files: dict[str, str]) -> dict[str, str]:
    """Return all on which the bits depend that a stepper computes, each by its name."""
    try:
        compiler = find_compiler()
        flags = [*compiler.flags, *_further_flags(files, compiler)]
        record = {"compiler": compiler.version, "flags": " ".join(flags)}
    except CompilerError:
        if not (record := prebuilt_provenance(files) or {}):
            raise
    return {
        "source": digest(files),
        **record,
        "cpu": digest(cpu_description()),  # -march=native: another CPU, other instructions
    }


def _further_flags(files: dict[str, str], compiler: Compiler) -> list[str]:
    """Return flags with which the cached module was compiled because without them it was wrong."""
    (name,) = (Path(file).stem for file in files if file.endswith(".json"))
    path = _path_of(name, files, compiler, "runs")
    try:
        return list(json.loads(_record_of(path).read_text(encoding="utf-8"))["flags"])
    except (OSError, ValueError, TypeError, KeyError):
        return []


def _path_of(name: str, files: dict[str, str], compiler: Compiler, module_kind: ModuleKind) -> Path:
    """Return the path of a module in the cache, which its text and its compiler determine."""
    key = binary_key(files, compiler, module_kind)
    return cache_folder() / f"{name}-{key}{extension_suffix()}"


def _record_of(path: Path) -> Path:
    """Return the path of the record beside a module."""
    return path.with_name(f"{path.name}.json")


def _checksum(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal digits."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _record(path: Path) -> dict[str, Any]:
    """Return the record of a module in the cache.

    It is empty unless the module has the bytes that were checked, and only this user could have
    written it.
    """
    try:
        record: dict[str, Any] = json.loads(_record_of(path).read_text(encoding="utf-8"))
        return record if is_trusted(path) and record["sha256"] == _checksum(path) else {}
    except (OSError, ValueError, TypeError, KeyError):
        return {}
