"""exudyn: bodies in Euler parameters on joints, generalised α (index 3) and trapezoidal (index 2).

Its fastest ways that were found: the module without range checks (unless exudyn was imported
before), the sparse solver, Newton with a kept Jacobian.
"""

from __future__ import annotations

import contextlib
import sys
from typing import Any

import numpy as np

from gyrospark.runtime.rigid_body.quaternion import rotation_matrix

from ..peer_linkages import Array, BodyStart, Hold, Linkage
from .optional import need

__all__ = ["PACKAGE", "SOLVERS", "ExudynBodies"]

PACKAGE = "exudyn"
#: What the table calls a setting → integrator, relative tolerance of Newton (absolute: a
#: hundredth). exudyn's own is 1e-8; 1e-10 does not show beside the error of any step here, 1e-6
#: is the loosest that leaves the order seen.
SOLVERS = {
    "trapezoidal index 2": ("TrapezoidalIndex2", 1e-10),
    "generalised α": ("GeneralizedAlpha", 1e-10),
    "trapezoidal index 2 tol 1e-6": ("TrapezoidalIndex2", 1e-6),
    "generalised α tol 1e-6": ("GeneralizedAlpha", 1e-6),
}


class ExudynBodies:
    """A linkage in exudyn, built and assembled once."""

    def __init__(self, linkage: Linkage) -> None:
        self.exudyn = _module()
        self._system = self.exudyn.SystemContainer()  # owns what follows
        self._main = self._system.AddSystem()
        made = [self._add(start, linkage.gravity) for start in linkage.starts()]
        self._nodes = [one["nodeNumber"] for one in made]
        bodies: dict[int | None, Any] = {None: self._main.CreateGround()}
        bodies |= {i: one["bodyNumber"] for i, one in enumerate(made)}
        for hold in linkage.holds:
            self._join(hold, [bodies[hold.a], bodies[hold.b]])
        self._main.Assemble()

    def run(self, solver: str, dt: float, steps: int) -> Array:
        """Return the centres of mass after so many steps from the start."""
        name, tolerance = SOLVERS[solver]
        settings = self.exudyn.SimulationSettings()
        settings.timeIntegration.endTime = steps * dt
        settings.timeIntegration.numberOfSteps = steps
        settings.timeIntegration.newton.relativeTolerance = tolerance
        settings.timeIntegration.newton.absoluteTolerance = tolerance / 100
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        settings.linearSolver.solverType = self.exudyn.LinearSolverType.EigenSparse
        kind = getattr(self.exudyn.DynamicSolverType, name)
        self._main.SolveDynamic(settings, solverType=kind, updateInitialValues=False)
        position = self.exudyn.OutputVariableType.Position
        return np.array([self._main.GetNodeOutput(node, position) for node in self._nodes])

    def _add(self, start: BodyStart, gravity: tuple[float, float, float]) -> Any:
        utilities = need("exudyn.utilities", "exudyn")
        R = rotation_matrix(start.q)
        inertia = utilities.RigidBodyInertia(mass=start.mass, inertiaTensor=np.diag(start.moments))
        return self._main.CreateRigidBody(
            inertia=inertia, referencePosition=start.x, referenceRotationMatrix=R,
            initialVelocity=start.v, initialAngularVelocity=R @ start.omega,
            gravity=list(gravity), returnDict=True, show=False)

    def _join(self, hold: Hold, items: list[Any]) -> None:
        where = {"itemNumbers": items, "position": list(hold.at), "useGlobalFrame": True,
                 "show": False}
        if hold.kind == "ball":
            self._main.CreateSphericalJoint(**where)
        elif hold.kind == "hinge":
            self._main.CreateRevoluteJoint(**where, axis=[0, 0, 1])
        else:
            self._main.CreateGenericJoint(**where, constrainedAxes=[1, 1, 0, 0, 0, 0])


def _module() -> Any:
    """Return exudyn, which says on stdout that it is the fast one: there only results belong."""
    if "exudyn" not in sys.modules:
        sys.exudynFast = True  # type: ignore[attr-defined]
    with contextlib.redirect_stdout(sys.stderr):
        return need("exudyn")
