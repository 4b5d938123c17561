"""verify --scheme splitting: order conditions of compositions, proved at the command line."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import pytest

from command_line import refused
from gyrospark.generator.tableaux.compositions import COMPOSITIONS

SPLITTING = ["verify", "--scheme", "splitting"]


@pytest.mark.parametrize(("arguments", "name", "order"), [
    (["--order", "2"], "Strang", 2),
    # The order is measured in 60 digits: seconds each.
    *(pytest.param(["--composition", name], name, order, marks=pytest.mark.slow)
      for name, order in (("G4", 4), ("KL8", 8), ("ABA1064", 4)))])
def test_compositions_hold(arguments, name, order, gyrospark):
    answer = gyrospark(*SPLITTING, *arguments)
    assert (answer.code, answer.stderr) == (0, "")
    assert answer.stdout.splitlines()[-1].startswith(f"{name}: order {order}")
    assert "FAILS" not in answer.stdout
    found = gyrospark(*SPLITTING, *arguments, "--json").document
    assert found["holds"] is True
    (only,) = found["verified"]
    assert (only["name"], only["order"], only["holds"]) == (name, order, True)
    names = " ".join(line["name"] for line in only["conditions"])
    for word in ("consistency", "symmetry", "symplecticity", "order, measured", "error constant"):
        assert word in names


def test_each_condition_has_its_interval(gyrospark):
    document = gyrospark(*SPLITTING, "--order", "6", "--json").document
    assert [one["name"] for one in document["verified"]] == ["KL6", "G6"]
    lines = {line["name"]: line for line in document["verified"][0]["conditions"]}
    for word in ("3", "113", "5"):
        low, high = map(Fraction, lines[f"order condition {word}"]["found"].strip("[]").split(", "))
        assert -Fraction(1, 10**58) < low < high < Fraction(1, 10**58)


@pytest.mark.slow
def test_all_of_them(gyrospark):
    document = gyrospark(*SPLITTING, "--json").document
    assert [one["name"] for one in document["verified"]] == [*COMPOSITIONS]
    assert document["holds"] is True


@pytest.mark.slow  # tests/generator/splitting proves the parts of every system
def test_a_stepper_of_a_system_has_its_parts_proved(gyrospark):
    (one,) = gyrospark("verify", "heavy_top_splitting4_gamma", "--json").document["verified"]
    found = {line["name"]: line["found"] for line in one["conditions"]}
    assert one["holds"]
    assert found["sum of the parts"] == found["one exact flow"] == "proved"


def test_a_wrong_composition_fails(gyrospark, monkeypatch):
    made = COMPOSITIONS["G4"]
    monkeypatch.setitem(COMPOSITIONS, "G4", replace(made, gradients=tuple(
        -c for c in made.gradients)))
    answer = gyrospark(*SPLITTING, "--composition", "G4")
    assert answer.code == 1
    assert "order condition ABB" in answer.stdout.splitlines()[-1]


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
