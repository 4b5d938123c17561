"""Target fmu2: an FMU for co-simulation, FMI 2.0."""

from __future__ import annotations

from .artefact import Option
from .fmi.target import Fmu

__all__ = ["OPTIONS", "check", "compile", "files"]

#: It has none of its own.
OPTIONS: tuple[Option, ...] = ()

_fmu = Fmu(2)
files, compile, check = _fmu.files, _fmu.compile, _fmu.check
