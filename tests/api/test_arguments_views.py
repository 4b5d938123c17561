"""Rotations and pictures of a trajectory, and the packages they need."""

from __future__ import annotations

import pickle
import re
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gyrospark as gs
import systems
from calls import RUN, TOP, refused
from gyrospark.core.extras import install


def test_rotation_there_and_back(gl3):
    made = gl3.integrate(TOP.q0, TOP.p0, steps=20, **RUN)
    rotation = made.rotation()
    assert isinstance(rotation, Rotation)
    assert np.allclose(rotation.as_matrix()[:, :, 2], made.axis(), rtol=0, atol=4e-16)
    start = gs.Start.of_body(rotation, made.angular_velocity(), TOP.inertia)
    q, p = start.q, start.p
    sign = np.sign((q * made.q).sum(axis=1))[:, None]
    assert np.allclose(sign * q, made.q, rtol=0, atol=4e-16)
    assert np.allclose(sign * p, made.p, rtol=0, atol=1e-15)
    gl3.step(q[5], p[5], **RUN)


def test_what_is_no_body_has_no_axis():
    made = systems.run("pendulum", systems.stepper("pendulum"), 3)
    for call in (made.axis, made.rotation, made.angular_velocity):
        with pytest.raises(gs.GyrosparkError, match=r"'pendulum'.*rigid"):
            call()
    assert made.energy().shape == (4,)


def test_jupyter_shows_a_picture_once(gl3):
    """By itself: ``pyplot``, which would show it once more, knows nothing of it."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    figure = gl3.integrate(TOP.q0, TOP.p0, steps=5, **RUN).plot()
    data, size = figure._repr_png_()
    assert data.startswith(b"\x89PNG")
    width, height = np.frombuffer(data[16:24], dtype=">u4")  # of the first chunk, IHDR
    assert (width, height) == (2 * size["width"], 2 * size["height"]) == (1584, 662)
    assert pyplot.get_fignums() == []
    assert isinstance(pickle.loads(pickle.dumps(figure)), type(figure))


def test_other_pictures_are_refused(tmp_path, gl3):
    made = gl3.integrate(TOP.q0, TOP.p0, steps=2, **RUN)
    for name in ("top.txt", "top", ".png", ""):
        with refused(r"\.png, \.svg, \.pdf"):
            made.plot(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_pictures_of_special_trajectories(tmp_path, gl3):
    """One state, a resting body, more states than a picture has points: no warning."""
    pytest.importorskip("matplotlib")
    gl3.integrate(TOP.q0, TOP.p0, steps=0, **RUN).plot(tmp_path / "one.png")
    gl3.integrate([1, 0, 0, 0], [0, 0, 0, 0], steps=5000, **RUN).plot(tmp_path / "rest.svg")
    assert len(list(tmp_path.iterdir())) == 2


def test_missing_extra_is_refused_with_the_cure(gl3, monkeypatch):
    monkeypatch.setitem(sys.modules, "gyrospark.runtime.plotting.figure", None)
    run = gl3.integrate(TOP.q0, TOP.p0, steps=2, **RUN)
    with pytest.raises(gs.errors.MissingDependencyError, match=re.escape(install("plot"))) as error:
        run.plot("top.png")
    assert isinstance(error.value, ImportError)
