"""The programs that are compared, one file each: its settings, and how to run each of them.

A file has ``PACKAGE`` (what pip calls it) and ``entries()``. Nothing is imported or compiled until
an entry is prepared; a package that is missing becomes a row that says so.

Left out because they do not install from PyPI without a Fortran compiler and CMake: numbalsoda.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable

from gyrospark.core.errors import InputError

from .entry import PeerEntry

__all__ = ["OF_OTHERS", "PEERS", "chosen", "entries"]

#: Name on the command line → its file.
PEERS = {
    "gyrospark": "ours",
    "casadi": "casadi_spark",
    "heyoka": "heyoka_taylor",
    "scipy": "scipy_dop853",
    "pydykit": "pydykit_body",
    "mujoco": "mujoco_rk4",
    "exudyn": "exudyn_body",
}
#: Those that have no run of the fast top, but one of bodies on joints or a gradient.
OF_OTHERS = ("pydy", "diffrax")


def chosen(text: str | None) -> list[str]:
    """Return the peers a comma-separated list names, all without one.

    Raises
    ------
    InputError
        For a name that is none of them.
    """
    known = [*PEERS, *OF_OTHERS]
    if text is None:
        return known
    names = [name.strip() for name in text.split(",")]
    for name in names:
        if name not in known:
            raise InputError(f"Unknown peer {name!r}; choose {', '.join(known)}.")
    return list(dict.fromkeys(names))


def entries(names: Iterable[str], *, quick: bool = False) -> list[PeerEntry]:
    """Return the entries of these peers; with ``quick`` only one or two of each."""
    found = []
    for name in (name for name in names if name in PEERS):
        made: list[PeerEntry] = importlib.import_module(f".{PEERS[name]}", __name__).entries()
        found += [entry for entry in made if entry.quick or not quick]
    return found
