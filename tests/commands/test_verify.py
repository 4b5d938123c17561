"""gyrospark verify: order conditions of compositions, and errors that fall with the order."""

from __future__ import annotations

import sys
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import gyrospark as gs
from calls import PARAMETERS, TOP
from command_line import refused
from gyrospark.certificates import accuracy_over_time
from gyrospark.certificates.accuracy_over_time import Accuracy, accuracy, draw
from gyrospark.core.errors import StepFailed
from gyrospark.generator.tableaux.compositions import COMPOSITIONS

SPLITTING = ["verify", "--scheme", "splitting"]


def test_a_composition_holds(gyrospark):
    answer = gyrospark(*SPLITTING, "--order", "2")
    assert (answer.code, answer.stderr) == (0, "")
    assert answer.stdout.splitlines()[-1].startswith("Strang: order 2")
    assert "FAILS" not in answer.stdout
    document = gyrospark(*SPLITTING, "--order", "2", "--json").document
    assert document["holds"] is True
    (only,) = document["verified"]
    assert (only["name"], only["order"], only["holds"]) == ("Strang", 2, True)
    names = " ".join(line["name"] for line in only["conditions"])
    for word in ("consistency", "symmetry", "symplecticity", "order, measured", "error constant"):
        assert word in names


def test_each_condition_has_its_interval(gyrospark):
    document = gyrospark(*SPLITTING, "--composition", "KL6", "--json").document
    lines = {line["name"]: line for line in document["verified"][0]["conditions"]}
    for word in ("3", "113", "5"):
        low, high = map(Fraction, lines[f"order condition {word}"]["found"].strip("[]").split(", "))
        assert -Fraction(1, 10**58) < low < high < Fraction(1, 10**58)


def test_a_wrong_composition_fails(gyrospark, monkeypatch):
    monkeypatch.setitem(COMPOSITIONS, "Strang", replace(
        COMPOSITIONS["Strang"], drifts=(Fraction(1, 4), Fraction(3, 4))))
    answer = gyrospark(*SPLITTING, "--composition", "Strang")
    assert answer.code == 1
    assert "symmetry" in answer.stdout.splitlines()[-1]


@pytest.mark.parametrize(("arguments", "fragments"), [
    ([*SPLITTING, "--order", "7"], ["7", "8 or 10"]),
    ([*SPLITTING, "--order", "eight"], ["'eight'", "whole number"]),
    ([*SPLITTING, "--composition", "KL9"], ["'KL9'", "KL8"]),
    ([*SPLITTING, "--composition", "KL8", "--order", "6"], ["leave out"]),
    ([*SPLITTING, "--stages", "3"], ["stages = 3", "leave"]),
    ([*SPLITTING, "heavy_top_gl3_gamma"], ["'heavy_top_gl3_gamma'", "give one"]),
    (["verify", "--scheme", "G-L", "--stages", "2", "--order", "4"], ["order", "splitting"]),
], ids=str)
def test_bad_choices_are_refused(arguments, fragments, gyrospark):
    refused(gyrospark(*arguments), *fragments)


def test_errors_fall_with_the_order(gl3):
    """The errors agree with a much finer run of another method."""
    step = gs.stepper("IMS")
    measured = accuracy(step, TOP.q0, TOP.p0, dt=1e-3, steps=100, parameters=PARAMETERS)
    assert step.order == measured.order == 2
    assert measured.dt == [4e-3 / 2**k for k in range(7)]
    assert np.abs(np.array(measured.slopes[-3:]) - 2).max() < 0.15
    fine = gl3.integrate(TOP.q0, TOP.p0, dt=1e-4, steps=round(measured.t_end / 1e-4),
                         parameters=PARAMETERS)
    count = round(measured.t_end / measured.dt[2])
    run = step.integrate(TOP.q0, TOP.p0, dt=measured.dt[2], steps=count, parameters=PARAMETERS)
    error = max(np.abs(a[-1] - b[-1]).max() / np.abs(b[[0, -1]]).max()
                for a, b in ((run.q, fine.q), (run.p, fine.p)))
    assert measured.error[2] == pytest.approx(error, rel=2e-3)


def test_steps_without_a_solution_are_left_out():
    step = gs.stepper("LIIIA-B", 3)
    measured = accuracy(step, TOP.q0, TOP.p0, dt=0.03, steps=40, parameters=PARAMETERS)
    assert 0 < len(measured.dt) < 7
    assert len(measured.dt) == len(measured.error) == len(measured.seconds)
    # the reference, of steps of 1/64 s, gets to its end, and no longer step does
    with pytest.raises(StepFailed, match=r"dt"):
        accuracy(step, TOP.q0, TOP.p0, dt=1.0, steps=4, parameters=PARAMETERS)


def test_the_picture_shows_the_numbers(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    figures = []
    monkeypatch.setattr("gyrospark.certificates.accuracy_over_time.save",
                        lambda figure, target: figures.append(figure))
    measured = Accuracy("a_stepper", 4, 1.0, [0.4, 0.2, 0.1], [1e-3, 6e-5, 0.0], [0.1, 0.2, 0.4])
    draw("top", measured, tmp_path / "a.png")
    order, work = figures[0].axes
    curve, guide = order.get_lines()
    assert list(curve.get_ydata()) == [1e-3, 6e-5]  # a logarithm has no place for 0
    assert guide.get_label() == "Δt^4"
    assert guide.get_ydata()[1] == pytest.approx(1e-3 / 16)
    assert list(work.get_lines()[0].get_xdata()) == [0.1, 0.2]
    assert {axes.get_xscale() for axes in (order, work)} == {"log"}


def test_a_step_that_failed_is_no_jump_of_the_order():
    """Errors h³ have slopes of 3, from 0.4 to 0.1 too."""
    steps = [0.4, 0.1, 0.05]
    measured = Accuracy("a_stepper", 3, 1.0, steps, [h**3 for h in steps], [1.0] * 3)
    # 8 units of round-off: those of logarithms of up to 6, and of their quotient
    assert measured.slopes == pytest.approx([3, 3], rel=2.0**-49)


def test_the_picture_is_of_the_stepper_in_the_frame(gyrospark, monkeypatch):
    """Errors are measured with the stepper and the rates that the certificate has."""
    def measured(step, *start, parameters, **size):
        return Accuracy(f"{step.name} {parameters.keys() - step.parameter_domains}", 2, 1.0,
                        [0.1], [1e-3], [1e-3])

    monkeypatch.setattr(accuracy_over_time, "accuracy", measured)
    monkeypatch.setattr(accuracy_over_time, "draw", lambda *drawn: None)
    answer = gyrospark("verify", "--model", "fast-top", "--scheme", "EMS", "--steps", "20",
                       "--frame", "symmetries", "--plot", "framed.png", "--json")
    assert answer.code == 0, answer.stderr
    assert answer.document["accuracy"]["stepper"] == f"{answer.document['stepper']} set()"


def test_on_the_command_line(gyrospark, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    verify = ["verify", "--model", "free-body", "--scheme", "IMS", "--steps", "20"]
    answer = gyrospark(*verify, "--plot", "order.png", "--json")
    assert answer.code == 0
    assert answer.document["plot"] == "order.png"
    assert len(answer.document["accuracy"]["dt"]) == 7
    assert (tmp_path / "order.png").stat().st_size > 10_000
    answer = gyrospark("verify", "--scheme", "IMS", "--plot", "order.png")
    assert answer.code == 2
    assert "--plot belongs to --model" in answer.stderr
    answer = gyrospark(*verify, "--plot", "order.txt")
    assert answer.code == 2
    assert ".png" in answer.stderr
    monkeypatch.setitem(sys.modules, "gyrospark.runtime.plotting.figure", None)
    assert 'pip install "matplotlib>=' in gyrospark(*verify, "--plot", "order.png").stderr
