"""An entry: a program with one setting."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ..tops import TopState

__all__ = ["PeerEntry", "Run"]

#: Integrates the first top from t = 0 to a time and returns its state there.
Run = Callable[[float], TopState]


@dataclass(frozen=True)
class PeerEntry:
    """A program with one setting.

    Attributes
    ----------
    program, setting
        Its names in the table.
    prepare
        Imports, compiles and returns the timed run; raises ``Unavailable``.
    dt
        Time step, None where it is adaptive.
    quick
        Whether it belongs to a quick run.
    """

    program: str
    setting: str
    prepare: Callable[[], Run]
    dt: float | None = None
    quick: bool = False

    @property
    def name(self) -> str:
        """Program and setting."""
        return f"{self.program} {self.setting}"
