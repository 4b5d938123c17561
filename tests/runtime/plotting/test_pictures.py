"""Pictures of bodies, joints and phases, and films: their lines are the run's numbers."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import gyrospark as gs
from calls import RUN, TOP
from gyrospark.runtime.plotting.animation import _faces, _upright
from gyrospark.runtime.plotting.scene import scene_of

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def tops():
    model = gs.models.double_top()
    return gs.stepper("G-L", 3, system=model.system).integrate(
        model.q0, model.p0, dt=1e-3, steps=400, parameters=dict(model.parameters))


def lines(axes):
    return {line.get_label(): line.get_ydata() for line in axes.get_lines()}


def test_a_body_in_panels(tops, tmp_path):
    body = tops.body("b")
    figure = body.plot(tmp_path / "b.png", euler="ZXZ")
    assert (tmp_path / "b.png").stat().st_size > 10_000
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[0] == "Euler angles ZXZ [°]"
    assert "centre of mass [m]" in titles
    shown = figure.axes[0].get_lines()[2].get_ydata()
    angle = body.euler("ZXZ", degrees=True)[:, 2]
    assert np.abs(np.sin(np.radians(shown - angle))).max() < 1e-9
    assert np.abs(np.diff(shown)).max() < 30  # no jumps of a turn
    assert np.array_equal(lines(figure.axes[1])["Ω₂"], body.angular_velocity()[:, 1])
    assert all(axes.get_yscale() == "linear" for axes in figure.axes)
    held = tops.body("a").plot(degrees=False)
    assert len(held.axes) == 3
    assert held.axes[0].get_title() == "Euler angles ZYX [rad]"


def test_joints_and_phases(tops):
    figure = tops.joint().plot()
    assert len(figure.axes) == 2  # a ball has no angle
    assert np.array_equal(lines(figure.axes[0])["z"], tops.joint().force()[:, 2])
    figure = tops.plot_phase("b_x", "b_z")
    (curve, start) = figure.axes[1].get_lines()
    column = tops.coordinates.index("b_z")
    assert np.array_equal(curve.get_xdata(), tops.q[:, column])
    assert np.array_equal(curve.get_ydata(), tops.p[:, column])
    assert start.get_xdata()[0] == tops.q[0, column]
    assert len(tops.plot_phase().axes) == 6
    with pytest.raises(gs.InputError, match="'x'"):
        tops.plot_phase("x")


def test_an_output_with_a_panel_is_drawn_against_time(tops, monkeypatch):
    monkeypatch.setattr(type(tops), "panels", lambda run: {"momenta": run.p})
    axes = tops.plot().axes[-1]
    assert (axes.get_title(), axes.get_xlabel()) == ("momenta", "t [s]")
    assert [line.get_ydata().tolist() for line in axes.get_lines()] == tops.p.T.tolist()


def test_several_bodies_have_a_legend(tops, gl3):
    figure = tops.plot()
    assert np.array_equal(lines(figure.axes[2])["b"], tops.body("b").position()[:, 2])
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["a", "b"]
    few = gl3.integrate(TOP.q0, TOP.p0, steps=20, **RUN).plot().axes[2]
    many = tops.plot().axes[-1]
    assert [line.get_linestyle() for line in (few.get_lines()[0], many.get_lines()[0])] == [
        "-", "None"]


def test_a_film_has_the_pictures_that_it_is_long(tops, tmp_path):
    from PIL import Image

    for shape in ("box", "ellipsoid"):
        path = tops.animate(tmp_path / f"{shape}.gif", seconds=0.6, fps=5, shape=shape)
        with Image.open(path) as film:
            assert film.n_frames == 3
            assert film.info["duration"] == 200
            first = np.asarray(film.convert("RGB"), dtype=int)
            film.seek(2)
            assert (np.abs(np.asarray(film.convert("RGB"), dtype=int) - first) > 30).sum() > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["box.gif", "ellipsoid.gif"]


def test_a_film_on_the_command_line(gyrospark, tmp_path):
    from PIL import Image

    run = ["run", "fast-top", "--dt", "1e-3", "--steps", "4", "--animate"]
    said = gyrospark(*run, "flip.gif")
    assert said.code == 0
    assert "wrote flip.gif" in said.stdout
    with Image.open(tmp_path / "flip.gif") as film:
        assert film.n_frames == 5
    said = gyrospark(*run, "flip.png")
    assert said.code == 2
    assert "'flip.png'" in said.stderr


def test_faces_lie_on_the_shape_and_point_everywhere(tops):
    for part in scene_of(tops, 2).parts:
        for shape, kind in (("box", np.inf), ("ellipsoid", 2)):
            faces = _faces(part, shape)
            units = (faces - part.centre) @ part.axes / part.sizes[shape]
            assert np.abs(np.linalg.norm(units, ord=kind, axis=-1) - 1).max() < 1e-12
            middle = units.mean(axis=1)
            assert (middle.max(axis=0) > 0.85).all()
            assert (middle.min(axis=0) < -0.85).all()
    for up in np.eye(3):
        R = _upright(up)
        assert np.abs(R @ up - [0, 0, 1]).max() < 1e-15
        assert np.linalg.det(R) == pytest.approx(1)


def test_what_is_no_film(tops, tmp_path, monkeypatch):
    for options, said in (({"seconds": 0}, "2 to 2000"), ({"fps": -3}, "product"),
                          ({"seconds": 1e9}, "product"), ({"seconds": "x"}, "seconds = 'x'"),
                          ({"shape": "ball"}, "Unknown shape 'ball'")):
        with pytest.raises(gs.InputError, match=said):
            tops.animate(tmp_path / "a.gif", **options)
    with pytest.raises(gs.InputError, match=r"\.gif.*\.mp4"):
        tops.animate("a.png")
    with pytest.raises(gs.GyrosparkError, match="written"):
        tops.animate(tmp_path / "not" / "a.gif", seconds=0.2, fps=10)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(gs.MissingDependencyError, match="ffmpeg"):
        tops.animate(tmp_path / "a.mp4")
    monkeypatch.setitem(sys.modules, "gyrospark.runtime.plotting.figure", None)
    with pytest.raises(gs.MissingDependencyError, match="matplotlib"):
        tops.body("a").plot()
