"""From the text of a stepper to its loaded module, through the cache."""

from __future__ import annotations

import contextlib
import hashlib
import importlib.machinery
import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

from ...errors import CompilerError
from ..notices import doing
from .cache import (
    binary_key,
    cache_folder,
    cpu_description,
    digest,
    publish,
    workshop,
)
from .compiler import compile_module, extension_suffix, find_compiler, module_name
from .objects import Part
from .prebuilt import prebuilt_module, prebuilt_provenance

__all__ = ["load_module", "provenance"]


def load_module(name: str, files: dict[str, str], part: Part = "runs") -> Any:
    """Return the compiled module of a stepper, or that of its lanes, which is compiled apart.

    Compiles only what is not in the cache. Without a compiler, what a platform's wheel brought.

    A cached file that is not as it was written (a damaged disk, say) is built anew; loading it
    could end the process, so its checksum, kept beside it, is compared first.

    Raises
    ------
    CompilerError, CacheError
        See ``compile_module`` and ``workshop``.
    """
    try:
        compiler = find_compiler()
    except CompilerError:
        if path := prebuilt_module(files, part):
            return _import(name, path)
        raise
    key = binary_key(files, compiler, part)
    path = cache_folder() / f"{name}-{key}{extension_suffix()}"
    if _is_whole(path):
        with contextlib.suppress(ImportError):  # another system's library is gone, say
            return _import(name, path)
    what = name if part == "runs" else f"{name} for ensembles"
    with doing(f"compiling {what}", f"compiled {what}"), workshop() as folder:
        built = compile_module(name, files, compiler, folder, part)
        proof = folder / "sha256"
        proof.write_text(_checksum(built), encoding="ascii")
        path = publish(built, path.name)  # elsewhere, if the folder cannot be used
        publish(proof, _proof_of(path).name)
    try:
        return _import(name, path)
    except ImportError as error:
        raise CompilerError(
            f"The C compiler made a module that does not load: {error}. It may be one for another "
            "machine or Python; set CC to a compiler for this one.", command=list(compiler.command)
        ) from error


def provenance(files: dict[str, str]) -> dict[str, str]:
    """Return all on which the bits depend that a stepper computes, each by its name."""
    try:
        compiler = find_compiler()
        made = {"compiler": compiler.version, "flags": " ".join(compiler.flags)}
    except CompilerError:
        if not (made := prebuilt_provenance(files) or {}):
            raise
    return {
        "source": digest(files),
        **made,
        "cpu": digest(cpu_description()),  # -march=native: another CPU, other instructions
    }


def _proof_of(path: Path) -> Path:
    return path.with_name(f"{path.name}.sha256")


def _checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _is_whole(path: Path) -> bool:
    """Whether a module is in the cache, byte for byte as it was published."""
    try:
        return _proof_of(path).read_text(encoding="ascii") == _checksum(path)
    except (OSError, ValueError):
        return False


def _import(name: str, path: Path) -> ModuleType:
    loader = importlib.machinery.ExtensionFileLoader(module_name(name), str(path))
    spec = importlib.util.spec_from_file_location(module_name(name), path, loader=loader)
    if spec is None:
        raise ImportError(f"{path} is not an extension module.")
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module
