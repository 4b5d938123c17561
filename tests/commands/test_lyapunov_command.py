"""gyrospark lyapunov: report, JSON, picture, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from processes import ROOT

MODEL = ROOT / "examples/pendulum.toml"
TWO = ("--scheme", "G-L", "--stages", "2")


def test_report_and_picture(gyrospark, tmp_path):
    answer = gyrospark("lyapunov", MODEL, *TWO, "--dt", "0.01", "--t-end", "0.5", "--plot", "a.png")
    assert answer.code == 0
    assert answer.stderr == ""
    assert "λ2" in answer.stdout
    assert "MEGNO" in answer.stdout
    assert (tmp_path / "a.png").stat().st_size > 10_000


def test_json(gyrospark):
    answer = gyrospark("lyapunov", MODEL, *TWO, "--dt", "0.01", "--steps", "300", "--json")
    found = answer.document
    assert answer.code == 0
    assert np.abs(np.array(found["exponents"]) + found["exponents"][::-1]).max() < 1e-10
    assert found["pairing"] < 1e-10
    assert found["time"] == pytest.approx(3)
    some = gyrospark("lyapunov", MODEL, *TWO, "--dt", "0.01", "--steps", "20", "--count", "1",
                     "--json").document
    assert some["pairing"] is None
    assert some["errors"] == [None]
    assert len(some["exponents"]) == 1
    shown = gyrospark("lyapunov", MODEL, *TWO, "--dt", "0.01", "--steps", "20", "--count", "1")
    assert "λ1" in shown.stdout
    assert "λ2" not in shown.stdout
    assert "pairs" not in shown.stdout


@pytest.mark.parametrize(("options", "word"), [
    (["--count", "9"], "count"), (["--every", "0"], "every"), (["--every", "a"], "--every"),
    (["--plot", "a.doc"], ".doc"), (["--set", "m3=1"], "m3"), (["--dt", "x"], "--dt"),
    (["--steps", "5", "--t-end", "1"], "--t-end"), (["--scheme", "GL"], "G-L"),
])
def test_bad_input(gyrospark, options, word):
    answer = gyrospark("lyapunov", MODEL, *TWO, *options)
    assert answer.code == 2
    assert answer.stderr.count("\n") == 1
    assert word in answer.stderr


def test_unknown_problem(gyrospark):
    answer = gyrospark("lyapunov", "fast_topp")
    assert answer.code == 2
    assert "fast-top" in answer.stderr
