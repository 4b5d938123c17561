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

from gyrospark.runtime.rigid_body.quaternion import rotation_matrix

from ..peer_linkages import Array, Hold, Linkage
from .optional import Unavailable, need

__all__ = ["PACKAGE", "TOLERANCES", "PydyBodies"]

PACKAGE = "pydy"
#: What DOP853 is asked for, relative and absolute.
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)


class PydyBodies:
    """Bodies that hang on ball joints, derived and compiled once."""

    def __init__(self, linkage: Linkage) -> None:
        if any(hold.kind != "ball" or hold.b is None for hold in linkage.holds):
            raise Unavailable("derived here for bodies on ball joints that close no loop")
        need("Cython", "cython")
        make = need("pydy.codegen.ode_function_generators", PACKAGE).generate_ode_function
        self._solve = need("scipy.integrate", "scipy").solve_ivp
        self._starts = linkage.starts()
        self._holds = {hold.b: hold for hold in linkage.holds if hold.b is not None}
        self._gravity = np.array(linkage.gravity)
        self._rates = make(*self._equations(), generator="cython", time_first=True,
                           constants_arg_type="array")

    def run(self, tolerance: float, t_end: float) -> Array:
        """Return the centres of mass at ``t_end``."""
        bodies = [self._starts[i] for i in self._holds]
        state = np.concatenate([*(body.q for body in bodies), *(body.omega for body in bodies)])
        found = self._solve(self._slopes, (0.0, t_end), state, method="DOP853", rtol=tolerance,
                            atol=tolerance, t_eval=[t_end])
        return self._centres(found.y[:4 * len(bodies), -1].reshape(-1, 4))

    def _slopes(self, t: float, state: Array) -> Array:
        """Return the rates in an array of their own: PyDy's is one for all calls, SciPy keeps it.
        """
        slopes: Array = self._rates(t, state, self._gravity)
        return slopes.copy()

    def _centres(self, attitudes: Array) -> Array:
        """Return the centres of mass of attitudes in the order of the joints."""
        x: dict[int | None, Array] = {None: np.zeros(3)}
        R = {None: np.eye(3)} | {i: rotation_matrix(q / np.linalg.norm(q))
                                 for i, q in zip(self._holds, attitudes, strict=True)}
        for i, hold in self._holds.items():
            at = x[hold.a] + R[hold.a] @ self._seen(hold.a, hold)
            x[i] = at - R[i] @ self._seen(i, hold)
        return np.array([x[i] for i in range(len(self._starts))])

    def _seen(self, i: int | None, hold: Hold) -> Array:
        """Return where a joint is in body i, from its mass centre; None is the ground."""
        at = np.array(hold.at)
        return at if i is None else rotation_matrix(self._starts[i].q).T @ (at - self._starts[i].x)

    def _equations(self) -> tuple[Any, ...]:
        """Return M u' = F, q' and the gravity as PyDy takes them."""
        space, origin = me.ReferenceFrame("N"), me.Point("O")
        origin.set_vel(space, 0)
        gravity = sp.symbols("gx gy gz")
        placed: dict[int | None, Any] = {None: me.RigidBody("ground", origin, space)}
        q, u, turning = [], [], []
        for i, hold in self._holds.items():
            attitude, speeds = me.dynamicsymbols(f"q{i}_:4"), me.dynamicsymbols(f"u{i}_:3")
            frame = _turned(space, f"A{i}", attitude, speeds)
            joint = placed[hold.a].masscenter.locatenew(
                f"J{i}", _vector(placed[hold.a].frame, self._seen(hold.a, hold)))
            joint.v2pt_theory(placed[hold.a].masscenter, space, placed[hold.a].frame)
            centre = joint.locatenew(f"C{i}", -_vector(frame, self._seen(i, hold)))
            centre.v2pt_theory(joint, space, frame)
            start = self._starts[i]
            placed[i] = me.RigidBody(f"B{i}", centre, frame, start.mass,
                                     (me.inertia(frame, *start.moments), centre))
            q += attitude
            u += speeds
            turning += _quaternion_rates(attitude, speeds)
        kane = me.KanesMethod(space, q, u, kd_eqs=[
            x.diff() - rate for x, rate in zip(q, turning, strict=True)])
        bodies = [body for i, body in placed.items() if i is not None]
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
    """q' = ½ q (0, Ω)."""
    w, v, turn = q[0], sp.Matrix(q[1:]), sp.Matrix(omega)
    return [-v.dot(turn) / 2, *((w * turn + v.cross(turn)) / 2)]
