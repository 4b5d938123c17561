"""From the text of a stepper to its loaded module, through the cache."""

from __future__ import annotations

import importlib.machinery
import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

from .cache import binary_key, cache_folder, publish, workshop
from .compiler import compile_module, extension_suffix, find_compiler, module_name

__all__ = ["load_module"]


def load_module(name: str, files: dict[str, str]) -> Any:
    """Return the compiled module of a stepper; compiles only what is not in the cache.

    A cached file that does not load (a damaged disk, say) is built anew once.

    Raises
    ------
    CompilerError, CacheError
        See ``compile_module`` and ``workshop``.
    """
    compiler = find_compiler()
    key = binary_key(files, compiler)
    path = cache_folder() / f"{name}-{key}{extension_suffix()}"
    if path.is_file():
        try:
            return _import(name, path)
        except ImportError:
            path.unlink(missing_ok=True)
    with workshop() as folder:
        built = compile_module(name, files, compiler, folder)
        return _import(name, publish(built, path.name))


def _import(name: str, path: Path) -> ModuleType:
    loader = importlib.machinery.ExtensionFileLoader(module_name(name), str(path))
    spec = importlib.util.spec_from_file_location(module_name(name), path, loader=loader)
    if spec is None:
        raise ImportError(f"{path} is not an extension module.")
    module = importlib.util.module_from_spec(spec)
    loader.exec_module(module)
    return module
