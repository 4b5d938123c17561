"""exudyn: a rigid body in Euler parameters on a spherical joint, generalised α and trapezoidal.

Its solver works on the index-2 or index-3 equations with multipliers, in C++.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..attitudes import Array
from ..tops import INERTIA, LEVER, TopState, state_of, tops
from .entry import PeerEntry, Run
from .optional import need

__all__ = ["PACKAGE", "entries"]

PACKAGE = "exudyn"
_MASS, _GRAVITY = 1.0, 9.81


def entries() -> list[PeerEntry]:
    """Return two implicit integrators."""
    dt = 1e-3
    return [PeerEntry("exudyn", f"{text} Δt={dt:g}",
                      partial(_prepare, name, dt), dt,
                      quick=name == "TrapezoidalIndex2")
            for text, name in (("trapezoidal index 2", "TrapezoidalIndex2"),
                               ("generalised α", "GeneralizedAlpha"))]


def _prepare(solver: str, dt: float) -> Run:
    exudyn = need("exudyn")
    utilities = need("exudyn.utilities", "exudyn")
    system = exudyn.SystemContainer()
    main = system.AddSystem()
    start = state_of(tops()[0])
    node, body = _add_body(main, utilities, start)
    main.CreateSphericalJoint(itemNumbers=[body, main.CreateGround()],
                              position=[0, 0, 0], useGlobalFrame=True, show=False)
    main.Assemble()

    def run(t_end: float) -> TopState:
        settings = exudyn.SimulationSettings()
        settings.timeIntegration.endTime = t_end
        settings.timeIntegration.numberOfSteps = round(t_end / dt)
        settings.timeIntegration.newton.relativeTolerance = 1e-10
        settings.timeIntegration.newton.absoluteTolerance = 1e-12
        settings.timeIntegration.verboseMode = 0
        settings.solution.file.write = False
        main.SolveDynamic(settings, solverType=getattr(exudyn.DynamicSolverType, solver),
                          updateInitialValues=False)
        q = main.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates)[3:7]
        reference = main.GetNodeOutput(node, exudyn.OutputVariableType.Coordinates,
                                       exudyn.ConfigurationType.Reference)[3:7]
        omega = main.GetNodeOutput(node, exudyn.OutputVariableType.AngularVelocityLocal)
        return TopState(np.array(q) + np.array(reference), np.array(omega))

    return run


def _add_body(main: Any, utilities: Any, start: TopState) -> tuple[Any, Any]:
    about_origin = np.diag(INERTIA)
    inertia = utilities.RigidBodyInertia(mass=_MASS, inertiaTensor=about_origin,
                                         com=np.array([0.0, 0.0, LEVER]))
    R: Array = utilities.EulerParameters2RotationMatrix(start.q)
    numbers = main.CreateRigidBody(
        inertia=inertia, referencePosition=[0, 0, 0], referenceRotationMatrix=R,
        initialAngularVelocity=R @ start.omega, gravity=[0, 0, -_GRAVITY], returnDict=True,
        show=False)
    return numbers["nodeNumber"], numbers["bodyNumber"]
