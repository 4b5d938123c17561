"""Back from a co-moving frame: the kernels that turn states and multipliers, and their angles.

    q = e^{ωtA} q̃,   p = e^{−ωtAᵀ} p̃,   λ = C(ωt)⁻ᵀ λ̃

Each angle is a ω t, with A³ = −a² A; one cosine and one sine turn all blocks of coordinates of one
a. Three rotations of space turn as one, about the axis ω/|ω|.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import sympy as sp

from ..kernels.statements import Kernel
from ..symmetry.frame_symmetries import CoMovingFrame, FrameSymmetry
from ..symmetry.rotations import Rotation, turned
from ..systems.elimination_order import connected
from ..systems.system import System
from .system_differences import vector

__all__ = ["FrameRotation"]


@dataclass(frozen=True)
class FrameRotation:
    """How a frame is turned back.

    Parameters
    ----------
    frame : Frame
    system : System
    """

    frame: CoMovingFrame
    system: System

    @property
    def angles(self) -> list[tuple[int, Fraction]]:
        """Each angle, by its group and its a."""
        return [(g, a) for g, group in enumerate(self.frame.groups) for a in _rates_of(group)]

    @property
    def axes(self) -> list[int | None]:
        """Where each group has its axis among all components of axes; None if it needs none."""
        places, count = list[int | None](), 0
        for group in self.frame.groups:
            places.append(count if len(group) > 1 else None)
            count += len(group) if len(group) > 1 else 0
        return places

    @property
    def components(self) -> int:
        """Components of all axes."""
        return sum(len(group) for group in self.frame.groups if len(group) > 1)

    @property
    def sets(self) -> list[int]:
        """The first of the coordinates that each coordinate turns into, by whatever symmetry."""
        first = list(range(self.system.n))
        for part in connected([frozenset(place) for symmetry in self.frame.symmetries
                               for place in symmetry.field.weights]):
            for a in part:
                first[a] = min(part)
        return first

    @property
    def turns_multipliers(self) -> bool:
        """Whether g turns, and multipliers with it."""
        return any(symmetry.turns for symmetry in self.frame.symmetries)

    def kernels(self) -> list[Kernel]:
        """Return the kernels of coordinates, momenta and, where g turns, multipliers."""
        n, m, groups = self.system.n, self.system.m, self.frame.groups
        made = [
            self._kernel("rotate_coordinates", "e^(omega t A) q", n,
                         [[s.rotation for s in group] for group in groups]),
            self._kernel("rotate_momenta", "e^(-omega t A^T) p", n,
                         [[s.rotation.dual for s in group] for group in groups]),
        ]
        if self.turns_multipliers:
            made.append(self._kernel(
                "rotate_multipliers", "C^(-T) lambda, where g(e^(theta A) q) = C g(q)", m,
                [[s.turns or Rotation({}) for s in group] for group in groups]))
        return made

    def _kernel(
        self, name: str, doc: str, count: int, rotations: list[list[Rotation]]
    ) -> Kernel:
        angles, x = self.angles, vector("x", count)
        cosines, sines = vector("cosine", len(angles)), vector("sine", len(angles))
        axis, y = vector("axis", max(self.components, 1)), list[sp.Expr](x)
        for g, (parts, place) in enumerate(zip(rotations, self.axes, strict=True)):
            about = [sp.Integer(1)] if place is None else axis[place : place + len(parts)]
            own = {a: k for k, (group, a) in enumerate(angles) if group == g}
            y = turned(y, parts, about, {a: cosines[k] for a, k in own.items()},
                       {a: sines[k] for a, k in own.items()})
        return Kernel(name, doc, {"cosine": cosines, "sine": sines, "axis": axis, "x": x},
                      {"y": y})


def _rates_of(group: tuple[FrameSymmetry, ...]) -> list[Fraction]:
    """Return every a of a group, of coordinates and of constraints."""
    return sorted({a for symmetry in group for rotation in (symmetry.rotation, symmetry.turns)
                   if rotation is not None for a in rotation.blocks})
