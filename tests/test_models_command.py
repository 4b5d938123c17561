"""``gyrospark models``: what has a name is listed, and what is listed can be run."""

from __future__ import annotations

import pytest

import gyrospark as gs
from gyrospark.catalogue import MODELS, PROBLEMS, SYSTEMS

NAMES = [*PROBLEMS, *MODELS, *SYSTEMS]


def test_every_name_is_listed_with_a_sentence(gyrospark):
    rows = gyrospark("models", "--json").document
    assert [row["name"] for row in rows] == NAMES
    for row in rows:
        assert row["about"].endswith(".")
        assert not row["about"].startswith("Return")
    said = gyrospark("models").stdout
    for name in NAMES:
        assert f"  {name} " in said


#: test_run_names.py runs these by their names, and compares the bits.
RUN_ELSEWHERE = ("lagrange_top", "double_pendulum", "chain")


def test_the_list_is_that_of_python():
    assert {name.replace("-", "_") for name in PROBLEMS} <= set(dir(gs.problems))
    assert set(MODELS) <= set(dir(gs.models))


@pytest.mark.parametrize("name", [*PROBLEMS, *(
    pytest.param(name, marks=[pytest.mark.slow] if name in RUN_ELSEWHERE else [])
    for name in MODELS)])
def test_every_problem_and_model_is_run_by_its_name(name, gyrospark):
    answer = gyrospark("run", name, "--scheme", "IMS", "--dt", "1e-3", "--steps", "2", "--json")
    assert answer.code == 0, answer.stderr
    assert answer.document["steps"] == 2
    assert answer.document["constraint_max"] < 1e-12
