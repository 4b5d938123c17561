"""verify --scheme splitting: order conditions of compositions, proved at the command line."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest

from command_line import refused
from gyrospark.generator.tableaux.compositions import COMPOSITIONS

SPLITTING = ["verify", "--scheme", "splitting"]


def test_a_composition_holds(gyrospark):
    answer = gyrospark(*SPLITTING, "--order", "2")
    assert (answer.code, answer.stderr) == (0, "")
    assert answer.stdout.splitlines()[-1].startswith("Strang: order 2")
    assert "FAILS" not in answer.stdout
    found = gyrospark(*SPLITTING, "--order", "2", "--json").document
    assert found["holds"] is True
    (only,) = found["verified"]
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
