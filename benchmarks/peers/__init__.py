"""Programs to compare with, one file each: settings, and a run for each setting.

A file of ``PEERS`` has ``entries()``, runs of the fast top. Nothing is imported or compiled until
an entry is prepared; a missing package becomes a row with a note.

Left out because they do not install from PyPI without a Fortran compiler and CMake: numbalsoda.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable

from .entry import PeerEntry

__all__ = ["PEERS", "PROGRAMS", "entries"]

#: Programs with a run of the fast top → their file.
PEERS = {
    "gyrospark": "ours",
    "casadi": "casadi_spark",
    "heyoka": "heyoka_taylor",
    "scipy": "scipy_dop853",
    "pydykit": "pydykit_body",
    "mujoco": "mujoco_rk4",
    "exudyn": "exudyn_body",
}
#: All programs, by their names for pip.
PROGRAMS = (*PEERS, "pydy", "diffrax", "pin", "pyelastica")


def entries(programs: Iterable[str]) -> list[PeerEntry]:
    """Return the entries of these programs."""
    return [entry for name in programs if name in PEERS
            for entry in importlib.import_module(f".{PEERS[name]}", __name__).entries()]
