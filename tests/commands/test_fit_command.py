"""``gyrospark fit``: a table of a run is fitted, and what cannot be fitted is one line."""

from __future__ import annotations

import numpy as np
import pytest

from command_line import refused
from processes import ROOT

MODEL = str(ROOT / "examples" / "pendulum.toml")
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
    for name, text, said in (
        ("empty", "", "no samples"), ("other", "time,x\n0,1\n", "no column 'y'"),
        ("two", "time,x,y,x\n0,1,2,1\n", "2 columns 'x'"),
        ("underscore", "time,x,y\n\n0,1_0,2\n", "line 3"),
        ("hole", "\n".join([*lines[:3], lines[3].replace(lines[3].split(",")[1], "?")]), "line 4"),
    ):
        path = tmp_path / f"{name}.csv"
        path.write_text(text, encoding="utf-8")
        refused(fit(file=path), said)


def test_the_columns_may_be_in_any_order(gyrospark, table, tmp_path):
    rows = np.genfromtxt(table, delimiter=",", names=True)
    path = tmp_path / "turned.csv"
    path.write_text("y, time ,x\n" + "".join(
        f"{float(row['y'])!r},{float(row['time'])!r},{float(row['x'])!r}\n" for row in rows),
        encoding="utf-8")
    found = [gyrospark("fit", MODEL, str(file), *SCHEME, "--observe", "x,y", "--free", "l",
                       "--json")
             for file in (table, path)]
    assert found[0].code == 0, found[0].stderr
    assert found[0].document == found[1].document
    assert found[0].document["converged"]
    assert found[0].document["parameters"]["l"] == pytest.approx(0.5, rel=1e-7)
    text = gyrospark("fit", MODEL, str(table), *SCHEME, "--observe", "x,y", "--fixed", "start",
                     "--sigma", "1e-3")
    assert text.code == 0, text.stderr
    assert "undetermined: m\n" in text.stdout
    assert "\n  g = 9.81" in text.stdout
