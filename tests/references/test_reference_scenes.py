"""Reference problems as bodies on joints, run by exudyn and MuJoCo."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import gyrospark as gs
from benchmarks import scenes
from benchmarks.peers.mujoco_scenes import tree_of
from benchmarks.peers.optional import Unavailable
from benchmarks.reference_bodies import measure_bodies
from benchmarks.reference_scenes import andrews, at_start, scene_reference
from gyrospark.generator.symbolic.numeric_evaluation import evaluate
from gyrospark.references.problem import largest_error
from gyrospark.references.problem_registry import REFERENCES

#: Problems that record their bodies themselves, or are a point on a rod.
RECORDED = ("simple-pendulum", "spherical-pendulum", "four-bar", "bricard", "bricard-pushed",
            "bennett", "slider-crank", "dzhanibekov", "heavy-top", "kovalevskaya")


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (
        name in ("bricard", "bricard-pushed", "four-bar"))) for name in RECORDED])
def test_a_scene_starts_where_the_model_does(name):
    """Masses, moments and places, read off the record, reproduce the state and its numbers."""
    problem = REFERENCES[name]
    model = problem.make().in_type(float)
    scene = scene_reference(problem)
    end = scene.scene.end(at_start(scene.scene))
    assert end.q[0] == pytest.approx(model.q0.astype(float), rel=0, abs=1e-15)
    assert end.p[0] == pytest.approx(model.p0.astype(float), rel=1e-14, abs=1e-15)
    groups = scene.read(at_start(scene.scene))
    assert set(groups) == set(problem.groups)


def test_andrews_and_the_governor_start_as_their_lagrangians_do():
    """Angles of bodies equal coordinates up to full turns."""
    for name in ("andrews", "flyball-governor-stiff"):
        problem = REFERENCES[name]
        model = problem.make().in_type(float)
        scene = scene_reference(problem)
        groups = scene.read(at_start(scene.scene))
        differences = np.subtract(groups["positions"], model.q0.astype(float))
        assert differences - 2 * np.pi * np.round(differences / (2 * np.pi)) == pytest.approx(
            0, abs=1e-13)
        speeds = [2 * np.pi, 0, 0.05] if "governor" in name else [0] * 7
        assert groups["velocities"] == pytest.approx(speeds, rel=1e-14, abs=1e-14)
        system = model.system
        momenta = evaluate(system.L_v, dict(zip((*system.q, *system.velocities), (
            *model.q0, *speeds), strict=True)) | {
                s: model.parameters[str(s)] for s in system.parameters})
        assert momenta == pytest.approx(model.p0.astype(float), rel=1e-13, abs=1e-13)


def test_a_top_has_a_weight_with_the_moment_of_its_potential():
    """The moment is 147.15 R₃₂ about the point, with the moments of inertia about it."""
    scene = scene_reference(REFERENCES["heavy-top"]).scene
    (top,) = scene.bodies.values()
    moment = -top.mass * scene.gravity[2] * top.centre
    assert moment == pytest.approx([0, 147.15, 0], rel=1e-14, abs=1e-13)
    assert top.about_origin == pytest.approx(np.diag([15.234375, 0.46875, 15.234375]), rel=1e-14)
    moments = top.inertia.diagonal()
    assert moments.sum() >= 2 * moments.max()  # there is such a body


def test_what_is_no_weight_and_what_is_no_record_is_said():
    top = REFERENCES["kovalevskaya"].make()
    square = replace(top, system=replace(top.system, H=top.system.H + top.system.q[1] ** 4))
    with pytest.raises(Unavailable, match=r"kovalevskaya_top.*weight"):
        scenes.scene_of(square)
    with pytest.raises(Unavailable, match=r"neumann.*bodies"):
        scenes.scene_of(REFERENCES["neumann"].make())


@pytest.mark.parametrize("name", [x for x in REFERENCES if REFERENCES[x].no_bodies])
def test_what_is_no_bodies_on_joints_is_left_out_with_a_reason(name):
    remarks = []
    assert list(measure_bodies(REFERENCES[name], watch=remarks.append)) == []
    assert len(remarks) == 1
    assert f"{name}: {REFERENCES[name].no_bodies}." in remarks[0]


def test_a_package_that_is_missing_is_said(monkeypatch):
    for module in ("exudyn", "mujoco"):
        monkeypatch.setitem(sys.modules, module, None)
    remarks = []
    assert list(measure_bodies(REFERENCES["kovalevskaya"], watch=remarks.append)) == []
    for package in ("exudyn", "mujoco"):
        assert any(f"pip install {package})" in line for line in remarks)


def test_loops_are_closed_by_balls_where_there_are():
    tree, loops = tree_of(scene_reference(REFERENCES["slider-crank"]).scene)
    assert [joint.kind for joint in loops] == ["ball"]
    assert [(parent, body) for parent, body, _ in tree] == [
        ("", "slider"), ("", "crank"), ("slider", "conrod")]
    tree, loops = tree_of(scene_reference(REFERENCES["four-bar"]).scene)
    assert len(tree) == 5
    assert [(joint.a, joint.b) for joint in loops] == [("c1", "v1"), ("c2", "v2")]


@pytest.mark.slow
def test_andrews_of_bodies_moves_as_its_lagrangian_does():
    """Our steps of 49 coordinates on hinges agree with the digits of seven angles."""
    problem = REFERENCES["andrews"]
    start, scene = problem.make().in_type(float), scene_reference(problem)
    build = andrews(start.parameters, start.q0.tolist())
    build.torque("K1", (0, 0, start.parameters["mom"]))
    model = build.model(redundant="leave out")
    run = gs.stepper("G-L", 4, system=model).integrate(
        model.q0, model.p0, dt=3e-2 / 400, steps=400, every=400, parameters=model.parameters)
    motions = {name: scenes.SceneMotion(body.attitude[-1], body.position()[-1], body.velocity()[-1],
                                        body.angular_velocity()[-1])
               for name in scene.scene.bodies for body in (run.body(name),)}
    groups = scene.read(motions)
    for group, names in problem.groups.items():
        assert largest_error(groups[group], [problem.truth.value(x) for x in names]) < 1e-9


def _errors(name, peer, scheme):
    runs = measure_bodies(REFERENCES[name], rounds=1, quick=True)
    return [run.error for run in runs if (run.peer, run.scheme) == (peer, scheme)]


@pytest.mark.parametrize(("name", "scheme", "order", "error"), [
    ("kovalevskaya", "RK67", 5, 1e-7), ("heavy-top", "RK67", 5, 1e-4),
    ("flyball-governor", "trapezoidal index 2", 2, 3e-6), ("bricard", "generalised α", 1.5, 3e-5),
    ("bennett", "trapezoidal index 2", 2, 3e-3), ("bricard-pushed", "generalised α", 2, 4e-3),
    ("slider-crank", "trapezoidal index 2", 2, 5e-3), ("andrews", "generalised α", 2, 2e-3),
    ("four-bar", "generalised α", 2, 4e-4), ("simple-pendulum", "trapezoidal index 2", 2, 1e-2)])
def test_exudyn_goes_to_the_digits(name, scheme, order, error):
    """It does so nearly at the order of its method, from equations that are not ours."""
    pytest.importorskip("exudyn")
    for coarse, fine in pairwise(_errors(name, "exudyn", scheme)):
        assert fine < min(error, coarse * 4.0**-order * 1.3)


@pytest.mark.parametrize(("name", "error"), [
    ("kovalevskaya", 4e-5), ("dzhanibekov", 1e-7), ("bricard-pushed", 3e-5),
    pytest.param("andrews", 2e-4, marks=pytest.mark.slow)])
def test_mujoco_goes_to_the_digits(name, error):
    pytest.importorskip("mujoco")
    coarse, fine = _errors(name, "MuJoCo", "RK4")
    assert fine < min(coarse, error)
