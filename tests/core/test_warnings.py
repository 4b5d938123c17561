"""Warnings about accepted but suspicious input name the value and the cure."""

from __future__ import annotations

import json
import threading
import warnings

import numpy as np
import pytest

import gyrospark as gs
from calls import TOP
from command_line import ECCENTRIC
from gyrospark.core.warnings import capture_warnings, warn
from gyrospark.generator.models.model_file import parse_model
from gyrospark.runtime.integration.run_arguments import warn_of_negative
from processes import ROOT

BODY = """
name = "said"
potential = "mass*9.81*l*R33"
[body]
inertia = [0.1, 0.1, 0.05]
mass = 1.5
[parameters]
l = 0.2
[start]
euler = [0.1, 0.2, 0.3]
angular_velocity = [0, 0, 10]
[run]
dt = 0.001
steps = 3
"""
#: Name → text of the file, the text in its place, and words of the remark.
REMARKS = {
    "degrees": ("euler = [0.1, 0.2, 0.3]", "euler = [30, 45, 90]",
                ["[start] euler", "[30, 45, 90]", "radians",
                 '["30 deg", "45 deg", "90 deg"]']),
    "unused parameter": ("l = 0.2", "l = 0.2\nlength = 3",
                         ["[parameters] length", "no formula"]),
    "unused mass": ("mass*9.81*l*R33", "l*R33", ["[body] mass", "no formula", "potential"]),
    "length": ("euler = [0.1, 0.2, 0.3]", "quaternion = [2, 0, 0, 0]", ["length 2"]),
    "order": ("euler = [0.1, 0.2, 0.3]", "quaternion = [0, 0, 0, 1]",
              ["scalar", "write (1, 0, 0, 0)"]),
    "flat": ("inertia = [0.1, 0.1, 0.05]", "inertia = [0.11, 0.11, 0.23]", ["rounding"]),
}
SILENT = {
    "as it is": ("", ""), "in degrees": ("euler = [0.1, 0.2, 0.3]", 'euler = ["400 deg", 0, 0]'),
    "with pi": ("euler = [0.1, 0.2, 0.3]", 'euler = ["40*pi", 0, 9]'),
    "in radians": ("euler = [0.1, 0.2, 0.3]", 'euler = ["30 rad", 45, 90]'),
    "by another number": ("l = 0.2", 'k = 0.1\nl = "2*k"'),
    "by the start": ("l = 0.2\n[start]\neuler = [0.1,", 'l = 0.2\nk = 0.1\n[start]\neuler = ["k",'),
    "by a quantity": ("[run]", '[quantities]\nx = "l*omega1"\n[run]'),
    "unit": ("euler = [0.1, 0.2, 0.3]", "quaternion = [0.6, 0, 0.8, 0]"),
}


def changed(old, new):
    assert old in BODY
    return BODY.replace(old, new, 1)


@pytest.mark.parametrize(("old", "new", "words"), REMARKS.values(), ids=REMARKS.keys())
def test_a_model_file_is_remarked_on(old, new, words):
    """The remark comes once, with the file's name, at the line of the call."""
    with pytest.warns(gs.errors.InputWarning) as remarks:
        parse_model(changed(old, new), "said.toml")
    assert len(remarks) == 1
    text = str(remarks[0].message)
    assert "'said.toml'" in text
    for word in words:
        assert word in text
    assert remarks[0].filename == __file__


@pytest.mark.parametrize(("old", "new"), SILENT.values(), ids=SILENT.keys())
def test_what_is_meant_so_is_not_remarked_on(old, new):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        parse_model(changed(old, new), "said.toml")


def test_unused_parameters_of_every_kind_of_file():
    system = """
name = "s"
[system]
coordinates = ["x"]
momenta = ["p"]
hamiltonian = "p**2/2 + k*x**2"
[parameters]
k = 1
c = 2
[start]
q = [1]
p = [0]
"""
    bodies = """
name = "b"
[[bodies]]
name = "a"
mass = "m"
inertia = [1, 1, 1]
[parameters]
m = 2
c = 3
"""
    for text in (system, bodies):
        with pytest.warns(gs.errors.InputWarning, match=r"\[parameters\] c\b") as remarks:
            parse_model(text, "u.toml")
        assert len(remarks) == 1


def test_angles_of_the_double_pendulum_in_degrees():
    with pytest.warns(gs.errors.InputWarning, match=r"\[30, 45\].*radians\("):
        gs.models.double_pendulum(angles=(30, 45))


def test_a_builder_remarks_on_quaternions():
    build = gs.Multibody("m")
    with pytest.warns(gs.errors.InputWarning, match="'a'.*scalar") as w:
        build.body("a", mass=1, inertia=(1, 1, 1), quaternion=(0, 0, 0, 1))
    assert w[0].filename == __file__
    with pytest.warns(gs.errors.InputWarning, match="'b'.*length 2"):
        build.body("b", mass=1, inertia=(1, 1, 1), quaternion=(2, 0, 0, 0))
    with pytest.warns(gs.errors.InputWarning, match="length 3"):
        gs.problems.free_body(attitude=(3, 0, 0, 0))
    with pytest.warns(gs.errors.InputWarning, match="quaternion.*scalar"):
        gs.sweep(TOP, {"start": {"angular_velocity": [[0, 0, 1]] * 2, "quaternion": [0, 0, 0, 1]}},
                 scheme="IMS", dt=1e-3, steps=1)


def test_negative_gamma_is_legal_and_said():
    """T does not depend on γ where |q| = 1; its discretisation does, linearly in 1/γ."""
    run = {"dt": 1e-3, "steps": 300}
    m = gs.gamma(TOP.inertia)
    step = gs.stepper("G-L", 2)
    with pytest.warns(gs.errors.InputWarning, match=r"gamma = -0\.0016.*\bm\b") as remarks:
        negative = step.integrate(TOP.q0, TOP.p0, **run, parameters=TOP.parameters | {"gamma": -m})
    assert len(remarks) == 1
    positive = step.integrate(TOP.q0, TOP.p0, **run, parameters=TOP.parameters | {"gamma": m})
    assert np.abs(negative.axis() - positive.axis()).max() < 1e-6
    ratio = negative.report.energy_error_max / positive.report.energy_error_max
    assert 2 < ratio < 20  # "several times"


def test_a_negative_parameter_that_is_no_gamma_of_a_body_is_silent():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warn_of_negative({"gamma": -1.0, "k": 2.0})
    with pytest.warns(gs.errors.InputWarning, match="gamma"):
        warn_of_negative({"gamma": -1.0, "I1": 2.0, "I2": 2.0, "I3": 1.0})
    with pytest.warns(gs.errors.InputWarning, match="hinge_damping = -0.1.*energy"):
        warn_of_negative({"hinge_damping": -0.1})


def test_remarks_are_heard_by_the_thread_that_listens():
    heard = {}

    def work(name):
        with capture_warnings() as captured:
            warn(name)
            heard[name] = list(captured)

    threads = [threading.Thread(target=work, args=(str(i),)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert heard == {str(i): [str(i)] for i in range(8)}
    with pytest.warns(gs.errors.InputWarning, match="now"):
        warn("now")


def test_the_command_line_says_it_in_a_line_and_keeps_json(gyrospark, tmp_path):
    """The warning appears again when the file is known from an earlier run and not read anew."""
    path, example = tmp_path / "said.toml", ROOT / "examples" / "pendulum.toml"
    path.write_text(example.read_text(encoding="utf-8").replace(
        "[parameters]", "[parameters]\nlength = 3"), encoding="utf-8")
    for _ in range(2):
        answer = gyrospark("run", path, "--scheme", "IMS", "--steps", "3", "--json")
        assert answer.code == 0
        assert answer.document["steps"] == 3
        assert answer.stderr.count("\n") == 1
        assert answer.stderr.startswith("gyrospark: warning: ")
        assert "said.toml'" in answer.stderr
        assert "[parameters] length" in answer.stderr


def test_warnings_that_a_user_makes_errors_stay_lines(gyrospark, monkeypatch):
    """The command line's own filter precedes the user's, and is removed at the end."""
    showwarning = warnings.showwarning
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        answer = gyrospark("run", "fast-top", "--scheme", "IMS", "--dt", "1e-3", "--steps", "3",
                           "--gamma", "-1", "--json")
    assert (answer.code, answer.stderr.count("\n")) == (0, 1)
    assert answer.document["parameters"]["gamma"] == -1
    assert "gamma = -1" in answer.stderr
    assert warnings.showwarning is showwarning


def test_other_commands_say_it_too(gyrospark, generate, tmp_path):
    path = tmp_path / "said.toml"
    path.write_text(ECCENTRIC.replace("k = 1", "k = 1\nlength = 3"), encoding="utf-8")
    study = tmp_path / "study.toml"
    study.write_text('model = "said.toml"\nscheme = "G-L 2"\ndtau = 0.1\nsteps = 2\n'
                     '[grid]\nk = [0.9, 1.1]\n', encoding="utf-8")
    for answer in (generate("--scheme", "G-L", "--stages", "2", "--system", path, "--no-compile"),
                   gyrospark("sweep", study, "--json")):
        assert answer.code == 0, answer.stderr
        assert answer.stderr.count("\n") == 1
        assert "[parameters] length" in answer.stderr
    json.loads(answer.stdout)
