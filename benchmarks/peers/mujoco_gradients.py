"""MuJoCo: finite differences of every step (``mjd_transitionFD``), by the start alone.

Its Runge-Kutta method is refused there; ``implicit`` is of order 1. A cotangent of the end goes
backwards through the steps' matrices.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..attitudes import Array, angular_velocity, left_matrix, rotation_matrix
from ..scenes import ReferenceScene
from .gradient_job import GradientJob, Job, of_euler, top_start
from .mujoco_rk4 import model_of_top
from .mujoco_scenes import MujocoScene
from .optional import need

__all__ = ["PACKAGE", "of_scene", "of_top"]

PACKAGE = "mujoco"
_STEPS = (1e-3,)
#: Size of the finite differences: MuJoCo's, and ours by a start.
_DIFFERENCE = 1e-6


def of_top(t_end: float, target: Array) -> dict[str, Callable[[], Job]]:
    """Return settings of the top, each with the function that prepares it."""
    return {f"transitionFD implicit Δt={dt:g}": partial(_top, dt, t_end, target) for dt in _STEPS}


def of_scene(scene: ReferenceScene, t_end: float) -> dict[str, Callable[[], Job]]:
    """Return settings of bodies on joints, each with the function that prepares it."""
    return {f"transitionFD implicit Δt={dt:g}": partial(_joined, scene, dt, t_end)
            for dt in _STEPS}


def _top(dt: float, t_end: float, target: Array) -> Job:
    mujoco = need(PACKAGE)
    model = model_of_top(dt)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICIT
    start = top_start()

    def by_end(data: Any) -> Array:
        cotangent = _turning(data.qpos).T @ (2 * (data.qpos - target))
        return np.concatenate([cotangent, np.zeros(3)])

    back, primal = _steps(model, start[:4], start[4:], round(t_end / dt), by_end)

    def gradient() -> GradientJob:
        by_start = back()
        # A turn δ in the body's axes is dq = ½ L(q)ᵀδ, so that δ = 2 L dq.
        return of_euler(np.concatenate([4 * _turning(start[:4]) @ by_start[:3], by_start[3:]]),
                        None)

    return Job(gradient, primal)


def _turning(q: Array) -> Array:
    """Return ½ L(q)ᵀ, which maps a turn in body axes to dq."""
    matrix: Array = left_matrix(q).T / 2
    return matrix


def _steps(
    model: Any, qpos: Array, qvel: Array, steps: int, by_end: Callable[[Any], Array]
) -> tuple[Callable[[], Array], Callable[[], object]]:
    """Return the gradient by (turns and moves, speeds) of the start, and the run alone."""
    mujoco = need(PACKAGE)
    data = mujoco.MjData(model)
    A = np.zeros((steps, 2 * model.nv, 2 * model.nv))

    def begin() -> None:
        mujoco.mj_resetData(model, data)
        data.qpos[:], data.qvel[:] = qpos, qvel

    def gradient() -> Array:
        begin()
        for k in range(steps):
            mujoco.mjd_transitionFD(model, data, _DIFFERENCE, True, A[k], None, None, None)
            mujoco.mj_step(model, data)
        w = by_end(data)
        for step in A[::-1]:
            w = w @ step
        return w

    def primal() -> None:
        begin()
        mujoco.mj_step(model, data, steps)

    return gradient, primal


def _joined(scene: ReferenceScene, dt: float, t_end: float) -> Job:
    mujoco = need(PACKAGE)
    steps = round(t_end / dt)
    model = MujocoScene(scene).model("implicit", dt)
    nv, last = model.nv, model.body(list(scene.bodies)[-1]).id
    start, coordinates = mujoco.MjData(model), _Coordinates(scene, model)
    mujoco.mj_forward(model, start)

    def by_end(data: Any) -> Array:
        mujoco.mj_forward(model, data)
        jacobian = np.zeros((3, nv))
        mujoco.mj_jacBodyCom(model, data, jacobian, None, last)
        return np.concatenate([2 * data.xipos[last] @ jacobian, np.zeros(nv)])

    z = np.concatenate([scene.model.q0, scene.model.p0])
    back, primal = _steps(model, start.qpos.copy(), coordinates(z)[nv:], steps, by_end)
    matrix = np.array([(coordinates(z + e) - coordinates(z - e)) / (2 * _DIFFERENCE)
                       for e in np.eye(len(z)) * _DIFFERENCE])

    def gradient() -> GradientJob:
        by_state = matrix @ back()
        return GradientJob(by_state[: len(z) // 2], by_state[len(z) // 2 :])

    return Job(gradient, primal)


class _Coordinates:
    """Map our (q, p) to turns and moves of MuJoCo's joints from the start, and to their speeds."""

    def __init__(self, scene: ReferenceScene, model: Any) -> None:
        self._mujoco, self._scene, self._model = need(PACKAGE), scene, model
        self._base = self._mujoco.MjData(model).qpos.copy()
        self._at_start = self._jacobian(self._base)

    def __call__(self, z: Array) -> Array:
        rows = z.reshape(2, -1, 7)
        displacements, rates = list[Array](), list[Array]()
        for body, q, p in zip(self._scene.bodies.values(), *rows, strict=True):
            turn = 2 * left_matrix(body.start.q) @ q[:4]
            displacements += [q[4:] - body.start.x, rotation_matrix(body.start.q) @ turn]
            unit = q[:4] / np.linalg.norm(q[:4])
            rates += [p[4:] / body.mass,
                      rotation_matrix(unit) @ angular_velocity(q[:4], p[:4], body.inertia)]
        move = np.linalg.lstsq(self._at_start, np.concatenate(displacements))[0]
        qpos = self._base.copy()
        self._mujoco.mj_integratePos(self._model, qpos, move, 1.0)
        speeds = np.linalg.lstsq(self._jacobian(qpos), np.concatenate(rates))[0]
        return np.concatenate([move, speeds])

    def _jacobian(self, qpos: Array) -> Array:
        """Return velocities and turning of the bodies, in space, by speeds of the joints."""
        data = self._mujoco.MjData(self._model)
        data.qpos[:] = qpos
        self._mujoco.mj_forward(self._model, data)
        rows = []
        for name in self._scene.bodies:
            move, turn = np.zeros((2, 3, self._model.nv))
            self._mujoco.mj_jacBodyCom(self._model, data, move, turn, self._model.body(name).id)
            rows += [move, turn]
        return np.vstack(rows)
