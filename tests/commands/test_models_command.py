"""``gyrospark models`` lists everything with a name, and each entry of the list can be run."""

from __future__ import annotations

import pytest

import gyrospark as gs
from gyrospark.core.registry import MODELS, PROBLEMS, SYSTEMS
from processes import ROOT

NAMES = [*PROBLEMS, *MODELS, *SYSTEMS]


def test_every_name_is_listed_with_a_sentence(gyrospark):
    rows = gyrospark("models", "--json").document
    assert [row["name"] for row in rows] == NAMES
    for row in rows:
        assert row["about"].endswith(".")
        assert not row["about"].startswith("Return")
    text = gyrospark("models").stdout
    for name in NAMES:
        assert f"  {name} " in text


def test_the_list_is_that_of_python():
    assert {name.replace("-", "_") for name in PROBLEMS} <= set(dir(gs.problems))
    assert set(MODELS) <= set(dir(gs.models))


@pytest.mark.parametrize("name", PROBLEMS)  # test_run_names.py runs the models
def test_every_problem_is_run_by_its_name(name, gyrospark):
    answer = gyrospark("run", name, "--scheme", "IMS", "--dt", "1e-3", "--steps", "2", "--json")
    assert answer.code == 0, answer.stderr
    assert answer.document["steps"] == 2
    assert answer.document["constraint_max"] < 1e-12


EXAMPLES = sorted(path.name for path in (ROOT / "examples").iterdir()
                  if not path.name.startswith("__"))


def test_every_example_is_listed_with_what_it_is(gyrospark):
    rows = gyrospark("examples", "list", "--json").document
    assert [row["name"] for row in rows] == EXAMPLES
    for row in rows:
        assert len(row["about"]) > 20, row
    text = gyrospark("examples", "list").stdout
    assert all(f"\n{name} " in f"\n{text}" for name in EXAMPLES)


def test_examples_are_copied_whole_and_run(gyrospark, tmp_path):
    assert gyrospark("examples", "copy", "all", "--to", str(tmp_path / "mine")).code == 0
    for path in (ROOT / "examples").rglob("*"):
        if path.is_file() and "__" not in str(path.relative_to(ROOT)):
            copied = tmp_path / "mine" / path.relative_to(ROOT / "examples")
            assert copied.read_bytes() == path.read_bytes()
    answer = gyrospark("run", str(tmp_path / "mine" / "pendulum.toml"), "--scheme", "IMS",
                       "--steps", "2", "--json")
    assert answer.code == 0, answer.stderr


def test_several_examples_are_copied_once_each(gyrospark, tmp_path):
    names = ("pendulum.toml", "crane.urdf", "pendulum.toml")
    assert gyrospark("examples", "copy", *names, "--to", str(tmp_path)).code == 0
    assert {path.name for path in tmp_path.iterdir()} == {*names}
    answer = gyrospark("examples", "copy", "control_c", "crane.urd", "--to", str(tmp_path))
    assert (answer.code, len(list(tmp_path.iterdir()))) == (2, 2)


def test_copying_writes_nothing_over(gyrospark, tmp_path):
    (tmp_path / "pendulum.toml").write_text("mine", encoding="utf-8")
    for name in ("pendulum.toml", "all"):
        answer = gyrospark("examples", "copy", name, "--to", str(tmp_path))
        assert (answer.code, answer.stderr.count("\n")) == (2, 1)
        assert "already" in answer.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["pendulum.toml"]
    assert (tmp_path / "pendulum.toml").read_text(encoding="utf-8") == "mine"


def test_an_example_that_is_none(gyrospark, tmp_path):
    answer = gyrospark("examples", "copy", "pendulm.toml", "--to", str(tmp_path))
    assert answer.code == 2
    assert "pendulum.toml?" in answer.stderr
