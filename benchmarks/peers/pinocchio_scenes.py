"""Pinocchio: bodies as a tree of joints; multipliers close loops, with Baumgarte's stabilisation.

Critically damped with the time constant of a few steps. The step is semi-implicit Euler, which its
users write themselves: v += h a(q, v), then q moves along v on the Lie group.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..attitudes import Array, rotation_matrix
from ..scenes import GROUND, ReferenceScene, SceneJoint, SceneMotion
from .mujoco_scenes import tree_of
from .optional import Unavailable, need

__all__ = ["PACKAGE", "PinocchioScene"]

PACKAGE = "pin"
#: Time constant of the stabilisation, in steps.
_CONSTANT = 5.0
#: Pinocchio's solver of contacts: accuracy, regularisation (rows may repeat) and iterations.
_ACCURACY, _MU, _ITERATIONS = 1e-12, 1e-10, 20


class PinocchioScene:
    """A scene in Pinocchio."""

    def __init__(self, scene: ReferenceScene) -> None:
        self._pin = need("pinocchio", PACKAGE)
        self._scene = scene
        self._attitudes = {name: rotation_matrix(body.start.q)
                           for name, body in scene.bodies.items()} | {GROUND: np.eye(3)}
        self._origins = {name: body.start.x for name, body in scene.bodies.items()} | {
            GROUND: np.zeros(3)}
        #: Body → its joint, and the placement of its axes in the axes of the joint.
        self._places: dict[str, tuple[int, Any]] = {GROUND: (0, self._pin.SE3.Identity())}
        self._model = self._pin.Model()
        self._model.gravity.linear = scene.gravity
        tree, loops = tree_of(scene)
        self._hang_all(GROUND, tree)
        self._loops = [constraint for joint in loops for constraint in self._close(joint)]

    def pieces(self, dt: float, steps: int, count: int) -> Iterator[Mapping[str, SceneMotion]]:
        """Yield how the bodies move at the end of each of ``count`` pieces of a run."""
        pin, model = self._pin, self._model
        data, q = model.createData(), pin.neutral(model)
        loops, contacts = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
        for loop in self._loops:
            loop.setBaumgarteCorrectorParameters(pin.BaumgarteCorrectorParameters(
                1 / (_CONSTANT * dt)**2, 2 / (_CONSTANT * dt)))
            loops.append(loop)
            contacts.append(loop.createData())
        settings = pin.ProximalSettings(_ACCURACY, _MU, _ITERATIONS)
        pin.initConstraintDynamics(model, data, loops, contacts)
        v, force = self._speeds(data, q), np.zeros(model.nv)
        for _ in range(count):
            for _ in range(steps):
                if self._scene.springs:
                    force = self._pulls(data, q)
                v = v + dt * pin.constraintDynamics(model, data, q, v, force, loops, contacts,
                                                    settings)
                q = pin.integrate(model, q, dt * v)
            if not np.isfinite(q).all():
                raise Unavailable("the state is not finite")
            pin.forwardKinematics(model, data, q, v)
            yield {name: self._read(data, name) for name in self._scene.bodies}

    def _read(self, data: Any, name: str) -> SceneMotion:
        joint, placement = self._places[name]
        pose, speed = data.oMi[joint] * placement, placement.actInv(data.v[joint])
        attitude = self._pin.Quaternion(pose.rotation)
        return SceneMotion(np.array([attitude.w, attitude.x, attitude.y, attitude.z]),
                           pose.translation.copy(), pose.rotation @ speed.linear,
                           speed.angular.copy())

    def _speeds(self, data: Any, q: Array) -> Array:
        """Return the joint velocities at which the bodies move as they do at the start."""
        pin, rows, velocities = self._pin, [], []
        pin.computeJointJacobians(self._model, data, q)
        for name, body in self._scene.bodies.items():
            joint, placement = self._places[name]
            local = placement.inverse().action @ pin.getJointJacobian(
                self._model, data, joint, pin.ReferenceFrame.LOCAL)
            rows += [self._attitudes[name] @ local[:3], local[3:]]
            velocities += [body.start.v, body.start.omega]
        speeds: Array = np.linalg.lstsq(np.vstack(rows), np.concatenate(velocities))[0]
        return speeds

    def _pulls(self, data: Any, q: Array) -> Array:
        """Return the generalised forces of springs between points."""
        pin, model = self._pin, self._model
        pin.computeJointJacobians(model, data, q)
        total = np.zeros(model.nv)
        for spring in self._scene.springs:
            ends = [(joint, placement.act(np.asarray(point, dtype=float)))
                    for (joint, placement), point in ((self._places[spring.a], spring.on_a),
                                                      (self._places[spring.b], spring.on_b))]
            a, b = (data.oMi[joint].act(point) for joint, point in ends)
            length = float(np.linalg.norm(b - a))
            pull = spring.stiffness * (1 - spring.length / length) * (b - a)
            for (joint, point), force in zip(ends, (pull, -pull), strict=True):
                local = data.oMi[joint].rotation.T @ force
                J = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL)
                total += J.T @ np.concatenate([local, np.cross(point, local)])
        return total

    # ------------------------------------------------------------ its model

    def _hang_all(self, parent: str, tree: Sequence[tuple[str, str, SceneJoint | None]]) -> None:
        """Add the subtree below a body, depth first, as Pinocchio numbers joints."""
        for above, name, joint in tree:
            if above == parent:
                self._hang(parent, name, joint)
                self._hang_all(name, tree)

    def _hang(self, parent: str, name: str, joint: SceneJoint | None) -> None:
        """Add a joint whose frame is at its point, with the axes of space at the start."""
        pin, body = self._pin, self._scene.bodies[name]
        if joint is None or joint.kind not in ("ball", "hinge", "slide"):
            kind = "free body" if joint is None else joint.kind
            raise Unavailable(f"knows no {kind} here")
        above, placement = self._places[parent]
        pose = pin.SE3(self._attitudes[parent], self._origins[parent])
        joint_frame = pin.SE3(np.eye(3), joint.at)
        kinds = {"ball": lambda: pin.JointModelSpherical(),
                 "hinge": lambda: pin.JointModelRevoluteUnaligned(joint.axes[2]),
                 "slide": lambda: pin.JointModelPrismaticUnaligned(joint.axes[2])}
        number = self._model.addJoint(above, kinds[joint.kind](),
                                      placement * pose.inverse() * joint_frame, name)
        body_placement = joint_frame.inverse() * pin.SE3(self._attitudes[name], self._origins[name])
        self._places[name] = number, body_placement
        self._model.appendBodyToJoint(
            number, pin.Inertia(float(body.mass), np.asarray(body.centre, dtype=float),
                                body.inertia), body_placement)

    def _close(self, joint: SceneJoint) -> Iterator[Any]:
        if joint.kind not in ("ball", "hinge"):
            raise Unavailable(f"knows no {joint.kind} that closes a loop")
        pin = self._pin
        for point in [joint.at, joint.at + joint.axes[2]][:1 + any(joint.holds[3:])]:
            sides = []
            for name in (joint.a, joint.b):
                number, placement = self._places[name]
                local = self._attitudes[name].T @ (point - self._origins[name])
                sides += [number, placement * pin.SE3(np.eye(3), local)]
            yield pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, self._model, *sides,
                                           pin.ReferenceFrame.LOCAL)
