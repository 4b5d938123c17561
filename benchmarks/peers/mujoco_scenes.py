"""MuJoCo: bodies as a tree of joints in its generalised coordinates, without contact.

A joint that closes a loop is one of its equality constraints, soft by design: here as stiff as
MuJoCo allows at a time step. Balls close loops where they can, else hinges: by a point, and where
the hinge holds its axis by a second point of the axis. The step loop is MuJoCo's, in C.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np
from numpy.typing import ArrayLike

from ..attitudes import Array, quaternion_of, rotation_matrix
from ..scenes import GROUND, ReferenceScene, SceneJoint, SceneMotion
from .optional import Unavailable, need

__all__ = ["INTEGRATORS", "PACKAGE", "MujocoScene", "configure", "moved", "mujoco_module",
           "tree_of"]

PACKAGE = "mujoco"
INTEGRATORS = ("RK4", "implicit")
#: The largest impedance that MuJoCo takes; its difference from 1 is the softness of a loop.
_STIFFEST = (0.9999, 0.9999, 0.001, 0.5, 2)
Run = Callable[[], Mapping[str, SceneMotion]]
#: Kinds of joints in the order in which they enter the tree.
_FIRST = ("slide", "hinge", "cross", "rod", "ball")


class MujocoScene:
    """A scene in MuJoCo."""

    def __init__(self, scene: ReferenceScene) -> None:
        self._mujoco = mujoco_module()
        self._scene = scene
        self._attitudes = {name: rotation_matrix(body.start.q)
                           for name, body in scene.bodies.items()} | {GROUND: np.eye(3)}
        self._origins = {name: body.start.x for name, body in scene.bodies.items()} | {
            GROUND: np.zeros(3)}
        self._text = self._scene_text(*tree_of(scene))

    def prepare(self, integrator: str, seconds: float, steps: int) -> Run:
        """Return a function that takes ``steps`` steps from the start and returns the motion.

        The function raises ``Unavailable`` if MuJoCo finds the motion unstable.
        """
        model = self.model(integrator, seconds / steps)
        data = self._mujoco.MjData(model)
        speeds = self._speeds(model, data)
        return lambda: next(self._moved(integrator, model, data, speeds, steps))

    def pieces(
        self, integrator: str, dt: float, steps: int, count: int
    ) -> Iterator[Mapping[str, SceneMotion]]:
        """Yield how the bodies move at the end of each of ``count`` pieces of a run.

        It raises ``Unavailable`` as ``prepare`` does.
        """
        model = self.model(integrator, dt)
        data = self._mujoco.MjData(model)
        motions = self._moved(integrator, model, data, self._speeds(model, data), steps)
        return itertools.islice(motions, count)

    def _moved(self, integrator: str, model: Any, data: Any, speeds: Array,
               steps: int) -> Iterator[Mapping[str, SceneMotion]]:
        """Yield how the bodies move after every ``steps`` steps from the start."""
        mujoco = self._mujoco
        mujoco.mj_resetData(model, data)
        data.qvel[:] = speeds
        for name, torque in self._scene.torques.items():
            data.xfrc_applied[model.body(name).id, 3:] = torque
        for snapshot in moved(mujoco, model, data, steps):
            yield {name: self._read(model, snapshot, name) for name in self._scene.bodies}

    def model(self, integrator: str, dt: float) -> Any:
        """Return MuJoCo's model with an integrator and a time step."""
        mujoco = self._mujoco
        model = mujoco.MjModel.from_xml_string(self._text)
        configure(mujoco, model, integrator, dt)
        for name, body in self._scene.bodies.items():  # a text is refused for its rounding
            model.body_inertia[model.body(name).id] = _principal(body.inertia)[0]
        mujoco.mj_setConst(model, mujoco.MjData(model))
        return model

    def _speeds(self, model: Any, data: Any) -> Array:
        """Return the generalised velocities at which the bodies move as they do at the start."""
        mujoco = self._mujoco
        mujoco.mj_forward(model, data)
        rows, velocities = [], []
        for name, body in self._scene.bodies.items():
            move, turn = np.zeros((3, model.nv)), np.zeros((3, model.nv))
            number = model.body(name).id
            mujoco.mj_jacBody(model, data, move, turn, number)
            parts = 2 if body.inertia.any() else 1  # a point does not turn
            rows += [move, turn][:parts]
            velocities += [body.start.v, self._attitudes[name] @ body.start.omega][:parts]
        speeds: Array = np.linalg.lstsq(np.vstack(rows), np.concatenate(velocities))[0]
        return speeds

    def _read(self, model: Any, data: Any, name: str) -> SceneMotion:
        body, velocity = data.body(name), np.zeros(6)
        self._mujoco.mj_objectVelocity(model, data, self._mujoco.mjtObj.mjOBJ_XBODY, body.id,
                                       velocity, 0)
        R = body.xmat.reshape(3, 3)
        return SceneMotion(body.xquat.copy(), body.xpos.copy(), velocity[3:], R.T @ velocity[:3])

    # ------------------------------------------------------------ its text

    def _scene_text(self, tree: Sequence[tuple[str, str, SceneJoint | None]],
                    loops: Sequence[SceneJoint]) -> str:
        root = Element("mujoco")
        SubElement(root, "compiler", boundmass="0", boundinertia="0")
        SubElement(root, "option", gravity=text(self._scene.gravity))
        elements = {GROUND: SubElement(root, "worldbody")}
        for parent, name, joint in tree:
            elements[name] = self._hang(elements[parent], parent, name, joint)
        if self._scene.springs:
            self._add_springs(root, elements)
        equality = SubElement(root, "equality")
        for joint in loops:
            self._close(equality, joint)
        return tostring(root, encoding="unicode")

    def _hang(self, parent: Element, above: str, name: str, joint: SceneJoint | None) -> Element:
        body, R = self._scene.bodies[name], self._attitudes[name]
        element = SubElement(parent, "body", name=name,
                             pos=text(self._seen(above, body.start.x)),
                             quat=text(quaternion_of(self._attitudes[above].T @ R)))
        if joint is None:
            SubElement(element, "joint", type="ball", pos="0 0 0") if body.held else SubElement(
                element, "freejoint")
        else:
            pos = text(self._seen(name, joint.at))
            for axis in self._axes(joint, above):
                kind = "slide" if joint.kind == "slide" else "hinge"
                SubElement(element, "joint", type=kind, pos=pos, axis=text(R.T @ axis))
            if joint.kind == "ball":
                SubElement(element, "joint", type="ball", pos=pos)
        SubElement(element, "inertial", pos=text(body.centre), mass=repr(float(body.mass)),
                   quat=text(quaternion_of(_principal(body.inertia)[1])),
                   diaginertia="1 1 1")
        return element

    def _add_springs(self, root: Element, elements: Mapping[str, Element]) -> None:
        tendons = SubElement(root, "tendon")
        for number, spring in enumerate(self._scene.springs):
            tendon = SubElement(tendons, "spatial", stiffness=repr(float(spring.stiffness)),
                                damping=repr(float(spring.damping)),
                                springlength=repr(float(spring.length)))
            for name, point, side in ((spring.a, spring.on_a, "a"), (spring.b, spring.on_b, "b")):
                site = f"spring{number}_{side}"
                SubElement(elements[name], "site", name=site, pos=text(point))
                SubElement(tendon, "site", site=site)

    def _close(self, equality: Element, joint: SceneJoint) -> None:
        if joint.kind not in ("ball", "hinge"):
            raise Unavailable(f"knows no {joint.kind} that closes a loop")
        first, second = (joint.a, joint.b) if joint.a else (joint.b, joint.a)
        points = [joint.at, joint.at + joint.axes[2]][:1 + any(joint.holds[3:])]
        for point in points:
            connection = SubElement(equality, "connect", body1=first,
                                    anchor=text(self._seen(first, point)))
            if second:
                connection.set("body2", second)

    def _axes(self, joint: SceneJoint, parent: str) -> list[Array]:
        """Return the axes of a joint in space at the start, the axis fixed in the parent first."""
        if joint.kind == "ball":
            return []
        if joint.kind == "rod":
            return self._about_rod(joint)
        if joint.kind != "cross":
            return [joint.axes[2]]
        arms = [joint.axes[0], joint.axes[1]]
        return arms if parent == joint.a else arms[::-1]

    def _about_rod(self, joint: SceneJoint) -> list[Array]:
        """Return the vertical, if the point leaves its plane, and the normal of the plane.

        A ball would let it turn about the rod, which takes no moment of a point.
        """
        point = self._scene.bodies[joint.b].start
        across = np.cross(point.x - joint.at, self._scene.gravity)
        leaves = point.v @ across
        return [self._scene.gravity, across] if leaves else [across]

    def _seen(self, name: str, point: Array) -> Array:
        """Return a point of space in a body at the start."""
        local: Array = self._attitudes[name].T @ (point - self._origins[name])
        return local


def text(numbers: ArrayLike) -> str:
    """Return numbers as MuJoCo's XML has them, to the last digit."""
    return " ".join(repr(float(x)) for x in np.ravel(numbers))


def mujoco_module() -> Any:
    """Return MuJoCo, whose warnings are counted and not written to a file."""
    mujoco = need(PACKAGE)
    mujoco.set_mju_user_warning(lambda text: None)
    return mujoco


def configure(mujoco: Any, model: Any, integrator: str, dt: float) -> None:
    """Set the integrator, without contact, and equalities to the stiffest at a time step."""
    model.opt.timestep = dt
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.eq_solref[:] = 2 * dt, 1  # smaller time constants are raised to it
    model.eq_solimp[:] = _STIFFEST


def moved(mujoco: Any, model: Any, data: Any, steps: int) -> Iterator[Any]:
    """Yield the data after every ``steps`` steps.

    Raises
    ------
    Unavailable
        Where MuJoCo finds the motion unstable.
    """
    for total in itertools.count(steps, steps):
        mujoco.mj_step(model, data, steps)
        if any(warning.number for warning in data.warning):
            raise Unavailable("the motion becomes unstable between steps "
                              f"{total - steps:,} and {total:,}")
        snapshot = copy(data)
        mujoco.mj_forward(model, snapshot)  # a step leaves velocities and forces of its start
        yield snapshot


def _principal(inertia: Array) -> tuple[Array, Array]:
    """Return the moments and, as columns, the axes; the body's axes where they are principal."""
    if not (inertia - np.diag(np.diag(inertia))).any():
        return np.diag(inertia), np.eye(3)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 2] *= np.linalg.det(axes)
    return moments, axes


def tree_of(
    scene: ReferenceScene
) -> tuple[list[tuple[str, str, SceneJoint | None]], list[SceneJoint]]:
    """Return (parent, body, joint) from the ground on, and the joints that close loops.

    The joint of a body that no joint holds is None.
    """
    group = {name: name for name in (*scene.bodies, GROUND)}
    tree_joints, loops = [], []
    for joint in sorted(scene.joints, key=lambda joint: _FIRST.index(joint.kind)):
        a, b = group[joint.a], group[joint.b]
        if a == b:
            loops.append(joint)
            continue
        tree_joints.append(joint)
        group = {name: a if label == b else label for name, label in group.items()}
    tree: list[tuple[str, str, SceneJoint | None]] = []
    reached = [GROUND]
    for parent in reached:
        for joint in tree_joints:
            for end, child in ((joint.a, joint.b), (joint.b, joint.a)):
                if end == parent and child not in reached:
                    tree.append((parent, child, joint))
                    reached.append(child)
    return [*tree, *((GROUND, name, None) for name in scene.bodies if name not in reached)], loops
