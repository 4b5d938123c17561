"""Trajectories in files and pictures: saved, loaded, drawn, refused."""

from __future__ import annotations

import json
import pickle
import re
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gyrospark as gs
import systems
from calls import PARAMETERS, RUN, TOP, equal, refused
from gyrospark.core.extras import install


@pytest.fixture
def saved(tmp_path, gl3):
    trajectory = gl3.integrate(TOP.q0, TOP.p0, steps=20, every=3, **RUN)
    return trajectory, trajectory.save(tmp_path / "top.npz")


def test_failed_trajectory_is_saved_too(failures, tmp_path):
    for _, _, failure in failures:
        path = failure.trajectory.save(tmp_path / "part.npz")
        assert equal(gs.load(path), failure.trajectory)


def test_names_of_files(saved, tmp_path, monkeypatch):
    trajectory, _ = saved
    monkeypatch.chdir(tmp_path)
    for bad in ("a.b", "a.xlsx", "top.npz.zip", "c", tmp_path / "c"):
        with refused(r"\.npz, \.csv, \.nc"):
            trajectory.save(bad)
    assert trajectory.save("a.NPZ") == Path("a.NPZ")
    assert not (tmp_path / "c.npz").exists()
    assert trajectory.save(str(tmp_path / "c.npz")) == tmp_path / "c.npz"
    for bad in ("", ".", "/"):
        with refused("file name"):
            trajectory.save(bad)
    for bad in ("none/top.npz", "/dev/null/top.npz", "/proc/top.npz"):
        with pytest.raises(gs.GyrosparkError, match="written"):
            trajectory.save(bad)
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(gs.GyrosparkError, match="written"):
        trajectory.save("folder.npz")
    assert not list(tmp_path.glob(".*"))


def test_file_in_the_way_is_replaced_whole(saved):
    trajectory, path = saved
    path.write_bytes(b"something else")
    trajectory.save(path)
    assert equal(gs.load(path), trajectory)


def test_damaged_files_are_refused(saved, tmp_path):
    """A file that is cut off or changed is an InputError, or has the same numbers."""
    trajectory, path = saved
    good = path.read_bytes()
    rng = np.random.default_rng(5)
    bad = tmp_path / "bad.npz"
    for size in (0, 1, 4, 30, 100, len(good) // 2, len(good) - 30, len(good) - 1):
        bad.write_bytes(good[:size])
        with refused("bad.npz"):
            gs.load(bad)
    for _ in range(60):
        content = bytearray(good)
        for position in rng.integers(0, len(good), rng.integers(1, 4)):
            content[position] ^= int(rng.integers(1, 256))
        bad.write_bytes(content)
        try:
            loaded = gs.load(bad)
        except gs.InputError as error:
            assert "bad.npz" in str(error)  # noqa: PT017 (it may be refused and need not)
        else:
            assert equal(loaded, trajectory)


def test_foreign_files_are_refused(tmp_path):
    np.savez(tmp_path / "foreign.npz", t=np.zeros(3))
    np.save(tmp_path / "array.npy", np.zeros(3))
    (tmp_path / "text.npz").write_text("t, q\n0, 1\n", encoding="utf-8")
    with zipfile.ZipFile(tmp_path / "zip.npz", "w") as archive:
        archive.writestr("about.npy", b"not an array")
    (tmp_path / "pickle.npz").write_bytes(pickle.dumps({"about": 1}))
    (tmp_path / "folder.npz").mkdir()
    for name in ("foreign.npz", "array.npy", "text.npz", "zip.npz", "pickle.npz", "none.npz",
                 "folder.npz"):
        with refused(name) as error:
            gs.load(tmp_path / name)
        assert str(error.value).count(name) == 1


class Bomb:
    """Would write a file if it were unpickled."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


def test_nothing_in_a_file_is_executed(saved, tmp_path):
    _, path = saved
    with np.load(path) as file:
        content = dict(file)
    for name in content:
        trap = content | {name: np.array([Bomb(tmp_path / "evil")], dtype=object)}
        np.savez(tmp_path / "bomb.npz", allow_pickle=True, **trap)
        with refused("bomb.npz"):
            gs.load(tmp_path / "bomb.npz")
    assert not (tmp_path / "evil").exists()


def rewritten(path, target, **changes):
    """Copy a trajectory file with changed arrays; ``about`` is given as changes of its keys."""
    with np.load(path) as file:
        content = dict(file)
    about = json.loads(str(content["about"]))
    about.update(changes.pop("about", {}))
    np.savez(target, **(content | {"about": np.array(json.dumps(about))} | changes))
    return target


def test_inconsistent_files_are_refused(saved, tmp_path):
    trajectory, path = saved
    bad = tmp_path / "bad.npz"
    for changes in ({"about": {"format": 1}}, {"about": {"report": {}}},
                    {"about": {"manifest": {}}}, {"q": trajectory.q[:-1]},
                    {"q": trajectory.q[:, :3]}, {"t": trajectory.t[None]},
                    {"multipliers": trajectory.multipliers[1:]},
                    {"iterations": trajectory.iterations[1:]},
                    {"energies": trajectory.energies[1:]}):
        with refused(r"bad\.npz"):
            gs.load(rewritten(path, bad, **changes))
    assert equal(gs.load(rewritten(path, bad)), trajectory)


def test_file_of_another_version(saved, tmp_path):
    """An unknown field is ignored, a later field has its default, a format is named."""
    trajectory, path = saved
    with np.load(path) as file:
        report = json.loads(str(file["about"]))["report"]
    work = report.pop("work")
    later_file = rewritten(path, tmp_path / "other.npz", about={"report": report | {"later": 1}})
    assert equal(gs.load(later_file), trajectory)
    assert work == gs.load(later_file).report.work == 0.0
    with refused(r"other\.npz'.*format 9.* 2\b"):
        gs.load(rewritten(path, later_file, about={"format": 9}))


def test_a_missing_folder_is_named(tmp_path):
    """The message has the command that creates it; no file or folder appears."""
    run = systems.stepper("heavy_top").integrate(TOP.q0, TOP.p0, steps=2, **RUN)
    for write, ending in (*((run.save, end) for end in ("npz", "csv")), (run.plot, "png"),
                          *((run.show, end) for end in ("html", "png", "glb", "gif"))):
        with pytest.raises(gs.GyrosparkError, match="mkdir"):
            write(tmp_path / "no" / "such" / f"run.{ending}")
    assert list(tmp_path.iterdir()) == []


def test_messages_say_the_way(gyrospark):
    """Messages name the remedy, such as a name of the catalogue or another argument."""
    step = systems.stepper("heavy_top")
    for rows in (np.tile(TOP.q0, (3, 1)), [TOP.q0.tolist()] * 3):
        with pytest.raises(gs.InputError, match="integrate_ensemble"):
            step.integrate(rows, rows, steps=1, **RUN)
    with pytest.raises(gs.InputError, match="positive=True"):
        gs.Multibody("x").parameter("c", 0, positive=True)
    with pytest.raises(gs.InputError, match="positive=True"):
        step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=1, parameters=PARAMETERS | {"I1": 0})
    assert "'examples/pendulum.toml'" in gyrospark("run", "pendulum.toml", "--steps", "3").stderr
    assert "examples/" not in gyrospark("run", "no-such.toml", "--steps", "3").stderr
    message = gyrospark("run", "double_pendulum", "--set", "mass=3", "--steps", "3").stderr
    assert "examples/double_pendulum.toml" in message


def test_rotation_there_and_back(gl3):
    trajectory = gl3.integrate(TOP.q0, TOP.p0, steps=20, **RUN)
    rotation = trajectory.rotation()
    assert isinstance(rotation, Rotation)
    assert np.allclose(rotation.as_matrix()[:, :, 2], trajectory.axis(), rtol=0, atol=4e-16)
    start = gs.Start.of_body(rotation, trajectory.angular_velocity(), TOP.inertia)
    q, p = start.q, start.p
    sign = np.sign((q * trajectory.q).sum(axis=1))[:, None]
    assert np.allclose(sign * q, trajectory.q, rtol=0, atol=4e-16)
    assert np.allclose(sign * p, trajectory.p, rtol=0, atol=1e-15)
    gl3.step(q[5], p[5], **RUN)


def test_what_is_no_body_has_no_axis():
    trajectory = systems.run("pendulum", systems.stepper("pendulum"), 3)
    for call in (trajectory.axis, trajectory.rotation, trajectory.angular_velocity):
        with pytest.raises(gs.GyrosparkError, match=r"'pendulum'.*rigid"):
            call()
    assert trajectory.energy().shape == (4,)


def test_jupyter_shows_a_picture_once(gl3):
    """The figure shows itself: ``pyplot``, which would show it once more, does not know it."""
    pyplot = pytest.importorskip("matplotlib.pyplot")
    figure = gl3.integrate(TOP.q0, TOP.p0, steps=5, **RUN).plot()
    data, size = figure._repr_png_()
    assert data.startswith(b"\x89PNG")
    width, height = np.frombuffer(data[16:24], dtype=">u4")  # of the first chunk, IHDR
    assert (width, height) == (2 * size["width"], 2 * size["height"]) == (1584, 662)
    assert pyplot.get_fignums() == []
    assert isinstance(pickle.loads(pickle.dumps(figure)), type(figure))


def test_other_pictures_are_refused(tmp_path, gl3):
    trajectory = gl3.integrate(TOP.q0, TOP.p0, steps=2, **RUN)
    for name in ("top.txt", "top", ".png", ""):
        with refused(r"\.png, \.svg, \.pdf"):
            trajectory.plot(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_pictures_of_special_trajectories(tmp_path, gl3):
    """One state, a resting body, and more states than a picture has points cause no warning."""
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
