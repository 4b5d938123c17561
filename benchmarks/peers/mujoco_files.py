"""MuJoCo runs of a robot in MJCF; states are converted to (q, p) of the model of the same file.

Equality constraints have the largest stiffness that MuJoCo allows at a time step.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..attitudes import Array, rotation_matrix
from ..scenes import ReferenceScene, SceneMotion
from .mujoco_scenes import configure, moved, mujoco_module
from .optional import Unavailable

__all__ = ["MujocoFile"]

#: Iterations that find joint coordinates of the start, and how far bodies may be off, m and rad.
_ITERATIONS, _OFF = 50, 1e-12


class MujocoFile:
    """A robot in MuJoCo; ``scene`` has the bodies of the model, whose origins are their centres."""

    def __init__(self, text: str, scene: ReferenceScene) -> None:
        self._mujoco = mujoco_module()
        self._scene = scene
        self._model = model = self._mujoco.MjModel.from_xml_string(text)
        moving = [k for k in range(model.nbody) if model.body_jntnum[k]]
        #: Body → its number.
        self._numbers = dict(zip(scene.bodies, moving, strict=True))
        data = self._mujoco.MjData(model)
        self._mujoco.mj_forward(model, data)
        self._centres = {k: self._centre(data, k) for k in moving}
        self._start(data)
        self._qpos, self._qvel = data.qpos.copy(), data.qvel.copy()

    def pieces(
        self, integrator: str, dt: float, steps: int, count: int
    ) -> Iterator[tuple[Array, Array]]:
        """Yield states (q, p) at the end of each of ``count`` pieces of a run.

        Raises
        ------
        Unavailable
            Where MuJoCo finds the motion unstable.
        """
        data = self._mujoco.MjData(self._model)
        configure(self._mujoco, self._model, integrator, dt)
        data.qpos[:], data.qvel[:] = self._qpos, self._qvel
        for snapshot in itertools.islice(
                moved(self._mujoco, self._model, data, steps), count):
            yield self._state(snapshot)

    def _centre(self, data: Any, k: int) -> Array:
        """Return the centre of mass of a body with all that is fixed to it, in its axes."""
        welded = self._model.body_weldid == k
        masses = self._model.body_mass[welded]
        centre: Array = data.xmat[k].reshape(3, 3).T @ (
            masses @ data.xipos[welded] / masses.sum() - data.xpos[k])
        return centre

    def _start(self, data: Any) -> None:
        """Find coordinates and velocities at which the bodies are and move as in the scene."""
        mujoco, model = self._mujoco, self._model
        for _ in range(_ITERATIONS):
            rows, deviations, velocities = [], [], []
            for name, k in self._numbers.items():
                start, R = self._scene.bodies[name].start, data.xmat[k].reshape(3, 3)
                x, rotation = data.xpos[k] + R @ self._centres[k], np.zeros(3)
                mujoco.mju_subQuat(rotation, start.q, data.xquat[k])  # in the axes of the body
                move, turn = np.zeros((3, model.nv)), np.zeros((3, model.nv))
                mujoco.mj_jac(model, data, move, turn, x, k)
                rows += [move, turn]
                deviations += [start.x - x, R @ rotation]
                velocities += [start.v, rotation_matrix(start.q) @ start.omega]
            step, data.qvel[:] = np.linalg.lstsq(
                np.vstack(rows), np.column_stack([np.concatenate(deviations),
                                                  np.concatenate(velocities)]),
                rcond=None)[0].T
            if np.abs(np.concatenate(deviations)).max() < _OFF:
                return
            mujoco.mj_integratePos(model, data.qpos, step, 1.0)
            mujoco.mj_forward(model, data)
        raise Unavailable("finds no joint coordinates of the start")

    def _state(self, data: Any) -> tuple[Array, Array]:
        motions = {}
        for name, k in self._numbers.items():
            R, velocity = data.xmat[k].reshape(3, 3), np.zeros(6)
            self._mujoco.mj_objectVelocity(self._model, data, self._mujoco.mjtObj.mjOBJ_XBODY, k,
                                           velocity, 0)
            arm = R @ self._centres[k]
            motions[name] = SceneMotion(data.xquat[k].copy(), data.xpos[k] + arm,
                                        velocity[3:] + np.cross(velocity[:3], arm),
                                        R.T @ velocity[:3])
        end, model = self._scene.end(motions), self._model
        q, p = end.q[0], end.p[0]
        for j in range(model.njnt):
            v = model.jnt_dofadr[j]
            if model.dof_armature[v]:  # its rotor is a coordinate of the model
                index = end.coordinates.index(
                    re.sub(r"\W", "_", model.joint(j).name) + "_rotor_phi")
                q[index] = data.qpos[model.jnt_qposadr[j]]
                p[index] = model.dof_armature[v] * data.qvel[v]
        return q, p
