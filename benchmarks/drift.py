"""Energy and position over a long time: what stays bounded and what grows.

Each entry runs afresh to times evenly spread in the logarithm; the position is compared where the
reference knows it (1, 10, 100 and 1000 s).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from .contest import Limits, judged
from .peers.entry import PeerEntry

__all__ = ["DriftRun", "Point", "drift_times", "follow"]

#: Times of a decade, in seconds; every time step of the entries divides them.
_DECADE = (1, 2, 5)


@dataclass(frozen=True)
class Point:
    """Errors at one time; ``error`` is None where there is no reference."""

    t: float
    error: float | None
    energy_error: float
    norm_error: float


@dataclass(frozen=True)
class DriftRun:
    """The points of one entry, and why there are no more."""

    peer: str
    version: str
    setting: str
    points: tuple[Point, ...]
    note: str = ""
    failed: bool = False

    @property
    def name(self) -> str:
        """Peer and setting."""
        return f"{self.peer} {self.setting}"

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON holds of it."""
        return asdict(self)


def drift_times(t_end: float) -> list[float]:
    """Return 1, 2, 5, 10, ... up to t_end seconds, t_end included."""
    times = [float(m * 10**k) for k in range(6) for m in _DECADE]
    return [*(t for t in times if t < t_end), float(t_end)]


def follow(
    entries: Sequence[PeerEntry], limits: Limits, watch: Callable[[str], None] = lambda name: None
) -> list[DriftRun]:
    """Return the course of each entry up to ``limits.t_end``."""
    courses = []
    for entry in entries:
        watch(entry.name)
        courses.append(_course(entry, limits))
    return courses


def _course(entry: PeerEntry, limits: Limits) -> DriftRun:
    points: list[Point] = []
    prepared: list[Any] = []

    def once() -> Any:
        if not prepared:
            prepared.append(entry.prepare())
        return prepared[0]

    kept = replace(entry, prepare=once)
    course = DriftRun(entry.peer, entry.version, entry.setting, ())
    for t in drift_times(limits.t_end):
        row, run = judged(kept, replace(limits, t_end=t))
        if run is None:
            return replace(course, points=tuple(points), note=row.note, failed=row.failed)
        points.append(Point(t, row.error, row.energy_error or 0.0, row.norm_error or 0.0))
    return replace(course, points=tuple(points))
