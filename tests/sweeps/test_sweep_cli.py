"""``gyrospark sweep``: studies, estimates, figures, and wrong files that are refused."""

from __future__ import annotations

import re

import pytest

import gyrospark as gs
from command_line import refused
from gyrospark.sweeps import cost_estimate, tiles
from gyrospark.sweeps.results import fields_of
from gyrospark.sweeps.study_file import parse_study
from gyrospark.sweeps.sweep_plots import draw
from processes import ROOT
from sweep_studies import FAILURES, GAMMAS, STUDY, TOP, study_file

EXAMPLES = sorted((ROOT / "examples" / "studies").glob("*.toml"))


def test_command_sweeps_draws_and_says_where_the_least_is(tmp_path, gyrospark):
    study_file(tmp_path, STUDY.replace("steps = 100", "steps = 10").replace("= 40", "= 8"))
    done = gyrospark("sweep", "study.toml", "--plot", "s.png", "--json")
    assert done.code == 0, done.stderr
    document = done.document
    assert document["statuses"] == {"done": 256}
    result = gs.load_sweep(tmp_path / "study.zarr")
    assert document["least"] == float(result.energy_error_max.min())
    cell = result.sel(gamma=document["least_at"]["gamma"], dt=document["least_at"]["dt"])
    assert cell.energy_error_max == document["least"]
    assert (tmp_path / "s.png").stat().st_size > 5000
    again = gyrospark("sweep", "study.toml", "--resume", "--workers", "2")
    assert again.code == 0
    assert "256 cells" in again.stdout
    assert "8 gamma × 32 dt" in again.stdout
    for options in ([], ["--dry-run"]):
        refused(gyrospark("sweep", "study.toml", *options), "study.zarr", "--resume")


def test_dry_run_computes_nothing_and_is_about_right(tmp_path, gyrospark, monkeypatch):
    text = STUDY.replace("steps = 100", "steps = 300")  # more than the pilots have
    monkeypatch.setattr(cost_estimate, "_SAMPLES", 8)
    path = study_file(tmp_path, text)
    done = gyrospark("sweep", "study.toml", "--dry-run", "--json")
    assert done.code == 0, done.stderr
    document = done.document
    assert (document["cells"], document["steps"]) == (1280, 1280 * 300)
    assert not (tmp_path / "study.zarr").exists()
    loaded = parse_study(text, path)
    assert document["disk_bytes"] == 1280 * sum(f.row_bytes for f in fields_of(loaded.study))
    assert 0 < document["low"] <= document["cpu_seconds"] <= document["high"] < 60
    assert document["tiles"] == len(list(tiles.tiles_of(loaded.study)))
    monkeypatch.setattr(cost_estimate, "_seconds_a_step", lambda study, tile: 1e-6)
    text = gyrospark("sweep", "study.toml", "--dry-run").stdout
    assert "1,280 cells" in text
    assert re.search(r"on the disk +[\d.]+ kB", text)


@pytest.mark.parametrize(("text", "fragments"), [
    ("", ["model"]), ("x = ", ["not TOML"]), ("model = 3", ["model = 3"]),
    (STUDY + "\n[extra]\n", ["'extra'"]),
    (STUDY.replace("steps = 100", 'steps = "many"'), ["steps", "many"]),
    (STUDY.replace("steps = 100", "steps = true"), ["steps"]),
    (STUDY.replace("fast-top", "slow-top"), ["slow-top"]),
    (STUDY.replace("fast-top", "nothing.toml"), ["nothing.toml"]),
    (STUDY.replace("steps", "keep = 3\nsteps"), ["keep"]),
    (STUDY.replace("steps", "settings = { x = 1 }\nsteps"), ["setting", "'x'", "fast-top"]),
    (STUDY.replace("steps", "name = 1\nsteps"), ["name"]),
    (STUDY.replace("steps = 100", "duration = 1.0"), ["'duration'", "t_end"]),
    (STUDY.replace("[grid]", "[grid]\nstart = { q = 1 }"), ["start"]),
])
def test_wrong_files_end_in_one_sentence(text, fragments, tmp_path, gyrospark):
    study_file(tmp_path, text)
    done = gyrospark("sweep", "study.toml")
    assert done.code == 2
    assert len(done.stderr.splitlines()) == 1
    assert all(fragment in done.stderr for fragment in [*fragments, "study.toml"]), done.stderr


def test_a_picture_that_cannot_be_drawn_is_refused_before_a_cell_is_computed(tmp_path, gyrospark):
    study_file(tmp_path, STUDY)
    refused(gyrospark("sweep", "study.toml", "--plot", "s.txt"), "s.txt")
    assert not (tmp_path / "study.zarr").exists()


def test_a_gamma_without_moments_of_inertia_is_not_chosen(tmp_path, gyrospark):
    (tmp_path / "mass.toml").write_text("""name = "mass"
[system]
coordinates = ["x"]
momenta = ["p"]
hamiltonian = "p**2/(2*gamma) + x**2/2"
[parameters]
gamma = 0.5
[start]
q = [1]
p = [0]
""")
    study_file(tmp_path, """model = "mass.toml"
scheme = "G-L 2"
steps = 5
[parameters]
gamma = "m"
[grid]
dt = [0.1, 0.2]
""")
    refused(gyrospark("sweep", "study.toml"), "gamma", "'I1'", "study.toml")


@pytest.mark.parametrize("arguments", [
    ["--out", "none/s.zarr"], ["--out", "s.csv"], ["--workers", "x"],
    ["--workers", "0"], ["--workers", "2", "--dask", "tcp://127.0.0.1:1"],
    ["--dry-run", "--plot", "s.png"],
    ["--dry-run", "--resume"], ["--dry-run", "--dask", "tcp://127.0.0.1:1"], ["--show", "q"],
    ["--plot", "s.txt"],
    pytest.param(["--dask", "tcp://127.0.0.1:1"], marks=pytest.mark.slow)])
def test_wrong_options_end_in_one_sentence(arguments, tmp_path, gyrospark):
    study_file(tmp_path)
    done = gyrospark("sweep", "study.toml", *arguments)
    assert done.code == 2
    assert len(done.stderr.splitlines()) == 1, done.stderr


@pytest.mark.parametrize("path", [
    pytest.param(path, id=path.stem,
                 marks=[pytest.mark.slow] * (path.stem == "gamma_dt"))  # pilots of a million cells
    for path in EXAMPLES])
def test_examples_are_studies_and_say_how_to_begin(path, gyrospark):
    text = path.read_text(encoding="utf-8")
    assert parse_study(text, path).study.size > 1
    header = [line for line in text.splitlines() if line.startswith("#   gyrospark sweep ")]
    words = header[0].removeprefix("#").split()
    assert words[3:] == ["--dry-run"]
    done = gyrospark(*words[1:])
    assert done.code == 0, done.stderr


def test_every_option_of_a_study_file_reaches_the_study(tmp_path):
    text = """
dt = 1e-3
every = 10
solver = "newton"
tolerance = 1e-12
max_iterations = 30
rep = "gamma"
real = "double"
frame = "symmetries"
keep = ["energy_error_max"]
"""
    loaded = parse_study(text + STUDY.replace("steps = 100", "steps = 1e3").replace(
        "dt =", "mgl ="), tmp_path / "options.toml")
    study, (step,) = loaded.study, loaded.study.steppers
    assert loaded.keep == ["energy_error_max"]
    assert step.name == "heavy_top_gl2_gamma_frame"
    assert (study.name, study.dt, study.steps, study.every, study.solver, study.tolerance,
            study.max_iterations) == ("options", 1e-3, 1000, 10, "newton", 1e-12, 30)


def test_a_study_file_has_the_order_of_a_splitting(tmp_path):
    text = "order = 4\n" + STUDY.replace('scheme = "G-L 2"\n', "")
    (step,) = parse_study(text, tmp_path / "order.toml").study.steppers
    assert step.order == 4


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@FAILURES
def test_pictures_of_lost_cells_and_what_cannot_be_drawn(tmp_path):
    lost = gs.sweep(TOP, {"gamma": GAMMAS, "dt": [50.0, 60.0]}, scheme="EMS", steps=5)
    draw(lost, "energy_error_max", tmp_path / "lost.png")
    with pytest.raises(gs.InputError, match="drawn"):
        draw(lost, "q")


def drawn(over, **arguments):
    """Return the axes of a picture of a sweep."""
    return draw(gs.sweep(TOP, over, steps=3, **arguments), "energy_error_max").axes[0]


def spaced(low, high, count, spacing):
    return {"from": low, "to": high, "count": count, "spacing": spacing}


@pytest.mark.parametrize(("values", "scale"), [
    (spaced(1e-4, 1e-2, 12, "linear"), "linear"), (spaced(1e-4, 1e-2, 12, "log"), "log"),
    (spaced(1e-3, 2e-3, 5, "log"), "log"), ([1e-4, 2e-4, 5e-4, 1e-3, 2e-3], "log"),
    ([1e-3, 2e-3], "linear"), ([1e-3], "linear"), ([3e-3, 1e-3, 2e-3], "linear"),
    (spaced(-1e-3, -1e-2, 5, "log"), "linear")])
def test_axes_are_drawn_as_they_are_spaced(values, scale):
    axes = drawn({"dt": values}, scheme="EMS")
    assert axes.get_xscale() == scale
    assert (axes.lines[0].get_xdata() == sorted(axes.lines[0].get_xdata())).all()


@pytest.mark.parametrize(("over", "names", "label", "scale"), [
    ({"scheme": ["EMS", "G-L 2"], "gamma": spaced(4e-4, 4e-3, 12, "linear")}, ["EMS", "G-L 2"],
     "γ (kg m²)", "linear"),
    ({"dt": spaced(1e-4, 1e-2, 9, "log"), "scheme": ["EMS", "IMS"]}, ["EMS", "IMS"], "Δt (s)",
     "log"),
    ({"gamma": [8e-4, 1.2e-3], "dt": [1e-3, 2e-3, 3e-3]}, ["0.0008", "0.0012"], "Δt (s)",
     "linear"),
    ({"pair": {"gamma": [8e-4, 1e-3], "mgl": [0.3, 0.4]}, "dt": [1e-3, 2e-3, 4e-3]},
     ["gamma = 0.0008, mgl = 0.3", "gamma = 0.001, mgl = 0.4"], "Δt (s)", "log"),
    ({"start": {"angular_velocity": [[0, 0, 100], [0, 5, 100]]}, "dt": [1e-3, 2e-3]}, ["0", "1"],
     "Δt (s)", "linear")])
def test_few_values_are_lines(over, names, label, scale):
    """Schemes, starts, points and short axes have a named line each, over the other axis."""
    axes = drawn(over, **({} if "scheme" in over else {"scheme": "EMS"}),
                 **({} if "dt" in over else {"dt": 1e-3}))
    assert [text.get_text() for text in axes.get_legend().get_texts()] == names
    assert (axes.get_xlabel(), axes.get_xscale()) == (label, scale)
    assert len(axes.lines) == len(names)
    assert not axes.collections


def test_two_long_axes_are_colours():
    """The title names the scheme, which is fixed."""
    over = {"scheme": ["EMS", "IMS"], "gamma": spaced(4e-4, 4e-3, 12, "log"),
            "dt": spaced(1e-4, 1e-2, 11, "linear")}
    axes = drawn(over)
    assert (axes.get_xscale(), axes.get_yscale()) == ("log", "linear")
    assert len(axes.collections) == 1
    assert not axes.lines
    assert axes.get_title().endswith("scheme = EMS")
