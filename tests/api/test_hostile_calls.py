"""Everything public, called with absurd arguments: results or errors of ours."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.core.registry import MODELS, PROBLEMS
from hostile import WRONG, calls

NAMES = [call.name for call in calls(Path())]
#: One of each kind of argument; the others are for the slow run.
FEW = ("text", "none", "nan", "block")
pytestmark = pytest.mark.filterwarnings("ignore::gyrospark.errors.InputWarning")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder for what calls write, and the calls, built once."""
    path = tmp_path_factory.mktemp("hostile")
    return path, calls(path)


@pytest.mark.parametrize("wrongs", [
    FEW, pytest.param({*WRONG} - {*FEW}, marks=pytest.mark.slow)], ids=["few", "others"])
@pytest.mark.parametrize("number", range(len(NAMES)), ids=lambda i: NAMES[i])
def test_wrong_arguments_end_in_sentences(number, wrongs, folder, monkeypatch):
    path, every = folder
    monkeypatch.chdir(path)
    ends = {every[number].try_one(argument, wrong) for argument, wrong in every[number].variants()
            if wrong in wrongs}
    assert ends <= {"refused", "accepted"}
    if every[number].make()[1]:
        assert "refused" in ends


def test_everything_public_is_called():
    """A new public function or method must be called here too."""
    called = {name.rpartition(".")[2] for name in NAMES}
    no_calls = {"Ensemble", "GyrosparkError", "InputError", "Simulation", "StepFailed", "Stepper",
                "Trajectory"}
    public = {name for name in gs.__all__ if callable(getattr(gs, name))}
    assert public - no_calls <= called
    methods = {name for owner in (gs.Stepper, gs.Multibody)
               for name, _ in inspect.getmembers(owner, inspect.isfunction)
               if not name.startswith("_")}
    methods |= {"save", "show", "plot", "table", "dataset"}  # of a trajectory
    of_lagrangians = {"momenta", "velocities"}  # test_lagrangian.py calls them
    assert methods - {"measured"} - of_lagrangians <= called
    makers = {entry.name.replace("-", "_") for entry in (*PROBLEMS.values(), *MODELS.values())}
    assert makers <= called


def test_every_argument_is_spoilt(folder):
    """Each call of the table has every argument of its function, except by name."""
    for call in folder[1]:
        function, arguments = call.make()
        parameters = inspect.signature(function).parameters
        names = {name for name, parameter in parameters.items()
                 if parameter.kind is not parameter.VAR_POSITIONAL or name in arguments}
        # Of the stepper's method, of targets, of robots' files; the gap of a latch.
        if collected := {name for name, parameter in parameters.items()
                         if parameter.kind is parameter.VAR_KEYWORD}:
            names = names - collected | set(arguments)
        assert set(arguments) <= names, call.name
        if call.name.startswith("Multibody."):  # several calls share a method's arguments
            names -= {"rotation"} if "quaternion" in arguments else {
                "quaternion", "rep", "weight", "position", "velocity", "angular_velocity"}
        if call.name in MODELS:
            names -= {"rep"}  # handed on to Multibody
        assert not names - set(arguments), call.name


@pytest.mark.parametrize("name", ["force", "torque"])
def test_bodies_by_name_are_the_bodies(name):
    """B.force("b", …) is B.force(b, …); a joint takes names too, and the ground."""
    def built(by_name):
        build = gs.Multibody("pushed")
        a = build.top("a", mass=1, inertia=(0.1, 0.1, 0.05), centre=(0, 0, 1))
        b = build.body("b", mass=1, inertia=(0.1, 0.1, 0.05))
        getattr(build, name)("b" if by_name else b, (0, 1, 2))
        build.ball("j", *(("a", "b") if by_name else (a, b)), on_a=(0, 0, 1), on_b=(0, 0, 0))
        build.rod("r", "ground" if by_name else build.ground, b, on_b=(0.5, 0, 0), length=1.1)
        return build.model()

    by_names, by_objects = built(by_name=True), built(by_name=False)
    assert by_names.system.forces == by_objects.system.forces
    assert by_names.system.constraints == by_objects.system.constraints
    assert np.array_equal(by_names.q0, by_objects.q0)


@pytest.mark.parametrize(("call", "words"), [
    (lambda b: b.force("c", (0, 0, 1)), "'c'.*body"),
    (lambda b: b.force("bodi", (0, 0, 1)), r"body\?"),
    (lambda b: b.torque("body", lambda t: (0, 0, t)), "'body'.*time"),
    (lambda b: b.torque("body", (lambda t: t, 0, 0)), "SymPy"),
], ids=range(4))
def test_what_users_tried_is_reported(call, words):
    build = gs.Multibody("told")
    build.body("body", mass=1, inertia=(0.1, 0.1, 0.05))
    with pytest.raises(gs.InputError, match=words):
        call(build)
