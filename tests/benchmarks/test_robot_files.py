"""Robots of MJCF files in ``reference robots``: what conserves energy, and the same in MuJoCo."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from benchmarks.long_runs import Mechanism, long_runs_page, measure_long_runs
from benchmarks.peers.mujoco_files import MujocoFile
from benchmarks.robot_files import conservative_text
from gyrospark.core.errors import InputError, InputWarning

FOUR_BAR = """
<mujoco model="bars">
  <compiler angle="radian"/>
  <option timestep="0.01"/>
  <default><joint axis="0.02 1 0" damping="3" range="-2 2"/></default>
  <worldbody>
    <body name="stand" pos="0 0 1">
      <freejoint/>
      <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
      <body name="crank-arm">
        <joint name="crank-arm" armature="0.3" frictionloss="0.1"/>
        <inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.02 0.02"/>
        <geom type="sphere" size="0.1"/>
        <body name="bar" pos="0.3 0 0">
          <joint name="pin" stiffness="2" springref="0.4"/>
          <inertial pos="0.4 0 0" mass="1.5" fullinertia="0.02 0.1 0.1 0.001 0 0"/>
          <body name="tip" pos="0.4 0 0">
            <inertial pos="0 0 0.1" mass="0.2" diaginertia="0.001 0.001 0.001"/>
          </body>
        </body>
      </body>
      <body name="rocker" pos="1 0 -0.5">
        <joint name="rocker"/>
        <inertial pos="0 0 0.3" mass="1" diaginertia="0.03 0.03 0.01"/>
      </body>
    </body>
  </worldbody>
  <equality><connect body1="rocker" body2="bar" anchor="0 0 0.5"/></equality>
  <actuator><motor joint="pin"/></actuator>
  <keyframe><key qpos="0 0 1 1 0 0 0 0.3 -0.3 -0.1" qvel="0 0 0 0 0 0 1 0 0"/></keyframe>
</mujoco>
"""


@pytest.fixture(scope="module")
def four_bar(tmp_path_factory):
    path = tmp_path_factory.mktemp("robots") / "bars.xml"
    path.write_text(FOUR_BAR)
    with pytest.warns(InputWarning, match="crank_arm"):  # its keyframe leaves the loop open
        return Mechanism.of_file(path)


def test_a_file_is_held_and_loses_nothing(four_bar):
    """The base, dampers and motors are out; tip and bar are one body of a loop of three."""
    model = four_bar.scene.model
    assert not any(model.system.forces)
    assert not model.system.inputs
    assert [at.name for at in model.system.bodies] == ["crank_arm", "bar", "rocker"]
    assert (model.system.n, model.system.m, four_bar.dt) == (22, 21, 1e-3)
    start = dict(zip(map(str, model.system.q), model.q0, strict=True))
    assert start["crank_arm_rotor_phi"] == pytest.approx(0.3, abs=0.05)  # the loop is closed
    assert "bars" in long_runs_page({four_bar: []})


@pytest.mark.slow
def test_a_file_runs(four_bar):
    (run,) = measure_long_runs(four_bar, steps=200, stages=(2,))
    assert run.constraint < 1e-14
    assert 0 < run.energy < 1e-7


@pytest.mark.slow  # MuJoCo beside a compiled chain
def test_mujoco_has_the_same_robot(four_bar):
    """Its states at the start are ours; its equality, which is soft, goes to ours in small steps.
    """
    pytest.importorskip("mujoco")
    scene = four_bar.scene
    machine = MujocoFile(four_bar.mjcf, scene)
    (begin,) = machine.pieces("RK4", 1e-12, 1, 1)
    for found, ours in zip(begin, (scene.model.q0, scene.model.p0), strict=True):
        assert found == pytest.approx(ours, abs=1e-10)
    run = four_bar.stepper(2).integrate(scene.model.q0, scene.model.p0, dt=5e-4, steps=200,
                                        parameters=scene.model.parameters, every=200)
    errors = []
    for steps in (200, 400, 800):
        (end,) = machine.pieces("RK4", 0.1 / steps, steps, 1)
        errors.append(np.abs(end[0] - run.q[-1]).max())
    assert errors[0] < 1e-4
    assert all(fine < 0.7 * coarse for coarse, fine in itertools.pairwise(errors))


@pytest.mark.parametrize(("text", "message"), [
    ("<robot/>", r"'x\.xml'.*<robot>"),
    ("<mujoco><worldbody><body/><body/></worldbody></mujoco>", r"'x\.xml'.*2 bodies"),
    ("<mujoco>", r"'x\.xml'.*line 1")])
def test_files_that_cannot_be_used_are_refused(text, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path.__class__("x.xml")
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        conservative_text(path)
