"""Keys of model files and elements of SDF that no example has."""

import json

import numpy as np
import pytest

import gyrospark as gs
from gyrospark.generator.models.model_file import parse_model

BODY = {"mass": 2.0, "inertia": [1.0, 1.5, 2.0], "position": [0.3, 0.1, 0.5]}
#: The text of a joint's keys, its type, its ends.
JOINTS = [
    ("screw", ["ground", "a"], "lead = 0.1\naxis_in_space = [0, 0, 1]\nat = [0, 0, 0]"
                               "\nrate = 2"),
    ("universal", ["ground", "a"], "axis_a = [1, 0, 0]\naxis_b = [0, 1, 0]\nat = [0, 0, 0]"
                                   "\nrate_a = 0.4\nrate_b = -0.7"),
    ("rolls", ["a"], "disc = 0.5\naxis_on_body = [0, 1, 0]\nnormal = [0, 0, 1]\nturning = 0.2"),
    ("rolls", ["a"], "ellipsoid = [0.4, 0.6, 0.5]\non_body = [0, 0, 0]"),
]


def values_of(lines):
    """Return the keyword arguments that lines of TOML stand for."""
    return {key: json.loads(value) for key, value in (
        line.split(" = ") for line in lines.splitlines())}


def same(model, builder):
    built = builder.model()
    assert model.system.H == built.system.H
    assert model.system.constraints == built.system.constraints
    assert model.system.velocity_constraints == built.system.velocity_constraints
    assert np.array_equal(model.q0, built.q0)
    assert np.array_equal(model.p0, built.p0)
    assert built.system.m + len(built.system.velocity_constraints) > 1


@pytest.mark.parametrize(("kind", "ends", "lines"), JOINTS, ids=lambda x: str(x)[:9])
def test_a_joint_is_what_the_builder_makes(kind, ends, lines):
    model = parse_model('name = "joined"\n[[bodies]]\nname = "a"\n' + "\n".join(
        f"{key} = {value}" for key, value in BODY.items())
        + f'\n[[joints]]\nname = "j"\ntype = "{kind}"\nbodies = {json.dumps(ends)}\n{lines}\n',
        "model.toml", None)
    builder = gs.Multibody("joined")
    builder.body("a", **BODY)
    getattr(builder, kind)("j", *ends, **values_of(lines))
    same(model, builder)


def test_coupled_joints_are_what_the_builder_makes():
    """A couple in a file, second = ratio first + offset, is the builder's."""
    bodies = "".join(f'[[bodies]]\nname = "{name}"\nmass = 2\ninertia = [1, 1.5, 2]\n'
                     for name in "ab")
    joints = "".join(f'[[joints]]\nname = "j{name}"\ntype = "revolute"\n'
                     f'bodies = ["ground", "{name}"]\naxis = [0, 0, 1]\nat = [0, 0, 0]\n'
                     for name in "ab")
    model = parse_model(f'name = "coupled"\n{bodies}{joints}[[joints]]\nname = "c"\n'
                        'type = "couple"\njoints = ["ja", "jb"]\nratio = -2\n',
                        "model.toml", None)
    builder = gs.Multibody("coupled")
    for name in "ab":
        builder.body(name, mass=2, inertia=(1, 1.5, 2))
        builder.revolute(f"j{name}", "ground", name, axis=(0, 0, 1), at=(0, 0, 0))
    builder.couple("c", "ja", "jb", ratio=-2.0)
    same(model, builder)


LINK = """<link name='{name}'><pose {relative}='{above}'>0.5 0 0 0 0.3 0</pose><inertial>
<mass>1</mass><inertia><ixx>2</ixx><iyy>2.5</iyy><izz>3</izz><ixy>.1</ixy><ixz>.2</ixz>
<iyz>-.3</iyz></inertia></inertial></link>"""
JOINT = ("<joint name='{name}' type='revolute'><parent>{parent}</parent><child>{child}</child>"
         "<axis>{axis}</axis></joint>")


def bars(tmp_path, relative, parent, axis, model=""):
    """Return the model of two bars, each turned in the axes of the bar above."""
    path = tmp_path / "bars.sdf"
    links = LINK.format(name="a", relative=relative, above="__model__") + LINK.format(
        name="b", relative=relative, above="a")
    joints = JOINT.format(name="base", parent="world", child="a", axis=axis) + JOINT.format(
        name="pin", parent=parent, child="b", axis=axis)
    path.write_text(f"<sdf version='1.8'><model name='bars' {model}>{links}{joints}</model></sdf>",
                    encoding="ascii")
    return gs.load_model(path)


def test_older_spellings_of_sdf_mean_the_same_and_products_of_inertia_are_kept(tmp_path):
    older = bars(tmp_path, "frame", "__model__", "<use_parent_model_frame>true"
                 "</use_parent_model_frame><xyz>0 1 0</xyz>", "canonical_link='a'")
    current = bars(tmp_path, "relative_to", "a", "<xyz expressed_in='__model__'>0 1 0</xyz>")
    assert np.array_equal(older.q0, current.q0)
    assert older.system.constraints == current.system.constraints
    assert older.system.H == current.system.H
    model = bars(tmp_path, "relative_to", "a", "<xyz>0 1 0</xyz>")
    for inertia in model.bodies.values():
        assert np.array_equal(inertia, [[2, 0.1, 0.2], [0.1, 2.5, -0.3], [0.2, -0.3, 3]])
