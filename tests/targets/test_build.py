"""Files that targets write, refusals, and the bits of artefacts; texts to the byte.

``pytest tests/targets/test_build.py --update`` writes the texts again after a change: in full for a
model with inputs and quantities, hashes of others. The generated C has tests of its own.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from command_line import refused
from gyrospark.targets import TARGETS, cpp
from gyrospark.targets.artefact import MARKER, literal
from gyrospark.targets.native import native_bits, refuse_difference
from gyrospark.targets.tools import TOOLS
from processes import ROOT

SATELLITE = ROOT / "examples" / "control_c" / "satellite.toml"
TEXTS = ("cpp", "rust", "octave", "arduino")
#: A model with inputs that are not 0, and short stages.
WITH_INPUTS = {"system": SATELLITE, "scheme": "G-L", "stages": 1,
               "parameters": {"u1": 0.01, "u3": -0.02}}


def bits_of(*arrays, kind=np.float64):
    return b"".join(np.asarray(x, kind).tobytes() for x in arrays).hex()


@pytest.fixture
def built(tmp_path):
    """Return a function that builds the satellite with inputs in a folder of the test."""
    return lambda target, **other: gs.build(
        target, **WITH_INPUTS | {"out": tmp_path / str(target)} | other)


@pytest.mark.parametrize("target", [  # a sketch is C++ as well; Rust takes three seconds to compile
    pytest.param(target, marks=[pytest.mark.slow] * (target in ("arduino", "rust")))
    for target in TEXTS])
def test_artefacts_have_the_bits_of_c(built, target):
    for name in TARGETS[target].checks:
        if TOOLS[name].find() is None:
            pytest.skip(f"{name} is not installed")
    assert "2000 steps" in built(target).check()


def test_a_class_has_another_name_than_the_types_in_it(built):
    """A system may be named "state"; what the class is called is in docs/build.md."""
    names = {"heavy_top": "HeavyTop", "state": "StateStepper", "Velocity": "VelocityStepper",
             "FILE": "FILEStepper", "EOF": "EOFStepper", "_1": "Stepper1", "m_pi": "MPi"}
    assert {name: cpp.class_name(name) for name in names} == names
    x, y = sp.symbols("x y", real=True)
    system = gs.System((x,), (y,), (), y**2 / 2 + x**2 / 2, name="state")
    artefact = built("cpp", system=system, dt=0.1, start=([1.0], [0.0]), parameters=None)
    assert "2000 steps" in artefact.check()


def test_another_start_is_taken(built):
    """A target accepts q and p of any model that are on the constraints."""
    artefact = built("cpp", system=gs.problems.fast_top(), dt=1e-3, parameters=None,
                     start=([0, 0.6, 0, 0.8], [1, 0.8, 2, -0.6]))
    assert artefact.options.q == (0, 0.6, 0, 0.8)
    assert "0.6" in (artefact.path / f"{artefact.stepper.name}.hpp").read_text()


def test_a_bit_that_differs_is_found(built):
    artefact = built("cpp")
    right = native_bits(artefact.stepper, artefact.options, 3)
    wrong = ("1" if right[0] == "0" else "0") + right[1:]
    with pytest.raises(gs.GyrosparkError, match="other bits"):
        refuse_difference("It", wrong, artefact, 3)
    other_options = replace(artefact.options, parameters={**artefact.options.parameters, "u1": 0.0})
    assert native_bits(artefact.stepper, other_options, 3) != right


def test_a_step_that_fails_says_so(built):
    artefact = built("cpp", dt=1e3)
    with pytest.raises(gs.GyrosparkError, match="dt = 1000"):
        native_bits(artefact.stepper, artefact.options, 3)


@pytest.mark.parametrize("x", [0.1, 1e-5, 8.333333333333334, 1.17549435e-38, -3.0, 16777217.0])
def test_literals_are_read_as_the_number(x):
    assert float(literal(x, "double")) == x
    assert np.float32(float(literal(x, "float"))) == np.float32(x)


def test_an_artefact_says_what_it_is(built):
    artefact = built("cpp")
    marker = json.loads((artefact.path / MARKER).read_text())
    assert marker["target"] == "cpp"
    assert marker["dt"] == 0.1
    assert marker["parameters"]["u3"] == -0.02
    assert {*artefact.files} == {*marker["files"], MARKER} == {
        path.name for path in artefact.path.iterdir()}
    assert np.linalg.norm(artefact.options.q) == pytest.approx(1, abs=1e-15)


def test_what_a_user_has_beside_it_stays(built):
    artefact = built("cpp")
    (artefact.path / "notes.txt").write_text("mine")
    (artefact.path / "build").mkdir()
    rebuilt = built("cpp", dt=0.05)
    assert rebuilt.path == artefact.path
    assert (artefact.path / "notes.txt").read_text() == "mine"
    assert "0.05" in (artefact.path / "wheeled_satellite_gl1_gamma.hpp").read_text()
    with_two_stages = built("cpp", stages=2)
    names = {path.name for path in with_two_stages.path.iterdir()}
    assert "wheeled_satellite_gl1_gamma.hpp" not in names  # the header of another stepper goes
    assert {"notes.txt", "wheeled_satellite_gl2_gamma.hpp"} <= names


def test_what_somebody_else_wrote_is_not_written_over(built, tmp_path):
    artefact = built("cpp")
    (artefact.path / "main.cpp").write_text("int main() {}")
    with pytest.raises(gs.InputError, match=r"main\.cpp.*changed"):
        built("cpp")
    assert (artefact.path / "main.cpp").read_text() == "int main() {}"
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "file").write_text("mine")
    for name in ("file", "folder"):
        with pytest.raises(gs.InputError, match=f"{name}.*another --out"):
            built("cpp", out=tmp_path / name)
    assert (tmp_path / "folder" / "file").read_text() == "mine"
    with pytest.raises(gs.InputError, match="nowhere"):
        built("cpp", out=tmp_path / "nowhere" / "cpp")


def test_nothing_is_left_where_a_target_fails(built, tmp_path, monkeypatch):
    def fail(folder, platforms):
        assert (folder / "main.cpp").is_file()
        raise gs.GyrosparkError("no compiler today")

    monkeypatch.setattr(TARGETS["cpp"].load(), "compile", fail)
    with pytest.raises(gs.GyrosparkError, match="today"):
        built("cpp")
    assert [*tmp_path.iterdir()] == []


@pytest.mark.parametrize(("change", "said"), [
    ({"target": "fmu1"}, "fmu1.*cpp"),
    ({"target": 3}, "3.*cpp"),
    ({"system": "heavy_top"}, "heavy_top.*fast-top"),
    ({"system": "fast-top"}, r"dt.*--dt"),
    ({"system": "slow-top"}, "slow-top.*fast-top"),
    ({"system": "chain", "dt": 1e-3}, "56.*28"),
    ({"system": ROOT / "examples" / "car_axis.toml"}, "car_axis"),
    ({"real": "float128"}, "float128.*double"),
    ({"real": "float", "parameters": {"u1": 1e60}}, "u1.*1e.60"),
    ({"real": "float", "dt": 1e-60}, "dt.*1e-60"),
    ({"platforms": "linux"}, "platforms.*linux"),
    ({"parameters": {"u9": 1.0}}, "u9"),
    ({"parameters": 3}, "3.*u1"),
    ({"parameters": {"I1": -1.0}}, "I1.*-1"),
    ({"parameters": {"gamma": "h"}}, r"gamma = 'h'.*gyrospark\.gamma"),  # as in runs
    ({"start": 3}, r"3.*\(q, p\)"),
    ({"start": ([1.0], [1.0])}, "q"),
    ({"start": ([1.0, 0.1, 0, 0], [0.0, 1, 1, 1])}, "constraints.*consistent"),
    ({"start": ([1.0, 0, 0, 0], [1.0, 1, 1, 1])}, "constraints.*consistent"),
    ({"dt": 0}, "dt"),
    ({"out": ""}, "out"),
    ({"target": "fmu3", "out": "stepper.txt"}, r"stepper\.txt.*stepper\.fmu"),
    # the model's start is on the rod of the model's own length
    ({"system": ROOT / "examples" / "pendulum.toml", "parameters": {"l": 2.0}},
     r"pendulum.*1\.5 from"),
    ({"colour": "red"}, "colour"),
    ({"scheme": "RK4"}, "RK4"),
    ({"system": None}, "None"),
    ({"system": systems.case("oscillator").system, "dt": 0.1}, "no start"),
])
def test_what_cannot_be_built_is_refused(built, tmp_path, change, said):
    change = {"stages": None, "scheme": None, **change} if "system" in change else change
    change = {"parameters": None, **change} if "system" in change else change
    with pytest.raises(gs.InputError, match=said):
        built(**{"target": "cpp"} | change)
    assert [*tmp_path.iterdir()] == []


def test_a_gamma_that_runs_search_is_refused(built, tmp_path):
    path = tmp_path / "searched.toml"
    path.write_text((ROOT / "examples" / "damped_top.toml").read_text().replace(
        "[body]\n", '[body]\ngamma = "auto"\n'))
    choice = {"system": path, "scheme": None, "stages": None}
    with pytest.raises(gs.InputError, match="gamma = 'auto'"):
        built("cpp", parameters=None, **choice)
    assert built("cpp", parameters={"gamma": 2e-3}, **choice).options.parameters["gamma"] == 2e-3


def test_names_that_a_language_keeps_for_itself_are_refused(built):
    for name, target, other_target in (("this", "cpp", "rust"), ("fn", "rust", "cpp"),
                                       ("B101", "arduino", "cpp")):
        x, y, k = *sp.symbols("x y", real=True), sp.Symbol(name, positive=True)
        arguments = {"system": gs.System((x,), (y,), (k,), y**2 / 2 + k * x**2 / 2, name="spring"),
                     "parameters": {name: 1.0}, "start": ([1.0], [0.0]), "dt": 0.1}
        with pytest.raises(gs.InputError, match=f"{name!r}.*spring"):
            built(target, **arguments)
        assert built(other_target, **arguments).path.is_dir()


def test_a_missing_tool_is_named_with_its_cure(built, monkeypatch):
    artefacts = {target: built(target) for target in TEXTS}
    monkeypatch.setenv("PATH", "")
    for name in ("CC", "CXX", "CARGO"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    for target, artefact in artefacts.items():
        with pytest.raises(gs.InputError, match=f"{target}.* needs .*install"):
            artefact.check()


def test_platforms_are_those_of_the_target(built, monkeypatch):
    monkeypatch.setitem(TARGETS, "cpp", replace(TARGETS["cpp"], platforms=("linux", "mac")))
    assert built("cpp").platforms == ("linux",)
    assert built("cpp", platforms="mac,linux").platforms == ("mac", "linux")
    for wrong in ("amiga", "", 3, []):
        with pytest.raises(gs.InputError):
            built("cpp", platforms=wrong)


def test_the_command_writes_and_checks(gyrospark, tmp_path):
    answer = gyrospark("build", "cpp", SATELLITE, "--scheme", "G-L", "--stages", "1", "--parameter",
                       "u1=0.01", "--parameter", "gamma=m", "--out", tmp_path / "made")
    assert answer.code == 0, answer.stderr
    assert "main.cpp" in answer.stdout
    marker = json.loads((tmp_path / "made" / MARKER).read_text())
    assert marker["parameters"]["u1"] == 0.01


def test_settings_are_those_of_a_changed_file(gyrospark, tmp_path):
    """They leave the name of the C and the choice of --rep as they are."""
    edited, example = tmp_path / "satellite.toml", ROOT / "examples" / "satellite.toml"
    edited.write_text(example.read_text().replace("r = 6.778e6", "r = 7e6"))
    for model, *words in ((edited,), (example, "--set", "r=7e6")):
        answer = gyrospark("build", "cpp", model, *words, "--scheme", "IMS", "--rep", "alpha",
                           "--out", tmp_path / f"made{len(words)}")
        assert answer.code == 0, answer.stderr
    of_file, of_settings = ({path.name: path.read_text() for path in (tmp_path / name).iterdir()}
                            for name in ("made0", "made2"))
    assert of_settings == of_file
    assert '"r": 7000000.0' in of_file[MARKER]
    assert "satellite_ims_alpha.c" in of_file
    answer = gyrospark("build", "cpp", "chain", "--set", "count=1", "--rep", "alpha", "--scheme",
                       "IMS", "--dt", "1e-3", "--out", tmp_path / "chain")
    assert "chain_1_ims_alpha" in answer.stdout, answer.stderr


def test_a_check_that_fails_ends_with_1(gyrospark, tmp_path, monkeypatch):
    monkeypatch.setattr(TARGETS["cpp"].load(), "check",
                        lambda artefact: refuse_difference("It", "00", artefact, 1))
    answer = gyrospark("build", "cpp", SATELLITE, "--scheme", "IMS", "--out", tmp_path / "made",
                       "--check")
    assert answer.code == 1
    assert "other bits" in answer.stderr


@pytest.mark.parametrize(("words", "said"), [
    (["fmu1", "fast-top"], "fmu1"), (["cpp", "slow-top"], "slow-top"),
    (["cpp", "fast-top"], "--dt"), (["cpp", "fast-top", "--dt", "1e-3", "--parameter", "x"], "x"),
    (["cpp", "fast-top", "--dt", "1e-3", "--set", "spin=3"], "spin"),
    (["cpp", "fast-top", "--dt", "1e-3", "--out", os.sep], "out"),
    (["cpp", "fast-top", "--dt", "1e-3", "--out", "x.c"], "'x.c' names a file"),
    (["cpp", "fast-top", "--dt", "1e-3", "--for", "linux"], "--for"),
])
def test_bad_input_is_one_line(gyrospark, words, said):
    refused(gyrospark("build", *words), said)


def test_help_has_the_options_of_that_target(gyrospark):
    """Platforms are options of targets with binaries only."""
    assert "--for" in gyrospark("build", "fmu3", "--help").stdout
    assert "--for" not in gyrospark("build", "cpp", "--help").stdout
    output = gyrospark("build", "--list").stdout
    assert all(any(line.startswith(name) for line in output.splitlines()) for name in TARGETS)


DATA = ROOT / "tests" / "data" / "targets"
MODELS = {
    "satellite": {"system": ROOT / "examples" / "control_c" / "satellite.toml", "scheme": "G-L",
                  "stages": 2, "parameters": {"u1": 0.01, "u3": -0.02}},
    "top": {"system": "fast-top", "scheme": "EMS", "dt": 1e-3},
    "pendulum": {"system": ROOT / "examples" / "pendulum.toml", "scheme": "IMS"},
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return the texts of each target and model that no generated file has."""
    folder = tmp_path_factory.mktemp("artefacts")

    def texts(target, model):
        artefact = gs.build(target, **MODELS[model], out=folder / f"{target}_{model}")
        return {name: (artefact.path / name).read_text(encoding="utf-8") for name in artefact.files
                if name != MARKER and name.rpartition("/")[2] not in artefact.stepper.sources}

    return {(target, model): texts(target, model) for target in TEXTS for model in MODELS}


@pytest.mark.parametrize("target", TEXTS)
def test_texts_are_those_that_were_looked_at(written, target, request):
    texts = written[target, "satellite"]
    folder = DATA / target
    if request.config.getoption("--update"):
        for name, text in texts.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
    assert {path.relative_to(folder).as_posix() for path in folder.rglob("*")
            if path.is_file()} == {*texts}
    for name, text in texts.items():
        assert text == (folder / name).read_text(encoding="utf-8"), name


def test_texts_of_other_models_stay_the_same(written, request):
    digests = {f"{target} {model}": {name: hashlib.sha256(text.encode()).hexdigest()[:16]
                                     for name, text in texts.items()}
               for (target, model), texts in written.items() if model != "satellite"}
    path = DATA / "digests.json"
    if request.config.getoption("--update"):
        path.write_text(json.dumps(digests, indent=2) + "\n", encoding="utf-8")
    assert digests == json.loads(path.read_text(encoding="utf-8"))


def test_every_target_is_listed_with_a_module():
    for name, target in TARGETS.items():
        module = target.load()
        assert target.name == name
        assert all(callable(getattr(module, function))
                   for function in ("files", "compile", "check"))
