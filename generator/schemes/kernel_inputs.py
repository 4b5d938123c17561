"""Symbols of the inputs of kernels."""

from __future__ import annotations

import sympy as sp

from ..systems.system import System

__all__ = ["time_input"]


def time_input(system: System) -> dict[str, list[sp.Symbol]]:
    """Return the input of what may depend on time: an autonomous system ignores it.

    So does one with time in H or g, whose kernels find it among the constants.
    """
    driven = system.time is not None and system.is_driven and not system.is_timed
    return {"t": [system.time if driven else sp.Symbol("_time", real=True)]}
