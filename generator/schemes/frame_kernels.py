"""Transformation of states and multipliers from a co-moving frame: its kernels and angles.

    q = e^{ωtA} q̃,   p = e^{−ωtAᵀ} p̃,   λ = C(ωt)⁻ᵀ λ̃

The angles are a ω t, with A³ = −a² A; one cosine and one sine serve all blocks of coordinates with
one a. Three rotations of space are one rotation about the axis ω/|ω|.
"""

from __future__ import annotations

from fractions import Fraction

import sympy as sp

from ...core.records import dataclass
from ..kernels.statements import Kernel
from ..symmetry.frame_symmetries import CoMovingFrame, FrameSymmetry
from ..symmetry.rotations import Rotation, rotate_coordinates
from ..systems.elimination_order import connected_components
from ..systems.system import System
from .system_differences import vector

__all__ = ["FrameRotation"]


@dataclass(frozen=True)
class FrameRotation:
    """The transformation from a co-moving frame.

    Parameters
    ----------
    frame : CoMovingFrame
    system : System
        The system in the user's frame.
    """

    frame: CoMovingFrame
    system: System

    @property
    def angles(self) -> list[tuple[int, Fraction]]:
        """The angles, as pairs of the index of a group and a rate a."""
        return [(g, a) for g, group in enumerate(self.frame.groups) for a in _rates_of(group)]

    @property
    def axes(self) -> list[int | None]:
        """Index of the axis of each group among the components of all axes; None without one.

        A group of one symmetry has a fixed axis, which is no input of the kernels.
        """
        starts: list[int | None] = []
        count = 0
        for group in self.frame.groups:
            if len(group) > 1:
                starts.append(count)
                count += len(group)
            else:
                starts.append(None)
        return starts

    @property
    def components(self) -> int:
        """Number of components of all axes."""
        return sum(len(group) for group in self.frame.groups if len(group) > 1)

    @property
    def sets(self) -> list[int]:
        """For each coordinate, the first coordinate of its set; rotations mix the q of one set."""
        first = list(range(self.system.n))
        for indices in connected_components([frozenset(entry) for symmetry in self.frame.symmetries
                                             for entry in symmetry.field.weights]):
            for a in indices:
                first[a] = min(indices)
        return first

    @property
    def turns_multipliers(self) -> bool:
        """Whether a symmetry rotates g, and the multipliers with it."""
        return any(symmetry.turns for symmetry in self.frame.symmetries)

    def kernels(self) -> list[Kernel]:
        """Return the kernels of coordinates, momenta and, if g rotates, multipliers."""
        n, m, groups = self.system.n, self.system.m, self.frame.groups
        kernels = [
            self._kernel("rotate_coordinates", "e^(omega t A) q", n,
                         [[s.rotation for s in group] for group in groups]),
            self._kernel("rotate_momenta", "e^(-omega t A^T) p", n,
                         [[s.rotation.dual for s in group] for group in groups]),
        ]
        if self.turns_multipliers:
            # the identity for symmetries that leave g invariant
            kernels.append(self._kernel(
                "rotate_multipliers", "C^(-T) lambda, where g(e^(theta A) q) = C g(q)", m,
                [[s.turns or Rotation(blocks={}) for s in group] for group in groups]))
        return kernels

    def _kernel(self, name: str, doc: str, count: int, rotations: list[list[Rotation]]) -> Kernel:
        """Return the kernel y = Π_g e^{θ_g A_g} x, with angle and generator of each group g.

        Its inputs are the cosines and sines of ``angles``, the components of the axes, and x with
        ``count`` entries; ``rotations`` has the e^{θA} of each symmetry of each group.
        """
        angles, x = self.angles, vector("x", count)
        cosines, sines = vector("cosine", len(angles)), vector("sine", len(angles))
        axis = vector("axis", max(self.components, 1))  # C has no arrays of length 0
        y: list[sp.Expr] = list(x)
        for g, (group_rotations, start) in enumerate(zip(rotations, self.axes, strict=True)):
            # a group of one symmetry has no axis; the rotations of space have one, which is an
            # input of the kernel
            unit_axis = ([sp.Integer(1)] if start is None
                         else axis[start : start + len(group_rotations)])
            index_of = {a: k for k, (group, a) in enumerate(angles) if group == g}
            y = rotate_coordinates(y, group_rotations, unit_axis,
                                   {a: cosines[k] for a, k in index_of.items()},
                                   {a: sines[k] for a, k in index_of.items()})
        return Kernel(name, doc, {"cosine": cosines, "sine": sines, "axis": axis, "x": x},
                      {"y": y})


def _rates_of(group: tuple[FrameSymmetry, ...]) -> list[Fraction]:
    """Return the rates a of a group, for coordinates and for constraints, in order."""
    return sorted({a for symmetry in group for rotation in (symmetry.rotation, symmetry.turns)
                   if rotation is not None for a in rotation.blocks})
