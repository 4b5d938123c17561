"""MuJoCo: a body on a ball joint, Runge-Kutta of order 4, its step loop in C (mujoco.rollout).

Its inertia is about the mass centre, I − m l²; the attitude is normalised in every step.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..tops import INERTIA, LEVER, MGL, TopState, state_of, tops
from .entry import PeerEntry, Run
from .optional import need

__all__ = ["PACKAGE", "entries", "model_of_top"]

PACKAGE = "mujoco"
_MASS, _GRAVITY = 1.0, 9.81
_MODEL = """
<mujoco>
  <compiler boundmass="0" boundinertia="0"/>
  <option integrator="RK4" timestep="{dt!r}" gravity="0 0 {gravity!r}"/>
  <worldbody>
    <body>
      <joint type="ball" damping="0" armature="0"/>
      <inertial pos="0 0 {lever!r}" mass="{mass!r}" diaginertia="1 1 1"/>
    </body>
  </worldbody>
</mujoco>
"""


def entries() -> list[PeerEntry]:
    """Return RK4 at three time steps."""
    return [PeerEntry("mujoco", f"RK4 Δt={dt:g}", partial(_prepare, dt), dt,
                      quick=dt == 1e-3)
            for dt in (2e-3, 1e-3, 5e-4)]


def model_of_top(dt: float) -> Any:
    """Return MuJoCo's model of the top."""
    mujoco = need("mujoco")
    assert abs(_MASS * _GRAVITY * LEVER - MGL) < 1e-15
    model = mujoco.MjModel.from_xml_string(_MODEL.format(
        dt=dt, gravity=-_GRAVITY, lever=LEVER, mass=_MASS))
    # Set here because A + B = C, a flat body, is refused in the text for a rounding error.
    model.body_inertia[1] = np.array(INERTIA) - np.array([1.0, 1.0, 0.0]) * _MASS * LEVER**2
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def _prepare(dt: float) -> Run:
    mujoco, rollout = need("mujoco"), need("mujoco.rollout", "mujoco")
    model = model_of_top(dt)
    data = mujoco.MjData(model)
    start = state_of(tops()[0])
    kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
    data.qpos[:], data.qvel[:] = start.q, start.omega
    initial = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, initial, kind)

    def run(t_end: float) -> TopState:
        states, _ = rollout.rollout(model, data, initial, nstep=round(t_end / dt))
        end = states[0, -1]
        return TopState(end[1:5].copy(), end[5:8].copy())  # entry 0 is the time

    return run
