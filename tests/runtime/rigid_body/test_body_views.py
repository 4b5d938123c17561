"""Rotation, axis and angular velocity of every system that is one body, and of one of several."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from gyrospark.core.json_records import UnfitError
from gyrospark.runtime.compilation.body_columns import bodies_of, joints_of
from gyrospark.runtime.compilation.manifest import parse_manifest
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix
from stores import record

VIEWS = ("rotation", "axis", "angular_velocity")
EPS = float(np.finfo(float).eps)


@pytest.fixture(scope="module")
def two_tops():
    return run(gs.models.double_top(), 5, "double_top")


def run(model, steps=40, name=None, **options):
    step = systems.stepper(name) if name else gs.stepper("G-L", 2, system=model.system)
    return step.integrate(model.q0, model.p0, dt=model.dt or 1e-3, steps=steps,
                          parameters=dict(model.parameters), **options)


def test_the_satellite_in_its_orbit():
    """Ω against axes at rest: what turns in orbit axes at n about y more than that."""
    model = gs.models.satellite()
    made = run(model, 60, "satellite")
    R, omega = made.rotation().as_matrix(), made.angular_velocity()
    turning = np.diff(R, axis=0) / made.dt
    middle = (R[1:] + R[:-1]) / 2
    relative = np.einsum("tji,tjk->tik", middle, turning)  # RᵀṘ = skew(Ω relative)
    relative = np.stack([relative[:, 2, 1], relative[:, 0, 2], relative[:, 1, 0]], axis=1)
    n = model.parameters["n"]
    absolute = relative + n * middle[:, 1, :]
    assert np.abs(absolute - (omega[1:] + omega[:-1]) / 2).max() < 1e-5 * np.abs(omega).max()
    assert np.abs(relative - (omega[1:] + omega[:-1]) / 2).max() > 0.1 * n


def test_several_bodies_are_asked_for_by_name(two_tops):
    made = two_tops
    assert made.bodies == ("a", "b")
    for view in VIEWS:
        with pytest.raises(gs.InputError, match=r"'double_top'.*2, a, b.*body\('a'\)"):
            getattr(made, view)()
        with pytest.raises(gs.InputError, match=r"'c'.*a or b"):
            getattr(made, view)("c")
    assert np.abs(made.angular_velocity("a")[0] - [0.2, 0, 40]).max() < 40 * 8 * EPS
    assert np.abs(made.angular_velocity("b")[0] - [0, 0.3, 70]).max() < 70 * 8 * EPS
    assert np.abs(made.rotation(body="b").as_matrix()
                  - rotation_matrix(made.q[:, 4:8])).max() < 8 * EPS
    assert np.array_equal(made.axis("b"), rotation_matrix(made.q[:, 4:8])[..., 2])


def test_views_go_with_a_trajectory_into_its_file(two_tops, tmp_path):
    made = two_tops
    again = gs.load(made.save(tmp_path / "two.npz"))
    assert again.bodies == made.bodies
    assert np.array_equal(again.angular_velocity("b"), made.angular_velocity("b"))
    case, step = systems.case("satellite"), systems.stepper("satellite")
    stored = record(step, *systems.start("satellite", step), dt=case.dt, steps=4,
                       parameters=case.parameters, out=tmp_path / "satellite.zarr")
    assert stored[:].axis().shape == (5, 3)


@pytest.mark.parametrize("spoil", [
    lambda body: body.update(q=["a_q0", "a_q1", "a_q2"]),
    lambda body: body.update(q=["a_q0", "a_q1", "a_q2", "z"]),
    lambda body: body.update(inertia=["a_I1", "a_I2"]),
    lambda body: body.update(inertia=["a_I1", "a_I2", "none"]),
    lambda body: body.update(inertia=[["a_I1"], "a_I2", "a_I3"]),
    lambda body: body.pop("inertia"), lambda body: body.update(q=3),
    lambda body: body.update(x=["b_x", "b_y"]), lambda body: body.update(mass="none"),
    lambda body: body.update(mass=True), lambda body: body.update(centre=[0.0, 1.0]),
    lambda body: body.update(centre="a_m"), lambda body: body.update(origin=[0.0, 0.0, np.inf]),
], ids=range(13))
def test_a_manifest_with_another_body_is_damaged(spoil, two_tops):
    content = two_tops.manifest.as_json()
    assert list(bodies_of(parse_manifest(content))) == ["a", "b"]
    spoil(content["system"]["bodies"]["a"])
    with pytest.raises(UnfitError, match=r"system\.bodies\.a"):
        parse_manifest(content)


@pytest.mark.parametrize("spoil", [
    lambda joint: joint.update(bodies=["a", "c"]), lambda joint: joint.update(bodies=["a"]),
    lambda joint: joint.update(on_a=[0.0]), lambda joint: joint.update(axis_b=["none", 0.0, 0.0]),
    lambda joint: joint.pop("constraints"), lambda joint: joint["constraints"].update(other=None),
    lambda joint: joint["constraints"]["joint: x"].update(kind="magic"),
    lambda joint: joint["constraints"]["joint: x"].update(on_a=[]),
], ids=range(8))
def test_a_manifest_with_another_joint_is_damaged(spoil, two_tops):
    content = two_tops.manifest.as_json()
    assert list(joints_of(parse_manifest(content))) == ["joint"]
    spoil(content["system"]["joints"]["joint"])
    with pytest.raises(UnfitError, match=r"system\.joints\.joint"):
        parse_manifest(content)


def test_what_is_called_a_rigid_body_is_one():
    x, y = sp.symbols("x y", real=True)
    with pytest.raises(gs.InputError, match=r"'a'.*1 coordinates"):
        gs.System([x], [y], [], y**2, name="a", rigid_body=True)
    q, p = sp.symbols("q0:4", real=True), sp.symbols("p0:4", real=True)
    with pytest.raises(gs.InputError, match="moments I1, I2, I3"):
        gs.System(q, p, [x], x * sum(e**2 for e in p), name="a", rigid_body=True)
