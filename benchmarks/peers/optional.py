"""Import of optional packages."""

from __future__ import annotations

import importlib
import importlib.metadata
from typing import Any

from gyrospark import GyrosparkError

__all__ = ["Unavailable", "need", "version"]


class Unavailable(GyrosparkError):  # noqa: N818 (it is a row of the table, no failure)
    """An entry cannot run here; the table shows the message."""


def need(module: str, package: str | None = None) -> Any:
    """Return an optional module.

    Raises
    ------
    Unavailable
        If it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise Unavailable(f"not installed (pip install {package or module})") from error


def version(package: str) -> str:
    """Return the version of an installed package, "" of one that is missing."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""
