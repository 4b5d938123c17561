"""Strict JSON text: numbers that JSON does not have become null."""

from __future__ import annotations

import json
import math
from operator import methodcaller
from typing import Any

import numpy as np

__all__ = ["json_text"]


def json_text(document: Any, *, indent: int = 2, ensure_ascii: bool = True) -> str:
    """Return a document as JSON, with null for infinite numbers and NaN.

    Numbers and booleans of NumPy become Python's, longer types than double rounded.
    """
    return json.dumps(_finite(document), indent=indent, ensure_ascii=ensure_ascii, allow_nan=False,
                      default=methodcaller("item"))


def _finite(value: Any) -> Any:
    """Return a value of a document with None in place of infinite numbers and NaN."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    if isinstance(value, float | np.floating):  # a subclass of float may have another text
        return float(value) if math.isfinite(value) else None
    return value
