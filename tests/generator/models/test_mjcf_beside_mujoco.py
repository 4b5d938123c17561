"""Robots in MJCF of PyPI's wheels: accelerations and mass matrices are MuJoCo's.

    pip install mujoco gymnasium playground   # without them nothing is tested here
"""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.generator.models.mjcf_document import read_document
from gyrospark.generator.models.mjcf_robot import COMMON, read_mjcf_robot
from gyrospark.generator.models.urdf import plain_name
from robots import Motion

mujoco = pytest.importorskip("mujoco", reason="pip install mujoco")


def files_of(*wheels):
    """Return name → path of the XML files of wheels that are installed."""
    found = {}
    for wheel in wheels:
        try:
            files = metadata.files(wheel) or []
        except metadata.PackageNotFoundError:
            continue
        found |= {f"{wheel}/{file.name}": Path(str(file.locate())) for file in files
                  if file.name.endswith(".xml")}
    return found


FILES = files_of("gymnasium", "playground")


def prepared(path):
    """Return MuJoCo's model at a random state, without what is not modelled here."""
    m = mujoco.MjModel.from_xml_path(str(path))
    off = mujoco.mjtDisableBit
    m.opt.disableflags |= int(off.mjDSBL_CONTACT | off.mjDSBL_LIMIT | off.mjDSBL_FRICTIONLOSS
                              | off.mjDSBL_CLAMPCTRL)
    m.actuator_forcelimited[:] = m.jnt_actfrclimited[:] = 0
    m.opt.density = m.opt.viscosity = 0
    d, rng = mujoco.MjData(m), np.random.default_rng(1)
    mujoco.mj_integratePos(m, d.qpos, rng.uniform(-0.3, 0.3, m.nv), 1.0)
    d.qvel[:] = rng.uniform(-1, 1, m.nv)
    mujoco.mj_forward(m, d)
    return m, d


@pytest.mark.parametrize("name", [
    "gymnasium/inverted_double_pendulum.xml", "gymnasium/ant.xml", "gymnasium/hopper.xml",
    "gymnasium/half_cheetah.xml", "gymnasium/walker2d.xml", "gymnasium/swimmer.xml",
    "gymnasium/point.xml", "gymnasium/humanoid.xml", "playground/acrobot.xml",
    "playground/cartpole.xml", "playground/finger.xml", "playground/fish.xml",
    "playground/ball_in_cup.xml"])
def test_joints_accelerate_as_in_mujoco(name):
    """Hinges and slides, with springs, dampers, armature and control 0: to 1e-11 of the largest."""
    if name not in FILES:
        pytest.skip(f"pip install {name.partition('/')[0]}")
    path = FILES[name]
    m, d = prepared(path)
    robot = read_mjcf_robot(read_document(path.read_text(), path, COMMON), "robot")
    angles, rates, rows = {}, {}, {}
    for k, joint in enumerate(robot.joints.values()):
        q, v = m.jnt_qposadr[k], m.jnt_dofadr[k]
        count = {"free": 6, "ball": 3}.get(joint.kind, 1)
        angles[joint.name] = d.qpos[q:q + joint.count] if count > 1 else float(d.qpos[q])
        rates[joint.name] = d.qvel[v:v + count] if count > 1 else float(d.qvel[v])
        if count == 1:
            kind = "rate" if joint.kind == "hinge" else "speed"
            rows[f"{plain_name(joint.name)}_{kind}"] = v
    motion = Motion(gs.load_mjcf(path, ignore="all", angles=angles, rates=rates))
    M = np.zeros((m.nv, m.nv))
    mujoco.mj_fullM(m, d, M)
    wanted = np.linalg.solve(M, d.qfrc_passive + d.qfrc_actuator - d.qfrc_bias)
    found = np.array([motion.acceleration(row) for row in rows])
    assert np.abs(found - wanted[[*rows.values()]]).max() <= 1e-11 * np.abs(wanted).max()
