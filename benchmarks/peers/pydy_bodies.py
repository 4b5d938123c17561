"""PyDy: Kane's equations by sympy.physics.mechanics, their C compiled by PyDy, SciPy's DOP853.

The speeds are the bodies' angular velocities in themselves, with which Kane's equations are
shortest, and the attitudes quaternions. Mass matrix and forces are C; NumPy solves for the
accelerations, and the step is SciPy's, in Python.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import sympy as sp
from sympy.physics import mechanics as me

from ..attitudes import Array, rotation_matrix
from ..scenes import GROUND, ReferenceScene, SceneJoint
from .optional import Unavailable, need

__all__ = ["PACKAGE", "TOLERANCES", "PydyBodies"]

PACKAGE = "pydy"
#: Tolerances of DOP853, relative and absolute.
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


class PydyBodies:
    """Equations of bodies on ball joints by PyDy, derived and compiled once."""

    def __init__(self, scene: ReferenceScene) -> None:
        self._joints = {joint.b: joint for joint in scene.joints}
        if (any(joint.kind != "ball" for joint in scene.joints)
                or list(self._joints) != list(scene.bodies)):
            raise Unavailable("derived here for bodies on ball joints that close no loop")
        need("Cython", "cython")
        make = need("pydy.codegen.ode_function_generators", PACKAGE).generate_ode_function
        self._solve = need("scipy.integrate", "scipy").solve_ivp
        self._bodies, self._gravity = scene.bodies, np.array(scene.gravity)
        self._rates = make(*self._equations(), generator="cython", time_first=True,
                           constants_arg_type="array")

    def run(self, tolerance: float, t_end: float) -> Array:
        """Return the centres of mass at ``t_end``."""
        starts = [body.start for body in self._bodies.values()]
        state = np.concatenate([*(start.q for start in starts), *(start.omega for start in starts)])
        end = self._solve(self._slopes, (0.0, t_end), state, method="DOP853", rtol=tolerance,
                          atol=tolerance, t_eval=[t_end])
        return self._centres(end.y[:4 * len(starts), -1].reshape(-1, 4))

    def _slopes(self, t: float, state: Array) -> Array:
        """Return a copy of the rates: PyDy fills one array in all calls, and SciPy stores it."""
        slopes: Array = self._rates(t, state, self._gravity)
        return slopes.copy()

    def _centres(self, attitudes: Array) -> Array:
        """Return the centres of mass of attitudes in the order of the bodies."""
        x = {GROUND: np.zeros(3)}
        R = {GROUND: np.eye(3)} | {name: rotation_matrix(q / np.linalg.norm(q))
                                   for name, q in zip(self._bodies, attitudes, strict=True)}
        for name, joint in self._joints.items():
            point = x[joint.a] + R[joint.a] @ self._seen(joint.a, joint)
            x[name] = point - R[name] @ self._seen(name, joint)
        return np.array([x[name] for name in self._bodies])

    def _seen(self, name: str, joint: SceneJoint) -> Array:
        """Return where a joint is in a body, from its mass centre."""
        if name == GROUND:
            return joint.at
        start = self._bodies[name].start
        point: Array = rotation_matrix(start.q).T @ (joint.at - start.x)
        return point

    def _equations(self) -> tuple[Any, ...]:
        """Return M u' = F, q' and the gravity as PyDy takes them."""
        space, origin = me.ReferenceFrame("N"), me.Point("O")
        origin.set_vel(space, 0)
        gravity = sp.symbols("gx gy gz")
        rigid_bodies: dict[str, Any] = {GROUND: me.RigidBody("ground", origin, space)}
        q, u, turning = [], [], []
        for i, (name, joint) in enumerate(self._joints.items()):
            attitude, speeds = me.dynamicsymbols(f"q{i}_:4"), me.dynamicsymbols(f"u{i}_:3")
            frame, above = _turned(space, f"A{i}", attitude, speeds), rigid_bodies[joint.a]
            point = above.masscenter.locatenew(
                f"J{i}", _vector(above.frame, self._seen(joint.a, joint)))
            point.v2pt_theory(above.masscenter, space, above.frame)
            centre = point.locatenew(f"C{i}", -_vector(frame, self._seen(name, joint)))
            centre.v2pt_theory(point, space, frame)
            body = self._bodies[name]
            rigid_bodies[name] = me.RigidBody(
                f"B{i}", centre, frame, body.mass,
                (me.inertia(frame, *np.diag(body.inertia)), centre))
            q += attitude
            u += speeds
            turning += _quaternion_rates(attitude, speeds)
        kane = me.KanesMethod(space, q, u, kd_eqs=[
            x.diff() - rate for x, rate in zip(q, turning, strict=True)])
        bodies = [body for name, body in rigid_bodies.items() if name != GROUND]
        kane.kanes_equations(bodies, [
            (body.masscenter, body.mass * _vector(space, gravity)) for body in bodies])
        return kane.forcing, q, u, gravity, kane.mass_matrix, sp.Matrix(turning)


def _turned(space: Any, name: str, attitude: list[Any], speeds: list[Any]) -> Any:
    """Return a frame of this attitude that turns with these speeds in itself."""
    frame = me.ReferenceFrame(name)
    frame.orient_quaternion(space, attitude)
    frame.set_ang_vel(space, _vector(frame, speeds))  # not by the attitude's rates
    frame.set_ang_acc(space, _vector(frame, [speed.diff() for speed in speeds]))
    return frame


def _vector(frame: Any, entries: Iterable[Any]) -> Any:
    return sum((x * e for x, e in zip(entries, (frame.x, frame.y, frame.z), strict=True)),
               me.Vector(0))


def _quaternion_rates(q: list[Any], omega: list[Any]) -> list[Any]:
    """Return q' = ½ q (0, Ω)."""
    w, v, turn = q[0], sp.Matrix(q[1:]), sp.Matrix(omega)
    return [-v.dot(turn) / 2, *((w * turn + v.cross(turn)) / 2)]
