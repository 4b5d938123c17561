"""``gyrospark run`` in everyday use: names, no scheme, 1e3 steps, other values."""

from __future__ import annotations

import numpy as np
import pytest

import gyrospark as gs
from calls import TOP
from command_line import refused
from gyrospark.core.registry import MODELS
from processes import ROOT
from stores import record

EXAMPLES = ROOT / "examples"
PENDULUM = EXAMPLES / "pendulum.toml"
TWO = ("--scheme", "G-L", "--stages", "2")


@pytest.mark.parametrize("name", [
    name if name == "double_top"
    else pytest.param(name, marks=pytest.mark.slow) for name in MODELS])
def test_every_model_runs_by_its_name(name, gyrospark):
    """A model runs with its own dt and has the same bits as from Python."""
    settings = ["--set", "count=1"] if name == "chain" else []
    answer = gyrospark("run", name, "--scheme", "G-L", "--stages", "2", "--steps", "2", "--json",
                       *settings)
    assert answer.code == 0, answer.stderr
    assert answer.stderr == ""
    model = getattr(gs.models, name)(**({"count": 1} if settings else {}))
    assert answer.document["problem"] == model.name
    assert answer.document["dt"] == model.dt
    step = gs.stepper("G-L", 2, system=model)
    run = step.integrate(model.start, dt=model.dt, steps=2)
    assert answer.document["q"] == list(run.report.q)


def test_scheme_and_stages_have_defaults(gyrospark, generate):
    """Scheme and stages have the defaults of ``gs.stepper``."""
    run = ["run", "fast-top", "--dt", "1e-3", "--steps", "5"]
    answer = gyrospark(*run)
    assert answer.code == 0
    assert "heavy_top_gl3_gamma" in answer.stdout.splitlines()[0]
    assert gyrospark(*run, "--json").document["stepper"] == "heavy_top_gl3_gamma"
    assert gyrospark(*run, "--stages", "2", "--json").document["stepper"] == "heavy_top_gl2_gamma"
    assert gs.stepper().name == gs.stepper("G-L").name == "heavy_top_gl3_gamma"
    assert gs.stepper(stages=2).name == "heavy_top_gl2_gamma"
    answer = generate("--rep", "alpha", "--no-compile", "--out", "made")
    assert "heavy_top_gl3_alpha: order 6" in answer.stdout
    answer = gyrospark("verify", "--model", "fast-top", "--steps", "4", "--json")
    assert answer.document["stepper"] == "heavy_top_gl3_gamma"


@pytest.mark.parametrize(("text", "count"), [("10.0", 10), ("1.5e1", 15), ("1E+1", 10)])
def test_whole_numbers_as_everybody_writes_them(text, count, gyrospark):
    answer = gyrospark("run", "fast-top", "--scheme", "IMS", "--dt", "1e-3", "--steps", text,
                       "--solver", "auto, max_iterations = 5e1", "--json")
    assert answer.document["steps"] == count


def test_counts_in_python_and_files(gl3, tmp_path):
    run = {"dt": 1e-3, "parameters": TOP.parameters}
    trajectory = gl3.integrate(TOP.q0, TOP.p0, steps=10.0, every=np.float32(5),
                               solver=gs.Solver("auto", max_iterations=5e1), **run)
    assert trajectory.q.shape == (3, 4)
    q, p = [TOP.q0] * 2, [TOP.p0] * 2
    assert gl3.integrate_ensemble(q, p, steps=4.0, every=2.0, workers=1.0, **run).q.shape == (2, 3,
                                                                                             4)
    assert record(gl3, TOP.q0, TOP.p0, steps=1e1, every=5.0,
                     out=tmp_path / "a.zarr", **run).report.steps == 10
    assert int(gs.sweep(TOP, {"mgl": [0.3]}, scheme="IMS", dt=1e-3, steps=4.0).steps_done[0]) == 4
    assert gs.certify(TOP, "IMS", dt=1e-3, steps=2.0).steps == 2


def test_gamma_is_the_mean_wherever_parameters_are(gl3):
    by_rule, with_gamma = TOP.parameters, TOP.parameters | {"gamma": gs.gamma(TOP.inertia)}
    q, p, x = TOP.q0, TOP.p0, np.zeros(gl3.unknowns)
    for call in (
        lambda s: gl3.step(q, p, dt=1e-3, parameters=s), lambda s: gl3.energy(q, p, parameters=s),
        lambda s: gl3.residual(x, q, p, dt=1e-3, parameters=s),
        lambda s: gl3.project(q, p, parameters=s), lambda s: gl3.defects(q, p, parameters=s),
        lambda s: gl3.guess(q, p, dt=1e-3, parameters=s),
        lambda s: gl3.integrate_ensemble([q, q], [p, p], dt=1e-3, steps=2, parameters=s).q,
        lambda s: gl3.integrate_ensemble([q], [p], dt=1e-3, steps=2, parameters=[s]).q,
        lambda s: gs.certify(TOP, "IMS", dt=1e-3, steps=2, parameters=s).parameters["gamma"],
    ):
        assert np.array_equal(np.asarray(call(by_rule)), np.asarray(call(with_gamma)))


@pytest.mark.parametrize(("changes", "words"), [
    ({"gamma": "x"}, "gamma = 'x'"), ({"I1": "m"}, "I1 = 'm'"),
])
def test_other_words_are_refused(changes, words, gl3):
    with pytest.raises(gs.InputError, match=words):
        gl3.step(TOP.q0, TOP.p0, dt=1e-3, parameters=TOP.parameters | {"gamma": 1e-3} | changes)


def test_settings_are_the_file_with_other_values(gyrospark, tmp_path):
    """A setting has the bits of the same file, written anew."""
    text = PENDULUM.read_text(encoding="utf-8")
    (tmp_path / "other.toml").write_text(text.replace("m = 1.0", "m = 2.5"), encoding="utf-8")
    assert "m = 1.0" in text
    run = ["--scheme", "IMS", "--steps", "5", "--json"]
    expected = gyrospark("run", tmp_path / "other.toml", *run).document
    for value in ("2.5", "5/2", "2.5e0"):
        document = gyrospark("run", PENDULUM, *run, "--set", f"m={value}").document
        assert document["parameters"]["m"] == 2.5
        assert (document["q"], document["p"]) == (expected["q"], expected["p"])


FILE = """
name = "settled"
potential = "k*R33"
[body]
inertia = [1, 1, "2*half"]
[parameters]
half = 0.5
k = 1
spin = "8*half"
[start]
euler = [0, 0.1, 0]
angular_velocity = [0, 0, "spin"]
[run]
dt = 0.01
steps = 2
"""


def test_what_depends_on_a_setting_follows(gyrospark, tmp_path):
    path = tmp_path / "settled.toml"
    path.write_text(FILE, encoding="utf-8")

    def run(*settings):
        options = [x for setting in settings for x in ("--set", setting)]
        answer = gyrospark("run", path, *TWO, "--json", *options)
        assert answer.code == 0, answer.stderr
        return answer.document

    assert run()["parameters"]["I3"] == 1
    document = run("half=0.75", "body.gamma=2")
    assert document["parameters"]["gamma"] == 2
    assert document["parameters"]["I3"] == 1.5
    assert document["p"][3] == pytest.approx(2 * 1.5 * 6, rel=0.02)
    document = run("k=3", "start.euler=[0, '30 deg', 0]", "run.steps=7")
    assert document["parameters"]["k"] == 3
    assert document["energy_start"] == pytest.approx(3 * np.cos(np.pi / 6) + 0.5 * 16, rel=1e-12)
    assert document["steps"] == 7
    assert run("start.angular_velocity=[0, 0, '60 rpm']")["q"] != run()["q"]


@pytest.mark.parametrize(("setting", "fragments"), [
    ("kk=3", ["'kk'", "half, k or spin", "k?"]),
    ("k", ["--set 'k'", "KEY=VALUE"]), ("k=", ["[parameters] k", "no number"]),
    ("k=[1]", ["[parameters] k", "a list of 1"]), ("start.angle=3", ["'angle'", "unknown"]),
    ("begin.euler=3", ["'begin.euler'"]), ("k.l=3", ["'k.l'"]),
    ("body.inertia=[1, 1, 9]", ["no body"]), ("k=1\nname='x'", ["k"]), ("=3", ["''"]),
    ("start.euler=__import__('os')", ["euler"]),
])
def test_settings_that_do_not_fit_are_refused(setting, fragments, gyrospark, tmp_path):
    path = tmp_path / "settled.toml"
    path.write_text(FILE, encoding="utf-8")
    refused(gyrospark("run", path, *TWO, "--set", setting), *fragments)


@pytest.mark.slow  # the derivation of two bodies
def test_settings_of_bodies_go_by_name(gyrospark):
    answer = gyrospark("run", EXAMPLES / "double_top.toml", "--scheme", "IMS", "--steps", "2",
                       "--set", "bodies.upper.mass=0.7", "--gamma", "h", "--json")
    parameters = answer.document["parameters"]
    assert parameters["upper_m"] == 0.7
    assert parameters["lower_gamma"] == gs.gamma((0.004, 0.004, 0.002), "h")
    assert parameters["upper_gamma"] == gs.gamma((0.001, 0.001, 0.0006), "h")
