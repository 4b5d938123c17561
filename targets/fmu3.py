"""Target fmu3: an FMU for co-simulation, FMI 3.0."""

from __future__ import annotations

from .fmi.target import Fmu

__all__ = ["check", "compile", "files"]

_fmu = Fmu(3)
files, compile, check = _fmu.files, _fmu.compile, _fmu.check
