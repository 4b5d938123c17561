"""An entry: a program with one setting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..tops import TopState

__all__ = ["PeerEntry", "Run"]

#: Integrates the first top from t = 0 to the given time and returns where it is.
Run = Callable[[float], TopState]


@dataclass(frozen=True)
class PeerEntry:
    """A program with one setting.

    Attributes
    ----------
    peer, version, setting
        What the table says of it.
    prepare
        Imports, compiles and returns what is timed; raises ``Unavailable``.
    dt
        Time step, None where it is adaptive.
    quick
        Whether it belongs to a quick run.
    """

    peer: str
    version: str
    setting: str
    prepare: Callable[[], Run]
    dt: float | None = None
    quick: bool = False

    @property
    def name(self) -> str:
        """Peer and setting."""
        return f"{self.peer} {self.setting}"
