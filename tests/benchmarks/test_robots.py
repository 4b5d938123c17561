"""Mechanisms with closed loops over many steps: our runs, the page, and other programs."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from benchmarks.peers import mujoco_scenes
from benchmarks.peers.mujoco_files import MujocoFile
from benchmarks.robots import MECHANISMS, Mechanism, conservative_text, draw_drift, page
from benchmarks.rows import Row
from benchmarks.scenes import scene_of
from gyrospark.generator.symbolic.numeric_evaluation import evaluate
from gyrospark.generator.systems.numeric_system import numeric
from gyrospark.references.problem_registry import REFERENCES
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix


@pytest.mark.slow  # many bodies; mechanisms of few are benchmarked alike
@pytest.mark.parametrize("name", ["delta_robot", "stewart_platform"])
def test_mechanisms_start_at_rest_on_their_constraints(name):
    """The remaining freedoms are motions of the platform and of legs about themselves."""
    model = getattr(gs.models, name)()
    assert not model.p0.any()
    rods = sum(body.name.startswith(("rod", "tube")) for body in model.system.bodies)
    assert model.system.n - model.system.m == {"delta_robot": 3 + rods,
                                               "stewart_platform": 6 + rods // 2}[name]
    joints = {joint.name: joint for joint in model.system.joints}
    scene = scene_of(model)
    assert len(scene.joints) == len(joints) - len(scene.springs)
    loops = mujoco_scenes.tree_of(scene)[1]
    assert len(loops) == 5
    assert name in MECHANISMS
    ours, reference = _accelerations(model), _newton_euler(scene)
    assert np.abs(ours - reference).max() <= 1e-11 * np.abs(reference).max()


@pytest.mark.slow  # a long derivation
def test_andrews_starts_with_the_work_of_the_torque_until_then():
    """H equals H at rest with 0.033 N m on the crank, −mom β in it, and no torque remains."""
    model, problem = MECHANISMS["andrews"].scene.model, REFERENCES["andrews"]
    start = problem.make().in_type(float)
    work = start.parameters["mom"] * float(problem.truth.value("beta"))
    assert _energy(model) == pytest.approx(_energy(start) + work, rel=1e-12)
    assert not any(model.system.forces)
    assert (model.system.n, model.system.m) == (49, 48)


def _energy(model):
    values = dict.fromkeys(model.system.velocities, 0.0)  # of a Lagrangian, here at rest
    values |= {x: float(model.parameters[str(x)]) for x in model.system.parameters}
    state = zip((*model.system.q, *model.system.p), (*model.q0, *model.p0), strict=True)
    return evaluate([model.system.H], values | {x: float(e) for x, e in state})[0]


def _accelerations(model):
    """Return x'' = (H_pp p')_x of p' = -V_q - g_qᵀ λ at rest, for each body."""
    system = model.system
    store = {x: float(model.parameters[str(x)]) for x in system.parameters}
    V = sp.lambdify([[*system.q]], system.H.xreplace(dict.fromkeys(system.p, sp.S.Zero) | store))
    V_q = np.array([V(model.q0 + 1e-30j * e).imag / 1e-30 for e in np.eye(system.n)])
    numbers = numeric(system, model.parameters)
    G = numbers.G(model.q0)
    H_pp = np.array([numbers.H_p(model.q0, e) for e in np.eye(system.n)])
    pull = np.linalg.solve(G @ H_pp @ G.T, G @ H_pp @ V_q)
    rates, index = H_pp @ (G.T @ pull - V_q), {x: i for i, x in enumerate(system.q)}
    return np.array([rates[[index[x] for x in body.x]] for body in system.bodies])


def _newton_euler(scene):
    """Return x'' by m v' = f, I ω' = τ for bodies at rest whose joints hold points and axes
    together."""
    names, n = list(scene.bodies), 6 * len(scene.bodies)
    attitudes = {name: rotation_matrix(body.start.q) for name, body in scene.bodies.items()}
    M, force, rows = np.zeros((n, n)), np.zeros(n), []

    def motion(name, point):
        """Return the matrix from v and ω of a body to the velocity of a point that moves with
        it."""
        row = np.zeros((3, n))
        if name:
            column = 6 * names.index(name)
            row[:, column : column + 3] = np.eye(3)
            row[:, column + 3 : column + 6] = -np.cross(
                np.eye(3), point - scene.bodies[name].start.x).T
        return row

    for i, (name, body) in enumerate(scene.bodies.items()):
        M[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = body.mass * np.eye(3)
        R = attitudes[name]
        M[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = R @ body.inertia @ R.T
        force[6 * i : 6 * i + 3] = body.mass * scene.gravity
    for spring in scene.springs:
        ends = [(name, scene.bodies[name].start.x + attitudes[name] @ point if name else point)
                for name, point in ((spring.a, spring.on_a), (spring.b, spring.on_b))]
        d = ends[1][1] - ends[0][1]
        pull = spring.stiffness * (1 - spring.length / np.linalg.norm(d)) * d
        force += pull @ (motion(*ends[0]) - motion(*ends[1]))
    for joint in scene.joints:
        relative = motion(joint.b, joint.at) - motion(joint.a, joint.at)
        turn = (motion(joint.b, joint.at + e) - motion(joint.b, joint.at)
                - motion(joint.a, joint.at + e) + motion(joint.a, joint.at)
                for e in np.eye(3))
        if joint.kind == "slide":
            rows += [joint.axes[:2] @ relative, *turn]
        else:
            rows.append(relative)
            if joint.kind == "hinge":
                end_of_axis = joint.at + joint.axes[2]
                rows.append(joint.axes[:2] @ (
                    motion(joint.b, end_of_axis) - motion(joint.a, end_of_axis) - relative))
    J = np.vstack(rows)
    K = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
    accelerations = np.linalg.lstsq(K, np.concatenate([force, np.zeros(len(J))]))[0][:n]
    return accelerations.reshape(-1, 6)[:, :3]


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
    with pytest.warns(gs.errors.InputWarning, match="crank_arm"):  # the keyframe is off it
        return Mechanism.of_file(path)


def test_a_file_is_held_and_loses_nothing(four_bar):
    """The base, dampers and motors are out; tip and bar are one body of a loop of three."""
    model = four_bar.scene.model
    assert not any(model.system.forces)
    assert not model.system.inputs
    assert [body.name for body in model.system.bodies] == ["crank_arm", "bar", "rocker"]
    assert (model.system.n, model.system.m, four_bar.dt) == (22, 21, 1e-3)
    start = dict(zip(map(str, model.system.q), model.q0, strict=True))
    assert start["crank_arm_rotor_phi"] == pytest.approx(0.3, abs=0.05)  # the loop is closed
    assert "bars" in page([], [four_bar])


@pytest.mark.slow  # MuJoCo beside a compiled chain
def test_mujoco_has_the_same_robot(four_bar):
    """Its states at the start are ours; its soft equality approaches ours in small steps."""
    pytest.importorskip("mujoco")
    scene = four_bar.scene
    machine = MujocoFile(four_bar.mjcf, scene)
    (begin,) = machine.pieces("RK4", 1e-12, 1, 1)
    for theirs, ours in zip(begin, (scene.model.q0, scene.model.p0), strict=True):
        assert theirs == pytest.approx(ours, abs=1e-10)
    run = four_bar.stepper(2).integrate(scene.model.q0, scene.model.p0, dt=5e-4, steps=200,
                                        parameters=scene.model.parameters, every=200)
    errors = []
    for steps in (200, 400, 800):
        (end,) = machine.pieces("RK4", 0.1 / steps, steps, 1)
        errors.append(np.abs(end[0] - run.q[-1]).max())
    assert errors[0] < 1e-4
    assert all(fine < 0.7 * coarse for coarse, fine in itertools.pairwise(errors))


def test_the_drift_of_the_energy_is_drawn(four_bar, tmp_path):
    """Seconds of repetitions are no energies."""
    pytest.importorskip("matplotlib")
    row = Row(four_bar.name, "gyrospark", "G-L", {"steps": 3.0}, {"run": (1e-3, 2e-3, 4e-3)})
    pictures = []
    for drift in ((), (1e-14, 3e-14, 2e-14)):
        draw_drift([replace(row, energy_drift=drift)], [four_bar], tmp_path / "drift.png")
        pictures.append((tmp_path / "drift.png").read_bytes())
    draw_drift([], [four_bar], tmp_path / "empty.png")
    assert pictures[0] == (tmp_path / "empty.png").read_bytes() != pictures[1]


@pytest.mark.parametrize(("text", "message"), [
    ("<robot/>", r"'x\.xml'.*<robot>"),
    ("<mujoco><worldbody><body/><body/></worldbody></mujoco>", r"'x\.xml'.*2 bodies"),
    ("<mujoco>", r"'x\.xml'.*line 1")])
def test_files_that_cannot_be_used_are_refused(text, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path.__class__("x.xml")
    path.write_text(text)
    with pytest.raises(gs.InputError, match=message):
        conservative_text(path)
