"""Attributes of public objects: an assignment has an effect, or is refused with a cure."""

from __future__ import annotations

import dataclasses
import importlib
import re
from pathlib import Path

import pytest

import gyrospark as gs
import systems

_PUBLIC = Path(__file__).parents[1].joinpath("data/public_api.txt").read_text(encoding="utf-8")


def _class(name):
    """Return a public class by its name in the list of public names."""
    home, _, inner = name.rpartition(".")
    if home in ("", "errors", "problems", "references"):
        return getattr(getattr(gs, home) if home else gs, inner)
    return getattr(importlib.import_module(f"gyrospark.{home}"), inner)


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """Objects by name: a simulation, its stepper, its start, a run in memory and one in a store."""
    case, step = systems.case("double_top"), systems.stepper("double_top")
    start = gs.Start(*systems.start("double_top", step), case.parameters)
    path = tmp_path_factory.mktemp("runs") / "run.zarr"
    run = step.integrate(start, dt=case.dt, steps=2)
    stored = step.integrate(start, dt=case.dt, steps=2, out=path)
    simulation = step.start(start, dt=case.dt)
    build = gs.Multibody("one")
    hinge = build.revolute("hinge", build.ground, build.body("rod", mass=1, inertia=(1, 1, 1)),
                           axis=(0, 1, 0), at=(0, 0, 1))
    return {"step": step, "start": start, "run": run, "stored": stored, "simulation": simulation,
            "inputs": simulation.input, "body": run.body(run.bodies[0]),
            "present joint": simulation.joint(run.joints[0]), "build": build, "hinge": hinge}


@pytest.mark.parametrize(("name", "attribute", "cure"), [
    ("simulation", "state", "parameters"), ("simulation", "dt", "step.start"),
    ("simulation", "q", "start.replace"), ("inputs", "torque", "sim.input["),
    ("step", "dt", "gyrospark.stepper"), ("step", "n", "gyrospark.stepper"),
    ("start", "q", "start.replace"), ("start", "velocity", "start.replace"),
    ("run", "q", "dataclasses.replace"), ("run", "colour", "another"),
    ("stored", "q", "store"), ("stored", "status", "store"), ("stored", "colour", "store"),
    ("body", "name", "run"), ("present joint", "angle", "run"), ("build", "gravity", "another"),
    ("build", "dt", "another"), ("hinge", "rate", "argument")])
def test_assignments_without_effect_are_refused(objects, name, attribute, cure):
    with pytest.raises(AttributeError, match=rf"{attribute}'.*{re.escape(cure)}"):
        setattr(objects[name], attribute, 0.5)


def test_assignments_with_an_effect_work(objects):
    simulation = objects["simulation"].copy()
    simulation.parameters = {**simulation.parameters, "gravity_z": -1.0}
    assert simulation.parameters["gravity_z"] == -1
    build = gs.Multibody("sprung")
    weight = build.point_mass("weight", mass=1, position=(0, 0, -1))
    spring = build.spring("spring", build.ground, weight, stiffness=1)
    spring.stiffness = 7.0
    assert build.model().parameters["spring_stiffness"] == 7


def test_classes_that_users_derive_take_attributes():
    class Robot(gs.Multibody):
        def __init__(self):
            super().__init__("robot")
            self.arm = self.body("arm", mass=1, inertia=(1, 1, 1))

    assert Robot().arm.name == "arm"

    class Tool(gs.Solver):
        pass

    tool = Tool("newton")
    tool.label = "a"
    assert tool.label == "a"
    with pytest.raises(dataclasses.FrozenInstanceError):
        tool.kind = "auto"


def test_every_public_class_refuses_unknown_attributes():
    names = re.findall(r"^class ([\w.]+)", _PUBLIC, flags=re.MULTILINE)
    assert len(names) > 40
    classes = [_class(name) for name in names]
    assert [cls for cls in classes if cls.__setattr__ is object.__setattr__] == []
