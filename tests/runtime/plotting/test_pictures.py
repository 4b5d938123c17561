"""Pictures of bodies, joints and phases, and films: their lines have the numbers of the run."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import gyrospark as gs
import systems
from gyrospark.runtime.plotting.picture import draw_picture

pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def tops():
    model = gs.models.double_top()
    return systems.stepper("double_top").integrate(
        model.q0, model.p0, dt=1e-3, steps=400, parameters=dict(model.parameters))


def lines(axes):
    return {line.get_label(): line.get_ydata() for line in axes.get_lines()}


def test_a_body_in_panels(tops, tmp_path):
    body = tops.body("b")
    figure = body.plot(tmp_path / "b.png", euler="ZXZ")
    assert (tmp_path / "b.png").stat().st_size > 10_000
    titles = [axes.get_title() for axes in figure.axes]
    # A panel for each angle: nutation is seen beside a spin of many turns.
    assert titles[0] != titles[2]
    assert "centre of mass [m]" in titles
    shown = figure.axes[2].get_lines()[0].get_ydata()
    angle = body.euler("ZXZ", degrees=True)[:, 2]
    assert np.abs(np.sin(np.radians(shown - angle))).max() < 1e-9
    assert np.abs(np.diff(shown)).max() < 30  # no jumps of a turn
    assert np.array_equal(lines(figure.axes[3])["Ω₂"], body.angular_velocity()[:, 1])
    assert all(axes.get_yscale() == "linear" for axes in figure.axes)
    lower = tops.body("a").plot(degrees=False)
    assert len(lower.axes) == 5
    middle = tops.body("a").euler("ZYX")[:, 1]
    assert np.array_equal(lower.axes[1].get_lines()[0].get_ydata(), middle)


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
    assert figure.axes[1].get_ylabel() == tops.momenta[column]
    assert len(tops.plot_phase().axes) == 6
    with pytest.raises(gs.InputError, match="'x'"):
        tops.plot_phase("x")


def test_views_of_a_run_in_float128_are_those_in_double():
    """Angles of hinges that the model counts, and titles with Δt."""
    double, wide = (systems.run("arm", systems.stepper("arm", "IMS", real=real), 2)
                    for real in ("double", "float128"))
    for joint in double.joints:
        assert np.abs(wide.joint(joint).angle() - double.joint(joint).angle()).max() < 1e-12
    for names in ((), ("energy",)):
        titles = [run.plot(*names).get_suptitle().partition("Δt")[2] for run in (double, wide)]
        assert titles[0] == titles[1] != ""


def test_an_output_with_a_panel_is_drawn_against_time(tops, monkeypatch):
    monkeypatch.setattr(type(tops), "panels", lambda run: {"momenta": run.p})
    axes = tops.plot().axes[-1]
    assert (axes.get_title(), axes.get_xlabel()) == ("momenta", "t [s]")
    assert [line.get_ydata().tolist() for line in axes.get_lines()] == tops.p.T.tolist()


@pytest.mark.slow  # four pictures; the command line has a test of a short film
def test_a_film_has_the_pictures_that_it_is_long(tops, tmp_path):
    """The frames of a film show the same as ``picture``, or boxes."""
    from PIL import Image

    frames = {}
    for shape, seconds in (("auto", 0.4), ("box", 0.4)):
        path = tops.show(tmp_path / f"{shape}.gif", seconds=seconds, fps=5, shape=shape)
        with Image.open(path) as film:
            assert film.n_frames == 5 * seconds
            assert film.info["duration"] == 200
            frames[shape] = np.asarray(film.convert("RGB"), dtype=int)
            film.seek(film.n_frames - 1)
            last = np.asarray(film.convert("RGB"), dtype=int)
            assert (np.abs(last - frames[shape]) > 30).sum() > 1000
    assert sorted(path.name for path in tmp_path.iterdir()) == ["auto.gif", "box.gif"]
    assert (np.abs(frames["auto"] - frames["box"]).max(axis=2) > 30).sum() > 500
    picture = draw_picture(tops, size=(480, 360), time=float(tops.t[0])).pixels.astype(int)

    def blue(pixels):
        return ((pixels[..., 2] > pixels[..., 0] + 40) & (pixels[..., 2] > 90)).sum()

    assert 0.2 < blue(frames["auto"][:360]) / blue(picture) < 1.2  # the film has all frames in view


def test_what_is_no_film(tops, tmp_path, monkeypatch):
    for options, message in (({"seconds": 0}, "2 to 2000"), ({"fps": -3}, "product"),
                             ({"seconds": 1e9}, "product"), ({"seconds": "x"}, "seconds = 'x'"),
                             ({"shape": "ball"}, "Unknown shape 'ball'")):
        with pytest.raises(gs.InputError, match=message):
            tops.show(tmp_path / "a.gif", **options)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(gs.errors.MissingDependencyError, match="ffmpeg"):
        tops.show(tmp_path / "a.mp4")
    monkeypatch.setitem(sys.modules, "gyrospark.runtime.plotting.figure", None)
    with pytest.raises(gs.errors.MissingDependencyError, match="matplotlib"):
        tops.body("a").plot()
