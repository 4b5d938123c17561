"""Numbers with units in model files: angles and rates."""

import math

import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.generator.models.formulas import parse_number
from gyrospark.generator.models.model_file import parse_model
from gyrospark.generator.parsing.grammar import ANGLES, RATES, UNITS
from gyrospark.generator.parsing.tokens import names_in


@pytest.mark.parametrize(("text", "value"), [
    ("30 deg", sp.pi / 6), ("30deg", sp.pi / 6), ("-90 deg", -sp.pi / 2), ("0.5 rad", 0.5),
    ("10*3 deg", sp.pi / 6), ("1/3 deg", sp.pi / 540), ("(10 + 20) deg", sp.pi / 6),
    ("90 deg - 0.1 rad", sp.pi / 2 - sp.Rational(1, 10)), ("pi/6 rad", sp.pi / 6),
    ("2*tilt deg", sp.pi / 36), ("acos(0) rad", sp.pi / 2), ("1e1 deg", sp.pi / 18),
    ("30 deg/s", sp.pi / 6), ("100 rpm", 10 * sp.pi / 3), ("2 rad/s", 2), ("30 deg / s", sp.pi / 6),
    ("pi/6", sp.pi / 6), ("40*pi", 40 * sp.pi),
])
def test_units_are_what_they_are(text, value):
    """Values are SymPy's at fifty digits, correctly rounded."""
    assert parse_number(text, {"tilt": 2.5}, UNITS) == float(sp.N(value, 50))


@pytest.mark.parametrize(("text", "units", "words"), [
    ("10 + 20 deg", ANGLES, r"unit.*\(10 \+ 20\) deg"), ("20 deg + 10", ANGLES, "unit"),
    ("30 deg/2", ANGLES, "deg/2.*deg, rad"), ("30 deg/s", ANGLES, "deg/s.*deg, rad, or none"),
    ("30 deg", RATES, r"unit deg\b.*deg/s, rad/s, rpm"), ("30 rpm", ANGLES, "unit rpm"),
    ("30 deg", {}, r"deg\b.*leave"), ("30 deg deg", ANGLES, "deg.*follow"),
    ("deg", ANGLES, "deg.*unknown"), ("30 degrees", ANGLES, "degrees.*follow"),
    ("deg 30", ANGLES, "deg.*unknown"), ("30 deg*2", ANGLES, "cannot follow"),
    ("2**30 deg/", ANGLES, "unit deg/"), ("sin(30 deg)", ANGLES, "not closed"),
    ("1" * 5000 + " deg", ANGLES, "characters"), ("30 deg $", ANGLES, "no meaning"),
    ("(1", ANGLES, "not closed"),
])
def test_units_out_of_place_are_reported(text, units, words):
    with pytest.raises(InputError, match=words):
        parse_number(text, {}, units)


def test_names_of_units_are_free_for_parameters():
    """Units stand behind numbers only, so that formulas may use their names."""
    assert parse_number("2*rad + deg", {"rad": 3.0, "deg": 1.0}) == 7
    assert parse_number("rad*s deg/s", {"rad": 3.0, "s": 2.0}, RATES) == float(sp.pi / 30)
    assert names_in("2*rad + sin(x) 30 deg/s") == {"rad", "sin", "x", "deg", "s"}


MODEL = """
name = "tilted"
potential = "k*R33"
[body]
inertia = [1, 2, 2.5]
[parameters]
k = 0.3
[start]
euler = [{a}, {b}, {c}]
angular_velocity = [{d}, 0, {e}]
"""


def test_a_model_with_units_is_the_one_in_radians():
    with_units = MODEL.format(a='"90 deg"', b='"10*3 deg"', c=0, d='"30 deg/s"', e='"60 rpm"')
    plain = MODEL.format(a='"pi/2"', b='"pi/6"', c=0, d='"pi/6"', e='"2*pi"')
    in_degrees, in_radians = (parse_model(text, "m.toml") for text in (with_units, plain))
    assert list(in_degrees.q0) == list(in_radians.q0)
    assert list(in_degrees.p0) == list(in_radians.p0)


def test_units_in_bodies_joints_parameters_and_coordinates():
    text = """
name = "hinged"
gravity = [0, 0, 0]
bodies = [{name = "door", mass = 1, inertia = [1, 1, 1], euler = ["90 deg", 0, 0]}]
joints = [
    {name = "hinge", type = "revolute", bodies = ["ground", "door"], axis = [0, 0, 1], \
     at = [0, 0, 0], rate = "120 rpm"},
]
"""
    model = parse_model(text, "m.toml")
    assert model.q0[0] == pytest.approx(math.sqrt(0.5), abs=1e-15)
    step_q = 0.5 * 4 * math.pi * math.sqrt(0.5)  # q̇ = ½ q ∘ (0, Ω)
    assert gs.consistent(model.system, model).p == pytest.approx(model.p0)
    assert model.p0[3] / 4 == pytest.approx(step_q, rel=1e-14)  # p = 4 J q̇ for J = 1
    pendulum = """
name = "angle"
[system]
coordinates = ["phi"]
momenta = ["l"]
hamiltonian = "l**2/2 - cos(phi - phi0)"
[parameters]
phi0 = "15 deg"
[start]
q = ["30 deg"]
p = [0]
"""
    model = parse_model(pendulum, "m.toml")
    assert (model.q0[0], model.parameters["phi0"]) == (
        float(sp.N(sp.pi / 6, 50)), float(sp.N(sp.pi / 12, 50)))


TWO_DOORS = """
name = "doors"
redundant = "leave out"
bodies = [{name = "a", mass = 1, inertia = [1, 1, 1]}, {name = "b", mass = 1, inertia = [1, 1, 1]}]
joints = [
    {name = "left", type = "KIND", bodies = ["ground", "a"], axis = [0, 0, 1], at = [0, 0, 0]},
    {name = "right", type = "KIND", bodies = ["ground", "b"], axis = [0, 0, 1], at = [0, 0, 0]},
    {name = "both", type = "couple", joints = ["left", "right"], offset = OFFSET},
]
forces = [{name = "closer", type = "joint_spring", joints = ["left"], stiffness = 3, rest = REST}]
"""


def test_units_in_the_rest_of_a_spring_and_the_offset_of_a_couple():
    """Rests and offsets of hinges are angles; of slides they are travels and have no unit."""
    def doors(kind, offset, rest):
        return parse_model(TWO_DOORS.replace("KIND", kind).replace("OFFSET", offset).replace(
            "REST", rest), "d.toml").parameters

    for degrees, radians in (('"30 deg"', '"pi/6"'),
                             ('["-30 deg", "60 deg"]', '["-pi/6", "pi/3"]')):
        assert doors("revolute", '"18 deg"', degrees) == doors("revolute", '"pi/10"', radians)
    for offset, rest in (('"18 deg"', "0.1"), ("0", '"30 deg"')):
        with pytest.raises(InputError, match="unit deg"):
            doors("prismatic", offset, rest)


@pytest.mark.parametrize(("old", "new", "words"), [
    ("inertia = [1, 2, 2.5]", 'inertia = ["1 deg", 2, 2.5]', r"inertia, entry 1.*unit deg\b"),
    ("euler = [0, 0, 0]", 'euler = ["3 deg/s", 0, 0]', "euler, entry 1.*unit deg/s"),
    ("angular_velocity = [0, 0, 0]", 'angular_velocity = ["3 deg", 0, 0]', "unit deg"),
])
def test_units_where_none_belong_are_refused(old, new, words):
    text = MODEL.format(a=0, b=0, c=0, d=0, e=0)
    assert old in text
    with pytest.raises(InputError, match=words):
        parse_model(text.replace(old, new), "m.toml")
