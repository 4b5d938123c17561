"""MuJoCo: bodies as a tree of ball joints and hinges, in its generalised coordinates.

A joint that closes a loop is one of its equality constraints, soft by design: here as stiff as it
lets one be at a time step. There is no contact and no damping; the step loop is its own, in C.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from numpy.typing import ArrayLike

from gyrospark.core.inertia import quaternion_of_matrix
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix

from ..peer_linkages import Array, Hold, Linkage
from .optional import need

__all__ = ["INTEGRATORS", "PACKAGE", "STIFFEST", "MujocoBodies", "text"]

PACKAGE = "mujoco"
#: Integrator → its order, without a closed loop and with one.
INTEGRATORS = {"RK4": (4, 2), "implicitfast": (1, 1), "implicit": (1, 1)}
#: The largest impedance that it takes; what is left of 1 is how soft a closed loop is.
STIFFEST = "0.9999 0.9999 0.001 0.5 2"


class MujocoBodies:
    """A linkage in MuJoCo."""

    def __init__(self, linkage: Linkage) -> None:
        self._mujoco = need(PACKAGE)
        self._linkage = linkage
        self._starts = linkage.starts()
        self._attitudes = [rotation_matrix(start.q) for start in self._starts]
        self._text = self._scene()

    def order(self, integrator: str) -> int:
        """Return the order of an integrator on this linkage."""
        open_order, closed_order = INTEGRATORS[integrator]
        loop = any(hold.b is None for hold in self._linkage.holds)
        return closed_order if loop else open_order

    def prepare(self, integrator: str, dt: float, steps: int) -> Callable[[], Array]:
        """Return what takes so many steps from the start and returns the centres of mass."""
        mujoco, model = self._mujoco, self.model(integrator, dt)
        data = mujoco.MjData(model)
        speeds = self._speeds(model)

        def run() -> Array:
            mujoco.mj_resetData(model, data)
            data.qvel[:] = speeds
            mujoco.mj_step(model, data, steps)
            mujoco.mj_kinematics(model, data)  # positions that a step leaves are of its beginning
            return np.array([data.body(_name(i)).xipos for i in range(len(self._starts))])

        return run

    def model(self, integrator: str, dt: float) -> Any:
        """Return MuJoCo's model with an integrator and a time step."""
        mujoco = self._mujoco
        model = mujoco.MjModel.from_xml_string(self._text)
        model.opt.timestep = dt
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        model.eq_solref[:, 0] = 2 * dt  # it makes larger what is less
        for i, start in enumerate(self._starts):  # a flat body's text is refused for its rounding
            model.body_inertia[model.body(_name(i)).id] = start.moments
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def _speeds(self, model: Any) -> Array:
        speeds = np.zeros(model.nv)
        for hold in self._linkage.holds:
            if hold.b is not None:
                rate = self._rate(hold)
                first = model.body_dofadr[model.body(_name(hold.b)).id]
                speeds[first:first + len(rate)] = rate
        return speeds

    def _scene(self) -> str:
        root = Element("mujoco")
        SubElement(root, "compiler", boundmass="0", boundinertia="0")
        SubElement(root, "option", gravity=text(self._linkage.gravity))
        elements: dict[int | None, Element] = {None: SubElement(root, "worldbody")}
        for hold in self._linkage.holds:
            if hold.b is not None:
                elements[hold.b] = self._hang(elements[hold.a], hold, hold.b)
        loops = SubElement(root, "equality")
        for hold in self._linkage.holds:
            if hold.b is None and hold.a is not None:
                SubElement(loops, "connect", body1=_name(hold.a), solimp=STIFFEST,
                               anchor=text(self._seen(hold.a, hold.at)))
        return tostring(root, encoding="unicode")

    def _hang(self, parent: Element, hold: Hold, i: int) -> Element:
        """Add body i, its frame in its mass centre along its principal axes."""
        start, R = self._starts[i], self._attitudes[i]
        above = np.eye(3) if hold.a is None else self._attitudes[hold.a]
        body = SubElement(parent, "body", name=_name(i),
                              pos=text(self._seen(hold.a, start.x)),
                              quat=text(quaternion_of_matrix(above.T @ R)))
        joint = SubElement(body, "joint", type=hold.kind, pos=text(self._seen(i, hold.at)))
        if hold.kind == "hinge":
            joint.set("axis", text(R.T @ [0, 0, 1]))
        SubElement(body, "inertial", pos="0 0 0", mass=repr(float(start.mass)),
                       diaginertia="1 1 1")
        return body

    def _seen(self, i: int | None, point: ArrayLike) -> Array:
        """Return a point of space in body i at the start; None is the ground."""
        at = np.asarray(point, dtype=float)
        return at if i is None else self._attitudes[i].T @ (at - self._starts[i].x)

    def _rate(self, hold: Hold) -> Array:
        """Return how fast b turns in a: of a ball joint in b, of a hinge about its axis."""
        assert hold.b is not None
        turn = self._attitudes[hold.b] @ self._starts[hold.b].omega
        if hold.a is not None:
            turn = turn - self._attitudes[hold.a] @ self._starts[hold.a].omega
        return turn[2:] if hold.kind == "hinge" else self._attitudes[hold.b].T @ turn


def _name(i: int) -> str:
    return f"b{i}"


def text(numbers: ArrayLike) -> str:
    """Return numbers as its XML has them, to the last digit."""
    return " ".join(repr(float(x)) for x in np.ravel(numbers))
