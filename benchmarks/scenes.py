"""Bodies on joints as another program must build them, read off the record of a model's system.

A scene has no equations: masses, inertia, where bodies are and how they move at t = 0, points and
axes of joints in space then. The ``SceneMotion`` of each body, which another program returns,
becomes a state (q, p) of the model again, so that it is read as our own runs are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
import sympy as sp

import gyrospark as gs

from .attitudes import Array, angular_velocity, left_matrix, rotation_matrix
from .peers.optional import Unavailable

__all__ = ["GROUND", "ReferenceScene", "SceneBody", "SceneJoint", "SceneMotion", "SceneSpring",
           "bodies_of", "scene_of"]

GROUND = ""


@dataclass(frozen=True)
class SceneMotion:
    """Where a body is and how it moves: quaternion; origin and its velocity in space; Ω in it."""

    q: Array
    x: Array
    v: Array
    omega: Array


@dataclass(frozen=True)
class SceneBody:
    """A body at t = 0.

    Attributes
    ----------
    mass, inertia, centre
        In kg; the tensor about the centre of mass in body axes, 0 of a point; the centre of mass
        from the origin.
    start : SceneMotion
    held : bool
        Whether the origin stays where it is.
    """

    mass: float
    inertia: Array
    centre: Array
    start: SceneMotion
    held: bool = False

    @property
    def about_origin(self) -> Array:
        """The tensor about the origin."""
        c = self.centre
        tensor: Array = self.inertia + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        return tensor


@dataclass(frozen=True)
class SceneJoint:
    """A joint at a point of space at t = 0; bodies by name, ``GROUND`` the ground.

    A rod holds a point mass at its distance from a point of the ground.

    Attributes
    ----------
    axes : ndarray, shape (3, 3)
        Rows in space: of a hinge and a slide n₁, n₂ and the axis, of a cross the arm in a, the arm
        in b and the direction across both; of others the axes of space.
    holds : tuple of bool
        Of a ball, hinge or cross whether it keeps its point together along x, y and z; of a hinge
        then whether n₁ and n₂ of a stay across the axis of b. What others imply is left out.
    """

    kind: Literal["ball", "hinge", "slide", "cross", "rod"]
    a: str
    b: str
    at: Array
    axes: Array
    holds: tuple[bool, ...]


@dataclass(frozen=True)
class SceneSpring:
    """A spring and damper between points of two bodies, in body axes from their origins."""

    a: str
    b: str
    on_a: Array
    on_b: Array
    stiffness: float
    length: float
    damping: float


@dataclass(frozen=True)
class ReferenceScene:
    """A model with its bodies, joints and springs; ``torques`` are constant in space."""

    name: str
    model: gs.Model
    gravity: Array
    bodies: Mapping[str, SceneBody]
    joints: tuple[SceneJoint, ...] = ()
    springs: tuple[SceneSpring, ...] = ()
    torques: Mapping[str, Array] = field(default_factory=dict)

    @property
    def planar(self) -> bool:
        """Whether all bodies turn about z alone, on hinges, and nothing pulls out of the plane."""
        hinges = all(joint.kind == "hinge" and not joint.axes[2, :2].any()
                     for joint in self.joints)
        flat = all(body.inertia.any() and not body.held
                   and not body.start.omega[:2].any() and not body.start.v[2]
                   and not rotation_matrix(body.start.q)[2, :2].any()
                   for body in self.bodies.values())
        return hinges and flat and not self.gravity[2] and not any(
            torque[:2].any() for torque in self.torques.values())

    def end(self, motions: Mapping[str, SceneMotion]) -> FinalState:
        """Return the state of the model whose bodies have these motions."""
        system = self.model.system
        indices = {x: i for i, x in enumerate(system.q)}
        q, p = np.zeros(system.n), np.zeros(system.n)
        if not system.bodies:
            (motion,), (body,) = motions.values(), self.bodies.values()
            q[:], p[:] = motion.x[:system.n], body.mass * motion.v[:system.n]
        for layout in system.bodies:
            motion, body = motions[layout.name], self.bodies[layout.name]
            turn = [indices[x] for x in layout.q]
            q[turn] = motion.q
            p[turn] = 2 * left_matrix(motion.q).T @ (body.about_origin @ motion.omega)
            if layout.x:
                move = [indices[x] for x in layout.x]
                q[move], p[move] = motion.x, body.mass * motion.v
        return FinalState(tuple(map(str, system.q)), q[None], p[None])


@dataclass(frozen=True)
class FinalState:
    """A run of one state, as far as a reference problem reads one."""

    coordinates: tuple[str, ...]
    q: Array
    p: Array


def scene_of(model: gs.Model) -> ReferenceScene:
    """Return bodies, joints, springs and gravity of a model, for other programs.

    Raises
    ------
    Unavailable
        For a system that does not say where its bodies are, and for a joint that is none of ours.
    """
    if not model.system.bodies:
        raise Unavailable(f"{model.name} has no record of bodies")
    model = model.in_type(float)
    values, bodies = dict(model.parameters), bodies_of(model)
    gravity = np.array([values.get(f"gravity_{axis}", 0.0) for axis in "xyz"])
    if all(layout.mass is None for layout in model.system.bodies):
        gravity = np.array([0.0, 0.0, -_pull(model)])
    joints, springs = [], []
    for layout in model.system.joints:
        if layout.constraint_forces:
            joints.append(_joint(layout, bodies, values))
        else:
            springs.append(_spring(layout, values))
    return ReferenceScene(model.name, model, gravity, bodies, tuple(joints), tuple(springs))


# ---------------------------------------------------------------- bodies


def bodies_of(model: gs.Model) -> dict[str, SceneBody]:
    """Return the bodies of a model in double precision at t = 0."""
    return {layout.name: _body(layout, model) for layout in model.system.bodies}


def _body(layout: Any, model: gs.Model) -> SceneBody:
    values, indices = model.parameters, {x: i for i, x in enumerate(model.system.q)}
    entries = [float(values[str(x)]) for x in layout.inertia]
    if len(entries) == 3:
        inertia = np.diag(entries)
    else:  # the upper triangle of J⁻¹
        inverse = np.zeros((3, 3))
        inverse[np.triu_indices(3)] = entries
        inertia = np.linalg.inv(inverse + np.triu(inverse, 1).T)
    turn, move = [indices[x] for x in layout.q], [indices[x] for x in layout.x]
    q, p = (np.asarray(state, dtype=float) for state in (model.q0, model.p0))
    omega = angular_velocity(q[turn], p[turn], inertia)
    if layout.x:
        assert layout.mass is not None
        mass = _number(layout.mass, values)
        start = SceneMotion(q[turn], q[move], p[move] / mass, omega)
        return SceneBody(mass, inertia, np.zeros(3), start)
    start = SceneMotion(q[turn], _vector(layout.origin, values), np.zeros(3), omega)
    if layout.mass is None:
        mass, centre = 1.0, _moment(model) / (_pull(model) or 1.0)
    else:
        mass, centre = _number(layout.mass, values), _vector(layout.centre, values)
    body = SceneBody(mass, inertia, centre, start, held=True)
    return SceneBody(mass, 2 * inertia - body.about_origin, centre, start, held=True)


def _moment(model: gs.Model) -> Array:
    """Return w of V = w · (R₃₁, R₃₂, R₃₃), mass times gravity times the centre of mass.

    Raises
    ------
    Unavailable
        If V is no such potential.
    """
    system = model.system
    potential = system.H.subs(dict.fromkeys(system.p, 0)).subs(
        {x: sp.Float(float(model.parameters[str(x)])) for x in system.parameters})
    half = np.sqrt(0.5)
    upright = np.array([[half, 0, -half, 0], [half, half, 0, 0], [1, 0, 0, 0]])
    attitudes = [*upright, np.array([0.5, 0.1, -0.7, 0.5])]
    V = [float(potential.subs(dict(zip(system.q, map(sp.Float, q), strict=True))))
         for q in attitudes]
    rows = [rotation_matrix(q)[2] for q in attitudes]
    w: Array = np.linalg.solve(np.array(rows[:3]), V[:3])
    if not np.isclose(rows[3] @ w, V[3], rtol=0, atol=1e-12 * (1 + np.abs(w).max())):
        raise Unavailable(f"the potential of {model.name} is not that of a weight")
    return np.where(np.abs(w) < 1e-12 * np.abs(w).max(), 0.0, w)


def _pull(model: gs.Model) -> float:
    """Return a gravity that gives a body of 1 kg the moment of its weight.

    It puts the centre of mass so near the fixed point that m |c|² is a hundredth of the smallest
    moment of inertia, as a real body can have it.
    """
    smallest_moment = min(float(model.parameters[str(x)])
                          for layout in model.system.bodies for x in layout.inertia)
    return float(np.linalg.norm(_moment(model)) / np.sqrt(smallest_moment / 100))


# ---------------------------------------------------------------- joints and springs


def _joint(
    layout: Any, bodies: Mapping[str, SceneBody], values: Mapping[str, float]
) -> SceneJoint:
    forces = {name.partition(": ")[2]: pull for name, pull in layout.constraint_forces}
    point = _in_space(layout.a, _vector(layout.on_a, values), bodies)
    points = tuple(axis in forces for axis in "xyz")
    if "cross" in forces:
        pull = forces["cross"]
        assert pull is not None
        first, second = (_turned(name, _vector(arm, values), bodies)
                         for name, arm in ((layout.a, pull.on_a), (layout.b, pull.on_b)))
        return SceneJoint("cross", layout.a, layout.b, point,
                          np.array([first, second, np.cross(first, second)]), points)
    if not layout.axis_a:
        return SceneJoint("ball", layout.a, layout.b, point, np.eye(3), points)
    normals = _vector(layout.axis_a, values).reshape(2, 3)
    axes = np.array([*(_turned(layout.a, n, bodies) for n in normals),
                     _turned(layout.b, _vector(layout.axis_b, values), bodies)])
    if any(name.startswith(("across", "turn")) for name in forces):
        if len(forces) != 5:
            raise Unavailable(f"{layout.name} is neither a hinge nor a slide")
        return SceneJoint("slide", layout.a, layout.b, point, axes, ())
    return SceneJoint("hinge", layout.a, layout.b, point, axes,
                      (*points, "axis 1" in forces, "axis 2" in forces))


def _spring(layout: Any, values: Mapping[str, float]) -> SceneSpring:
    return SceneSpring(layout.a, layout.b,
                       _vector(layout.on_a, values), _vector(layout.on_b, values),
                       values[f"{layout.name}_stiffness"], values.get(f"{layout.name}_length", 0.0),
                       values.get(f"{layout.name}_damping", 0.0))


def _in_space(name: str, point: Array, bodies: Mapping[str, SceneBody]) -> Array:
    if name == GROUND:
        return point
    position: Array = bodies[name].start.x + _turned(name, point, bodies)
    return position


def _turned(name: str, direction: Array, bodies: Mapping[str, SceneBody]) -> Array:
    if name == GROUND:
        return direction
    turned: Array = rotation_matrix(bodies[name].start.q) @ direction
    return turned


def _vector(entries: Any, values: Mapping[str, float]) -> Array:
    return np.array([_number(e, values) for e in entries])


def _number(entry: Any, values: Mapping[str, float]) -> float:
    return float(values[str(entry)] if isinstance(entry, sp.Symbol) else entry)
