"""Joints: what Python has, model files have, with the same arguments."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.generator.multibody.joints import Align, Connection, Joint, Revolute, Rod, Spring
from gyrospark.generator.multibody.multibody import JOINTS

TOPS = """
name = "tops"
bodies = [
    {name = "outer", mass = 1, inertia = [0.1, 0.1, 0.2], angular_velocity = [1, 2, 3]},
    {name = "inner", mass = 1, inertia = [0.1, 0.1, 0.2]},
]
joints = [
    {name = "foot", type = "fixed_point", bodies = ["outer"], at = [0, 0, 0], \
     on_body = [0, 0, -0.5]},
    {name = "middle", type = "ball", bodies = ["outer", "inner"], at = [0, 0, 0.5]},
    {name = "axis", type = "align", bodies = ["outer", "inner"], axis = [0, 3, 4], rate = "30 rpm"},
]
"""


def test_model_files_have_the_joints_of_python():
    methods = {name for name, thing in vars(gs.Multibody).items()
               if inspect.isfunction(thing) and not name.startswith("_")
               and {"a", "b"} <= set(inspect.signature(thing).parameters)}
    # Of joints that are mappings: of robots in MJCF; contacts and latches have tables of their own.
    methods -= {"chain", "contact", "latch"}
    assert methods | {"fixed_point", "rolls"} == {*JOINTS, "spring"}


def test_align_in_a_file(tmp_path):
    """As a ball it is a hinge: the same system as from Python, and as with ``revolute``."""
    (tmp_path / "tops.toml").write_text(TOPS, encoding="utf-8")
    found = gs.load_model(tmp_path / "tops.toml")
    build = gs.Multibody("tops")
    for name, more in (("outer", {"angular_velocity": (1, 2, 3)}), ("inner", {})):
        build.body(name, mass=1, inertia=(0.1, 0.1, 0.2), **more)
    build.fixed_point("foot", "outer", at=(0, 0, 0), on_body=(0, 0, -0.5))
    build.ball("middle", "outer", "inner", at=(0, 0, 0.5))
    build.align("axis", "outer", "inner", axis=(0, 3, 4), rate=np.pi)
    made = build.model()
    assert found.system.constraints == made.system.constraints
    assert found.system.constraint_names[-2:] == ("axis: axis 1", "axis: axis 2")
    assert found.p0 == pytest.approx(made.p0, abs=1e-14)
    (tmp_path / "tops.toml").write_text(TOPS.replace("axis = [0, 3, 4], ", ""), encoding="utf-8")
    with pytest.raises(gs.InputError, match="axis"):
        gs.load_model(tmp_path / "tops.toml")


@pytest.mark.parametrize("kind", [Align, Joint, Revolute, Rod, Spring])
def test_connections_say_what_they_do(kind):
    """Nothing asks which kind one is: each hands on, holds and has energy, or none."""
    assert issubclass(kind, Connection)
    own = {name for part in kind.__mro__ if part not in (Connection, object) for name in vars(part)}
    assert own & {"equations", "energy"}
