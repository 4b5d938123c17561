"""Motions of bodies: attitudes, positions, velocities, momenta of the states of a trajectory."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_flag, choose, count_text, few, shown
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.html import card, table
from ...core.inertia import inertia_matrix, real_array
from ...core.records import FixedAttributes
from ..compilation.body_columns import BodyAt, PlacedAt, bodies_of, numbers
from ..rigid_body import quaternion
from ..rigid_body.euler_angles import euler_angles

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["BodyMotion", "FrameName", "PlacedMotion", "rotate", "total_momenta"]


#: The axes in which components are given.
FrameName = Literal["body", "space"]
FRAMES: tuple[FrameName, ...] = ("body", "space")


@explain_arguments
class BodyMotion(FixedAttributes):
    """One body of a trajectory; made by ``Trajectory.body``.

    Body axes are those in which the inertia was given. Their origin is the centre of mass of a body
    that moves freely, and the fixed point of one that turns about it (``Multibody.top`` and the
    systems of one rigid body). Every array has a row for each stored state, N+1 of them, in
    doubles, in SI units for SI input.

    Attributes
    ----------
    name : str
        The body's.
    """

    _CURE = "it shows what the run has"

    name: str

    def __init__(self, trajectory: Trajectory, name: str, at: BodyAt) -> None:
        self.name = name
        self._run, self._layout = trajectory, at

    def __repr__(self) -> str:
        return (f"<BodyMotion of {self.name} in {self._run.manifest.name}: "
                f"{count_text(len(self._run), 'state')}>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the states, with attitude and position of the last."""
        last = [(label, few(f"{x:.6g}" for x in rows[-1].astype(float))) for label, rows in (
            ("last attitude", self.attitude), ("last position in m", self._origin()))]
        return card(f"Body {self.name} of {self._run.manifest.name}", table([
            *self._run._extent(), *last]))

    # ------------------------------------------------------------ attitude

    @property
    def attitude(self) -> Array:
        """Unit quaternions from body to space axes, scalar first, shape (N+1, 4), as computed."""
        quaternions: Array = self._run.q[..., self._layout.q]
        return quaternions

    def rotation(self) -> Any:
        """Return the attitudes as ``scipy.spatial.transform.Rotation``, body to space."""
        return quaternion.to_rotation(self.attitude)

    def rotation_matrix(self) -> Array:
        """Return R(q) of the paper's (3), body to space axes, shape (N+1, 3, 3)."""
        return quaternion.rotation_matrix(self.attitude)

    def euler(self, sequence: str, *, degrees: bool = False) -> Array:
        """Return Euler angles, shape (N+1, 3), in rad or in degrees, an angle for each letter.

        Small letters turn about the axes of space, the first letter's first, capitals about those
        of the body, as in SciPy: ``"ZXZ"`` gives φ, θ, ψ of the paper's (81), ``"ZYX"`` yaw, pitch
        and roll, ``"zyx"`` the angles of R_x R_y R_z. See ``runtime.rigid_body.euler_angles`` for
        ranges.

        Raises
        ------
        InputError
            For a text that is no sequence of axes.
        """
        factor = np.degrees(1.0) if as_flag("degrees", degrees) else 1.0
        return euler_angles(self.attitude, sequence) * factor

    def axis(self) -> Array:
        """Return the body's third axis in space, (R13, R23, R33), shape (N+1, 3)."""
        return quaternion.axis(self.attitude)

    # ------------------------------------------------------------ turning

    def angular_velocity(self, frame: FrameName = "body") -> Array:
        """Return Ω = J⁻¹ ½ L(q) p, or R(q) Ω for ``frame="space"``, shape (N+1, 3), in rad/s.

        In a model whose space axes turn (``gs.models.satellite``) it is the angular velocity
        against axes that do not.

        Raises
        ------
        InputError
            For another frame.
        """
        omega = quaternion.angular_velocity(self.attitude, self._p, self._inertia)
        return self._in(frame, omega)

    def angular_momentum(self, frame: FrameName = "space") -> Array:
        """Return l = ½ L(q) p about the origin of the body axes, or R(q) l, shape (N+1, 3).

        In kg m²/s; in space axes unless ``frame="body"``.
        """
        L = quaternion.left_matrix(self.attitude)
        return self._in(frame, np.einsum("...ij,...j->...i", L, self._p.astype(float)) / 2)

    # ------------------------------------------------------------ moving

    def position(self, on_body: ArrayLike | None = None) -> Array:
        """Return where in space a point of the body is, x + R(q) r, shape (N+1, 3), in m.

        ``on_body`` is r in body axes from their origin; by default it is the centre of mass.

        Raises
        ------
        InputError
            If ``on_body`` is no point, and if the model does not give the centre of mass.
        """
        return self._origin() + self._in_space(self._point(on_body))

    def velocity(self, on_body: ArrayLike | None = None) -> Array:
        """Return the velocity of a point of the body, ẋ + R(q) (Ω × r), shape (N+1, 3), in m/s.

        Takes the same argument and raises the same errors as ``position``.
        """
        r = self._point(on_body)
        rotation_velocity = self._in_space(np.cross(self.angular_velocity(), r))
        if not self.moves:
            return rotation_velocity
        return self._run.p[..., self._layout.x].astype(float) / self.mass + rotation_velocity

    def momentum(self) -> Array:
        """Return m ẋ of the centre of mass in space axes, shape (N+1, 3), in kg m/s.

        Raises
        ------
        InputError
            If the model does not give the mass or the centre of mass.
        """
        return self.mass * self.velocity()

    def kinetic_energy(self) -> Array:
        """Return ½ l·Ω + ½ m |ẋ|² with ẋ of the origin, shape (N+1,), in J.

        Without the terms of γ or α, which vanish on the constraints.
        """
        l, omega = self.angular_momentum("body"), self.angular_velocity()  # noqa: E741
        energy: Array = (l * omega).sum(axis=-1) / 2
        if self.moves:
            energy = energy + (self._run.p[..., self._layout.x].astype(float) ** 2).sum(axis=-1) / (
                2 * self.mass)
        return energy

    @property
    def mass(self) -> float:
        """The mass in kg.

        Raises
        ------
        InputError
            If the model does not give it.
        """
        mass = self._layout.mass_of(self._run.parameters)
        if mass is None:
            raise InputError(self._unknown("the mass"))
        return mass

    @property
    def inertia(self) -> Array:
        """J about the origin of the body axes, shape (3, 3), in kg m²."""
        return inertia_matrix(self._inertia)

    @property
    def centre(self) -> Array:
        """The centre of mass in body axes from their origin, shape (3,), in m.

        Raises
        ------
        InputError
            If the model does not give it.
        """
        if not self._layout.centre:
            raise InputError(self._unknown("where the centre of mass is") + " (Other points are "
                             "asked for in body axes: position(on_body=(0, 0, 0.1)).)")
        return numbers(self._layout.centre, self._run.parameters)

    @property
    def moves(self) -> bool:
        """Whether the body has a position: none of its points is fixed in space."""
        return bool(self._layout.x)

    def plot(self, path: str | os.PathLike[str] | None = None, *, euler: str = "ZYX",
             degrees: bool = True) -> Any:
        """Draw Euler angles, without jumps, angular velocity, momenta, and how it moves.

        Returns a matplotlib figure, which Jupyter shows; .png, .svg or .pdf where a path is given.
        """
        from ..plotting.motion_plots import draw_body  # matplotlib is optional

        return draw_body(self, self._run, path, euler, as_flag("degrees", degrees))

    # ------------------------------------------------------------ inside

    @property
    def _p(self) -> Array:
        """The momenta of the quaternion, shape (N+1, 4)."""
        momenta: Array = self._run.p[..., self._layout.q]
        return momenta

    @property
    def _inertia(self) -> Any:
        """The moments or the tensor, with the run's parameters."""
        return self._layout.inertia_of(self._run.parameters)

    def _origin(self) -> Array:
        """Return the position of the origin of the body axes in space, (N+1, 3), in m."""
        if self.moves:
            return self._run.q[..., self._layout.x].astype(float)
        fixed_point = numbers(self._layout.origin, self._run.parameters)
        return np.broadcast_to(fixed_point, (*self._run.q.shape[:-1], 3))

    def _point(self, on_body: ArrayLike | None) -> Array:
        """Return a point in body axes, (3,), by default the centre of mass.

        Raises InputError for an argument that is no point.
        """
        if on_body is None:
            return self.centre
        r = real_array(on_body)
        if r is None or r.shape != (3,) or not np.isfinite(r).all():
            raise InputError(f"on_body = {shown(on_body)} is no point of body {self.name!r}; give "
                             "three finite numbers in body axes, in m.")
        return r

    def _in_space(self, vectors: Array) -> Array:
        """Return R(q) v of vectors in body axes, shape (N+1, 3) or (3,)."""
        return rotate(self.attitude, vectors)

    def _in(self, frame: FrameName, vectors: Array) -> Array:
        """Return vectors in body axes, (N+1, 3), in the axes of ``frame``."""
        in_body = choose("frame", frame, FRAMES) == "body"
        return vectors if in_body else self._in_space(vectors)

    def _unknown(self, quantity: str) -> str:
        """Return the message of the error for a quantity that the model does not give."""
        return (f"System {self._run.manifest.system.name!r} does not say {quantity} of body "
                f"{self.name!r}; bodies of gyrospark.Multibody and of [[bodies]] in model files "
                "have it.")


def rotate(q: Array, vectors: Array) -> Array:
    """Return R(q) v of each row, shape (N+1, 3), or of one; v may be one for all."""
    R = quaternion.rotation_matrix(q)
    in_space: Array = np.einsum("...ij,...j->...i", R, vectors)
    return in_space


def total_momenta(run: Trajectory) -> tuple[Array, Array]:
    """Return Σ p and Σ (l + x × p) of the bodies of a run in space, shape (N+1, 3) each.

    Here p is the momentum of the centre of mass x, and l = R(q) ½ L(q) p_q the angular momentum
    about it, with the momenta p_q of the quaternion q.
    Raises InputError unless all coordinates belong to bodies with quaternion and position.
    """
    bodies = bodies_of(run.manifest).values()
    # a free body has 7 coordinates: a quaternion and a position
    if sum(bool(body_columns.x) for body_columns in bodies) * 7 != run.q.shape[1]:
        raise InputError(f"System {run.manifest.system.name!r} has coordinates of others "
                         "than free bodies; add up what body(name).momentum() and "
                         "angular_momentum() return.")
    # columns of each body: arrays indexed by them have the axes (state, body, component)
    attitudes = [body_columns.q for body_columns in bodies]
    positions = [body_columns.x for body_columns in bodies]
    x, p = (array[:, positions].astype(float) for array in (run.q, run.p))
    l_in_body = np.einsum("kbij,kbj->kbi", quaternion.left_matrix(run.q[:, attitudes]),
                          run.p[:, attitudes].astype(float)) / 2
    l = np.einsum("kbij,kbj->kbi",  # noqa: E741
                  quaternion.rotation_matrix(run.q[:, attitudes]), l_in_body)
    return p.sum(axis=1), (l + np.cross(x, p)).sum(axis=1)


class PlacedMotion(BodyMotion):
    """One body of a system in coordinates of its own: place and attitude; made as ``BodyMotion``.

    The origin of its axes is the centre of mass. The model gives no velocities, momenta or inertia;
    asking for them raises ``InputError``.
    """

    def __init__(self, trajectory: Trajectory, name: str, placed: PlacedAt) -> None:
        # no columns of its own: positions and attitudes are quantities of the system
        super().__init__(trajectory, name, BodyAt(
            q=[], inertia=[], x=[], origin=[0.0] * 3, centre=[0.0] * 3, mass=None))
        self._placed = placed

    def _quantities(self, names: list[str]) -> Array:
        """Return quantities as columns, shape (N+1, names)."""
        return np.stack([np.asarray(self._run.quantity(name), float) for name in names], axis=-1)

    @property
    def attitude(self) -> Array:
        """Unit quaternions from body to space axes, scalar first, shape (N+1, 4), without jumps.

        The eigenvector of the largest eigenvalue of Bar-Itzhack's K(R) (J. Guid. Control Dyn. 23,
        2000), with the sign of the state before. The model has the first two columns of R
        as quantities; the third is their cross product.
        """
        if not self._placed.axes:
            return np.tile([1.0, 0.0, 0.0, 0.0], (*self._run.q.shape[:-1], 1))
        # the first two columns of R, one after the other
        axes = self._quantities(self._placed.axes).reshape(-1, 2, 3)
        # K of R: its scalar part from the antisymmetric part of R, the rest from the symmetric one
        R = np.stack([axes[:, 0], axes[:, 1], np.cross(axes[:, 0], axes[:, 1])], axis=2)
        turn = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0],
                         R[:, 1, 0] - R[:, 0, 1]], axis=1)
        trace = np.trace(R, axis1=1, axis2=2)
        K = np.empty((len(R), 4, 4))
        K[:, 0, 0] = trace
        K[:, 0, 1:] = K[:, 1:, 0] = turn
        K[:, 1:, 1:] = R + R.transpose(0, 2, 1) - trace[:, None, None] * np.eye(3)
        q = np.linalg.eigh(K)[1][:, :, -1]  # eigenvalues rise
        # an eigenvector has any sign: the scalar of the first is positive, others follow it
        q[0] *= -1 if q[0, 0] < 0 else 1
        signs = np.where((q[1:] * q[:-1]).sum(axis=1) < 0, -1.0, 1.0)
        q[1:] *= np.cumprod(signs)[:, None]
        return q.reshape(*self._run.q.shape[:-1], 4)

    def _origin(self) -> Array:
        """Return the centre of mass in space, (N+1, 3), in m."""
        return self._quantities(self._placed.x)

    @property
    def _inertia(self) -> Any:
        """Raise InputError: the model has neither inertia nor angular velocity."""
        raise InputError(self._unknown("the motion and the inertia"))

    @property
    def _p(self) -> Array:
        """Raise InputError: the momenta of the model belong to other coordinates."""
        raise InputError(self._unknown("the momentum"))
