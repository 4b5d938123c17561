"""gyrospark lyapunov and fit: report, JSON, picture, and refusals in one line."""

from __future__ import annotations

import numpy as np
import pytest

from command_line import refused
from processes import ROOT

MODEL = str(ROOT / "examples" / "pendulum.toml")
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
    document = answer.document
    assert answer.code == 0
    assert np.abs(np.array(document["exponents"]) + document["exponents"][::-1]).max() < 1e-10
    assert document["pairing"] < 1e-10
    assert document["time"] == pytest.approx(3)
    first = gyrospark("lyapunov", MODEL, *TWO, "--dt", "0.01", "--steps", "20", "--count", "1",
                      "--json").document
    assert first["pairing"] is None
    assert first["errors"] == [None]
    assert len(first["exponents"]) == 1
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


SCHEME = ["--scheme", "G-L", "--stages", "2", "--dt", "0.01"]


@pytest.fixture
def table(gyrospark, tmp_path):
    """Return a table of a run, as ``gyrospark run`` writes it."""
    path = tmp_path / "swing.csv"
    answer = gyrospark("run", MODEL, *SCHEME, "--steps", "120", "--every", "4", "--out", str(path))
    assert answer.code == 0, answer.stderr
    return path


def test_a_wrong_call_is_answered_in_one_line(gyrospark, table, tmp_path):
    def fit(*arguments, file=table):
        return gyrospark("fit", MODEL, str(file), *SCHEME, "--observe", "x,y", *arguments)

    refused(fit("--free", "gg"), "'gg'", "mean g?")
    refused(fit("--observe", "x,z"), "'z'", "px")
    refused(fit("--observe", "q,x"), "'x'", "2 times")
    refused(fit("--dt", "0.03"), "whole number")
    refused(fit("--sigma", "much"), "--sigma")
    refused(fit(file=tmp_path / "none.csv"), "none.csv", "be read")
    lines = table.read_text(encoding="utf-8").splitlines()
    for name, text, message in (
        ("empty", "", "no samples"), ("other", "time,x\n0,1\n", "no column 'y'"),
        ("two", "time,x,y,x\n0,1,2,1\n", "2 columns 'x'"),
        ("underscore", "time,x,y\n\n0,1_0,2\n", "line 3"),
        ("hole", "\n".join([*lines[:3], lines[3].replace(lines[3].split(",")[1], "?")]), "line 4"),
    ):
        path = tmp_path / f"{name}.csv"
        path.write_text(text, encoding="utf-8")
        refused(fit(file=path), message)


def test_the_columns_may_be_in_any_order(gyrospark, table, tmp_path):
    rows = np.genfromtxt(table, delimiter=",", names=True)
    path = tmp_path / "turned.csv"
    path.write_text("y, time ,x\n" + "".join(
        f"{float(row['y'])!r},{float(row['time'])!r},{float(row['x'])!r}\n" for row in rows),
        encoding="utf-8")
    answers = [gyrospark("fit", MODEL, str(file), *SCHEME, "--observe", "x,y", "--free", "l",
                         "--json")
               for file in (table, path)]
    assert answers[0].code == 0, answers[0].stderr
    assert answers[0].document == answers[1].document
    assert answers[0].document["converged"]
    assert answers[0].document["parameters"]["l"] == pytest.approx(0.5, rel=1e-7)
    text = gyrospark("fit", MODEL, str(table), *SCHEME, "--observe", "x,y", "--fixed", "start",
                     "--sigma", "1e-3")
    assert text.code == 0, text.stderr
    assert "undetermined: m\n" in text.stdout
    assert "\n  g = 9.81" in text.stdout
