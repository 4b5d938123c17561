"""The digits of each problem: ``digits.json``, made by ``benchmarks.make_digits``."""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

__all__ = ["PATH", "Truth", "truth"]

PATH = Path(__file__).resolve().parent / "digits.json"


@dataclass(frozen=True)
class Truth:
    """The exact values at the end of a problem.

    Attributes
    ----------
    values : mapping of str to str
        Name → 24 decimal digits, all of them true.
    made : str
        A description of the two methods.
    agreement : float
        The largest relative difference of a number by the two methods.
    """

    values: Mapping[str, str]
    made: str
    agreement: float

    def value(self, name: str) -> Fraction:
        """Return a number exactly as its digits say."""
        return Fraction(self.values[name])


@functools.cache
def _content() -> dict[str, Any]:
    """Return the file's content: name of a problem → the arguments of its ``Truth``."""
    content: dict[str, Any] = json.loads(PATH.read_text(encoding="utf-8"))
    return content


def truth(name: str) -> Truth:
    """Return the digits of a problem."""
    return Truth(**_content()[name])
