"""The motion of a body whose place and attitude are quantities of the coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...core.errors import InputError
from ..compilation.body_columns import BodyAt, PlacedAt
from .body_motion import BodyMotion

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["PlacedMotion"]

Array = NDArray[Any]


class PlacedMotion(BodyMotion):
    """One body of a system in coordinates of its own: place and attitude; made as ``BodyMotion``.

    The origin of its axes is the centre of mass. Velocities, momenta and inertia are not known of
    it; asking for them raises ``InputError``.
    """

    def __init__(self, trajectory: Trajectory, name: str, placed: PlacedAt) -> None:
        super().__init__(trajectory, name, BodyAt([], [], [], [0.0] * 3, [0.0] * 3, None))
        self._placed = placed

    def _values(self, names: list[str]) -> Array:
        """Return quantities as columns."""
        return np.stack([self._run.quantity(name).astype(float) for name in names], axis=1)

    @property
    def attitude(self) -> Array:
        """Unit quaternions from body to space axes, scalar first, shape (N+1, 4), without jumps.

        The eigenvector of the largest eigenvalue of Bar-Itzhack's K(R) (J. Guid. Control Dyn. 23,
        2000), whose signs are those of the state before.
        """
        if not self._placed.axes:
            return np.tile([1.0, 0.0, 0.0, 0.0], (len(self._run), 1))
        axes = self._values(self._placed.axes).reshape(-1, 2, 3)
        R = np.stack([axes[:, 0], axes[:, 1], np.cross(axes[:, 0], axes[:, 1])], axis=2)
        turn = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0],
                         R[:, 1, 0] - R[:, 0, 1]], axis=1)
        trace = np.trace(R, axis1=1, axis2=2)
        K = np.empty((len(R), 4, 4))
        K[:, 0, 0] = trace
        K[:, 0, 1:] = K[:, 1:, 0] = turn
        K[:, 1:, 1:] = R + R.transpose(0, 2, 1) - trace[:, None, None] * np.eye(3)
        q = np.linalg.eigh(K)[1][:, :, -1]
        q[0] *= -1 if q[0, 0] < 0 else 1
        signs = np.where((q[1:] * q[:-1]).sum(axis=1) < 0, -1.0, 1.0)
        q[1:] *= np.cumprod(signs)[:, None]
        return q

    def _origin(self) -> Array:
        return self._values(self._placed.x)

    @property
    def _inertia(self) -> Any:
        raise InputError(self._unknown("the motion and the inertia"))

    @property
    def _p(self) -> Array:
        raise InputError(self._unknown("the momentum"))
