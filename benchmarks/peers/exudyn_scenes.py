"""exudyn: bodies on joints in Euler parameters, in a plane in three coordinates each.

    trapezoidal index 2, generalised α     implicit, of order 2, with joints
    RK44, RK67                             explicit, for a body on no joints

A body with a fixed point turns like a body whose centre of mass is there, with the moments about
that point, its weight at the true centre and the opposite force at the point: so explicit methods
need no joint.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from ..attitudes import Array, quaternion_of, rotation_matrix
from ..scenes import GROUND, ReferenceScene, SceneBody, SceneJoint, SceneMotion, SceneSpring
from .optional import Unavailable, need

__all__ = ["EXPLICIT", "IMPLICIT", "PACKAGE", "ExudynScene"]

PACKAGE = "exudyn"
#: Name of a method in tables → exudyn's name.
IMPLICIT = {"trapezoidal index 2": "TrapezoidalIndex2", "generalised α": "GeneralizedAlpha"}
#: Tolerances of Newton, relative and absolute, are exudyn's: tighter ones fail for short steps.
_TOLERANCE = 1e-8, 1e-10
EXPLICIT = {"RK44": "RK44", "RK67": "RK67"}


class ExudynScene:
    """A scene in exudyn, built and assembled once.

    With ``lie_group`` attitudes are rotation vectors, which explicit methods want; else Euler
    parameters.
    """

    def __init__(self, scene: ReferenceScene, *, lie_group: bool = False) -> None:
        self.exudyn = _module()
        self._utilities = need("exudyn.utilities", PACKAGE)
        self._scene, self._lie_group = scene, lie_group
        self._system = self.exudyn.SystemContainer()  # owns all objects below
        self._main = self._system.AddSystem()
        with contextlib.redirect_stdout(io.StringIO()):  # remarks on impossible inertia
            self._build(scene)
        self._main.Assemble()

    def _build(self, scene: ReferenceScene) -> None:
        self._made = {name: self._add(body) for name, body in scene.bodies.items()}
        self._items = {name: numbers["bodyNumber"] for name, numbers in self._made.items()}
        self._items[GROUND] = self._main.CreateGround()
        for joint in scene.joints:
            self._planar_hinge(joint) if scene.planar else self._join(joint)
        for spring in scene.springs:
            self._pull(spring)
        for name, torque in scene.torques.items():
            self._main.CreateTorque(itemNumber=self._items[name], loadVector=torque.tolist())

    def run(self, method: str, seconds: float, steps: int) -> Mapping[str, SceneMotion]:
        """Return how the bodies move after ``steps`` steps.

        Raises
        ------
        Unavailable
            If a step finds no solution.
        """
        return self._run(method, self._settings(seconds, steps), go_on=False)

    def pieces(
        self, method: str, dt: float, steps: int, count: int
    ) -> Iterator[Mapping[str, SceneMotion]]:
        """Yield how the bodies move at the end of each of ``count`` pieces of a run.

        It raises ``Unavailable`` as ``run`` does.
        """
        fresh = ExudynScene(self._scene, lie_group=self._lie_group)
        for _ in range(count):
            yield fresh._run(method, fresh._settings(steps * dt, steps), go_on=True)

    def _run(self, method: str, settings: Any, *, go_on: bool) -> Mapping[str, SceneMotion]:
        kind = getattr(self.exudyn.DynamicSolverType, (IMPLICIT | EXPLICIT)[method])
        try:
            with contextlib.redirect_stdout(io.StringIO()):  # the error below has its first line
                self._main.SolveDynamic(settings, solverType=kind, updateInitialValues=go_on)
        except (RuntimeError, ValueError) as error:
            raise Unavailable(f"{method}: {str(error).strip().splitlines()[0]}") from error
        return {name: self._read(body, self._made[name]["nodeNumber"])
                for name, body in self._scene.bodies.items()}

    def _settings(self, seconds: float, steps: int) -> Any:
        settings = self.exudyn.SimulationSettings()
        integration = settings.timeIntegration
        integration.endTime, integration.numberOfSteps = seconds, steps
        newton = integration.newton
        newton.relativeTolerance, newton.absoluteTolerance = _TOLERANCE
        integration.adaptiveStep = False
        integration.verboseMode = 0
        settings.solution.file.write = False
        settings.linearSolver.solverType = self.exudyn.LinearSolverType.EigenSparse
        return settings

    def _read(self, body: SceneBody, node: int) -> SceneMotion:
        def output(name: str) -> Array:
            kind = getattr(self.exudyn.OutputVariableType, name)
            return np.array(self._main.GetNodeOutput(node, kind))

        x, v = output("Position"), output("Velocity")
        if not body.inertia.any():
            return SceneMotion(body.start.q, x, v, body.start.omega)
        U, _, Vt = np.linalg.svd(output("RotationMatrix").reshape(3, 3))
        q = quaternion_of(U @ Vt)  # Euler parameters of index 2 leave |q| = 1
        return SceneMotion(q, x, v, output("AngularVelocityLocal"))

    # ------------------------------------------------------------ parts

    def _add(self, body: SceneBody) -> Any:
        R, start, kinds = rotation_matrix(body.start.q), body.start, self.exudyn.NodeType
        if not body.inertia.any():
            return self._main.CreateMassPoint(
                mass=body.mass, referencePosition=start.x, initialVelocity=start.v,
                gravity=self._scene.gravity.tolist(), returnDict=True, show=False)
        tensor = body.about_origin if body.held else body.inertia
        gravity = np.zeros(3) if body.held else self._scene.gravity
        numbers = self._main.CreateRigidBody(
            inertia=self._utilities.RigidBodyInertia(mass=body.mass, inertiaTensor=tensor),
            referencePosition=start.x, referenceRotationMatrix=R,
            initialVelocity=start.v, initialAngularVelocity=R @ start.omega,
            gravity=gravity.tolist(), create2D=self._scene.planar,
            nodeType=(kinds.RotationRotationVector if self._lie_group
                      else kinds.RotationEulerParameters), returnDict=True, show=False)
        for point, sign in ((body.centre, 1), (np.zeros(3), -1)) if body.held else ():
            self._main.CreateForce(
                itemNumber=numbers["bodyNumber"], localPosition=point.tolist(), show=False,
                loadVector=(sign * body.mass * self._scene.gravity).tolist())
        return numbers

    def _join(self, joint: SceneJoint) -> None:
        options = {"itemNumbers": [self._items[joint.a], self._items[joint.b]],
                   "position": joint.at.tolist(), "useGlobalFrame": True, "show": False}
        create = self._main
        if joint.kind == "ball":
            create.CreateSphericalJoint(**options, constrainedAxes=_flags(joint.holds))
        elif joint.kind == "hinge":
            if all(joint.holds):
                create.CreateRevoluteJoint(**options, axis=joint.axes[2].tolist())
                return
            create.CreateSphericalJoint(**options, constrainedAxes=_flags(joint.holds[:3]))
            if any(joint.holds[3:]):  # n₁ across the axis: no turn about n₂
                create.CreateGenericJoint(
                    **options, rotationMatrixAxes=joint.axes.T,
                    constrainedAxes=[0, 0, 0, *_flags(joint.holds[:2:-1]), 0])
        elif joint.kind == "rod":
            create.CreateDistanceConstraint(
                itemNumbers=options["itemNumbers"], localPosition0=options["position"], show=False)
        elif joint.kind == "slide":
            create.CreatePrismaticJoint(**options, axis=joint.axes[2].tolist())
        else:
            create.CreateGenericJoint(**options, rotationMatrixAxes=joint.axes.T,
                                      constrainedAxes=[1, 1, 1, 0, 0, 1])

    def _planar_hinge(self, joint: SceneJoint) -> None:
        markers = []
        for name in (joint.a, joint.b):
            point = joint.at
            if name != GROUND:
                start = self._scene.bodies[name].start
                point = rotation_matrix(start.q).T @ (point - start.x)
            markers.append(self._main.AddMarker(self._utilities.MarkerBodyPosition(
                bodyNumber=self._items[name], localPosition=point.tolist())))
        self._main.AddObject(self._utilities.RevoluteJoint2D(
            markerNumbers=markers))

    def _pull(self, spring: SceneSpring) -> None:
        self._main.CreateSpringDamper(
            itemNumbers=[self._items[spring.a], self._items[spring.b]],
            localPosition0=spring.on_a.tolist(), localPosition1=spring.on_b.tolist(),
            referenceLength=spring.length, stiffness=spring.stiffness, damping=spring.damping,
            show=False)


def _flags(holds: tuple[bool, ...]) -> list[int]:
    return [int(hold) for hold in holds]


def _module() -> Any:
    """Return exudyn, without its remark on stdout, where only results belong."""
    if "exudyn" not in sys.modules:
        sys.exudynFast = True  # type: ignore[attr-defined]
    with contextlib.redirect_stdout(io.StringIO()):
        return need("exudyn")
