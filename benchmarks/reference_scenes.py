"""The reference problems as bodies on joints, for programs that take bodies and no equations.

Each is built from the numbers of its model. Most models record their bodies; Andrews' mechanism
and the governors, Lagrangians in few coordinates, are put together here and by
``examples/flyball_governor.py``; a pendulum is a point on a rod.
"""

from __future__ import annotations

import math
import runpy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

import gyrospark as gs
from gyrospark.references import Reference, reference

from .attitudes import rotation_matrix
from .peers.optional import Unavailable
from .scenes import GROUND, ReferenceScene, SceneBody, SceneJoint, SceneMotion, scene_of

__all__ = ["SceneReference", "andrews", "andrews_released", "at_start", "scene_reference"]

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
Motions = Mapping[str, SceneMotion]
Numbers = Mapping[str, Sequence[float]]
#: ε of derivatives by complex numbers.
_STEP = 1e-30

@dataclass(frozen=True)
class SceneReference:
    """A scene, and a function that reads numbers by group off its motions, as ``Reference.read``.
    """

    scene: ReferenceScene
    read: Callable[[Motions], Numbers]


def scene_reference(problem: Reference) -> SceneReference:
    """Return a reference problem as a scene.

    Raises
    ------
    Unavailable
        With a reason, for a problem that is no bodies on joints.
    """
    if problem.no_bodies:
        raise Unavailable(problem.no_bodies)
    model = problem.make().in_type(float)
    if problem.name == "andrews":
        return _andrews(problem, model)
    if problem.name.startswith("flyball-governor"):
        return _governor(model)
    scene = scene_of(model) if model.system.bodies else _pendulum(model)
    return SceneReference(scene, lambda motions: _signed(problem, problem.read(scene.end(motions))))  # type: ignore[arg-type]


def _signed(problem: Reference, groups: Numbers) -> Numbers:
    """Return the groups, the attitude as the quaternion of ±q that is nearer to the true one."""
    if "attitude" not in groups:
        return groups
    true = [float(problem.truth.value(name)) for name in problem.groups["attitude"]]
    q = np.asarray(groups["attitude"])
    return {**groups, "attitude": (q if q @ true > 0 else -q).tolist()}


# ---------------------------------------------------------------- a point on a rod


def _pendulum(model: gs.Model) -> ReferenceScene:
    """Return a point on a rod, with the mass and weight of H.

    Raises
    ------
    Unavailable
        For another constraint, or another potential.
    """
    system = model.system
    mass = 1 / float(sp.diff(system.H, system.p[0], 2))
    pulls = [-sp.diff(system.H, x) for x in system.q]
    fall = [e.xreplace({x: sp.Float(model.parameters[str(x)]) for x in system.parameters})
            for e in pulls]
    position, momentum, weight = (np.array([*map(float, entries), 0.0][:3]) for entries in (
        model.q0, model.p0, fall))
    length = float(np.linalg.norm(position))
    if sp.expand(system.constraints[0] + length**2 - sum(x**2 for x in system.q)):
        raise Unavailable(f"{model.name} is no point on a rod")
    zero = np.zeros(3)
    start = SceneMotion(np.array([1.0, 0, 0, 0]), position, momentum / mass, zero)
    point = SceneBody(mass, np.zeros((3, 3)), zero, start)
    joint = SceneJoint("rod", GROUND, "point", zero, np.eye(3), ())
    return ReferenceScene(model.name, model, weight / mass, {"point": point}, (joint,))


# ---------------------------------------------------------------- Andrews


def andrews(
    values: Mapping[str, float], angles: Sequence[float], rates: Sequence[float] = (0.0,) * 7
) -> gs.Multibody:
    """Return the seven bodies of Andrews' mechanism in a plane, K1 to K7, without its torque.

    Parameters
    ----------
    values, angles, rates
        Parameters, β, Θ, γ, φ, δ, Ω, ε and their rates as in ``examples/andrews.py``.
    """
    v = values
    # f(x + iεẋ) = f(x) + iε df/dt: the imaginary parts are velocities, to all digits.
    beta, theta, gamma, phi, delta, omega, epsilon = (
        np.asarray(angles) + 1j * _STEP * np.asarray(rates))
    A, B = (v["xa"], v["ya"]), (v["xb"], v["yb"])
    build = gs.Multibody("andrews_of_bodies", gravity=(0, 0, 0))
    frames: dict[str, tuple[Any, Any]] = {}

    def link(number: int, hinge: Any, turn: complex, centre: tuple[float, float]) -> None:
        """Add K_number, turned about a hinge, its centre of mass in its own axes from there."""
        R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        frames[f"K{number}"] = np.asarray(hinge), R
        position, about_z = hinge + R @ centre, np.eye(3)
        about_z[:2, :2] = R.real
        build.body(f"K{number}", mass=v[f"m{number}"], inertia=(v[f"I{number}"],) * 3,
                   position=(*position.real, 0), velocity=(*(position.imag / _STEP), 0),
                   rotation=about_z, angular_velocity=(0, 0, turn.imag / _STEP))

    def point(name: str, x: float, y: float) -> Any:
        hinge, R = frames[name]
        return hinge + R @ (x, y)

    link(1, (0, 0), beta, (v["ra"], 0))
    link(2, point("K1", v["rr"], 0), beta + theta, (-v["da"], 0))
    link(3, B, gamma, (v["sb"], -v["sa"]))
    link(5, A, delta, (v["ta"], v["tb"]))
    link(4, point("K5", v["zt"], 0), phi + delta, (0, v["ea"] - v["e"]))
    link(7, A, epsilon, (-v["ub"], -v["ua"]))
    link(6, point("K7", 0, -v["u"]), omega + epsilon, (v["zf"] - v["fa"], 0))
    E = point("K3", 0, -v["ss"])
    for name, a, b, joint_point in (
            ("O", "ground", "K1", (0, 0)), ("F", "K1", "K2", frames["K2"][0]),
            ("B", "ground", "K3", B), ("A5", "ground", "K5", A), ("H", "K5", "K4", frames["K4"][0]),
            ("A7", "ground", "K7", A), ("G", "K7", "K6", frames["K6"][0]), ("E3", "K2", "K3", E),
            ("E4", "K2", "K4", E), ("E6", "K2", "K6", E)):
        build.revolute(name, a, b, axis=(0, 0, 1), at=(*np.real(joint_point), 0))
    centre = np.array([v["sb"], -v["sa"]])
    build.spring("spring", "K3", "ground", stiffness=v["c0"], length=v["l0"],
                 on_a=(*((v["sd"], -v["sc"]) - centre), 0), on_b=(v["xc"], v["yc"], 0))
    return build


def andrews_released() -> gs.Model:
    """Return Andrews' mechanism at t = 0.03 s of the reference solution, its torque then off."""
    problem = reference("andrews")
    angles, rates = ([float(problem.truth.value(name)) for name in problem.groups[group]]
                     for group in ("positions", "velocities"))
    build = andrews(problem.make().in_type(float).parameters, angles, rates)
    return build.model(redundant="leave out")


def _andrews(problem: Reference, model: gs.Model) -> SceneReference:
    build = andrews(model.parameters, model.q0.tolist())
    scene = replace(scene_of(build.model(redundant="leave out")),
                    torques={"K1": np.array([0.0, 0.0, model.parameters["mom"]])})
    ways = (("K1",), ("K2", "K1"), ("K3",), ("K4", "K5"), ("K5",), ("K6", "K7"), ("K7",))

    def read(motions: Motions) -> Numbers:
        turns = {name: 2 * math.atan2(motion.q[3], motion.q[0]) for name, motion in motions.items()}
        rates = {name: motion.omega[2] for name, motion in motions.items()}
        angles, velocities = (
            [numbers[body] - sum(numbers[x] for x in parents) for body, *parents in ways]
            for numbers in (turns, rates))
        true = [float(problem.truth.value(name)) for name in problem.groups["positions"]]
        return {"positions": [_next_to(x, y) for x, y in zip(angles, true, strict=True)],
                "velocities": velocities}

    return SceneReference(scene, read)


def _next_to(angle: float, true: float) -> float:
    """Return the angle with as many whole turns, which no attitude shows, as the true one has."""
    return angle + 2 * math.pi * round((true - angle) / (2 * math.pi))


# ---------------------------------------------------------------- the governors


def _governor(model: gs.Model) -> SceneReference:
    governor = runpy.run_path(str(EXAMPLES / "flyball_governor.py"))["governor"]
    slide = model.p0[2] / model.parameters["M"]
    return SceneReference(scene_of(governor(model.parameters["C"], slide)), _governor_end)


def _governor_end(motions: Motions) -> Numbers:
    """Return the angles of the shaft and of the right rod, the height of the slider, their rates.
    """
    shaft, rod, slider = (motions[name] for name in ("shaft", "right", "slider"))
    down = -math.asin(rotation_matrix(rod.q)[2, 0])
    return {"positions": [2 * math.atan2(shaft.q[3], shaft.q[0]), down, slider.x[2]],
            "velocities": [shaft.omega[2], rod.omega[1], slider.v[2]]}


def at_start(scene: ReferenceScene) -> Motions:
    """Return how the bodies of a scene move at t = 0."""
    return {name: body.start for name, body in scene.bodies.items()}
