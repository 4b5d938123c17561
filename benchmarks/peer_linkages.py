"""Bodies on joints as another program must build them: numbers of a ``Model``, and its joints.

``Multibody`` hands on equations, not joints, so the joints are told here a second time, in space
at the start. A peer that understands them otherwise than we do ends elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gyrospark.core.inertia import Inertia, as_moments
from gyrospark.generator.multibody.model import Model
from gyrospark.generator.multibody.models import chain, four_bar
from gyrospark.runtime.rigid_body.quaternion import angular_velocity, rotation_matrix

__all__ = ["BodyStart", "Hold", "Linkage", "chain_of", "closed_loop"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hold:
    """A joint at a point of space, between two bodies by number; None is the ground.

    A slot keeps only x and y together: the last hinge of a plane loop, whose other equations
    follow from those of the hinges before.
    """

    kind: Literal["ball", "hinge", "slot"]
    a: int | None
    b: int | None
    at: tuple[float, ...]


@dataclass(frozen=True)
class BodyStart:
    """A body at t = 0: mass, principal moments, quaternion; centre and velocity in space, Ω in it.
    """

    mass: float
    moments: tuple[float, float, float]
    q: Array
    x: Array
    v: Array
    omega: Array


@dataclass(frozen=True)
class Linkage:
    """A model all of whose bodies have 7 coordinates, and its joints."""

    name: str
    model: Model
    gravity: tuple[float, float, float]
    holds: tuple[Hold, ...]

    def starts(self) -> list[BodyStart]:
        """Return where each body starts."""
        rows = zip(self.model.bodies.items(), self._rows(self.model.q0),
                   self._rows(self.model.p0), strict=True)
        return [self._start(name, moments, q, p) for (name, moments), q, p in rows]

    def centres(self, q: Any) -> Array:
        """Return the centres of mass of a state q, shape (bodies, 3)."""
        return self._rows(np.asarray(q, dtype=np.float64))[:, 4:]

    def _rows(self, values: Array) -> Array:
        return values.reshape(-1, 7)

    def _start(
        self, weight: str, moments: Inertia, q: Array, p: Array
    ) -> BodyStart:
        mass = self.model.parameters[weight.removesuffix("_gamma") + "_m"]
        return BodyStart(mass, as_moments(moments), q[:4], q[4:], p[4:] / mass,
                         angular_velocity(q[:4], p[:4], moments))


def chain_of(count: int) -> Linkage:
    """Return ``models.chain``: each rod hangs by its upper end, a ball joint."""
    linkage = Linkage(f"chain of {count}", chain(count), (0.0, 0.0, -9.81), ())
    upper_end = np.array([0.0, 0.0, 0.15])
    holds = tuple(
        Hold("ball", i - 1 if i else None, i, tuple(body.x + rotation_matrix(body.q) @ upper_end))
        for i, body in enumerate(linkage.starts()))
    return Linkage(linkage.name, linkage.model, linkage.gravity, holds)


def closed_loop() -> Linkage:
    """Return ``models.four_bar``: three hinges and, to close the loop, a slot."""
    return Linkage("four-bar", four_bar(), (0.0, -9.81, 0.0), (
        Hold("hinge", None, 0, (0.0, 0.0, 0.0)), Hold("hinge", 0, 1, (0.0, 0.4, 0.0)),
        Hold("hinge", 1, 2, (0.9, 0.8, 0.0)), Hold("slot", 2, None, (1.0, 0.0, 0.0))))
