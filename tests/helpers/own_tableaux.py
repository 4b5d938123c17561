"""Tableau files computed from nodes."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from typing import Any

import sympy as sp

import gyrospark as gs
from gyrospark.generator.tableaux.tableau import FIELDS

FOLDER = Path(gs.__file__).parent / "examples" / "tableaux"


@cache
def make() -> Any:
    """Return the script that derives the examples, as a module."""
    spec = importlib.util.spec_from_file_location("make_tableaux", FOLDER / "make.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def in_decimals(table: dict[str, Any], digits: int) -> dict[str, Any]:
    """Return a table with its entries as decimals."""

    def text(e: Any) -> Any:
        return [text(x) for x in e] if isinstance(e, (list, tuple)) else str(
            sp.N(e, digits + 10).round(digits))

    return {key: text(value) if key in FIELDS else value for key, value in table.items()}
