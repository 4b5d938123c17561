"""One beam of a trajectory: its centre line, curvature, and the force and moment in its sections.

Between the sections before and after, with w + u = q̄_a q_b in section axes, h the length of a
segment and f = 2, 4 at a clamp (see ``generator.multibody.beam``):

    curvature  κ = (f/h) u
    moment     M = R_a (w m + u × m),  m = B (κ − κ° + τ κ̇),  B = (EI₁, EI₂, GJ)
    force      n = λ of the ball joint, or ½ Σ R C Γ of both sides with Γ = Rᵀ(P_b − P_a)/h,
               to which damping adds τ C Γ̇

M and n act on the part before, their opposites on the part after: a tension is positive.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ...core.arguments import choose
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.html import card, table
from ...core.manifest import SectionManifest
from ..compilation.body_columns import JointAt, numbers
from ..rigid_body.quaternion import left_matrix
from .body_motion import turned
from .joint_motion import multipliers_at_states, quaternion_product

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["BeamMotion"]

AxesName = Literal["space", "section"]


@explain_arguments
class BeamMotion:
    """One beam of a trajectory; made by ``Trajectory.beam``.

    A beam of N segments has its sections between neighbouring segments, and at its clamps: K of
    them. Every array has a row for each stored state, N+1 of them; units are those of SI.

    Attributes
    ----------
    name : str
        The beam's.
    segments : tuple of str
        The names of its segments, which ``Trajectory.body`` takes.
    arc : ndarray, shape (K,)
        Distances of the sections from the start along the beam without load, in m.
    """

    def __init__(self, trajectory: Trajectory, name: str, sections: list[JointAt]) -> None:
        self.name, self._run, self._sections = name, trajectory, sections
        self._inner = [joint for joint in sections if not _section_of(joint).holder]
        self.segments = (*(joint.a for joint in self._inner), self._inner[-1].b)
        self.arc = np.array([_section_of(joint).arc for joint in sections])

    def __repr__(self) -> str:
        return (f"<BeamMotion of {self.name} in {self._run.manifest.name}: {len(self.segments)} "
                f"segments, {len(self._run):,} states>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the segments and the states."""
        return card(f"Beam {self.name} of {self._run.manifest.name}", table([
            ("segments", str(len(self.segments))), *self._run._extent()]))

    def line(self) -> Array:
        """Return the centre line: ends of segments in space, shape (N+1, segments + 1, 3), in m.

        The ends between two segments of a beam that stretches are the means of both.
        """
        # the points of a and of b in turn, joint by joint
        joint_points = np.stack([point for joint in self._inner for point in self._points(joint)],
                                axis=-2)
        first_joint, last_joint = self._inner[0], self._inner[-1]
        start = self._run.body(first_joint.a).position(-self._numbers(first_joint.on_a))
        end = self._run.body(last_joint.b).position(-self._numbers(last_joint.on_b))
        inner_ends = (joint_points[..., ::2, :] + joint_points[..., 1::2, :]) / 2
        line: Array = np.concatenate([start[..., None, :], inner_ends, end[..., None, :]], axis=-2)
        return line

    def directors(self) -> Array:
        """Return the axes of the segments in space, shape (N+1, segments, 3, 3).

        Columns are the two axes of the section and the tangent.
        """
        return np.stack([self._run.body(name).rotation_matrix() for name in self.segments], axis=-3)

    def curvature(self) -> Array:
        """Return κ = (f/h) u, shape (N+1, K, 3), in 1/m, about the axes of the section.

        The third component is the torsion, and |κ| = (f/h) sin(θ/2) at the angle θ.
        """
        return np.stack([_section_of(joint).ratio / self._number(_section_of(joint).spacing)
                         * self._strain(joint)[1]
                         for joint in self._sections], axis=-2)

    def force(self, frame: AxesName = "space") -> Array:
        """Return the force n of the part after on the part before, shape (N+1, K, 3), in N.

        In the axes of the section with ``frame="section"``, the third of which is the tangent. Of a
        beam that keeps its length it is the multipliers' at the states, as ``JointMotion.force``.

        Raises
        ------
        InputError
            For another frame.
        """
        multipliers = multipliers_at_states(self._run).astype(float) if any(
            joint.constraints for joint in self._sections) else np.zeros(0)
        return self._in(frame, [np.add(*self._strained(joint)) if _section_of(joint).extension else
                                self._reaction(joint, multipliers) for joint in self._sections])

    def tension(self) -> Array:
        """Return n along the tangent of the section, shape (N+1, K), in N."""
        tension: Array = self.force("section")[..., 2]
        return tension

    def moment(self, frame: AxesName = "space") -> Array:
        """Return the moment M of the part after on the part before, shape (N+1, K, 3), in N m.

        It is about the point of the centre line, and balances loads without an error of the
        segments' length.
        Takes the same argument and raises the same error as ``force``.
        """
        return self._in(frame, [self._moment(joint) for joint in self._sections])

    # ------------------------------------------------------------ inside

    def _sides(self, joint: JointAt) -> list[tuple[str, Array]]:
        """Return (body, attitude of the section in its axes) before the section, and after it.

        At a clamp one of them is the body that holds the beam; at the start it comes first.
        """
        section, still = _section_of(joint), np.array([1.0, 0.0, 0.0, 0.0])
        sides = [(joint.a, still), (joint.b, still)]
        if section.holder:
            holder = 0 if section.holder == "a" else 1
            sides[holder] = (sides[holder][0], self._numbers(section.turn))
            if (holder == 0) == bool(section.arc):
                sides.reverse()
        return sides

    def _attitudes(self, joint: JointAt) -> list[Array]:
        """Return the attitudes of the section before and after in space, shape (N+1, 4) each."""
        return [quaternion_product(self._run.body(name).attitude.astype(float) if name else
                       np.broadcast_to([1.0, 0, 0, 0], (*self._run.q.shape[:-1], 4)), turn)
                for name, turn in self._sides(joint)]

    def _strain(self, joint: JointAt) -> tuple[Array, Array]:
        """Return w and u of w + u = q̄_a q_b in section axes, shapes (N+1, 1) and (N+1, 3)."""
        q_a, q_b = self._attitudes(joint)
        w = (q_a * q_b).sum(axis=-1, keepdims=True)
        return w, np.einsum("...ij,...j->...i", left_matrix(q_a), q_b)

    def _moment(self, joint: JointAt) -> Array:
        """Return the moment of a section in space, shape (rows, 3), in N m.

        R_a (w m + u × m) with m = B (f/h) (u − u° + τ u̇), where u̇ = ½ (w (Ω_b − Ω_a) + u × (Ω_a +
        Ω_b)) with the angular velocities in the axes of their own sides. Of a joint that stretches,
        half of the moment of its two forces about each other's points is added.
        """
        section = _section_of(joint)
        ratio = section.ratio / self._number(section.spacing)
        (w, u), (q_a, q_b) = self._strain(joint), self._attitudes(joint)
        strain = u - self._numbers(section.rest)
        tau = self._number(section.damping)
        if tau:
            spins = [turned(_conjugate(q), self._spin(name)) for q, (name, _) in
                     zip((q_a, q_b), self._sides(joint), strict=True)]
            strain = strain + tau / 2 * (w * (spins[1] - spins[0]) + np.cross(u, sum(spins)))
        m = ratio * self._numbers(section.stiffness) * strain
        moment = turned(q_a, w * m + np.cross(u, m))
        if section.extension:  # the term with the axes of a acts on a at P_b, that of b at P_a
            points, terms = self._points(joint), self._strained(joint)
            moment = moment + np.cross(points[1] - points[0], terms[0] - terms[1]) / 2
        return moment

    def _strained(self, joint: JointAt) -> list[Array]:
        """Return n of a joint that stretches, as two terms, with the axes of a and those of b.

        Each is ½ R C (Γ + τ Γ̇) with Γ = Rᵀ d/h, d = P_b − P_a: along the body's axis with the
        stiffness ``along``, across it with ``across``; R Γ̇ = (ḋ − ω × d)/h.
        """
        across, along, length = self._numbers(_section_of(joint).extension)
        tau, points = self._number(_section_of(joint).damping), self._points(joint)
        d = points[1] - points[0]
        bodies = [self._run.body(name) for name in (joint.a, joint.b)]
        speed = np.subtract(*(body.velocity(self._numbers(r)) for body, r in
                              zip(bodies[::-1], (joint.on_b, joint.on_a), strict=True)))
        terms = []
        for body in bodies:
            rate = d + tau * (speed - np.cross(body.angular_velocity("space"), d)) if tau else d
            t = body.axis()
            terms.append((across * rate + (along - across) * (rate * t).sum(
                axis=-1, keepdims=True) * t) / (2 * length))
        return terms

    def _reaction(self, joint: JointAt, multipliers: Array) -> Array:
        """Return n of a joint with constraints: the opposite of the force on the part after."""
        sign = -1.0 if self._sides(joint)[1][0] == joint.b else 1.0
        force = np.zeros((*multipliers.shape[:-1], 3))
        for pull in joint.pulls or ():
            force = force + multipliers[..., pull.index, None] * self._numbers(pull.on_a)
        return sign * force

    def _in(self, frame: str, vectors: list[Array]) -> Array:
        """Return vectors in space in the axes of ``frame``; the section's halve the angle."""
        choose("frame", frame, ["space", "section"])
        if frame == "section":
            for k, joint in enumerate(self._sections):
                q_a, q_b = self._attitudes(joint)
                # q and −q are one attitude: the nearer one makes the mean of the shorter way
                q = q_a + np.sign((q_a * q_b).sum(axis=-1, keepdims=True)) * q_b
                q = q / np.linalg.norm(q, axis=-1, keepdims=True)
                vectors[k] = turned(_conjugate(q), vectors[k])
        return np.stack(vectors, axis=-2)

    def _points(self, joint: JointAt) -> tuple[Array, Array]:
        """Return the joint's points on a and on b in space, shape (N+1, 3) each."""
        return (self._run.body(joint.a).position(self._numbers(joint.on_a)),
                self._run.body(joint.b).position(self._numbers(joint.on_b)))

    def _spin(self, name: str) -> Array:
        return self._run.body(name).angular_velocity("space") if name else np.zeros(
            (*self._run.q.shape[:-1], 3))

    def _numbers(self, entries: Any) -> Array:
        return numbers(entries, self._run.parameters)

    def _number(self, entry: Any) -> float:
        return float(self._numbers([entry])[0])


def _section_of(joint: JointAt) -> SectionManifest:
    """Return the section of a beam that a joint is."""
    assert joint.section is not None
    return joint.section


def _conjugate(q: Array) -> Array:
    """Return the conjugate quaternions."""
    opposite: Array = q * np.array([1.0, -1.0, -1.0, -1.0])
    return opposite
