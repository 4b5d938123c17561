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

from ...core.arguments import choose, count_text
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.html import card, table
from ...core.inertia import quaternion_product
from ...core.manifest import SectionManifest
from ...core.records import FixedAttributes
from ..compilation.body_columns import JointAt, numbers
from ..rigid_body.quaternion import left_matrix
from .body_motion import rotate
from .joint_motion import multipliers_at_states, refuse_single_state

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["BeamMotion"]

AxesName = Literal["space", "section"]


@explain_arguments
class BeamMotion(FixedAttributes):
    """One beam of a trajectory; made by ``Trajectory.beam``.

    A beam of N segments has its sections between neighbouring segments, and at its clamps: K of
    them. Every array has a row for each stored state, N+1 of them; units are SI.

    Attributes
    ----------
    name : str
        The beam's.
    segments : tuple of str
        The names of its segments, which ``Trajectory.body`` takes.
    arc : ndarray, shape (K,)
        Distances of the sections from the start along the beam without load, in m.
    """

    _CURE = "it shows what the run has"

    name: str
    segments: tuple[str, ...]
    arc: Array

    def __init__(self, trajectory: Trajectory, name: str, sections: list[JointAt]) -> None:
        self.name, self._run, self._sections = name, trajectory, sections
        # without the clamps, at which a body holds the beam
        self._inner = [joint for joint in sections if not _section_of(joint).holder]
        self.segments = (*(joint.a for joint in self._inner), self._inner[-1].b)
        self.arc = np.array([_section_of(joint).arc for joint in sections])

    def __repr__(self) -> str:
        return (f"<BeamMotion of {self.name} in {self._run.manifest.name}: "
                f"{count_text(len(self.segments), 'segment')}, "
                f"{count_text(len(self._run), 'state')}>")

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
        # the two ends of a segment are opposite points about its centre of mass
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
        curvatures = []
        for joint in self._sections:
            section, (_, u) = _section_of(joint), self._strain(joint)
            curvatures.append(section.ratio / self._number(section.spacing) * u)
        return np.stack(curvatures, axis=-2)

    def force(self, frame: AxesName = "space") -> Array:
        """Return the force n of the part after on the part before, shape (N+1, K, 3), in N.

        In the axes of the section with ``frame="section"``, the third of which is the tangent. For
        a beam that keeps its length it follows from the multipliers at the states, as
        ``JointMotion.force`` does.

        Raises
        ------
        InputError
            For another frame; for a run of one state, of a beam that keeps its length.
        """
        multipliers = np.zeros(0)
        if any(joint.constraints for joint in self._sections):
            refuse_single_state(self._run, self.name)
            multipliers = multipliers_at_states(self._run).astype(float)
        forces = []
        for joint in self._sections:
            if _section_of(joint).extension:
                term_a, term_b = self._elastic_forces(joint)
                forces.append(term_a + term_b)
            else:
                forces.append(self._reaction(joint, multipliers))
        return self._in(frame, forces)

    def tension(self) -> Array:
        """Return n along the tangent of the section, shape (N+1, K), in N."""
        tension: Array = self.force("section")[..., 2]
        return tension

    def moment(self, frame: AxesName = "space") -> Array:
        """Return the moment M of the part after on the part before, shape (N+1, K, 3), in N m.

        It is about the point of the centre line, and balances loads without an error of the
        segments' length.
        Takes the same argument as ``force`` and raises the same error for another frame.
        """
        return self._in(frame, [self._moment(joint) for joint in self._sections])

    # ------------------------------------------------------------ inside

    def _sides(self, joint: JointAt) -> list[tuple[str, Array]]:
        """Return (body, attitude of the section in its axes) before the section, and after it.

        At a clamp one of the two is the body that holds the beam: the first one at the start of the
        beam, the second one at its end.
        """
        section, unturned = _section_of(joint), np.array([1.0, 0.0, 0.0, 0.0])
        sides = [(joint.a, unturned), (joint.b, unturned)]
        if section.holder:
            holder = 0 if section.holder == "a" else 1
            sides[holder] = (sides[holder][0], self._numbers(section.turn))
            # the start of the beam has the arc length 0: there the holder is before the section
            is_at_start = not section.arc
            if (holder == 0) != is_at_start:
                sides.reverse()
        return sides

    def _attitudes(self, joint: JointAt) -> list[Array]:
        """Return the attitudes of the section before and after in space, shape (N+1, 4) each."""
        # the ground, "", is not turned
        ground = np.broadcast_to([1.0, 0, 0, 0], (*self._run.q.shape[:-1], 4))
        return [np.stack(quaternion_product(
                    (self._run.body(name).attitude.astype(float) if name else ground).T, turn),
                    axis=-1)
                for name, turn in self._sides(joint)]

    def _strain(self, joint: JointAt) -> tuple[Array, Array]:
        """Return w and u of w + u = q̄_a q_b in section axes, shapes (N+1, 1) and (N+1, 3)."""
        q_a, q_b = self._attitudes(joint)
        w = (q_a * q_b).sum(axis=-1, keepdims=True)
        return w, np.einsum("...ij,...j->...i", left_matrix(q_a), q_b)

    def _moment(self, joint: JointAt) -> Array:
        """Return the moment of a section in space, shape (rows, 3), in N m.

        R_a (w m + u × m) with m = B (f/h) (u − u° + τ u̇), B ``stiffness``, u° ``rest`` and τ
        ``damping`` of the section, where u̇ = ½ (w (Ω_b − Ω_a) + u × (Ω_a + Ω_b)) with the angular
        velocities in the axes of their own sides. Of a joint that stretches, half of the moment of
        its two forces about each other's points is added.
        """
        section = _section_of(joint)
        ratio = section.ratio / self._number(section.spacing)
        (w, u), (q_a, q_b) = self._strain(joint), self._attitudes(joint)
        strain = u - self._numbers(section.rest)
        tau = self._number(section.damping)
        if tau:
            (name_a, _), (name_b, _) = self._sides(joint)
            omega_a = rotate(_conjugate(q_a), self._spin(name_a))
            omega_b = rotate(_conjugate(q_b), self._spin(name_b))
            u_rate_doubled = w * (omega_b - omega_a) + np.cross(u, omega_a + omega_b)
            strain = strain + tau / 2 * u_rate_doubled
        m = ratio * self._numbers(section.stiffness) * strain
        moment = rotate(q_a, w * m + np.cross(u, m))
        if section.extension:  # the term with the axes of a acts on a at P_b, that of b at P_a
            (point_a, point_b), (term_a, term_b) = self._points(joint), self._elastic_forces(joint)
            moment = moment + np.cross(point_b - point_a, term_a - term_b) / 2
        return moment

    def _elastic_forces(self, joint: JointAt) -> list[Array]:
        """Return the two terms of n of a joint that stretches, by the axes of a and by those of b.

        Their shape is (N+1, 3), in N, in space axes. Each is ½ R C (Γ + τ Γ̇) with Γ = Rᵀ d/h,
        d = P_b − P_a: along the body's axis with the stiffness ``along``, across it with
        ``across``; R Γ̇ = (ḋ − ω × d)/h.
        """
        across, along, length = self._numbers(_section_of(joint).extension)
        tau, points = self._number(_section_of(joint).damping), self._points(joint)
        d = points[1] - points[0]
        a, b = self._run.body(joint.a), self._run.body(joint.b)
        # ḋ, the velocity of the point on b against that on a
        d_rate = b.velocity(self._numbers(joint.on_b)) - a.velocity(self._numbers(joint.on_a))
        terms = []
        for body in (a, b):
            # h R (Γ + τ Γ̇)
            damped = (d + tau * (d_rate - np.cross(body.angular_velocity("space"), d)) if tau
                      else d)
            tangent = body.axis()
            along_tangent = (damped * tangent).sum(axis=-1, keepdims=True) * tangent
            terms.append((across * damped + (along - across) * along_tangent) / (2 * length))
        return terms

    def _reaction(self, joint: JointAt, multipliers: Array) -> Array:
        """Return n of a joint with constraints, (rows, 3), in N: Σ λ e over its constraints.

        e is ``on_a`` of each pull. n acts on the part before, the multipliers' force on body b: the
        sign is −1 if b is the part after. ``multipliers``, (rows, m), are those at the states.
        """
        _, (body_after, _) = self._sides(joint)
        sign = -1.0 if body_after == joint.b else 1.0
        force = np.zeros((*multipliers.shape[:-1], 3))
        for pull in joint.pulls or ():
            force = force + multipliers[..., pull.index, None] * self._numbers(pull.on_a)
        return sign * force

    def _in(self, frame: str, vectors: list[Array]) -> Array:
        """Return vectors in space, one (N+1, 3) a section, in axes of ``frame``, (N+1, K, 3).

        Axes of a section are half way between those of its two sides.
        """
        choose("frame", frame, ["space", "section"])
        if frame == "section":
            for k, joint in enumerate(self._sections):
                q_a, q_b = self._attitudes(joint)
                # q and −q are one attitude: the nearer one makes the mean of the shorter way
                q = q_a + np.sign((q_a * q_b).sum(axis=-1, keepdims=True)) * q_b
                q = q / np.linalg.norm(q, axis=-1, keepdims=True)
                vectors[k] = rotate(_conjugate(q), vectors[k])
        return np.stack(vectors, axis=-2)

    def _points(self, joint: JointAt) -> tuple[Array, Array]:
        """Return the joint's points on a and on b in space, shape (N+1, 3) each."""
        return (self._run.body(joint.a).position(self._numbers(joint.on_a)),
                self._run.body(joint.b).position(self._numbers(joint.on_b)))

    def _spin(self, name: str) -> Array:
        """Return the angular velocity of a body in space, (N+1, 3), in rad/s; 0 of the ground."""
        if not name:
            return np.zeros((*self._run.q.shape[:-1], 3))
        return self._run.body(name).angular_velocity("space")

    def _numbers(self, entries: Any) -> Array:
        """Return a vector of the manifest with the run's parameters."""
        return numbers(entries, self._run.parameters)

    def _number(self, entry: Any) -> float:
        """Return an entry of the manifest with the run's parameters."""
        return float(self._numbers([entry])[0])


def _section_of(joint: JointAt) -> SectionManifest:
    """Return the section of a beam that a joint is."""
    assert joint.section is not None
    return joint.section


def _conjugate(q: Array) -> Array:
    """Return the conjugate quaternions."""
    conjugate: Array = q * np.array([1.0, -1.0, -1.0, -1.0])
    return conjugate
