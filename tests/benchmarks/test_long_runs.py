"""Mechanisms with closed loops over many steps: our runs, the page, and other programs."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from benchmarks.long_runs import MECHANISMS, long_runs_page, measure_long_runs
from benchmarks.peers import mujoco_scenes
from benchmarks.scenes import scene_of
from gyrospark.generator.symbolic.numeric_evaluation import evaluate
from gyrospark.generator.systems.numeric_system import numeric
from gyrospark.references.problem_registry import REFERENCES
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix


@pytest.mark.slow  # a thousand steps, compiled for speed
def test_a_linkage_and_its_page():
    four_bar = MECHANISMS["four_bar"]
    (run,) = measure_long_runs(four_bar, steps=1000, stages=(2,))
    assert run.constraint < 1e-14
    assert run.energy < 1e-6
    assert 0 < run.error < 1e-6
    assert len(run.drift) == 100
    assert max(run.drift) == run.energy
    page = long_runs_page({four_bar: [run]}, "a.png")
    assert "2-G-L | 1,000" in page
    assert "](a.png)" in page


@pytest.mark.parametrize("name", [
    "delta_robot", pytest.param("stewart_platform", marks=pytest.mark.slow)])  # twice the bodies
def test_mechanisms_start_at_rest_on_their_constraints(name):
    """The freedoms that are left are those of the platform and of legs about themselves."""
    model = getattr(gs.models, name)()
    assert not model.p0.any()
    rods = sum(body.name.startswith(("rod", "tube")) for body in model.system.bodies)
    assert model.system.n - model.system.m == {"delta_robot": 3 + rods,
                                               "stewart_platform": 6 + rods // 2}[name]
    joints = {at.name: at for at in model.system.joints}
    scene = scene_of(model)
    assert len(scene.joints) == len(joints) - len(scene.springs)
    loops = mujoco_scenes.tree_of(scene)[1]
    assert len(loops) == 5
    assert name in MECHANISMS
    ours, others = _accelerations(model), _newton_euler(scene)
    assert np.abs(ours - others).max() <= 1e-11 * np.abs(others).max()


def test_andrews_starts_with_the_work_of_the_torque_until_then():
    """H is that of rest with 0.033 N m on the crank, −mom β in it, and no torque is left."""
    model, problem = MECHANISMS["andrews"].scene.model, REFERENCES["andrews"]
    start = problem.make().in_type(float)
    work = start.parameters["mom"] * float(problem.truth.value("beta"))
    assert _energy(model) == pytest.approx(_energy(start) + work, rel=1e-12)
    assert not any(model.system.forces)
    assert (model.system.n, model.system.m) == (49, 48)


def _energy(model):
    values = dict.fromkeys(model.system.velocities, 0.0)  # of a Lagrangian, here at rest
    values |= {x: float(model.parameters[str(x)]) for x in model.system.parameters}
    at = zip((*model.system.q, *model.system.p), (*model.q0, *model.p0), strict=True)
    return evaluate([model.system.H], values | {x: float(e) for x, e in at})[0]


def _accelerations(model):
    """x'' = (H_pp p')_x of p' = -V_q - g_qᵀ λ at rest, for each body."""
    system = model.system
    store = {x: float(model.parameters[str(x)]) for x in system.parameters}
    V = sp.lambdify([[*system.q]], system.H.xreplace(dict.fromkeys(system.p, sp.S.Zero) | store))
    V_q = np.array([V(model.q0 + 1e-30j * e).imag / 1e-30 for e in np.eye(system.n)])
    numbers = numeric(system, model.parameters)
    G = numbers.G(model.q0)
    H_pp = np.array([numbers.H_p(model.q0, e) for e in np.eye(system.n)])
    pull = np.linalg.solve(G @ H_pp @ G.T, G @ H_pp @ V_q)
    rates, at = H_pp @ (G.T @ pull - V_q), {x: i for i, x in enumerate(system.q)}
    return np.array([rates[[at[x] for x in body.x]] for body in system.bodies])


def _newton_euler(scene):
    """m v' = f, I ω' = τ of bodies at rest whose joints hold: points together, axes across."""
    names, n = list(scene.bodies), 6 * len(scene.bodies)
    attitudes = {name: rotation_matrix(body.start.q) for name, body in scene.bodies.items()}
    M, force, rows = np.zeros((n, n)), np.zeros(n), []

    def motion(name, point):
        """v and ω of a body to the velocity of a point of space that moves with it."""
        row = np.zeros((3, n))
        if name:
            at = 6 * names.index(name)
            row[:, at : at + 3] = np.eye(3)
            row[:, at + 3 : at + 6] = -np.cross(np.eye(3), point - scene.bodies[name].start.x).T
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
        together = motion(joint.b, joint.at) - motion(joint.a, joint.at)
        turn = (motion(joint.b, joint.at + e) - motion(joint.b, joint.at)
                - motion(joint.a, joint.at + e) + motion(joint.a, joint.at)
                for e in np.eye(3))
        if joint.kind == "slide":
            rows += [joint.axes[:2] @ together, *turn]
        else:
            rows.append(together)
            if joint.kind == "hinge":
                moved = joint.at + joint.axes[2]
                rows.append(joint.axes[:2] @ (motion(joint.b, moved) - motion(joint.a, moved)
                                              - together))
    J = np.vstack(rows)
    K = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
    found = np.linalg.lstsq(K, np.concatenate([force, np.zeros(len(J))]))[0][:n]
    return found.reshape(-1, 6)[:, :3]
