"""Target fmu2: an FMU for co-simulation, FMI 2.0."""

from __future__ import annotations

from .fmi.target import Fmu

__all__ = ["check", "compile", "files"]

_fmu = Fmu(2)
files, compile, check = _fmu.files, _fmu.compile, _fmu.check
