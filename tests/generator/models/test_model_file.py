"""Model files: the numbers and formulas they give, and a sentence for each mistake."""

from __future__ import annotations

import os
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.generator.models.common_tables import MAX_PARAMETERS
from gyrospark.generator.models.model_file import parse_model
from gyrospark.generator.models.single_body_file import from_euler
from gyrospark.generator.multibody.rigid_body import left_matrix
from gyrospark.runtime.rigid_body import quaternion
from processes import ROOT

EPS = float(np.finfo(float).eps)
EXAMPLES = sorted((ROOT / "examples").glob("*.toml"))

BODY = """
name = "thing"
potential = "a*R33**2 + b*q0*cos(t)"
[body]
inertia = [1, 2, "3/2"]
mass = 2.5
[parameters]
a = 0.5
b = "2*a"
[start]
euler = [0.1, "pi/6", 0.2]
angular_velocity = [1, 2, 3]
[run]
dt = 0.01
steps = 10
[quantities]
spin = "omega3*t"
weight = "mass*9.81"
"""

SYSTEM = """
name = "rod"
[system]
coordinates = ["x", "y"]
momenta = ["px", "py"]
hamiltonian = "(px**2 + py**2)/(2*m) + m*g*y"
constraints = ["x**2 + y**2 - l**2"]
[parameters]
m = 1
g = 0
l = 0.5
[start]
q = ["l", 0]
p = [0, 0]
"""


def read(text: str, rep: str | None = None) -> gs.Model:
    return parse_model(text, "model.toml", rep)


def changed(text: str, old: str, new: str) -> str:
    assert text.count(old) == 1, old
    return text.replace(old, new)


# ---------------------------------------------------------------- contents


def test_starts_of_a_body_are_the_runtimes():
    """q and p from 30 digits, rounded once, equal NumPy's."""
    model = read(BODY)
    q, R = gs.symbols.q, gs.symbols.R
    a, b = (s for s in model.system.parameters if s.name in ("a", "b"))
    V = model.system.H - gs.body_system("free", "gamma", sp.Integer(0)).H
    assert sp.expand(V - (a * R[2, 2] ** 2 + b * q[0] * sp.cos(gs.symbols.t))) == 0
    assert model.parameters == {"a": 0.5, "b": 1.0, "mass": 2.5, "I1": 1, "I2": 2, "I3": 1.5}
    assert model.bodies == {"gamma": (1, 2, 1.5)}
    assert (model.dt, model.steps, model.name) == (0.01, 10, "thing")
    assert model.system.rigid_body
    assert model.system.quantities["spin"] == gs.symbols.omega[2] * gs.symbols.t
    assert model.system.time == gs.symbols.t
    assert set(read(BODY, "alpha").bodies) == {"alpha"}
    q0 = quaternion.euler_quaternion(0.1, np.pi / 6, 0.2)
    assert abs(model.q0 - q0).max() <= 2 * EPS
    p0 = quaternion.momentum(model.q0, [1, 2, 3], (1, 2, 1.5))
    assert abs(model.p0 - p0).max() <= 8 * EPS * abs(p0).max()
    assert abs(model.q0 @ model.p0) <= 8 * EPS * abs(p0).max()


@pytest.mark.filterwarnings("ignore::gyrospark.errors.InputWarning")
@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda x: np.linalg.norm(x) > 0.1))
@settings(max_examples=10)
def test_rotation_matrix_and_quaternion_give_one_attitude(parts):
    """R gives q up to its sign, whichever entry of q is the largest."""
    q = np.array(parts) / np.linalg.norm(parts)
    rows = quaternion.rotation_matrix(q).tolist()
    euler = 'euler = [0.1, "pi/6", 0.2]'
    by_matrix = read(changed(BODY, euler, f"rotation = {rows}")).q0
    by_quaternion = read(changed(BODY, euler, f"quaternion = {parts}")).q0
    assert abs(by_quaternion - q).max() <= 2 * EPS
    assert min(abs(by_matrix - q).max(), abs(by_matrix + q).max()) <= 8 * EPS


def test_a_system_has_its_forces_and_time():
    model = read(SYSTEM)
    x, y = model.system.q
    m, g, length = model.system.parameters
    px, py = model.system.p
    assert (px**2 + py**2) / (2 * m) + m * g * y == model.system.H
    assert model.system.constraints == (x**2 + y**2 - length**2,)
    assert m.is_nonzero
    assert not g.is_nonzero
    assert model.q0.tolist() == [0.5, 0]
    assert model.bodies == {}
    assert (model.dt, model.steps) == (None, None)
    text = changed(SYSTEM, "constraints =", 'forces = ["-px", "sin(s)"]\ntime = "s"\nconstraints =')
    system = read(text).system
    assert system.time == sp.Symbol("s", real=True)
    assert system.forces == (-system.p[0], sp.sin(system.time))


def test_torque_of_a_body_does_its_work():
    """F·q̇ = τ·Ω holds on the sphere, and q·F = 0 everywhere."""
    text = BODY + '[forces]\ntorque = ["-omega1", "a*t", "q0"]\n'
    model = read(text)
    F, q = sp.Matrix(model.system.forces), sp.Matrix(model.system.q)
    omega = sp.Matrix(gs.symbols.omega)
    a = next(s for s in model.system.parameters if s.name == "a")
    tau = sp.Matrix([-omega[0], a * gs.symbols.t, q[0]])
    assert sp.expand((q.T * F)[0]) == 0
    values = dict(zip([*model.system.q, *model.system.p], [*model.q0, *model.p0], strict=True))
    values |= {s: model.parameters[s.name] for s in model.system.parameters if s.name != "gamma"}
    values |= {gs.symbols.t: 0.3}
    L = left_matrix(model.system.q)
    rate = L.T * omega / 2  # q̇ = ½ Lᵀ Ω where |q| = 1
    power, expected = ((side[0]).subs(values) for side in (F.T * rate, tau.T * omega))
    assert abs(power - expected) <= 16 * EPS * abs(expected)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda p: p.stem)
def test_examples_are_models(path):
    model = gs.load_model(path)
    assert model.name == path.stem
    assert model.description
    assert model.dt
    assert model.steps
    assert path.read_text(encoding="utf-8").startswith("# ")


def test_example_is_found_from_any_folder(tmp_path, monkeypatch):
    """The name in the help loads the installed example, unless the folder has such a file."""
    monkeypatch.chdir(tmp_path)
    assert gs.load_model("examples/pendulum.toml").name == "pendulum"
    assert gs.tableau("examples/tableaux/gauss_lobatto_2.json").order == 4
    for path in ("examples/none.toml", "examples/../examples/pendulum.toml", "pendulum.toml"):
        with pytest.raises(InputError, match="such file"):
            gs.load_model(path)
    (tmp_path / "examples").mkdir()
    (tmp_path / "examples" / "pendulum.toml").write_text(SYSTEM, encoding="utf-8")
    assert gs.load_model("examples/pendulum.toml").name == "rod"


def test_satellite_is_what_python_makes():
    mu, r = sp.symbols("mu r", real=True, nonzero=True)
    V = 3 * mu / (2 * r**3) * sum(
        moment * x**2 for moment, x in zip(gs.symbols.inertia, gs.symbols.R[2, :], strict=True))
    built = gs.body_system("satellite", "gamma", V, (mu, r))
    loaded = gs.load_model(ROOT / "examples" / "satellite.toml").system
    to_same = {s: sp.Symbol(s.name) for system in (built, loaded) for s in system.parameters}
    assert sp.expand((built.H - loaded.H).xreplace(to_same)) == 0


# ---------------------------------------------------------------- mistakes

MISTAKES: list[tuple[str, str, str, list[str]]] = [
    # text, the replaced piece, its replacement, words of the message
    (BODY, 'name = "thing"', 'name = "Thing"', ["name", "'Thing'", "lower"]),
    (BODY, 'name = "thing"', 'name = "double"', ["name", "keyword"]),
    (BODY, 'name = "thing"', 'name = "heavy_top"', ["name", "built-in"]),
    (BODY, 'name = "thing"', "name = 3", ["name", "3", "text"]),
    (BODY, 'name = "thing"', "", ["name", "missing"]),
    (BODY, 'name = "thing"', 'name = "thing"\ncolour = "red"', ["'colour'", "allowed"]),
    (BODY, 'name = "thing"', 'name = "thing"\ndescription = "a\\nb"', ["description", "one line"]),
    (BODY, "a*R33**2", "a*R44**2", ["potential", "R44", "unknown", "R33"]),
    (BODY, "a*R33**2", "a*p0**2", ["potential", "p0", "unknown"]),
    (BODY, "a*R33**2", "1/b + 1/(a - a)", ["potential", "divides"]),
    (BODY, "mass = 2.5", "mass = 0", ["[body] mass", "above 0"]),
    (BODY, "mass = 2.5", "height = 0", ["'height'", "allowed", "inertia, mass"]),
    (BODY, "mass = 2.5", 'rep = "beta"', ["[body] rep", "gamma"]),
    (BODY, "mass = 2.5", 'mass = 1\nrep = "gamma"\nalpha = 2', ["[body] alpha", "belongs"]),
    (BODY, "mass = 2.5", "mass = 1\ngamma = 0", ["[body] gamma", "is 0"]),
    (BODY, 'inertia = [1, 2, "3/2"]', "inertia = [1, 2]", ["inertia", "2 entries", "3 numbers"]),
    (BODY, 'inertia = [1, 2, "3/2"]', "inertia = [1, 2, -3]", ["inertia", "above 0"]),
    (BODY, 'inertia = [1, 2, "3/2"]', "inertia = [1, 2, nan]", ["inertia, entry 3", "finite"]),
    (BODY, 'inertia = [1, 2, "3/2"]', "inertia = [1, 2, true]", ["inertia, entry 3", "true"]),
    (BODY, 'inertia = [1, 2, "3/2"]', 'inertia = [1, 2, "x"]', ["entry 3", "x", "unknown"]),
    (BODY, 'inertia = [1, 2, "3/2"]', "", ["[body] inertia", "missing"]),
    (BODY, "a = 0.5", "sin = 0.5", ["[parameters] sin"]),
    (BODY, "a = 0.5", "q0 = 0.5\na = 1", ["[parameters] q0", "another name"]),
    (BODY, "a = 0.5", "a = 0.5\n" + "".join(f"x{i} = 1\n" for i in range(MAX_PARAMETERS)),
     ["parameters", f"{MAX_PARAMETERS}"]),
    (BODY, "a = 0.5", "I1 = 0.5\na = 1", ["[parameters] I1", "another name"]),
    (BODY, "a = 0.5", "mass = 1\na = 1", ["mass", "once"]),
    (BODY, "a = 0.5", '"a b" = 1', ["[parameters] a b", "letters, digits"]),
    (BODY, "a = 0.5", "a = inf", ["[parameters] a", "finite"]),
    (BODY, "a = 0.5", "a = [1]", ["[parameters] a", "a list of 1"]),
    (BODY, "a = 0.5", 'a = "b"', ["[parameters] a", "b", "unknown"]),
    (BODY, "a = 0.5", "a = 1979-05-27", ["[parameters] a", "number"]),
    (BODY, "a = 0.5", "a = 0.5\na = 0.6", ["not TOML", "line"]),
    (BODY, "euler = ", "quaternion = ", ["[start] quaternion", "3 entries", "4 numbers"]),
    (BODY, 'euler = [0.1, "pi/6", 0.2]', "quaternion = [0, 0, 0, 0]", ["quaternion", "zero"]),
    (BODY, 'euler = [0.1, "pi/6", 0.2]', "rotation = [[1,0,0],[0,1,0],[0,0,-1]]",
     ["[start] rotation", "matrix"]),
    (BODY, 'euler = [0.1, "pi/6", 0.2]', "rotation = [[1,0,0],[0,1,0],[0,0]]",
     ["rotation, row 3", "2 entries"]),
    (BODY, 'euler = [0.1, "pi/6", 0.2]', "", ["[start] attitude", "missing", "quaternion, euler"]),
    (BODY, 'euler = [0.1, "pi/6", 0.2]', "euler = [0, 0, 0]\nquaternion = [1, 0, 0, 0]",
     ["[start] attitude", "quaternion and euler"]),
    (BODY, 'name = "thing"', 'name = "thing"\nframe = "still"', ["frame", "'still'", "symmetries"]),
    (BODY, "angular_velocity = [1, 2, 3]", "", ["angular_velocity", "missing"]),
    (BODY, "dt = 0.01", "dt = 0", ["[run] dt", "is 0"]),
    (BODY, "dt = 0.01", 'dt = "fast"', ["[run] dt", "fast", "unknown"]),
    (BODY, "dt = 0.01", "stride = 1", ["[run] 'stride'", "dt, steps"]),
    (BODY, "steps = 10", "steps = -1", ["[run] steps", "-1", "whole number"]),
    (BODY, "steps = 10", "steps = 1.5", ["[run] steps", "1.5", "whole number"]),
    (BODY, "steps = 10", f"steps = {10**40}", ["[run] steps", "huge"]),
    (BODY, 'spin = "omega3*t"', 'spin = "omega4*t"', ["[quantities] spin", "omega4", "unknown"]),
    (BODY, 'spin = "omega3*t"', "spin = [1]", ["[quantities] spin", "formula"]),
    (BODY, 'spin = "omega3*t"', '"sp in" = "t"', ["[quantities] sp in", "letters"]),
    (BODY, "[quantities]", '[forces]\ntorque = ["a"]\n[quantities]', ["torque", "1 entries"]),
    (BODY, "[quantities]", '[forces]\nforce = ["a"]\n[quantities]', ["'force'", "torque"]),
    (BODY, "[body]", "[system]\n[body]", ["has [body], [system]", "one"]),
    (BODY, "[body]", "[corps]", ["[body], [system]", "none"]),
    (SYSTEM, '["x", "y"]', '["x"]', ["momenta", "2 names"]),
    (SYSTEM, '["x", "y"]', "[]", ["coordinates", "0 names", "1 to 64"]),
    (SYSTEM, '["x", "y"]', '["x", "x"]', ["coordinates", "'x' twice"]),
    (SYSTEM, '["x", "y"]', '["x", "px"]', ["momenta", "'px'"]),
    (SYSTEM, '["x", "y"]', '["x", 3]', ["coordinates, entry 2", "3"]),
    (SYSTEM, '["x", "y"]', '["x", "m"]', ["[parameters] m", "another name"]),
    (SYSTEM, '["x", "y"]', '["x", "__y"]', ["entry 2", "letter"]),
    (SYSTEM, "m*g*y", "m*g*z", ["hamiltonian", "z", "unknown"]),
    (SYSTEM, "m*g*y", "m*g*y**10**9", ["hamiltonian", "not within ±64"]),
    (SYSTEM, "- l**2", "- px**2", ["constraints, entry 1", "px", "unknown"]),
    (SYSTEM, "constraints =", 'constraint_names = ["a", "b"]\nconstraints =',
     ["2 constraint_names"]),
    (SYSTEM, "constraints =", 'time = "x"\nconstraints =', ["[system] time", "'x'"]),
    (SYSTEM, "constraints =", 'forces = ["1"]\nconstraints =', ["forces", "1 entries"]),
    (SYSTEM, "constraints =", "forces = 3\nconstraints =", ["forces", "list"]),
    (SYSTEM, "m = 1", "m = 0", ["[parameters] m", "divides"]),
    (SYSTEM, "m = 1", 'int = 1\nm = "int"', []),  # not used by the system: no name in C
    (SYSTEM, "m = 1", 'long = 1\nm = "0*long + 1"', []),
    (SYSTEM, 'q = ["l", 0]', "q = [1]", ["[start] q", "1 entries", "2 numbers"]),
    (SYSTEM, 'q = ["l", 0]', "quaternion = [1]", ["'quaternion'", "q, p"]),
    (SYSTEM, "p = [0, 0]", "", ["[start] p", "missing"]),
    (SYSTEM, "[system]", "[body]\n[system]", ["has [body], [system]"]),
]


@pytest.mark.parametrize(("text", "old", "new", "fragments"), MISTAKES,
                         ids=[f"{new[:30]}" for _, _, new, _ in MISTAKES])
def test_mistake_is_named(text, old, new, fragments):
    text = changed(text, old, new)
    if not fragments:
        read(text)
        return
    with pytest.raises(InputError) as caught:
        read(text)
    message = str(caught.value)
    for fragment in ("'model.toml'", *fragments):
        assert fragment in message, message
    assert message.endswith(".")
    assert len(message) < 1200
    assert "\n" not in message


BODIES = """
name = "pair"
potential = "c*(b_x - a_x)**2 + a_R33"
without = []
[[bodies]]
name = "a"
mass = 1
inertia = [1, 2, 2.5]
position = [0, 0, -1]
[[bodies]]
name = "b"
mass = "m"
inertia = [1, 1, 1]
rep = "alpha"
alpha = 3
euler = [0, 0, "pi/2"]
[[joints]]
name = "top"
type = "fixed_point"
bodies = ["a"]
at = [0, 0, 0]
[[joints]]
name = "hinge"
type = "revolute"
bodies = ["a", "b"]
at = [0, 0, -2]
axis = [0, 1, 0]
on_b = [0, 0, 1]
rate = 2
[[forces]]
name = "bow"
type = "spring"
bodies = ["ground", "b"]
stiffness = 5
length = 0.5
[[forces]]
type = "torque"
bodies = ["b"]
torque = ["-k*b_omega1", 0, "sin(t)"]
[[forces]]
type = "force"
bodies = ["b"]
force = [0, 0, "k*b_pz"]
on_body = [0, 0, 1]
[parameters]
m = 2
c = 4
k = 0.1
[quantities]
bend = "b_z - a_z"
"""


def test_bodies_are_what_the_builder_makes():
    """Python calls make the same H, constraints, forces and parameters, and the start to ε."""
    model = read(BODIES)
    pair = gs.Multibody("pair")
    a = pair.body("a", mass=1, inertia=(1, 2, 2.5), position=(0, 0, -1))
    quarter = from_euler(0, 0, np.pi / 2)
    b = pair.body("b", mass=2, inertia=(1, 1, 1), rep="alpha", weight=3, quaternion=quarter)
    pair.fixed_point("top", a, at=(0, 0, 0))
    pair.revolute("hinge", a, b, at=(0, 0, -2), axis=(0, 1, 0), on_b=(0, 0, 1), rate=2)
    c, k = pair.parameter("c", 4), pair.parameter("k", 0.1)
    pair.spring("bow", pair.ground, b, stiffness=5, length=0.5)
    pair.torque(b, (-k * b.angular_velocity[0], 0, sp.sin(pair.time)))
    pair.force(b, (0, 0, k * b.p_x[2]), on_body=(0, 0, 1))
    pair.potential(c * (b.x[0] - a.x[0]) ** 2 + a.rotation[2, 2])
    pair.quantity("bend", b.x[2] - a.x[2])
    built = pair.model()
    assert model.system.H == built.system.H
    assert model.system.constraints == built.system.constraints
    assert model.system.forces == built.system.forces
    assert dict(model.system.quantities) == dict(built.system.quantities)
    assert model.parameters == built.parameters
    assert model.bodies == built.bodies == {"a_gamma": (1, 2, 2.5), "b_alpha": (1, 1, 1)}
    assert abs(model.q0 - built.q0).max() <= 4 * EPS
    assert abs(model.p0 - built.p0).max() <= 64 * EPS * abs(built.p0).max()


@pytest.mark.parametrize(("old", "new", "fragments"), [
    ('name = "b"', 'name = "a"', ["[[bodies]] 2", "'a'", "twice"]),
    ('name = "b"', 'name = "b c"', ["[[bodies]] 2, name", "letters"]),
    ("inertia = [1, 1, 1]", "inertia = [1, 1, 0]", ["[[bodies]] 2", "above 0"]),
    ("inertia = [1, 1, 1]", "colour = 1", ["[[bodies]] 2, 'colour'", "allowed"]),
    ("alpha = 3", "gamma = 3", ["[[bodies]] 2", "gamma belongs"]),
    ("alpha = 3", "alpha = 0", ["[[bodies]] 2", "alpha", "divides"]),
    ('euler = [0, 0, "pi/2"]', "quaternion = [0, 0, 0, 0]", ["[[bodies]] 2", "zero"]),
    ('type = "revolute"', 'type = "weld"', ["[[joints]] 2, type", "'weld'", "revolute"]),
    ('bodies = ["a", "b"]', 'bodies = ["a", "d"]', ["[[joints]] 2, bodies", "'d'", "ground"]),
    ('bodies = ["a", "b"]', 'bodies = ["a"]', ["[[joints]] 2, bodies", "1 name;", "write 2"]),
    ('bodies = ["a", "b"]', 'bodies = ["a", "a"]', ["[[joints]] 2", "itself"]),
    ("axis = [0, 1, 0]", "axis = [0, 0, 0]", ["[[joints]] 2", "axis"]),
    ("axis = [0, 1, 0]", "", ["[[joints]] 2", "axis"]),
    ("rate = 2", "length = 2", ["[[joints]] 2, 'length'", "rate"]),
    ('type = "torque"\nbodies = ["b"]', 'type = "torque"\nbodies = ["ground"]',
     ["[[forces]] 2, bodies", "ground"]),
    ('"-k*b_omega1"', '"-k*c_omega1"', ["[[forces]] 2, torque, entry 1", "c_omega1", "unknown"]),
    ("c*(b_x - a_x)**2", "c*b_px", ["potential", "b_px", "unknown"]),
    ("stiffness = 5", "", ["[[forces]] 1, stiffness", "missing"]),
    ("[parameters]", '[[forces]]\nname = "s"\ntype = "joint_spring"\njoints = ["hinge"]\nrest = 1\n'
     "damping = 2\n[parameters]", ["[[forces]] 4, stiffness", "missing"]),
    ("m = 2", "m = -2", ["[[bodies]] 2", "mass"]),
    ("k = 0.1", "k = 0.1\na_x = 1", ["[parameters] a_x", "another name"]),
    ("without = []", 'without = ["hinge: q"]', ["'hinge: q'", "leave"]),
    ("without = []", 'start = 3', ["'start'", "allowed"]),
    ("without = []", "without = [3]", ["without, entry 1", "3"]),
])
def test_mistake_in_bodies_is_named(old, new, fragments):
    with pytest.raises(InputError) as caught:
        read(changed(BODIES, old, new.replace("\\n", "\n")))
    for fragment in ("'model.toml'", *fragments):
        assert fragment in str(caught.value), str(caught.value)


def test_keywords_of_c_are_no_symbols_and_a_system_has_no_rep():
    with pytest.raises(InputError, match=r"'int'.*keyword"):
        read(SYSTEM.replace('"y"', '"int"').replace("g*y", "g*int").replace("y**2 -", "int**2 -"))
    with pytest.raises(InputError, match="leave"):
        read(SYSTEM, "gamma")


@pytest.mark.parametrize("text", [
    "", "[" * 100_000, "x = " + "[" * 100_000, "x = " + "{a=" * 50_000, "a." * 50_000 + "a = 1",
    "\n".join(["a." * 60 + "a = 1"] * 2000), "x = " + "9" * 10_000, "x = 0x" + "f" * 10_000,
    "x = '''" + "a" * 10_000, "[[body]]\n[system]", "body = 3", "\x00", "= 1", "[body\n",
], ids=lambda text: repr(text[:12]))
def test_text_that_is_no_model(text):
    with pytest.raises(InputError, match=r"'model\.toml'"):
        read(text)


def test_files_that_cannot_be_read(tmp_path):
    def refused(path: Any, reason: str) -> None:
        with pytest.raises(InputError, match=reason):
            gs.load_model(path)

    refused(tmp_path / "none.toml", "such file")
    refused(tmp_path, "regular")
    refused("/dev/zero", "regular")
    refused("a\0.toml", "file name")
    (tmp_path / "latin.toml").write_bytes(b"name = '\xe9'")
    refused(tmp_path / "latin.toml", "not UTF-8")
    (tmp_path / "top.png").write_bytes(b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR")
    refused(tmp_path / "top.png", r"PNG.*\.toml")
    with (tmp_path / "large.toml").open("wb") as file:
        file.truncate(50 * 2**20)
    refused(tmp_path / "large.toml", "262144")
    if hasattr(os, "mkfifo"):
        os.mkfifo(tmp_path / "pipe.toml")
        refused(tmp_path / "pipe.toml", "regular")


def test_documented_forms_are_models():
    """The two files in the module's docstring are read as models."""
    from gyrospark.generator.models import model_file

    blocks = (model_file.__doc__ or "").split("\n\n")
    examples = [block for block in blocks if block.lstrip().startswith("name =")]
    assert len(examples) == 2
    for block in examples:
        text = "\n".join(line.strip() for line in block.splitlines())
        assert tomllib.loads(text)
        assert parse_model(text, Path("doc.toml")).name in ("satellite", "pendulum")


@pytest.mark.parametrize(("name", "options", "words"), [
    ("pendulum.toml", {"keyframe": 1}, "keyframe.*MJCF"),
    ("pendulum.toml", {"ignore": "all"}, "ignore.*SDF"),
    ("crane.urdf", {"keyframe": 0}, "keyframe.*MJCF"),
    ("crane.urdf", {"set": {"m": 1.0}}, "set.*TOML"),
    ("four_bar.sdf", {"loops": "loops.toml"}, "loops.*MJCF"),
    ("pumpjack.xml", {"base": "fixed"}, "base.*URDF")])
def test_options_of_another_format_are_refused(name, options, words):
    readers = [gs.load_model] if name.endswith(".toml") or "set" in options else [
        gs.load_model, gs.Multibody.from_file]
    for read in readers:
        with pytest.raises(TypeError, match=words):
            read(f"examples/{name}", **options)


def test_builders_and_values_of_files():
    with pytest.raises(gs.InputError, match=r"pendulum\.toml.*urdf"):
        gs.Multibody.from_file("examples/pendulum.toml")
    with pytest.raises(gs.InputError, match=r"keyfram.*keyframe"):
        gs.Multibody.from_file("examples/pumpjack.xml", keyfram=0)
    plain = gs.load_model("examples/pendulum.toml")
    key, value = next(iter(plain.parameters.items()))
    for changed in (2 * value, f"2*{value}", np.float64(2 * value)):
        model = gs.load_model("examples/pendulum.toml", set={key: changed})
        assert model.parameters == {**plain.parameters, key: 2 * value}
    q = gs.load_model("examples/pendulum.toml", set={"start.q": np.array(plain.q0) * -1}).q0
    np.testing.assert_array_equal(q, -np.array(plain.q0))
    for bad in ({key: None}, {key: float("nan")}, {"no_such": 1.0}, 3):
        with pytest.raises(gs.InputError, match="set"):
            gs.load_model("examples/pendulum.toml", set=bad)


def test_keys_above_all_tables_are_set(tmp_path):
    """A falling body takes another gravity; a parameter with the name of a key goes first."""
    path = tmp_path / "falls.toml"
    path.write_text('name = "falls"\ngravity = [0, 0, -10]\n[[bodies]]\nname = "a"\nmass = 2\n'
                    "inertia = [1, 1, 1]\n", encoding="utf-8")
    for value in ([0, 0, -1.5], "[0, 0, '-3/2']"):
        assert gs.load_model(path, set={"gravity": value}).parameters["gravity_z"] == -1.5
    for bad, cure in (("gravit", r"gravity\?"), ("bodies", "gravity")):
        with pytest.raises(gs.InputError, match=f"'{bad}'.*{cure}"):
            gs.load_model(path, set={bad: 1.0})
    path.write_text(path.read_text(encoding="utf-8") + "[parameters]\nname = 3\n"
                    '[quantities]\nh = "name*a_z"\n', encoding="utf-8")
    assert gs.load_model(path, set={"name": 4.0}).parameters["name"] == 4


def test_springs_and_stops_of_a_cylindrical_joint_choose_its_coordinate(tmp_path):
    """Angles of files may have units; by default the joint counts by its travel."""
    path = tmp_path / "bolt.toml"

    def bolt(choice, rest):
        path.write_text(
            'name = "bolt"\n[[bodies]]\nname = "nut"\nmass = 2\ninertia = [1, 1, 0.5]\n'
            'position = [0, 0, 0]\n[[joints]]\nname = "axis"\ntype = "cylindrical"\n'
            'bodies = ["ground", "nut"]\nat = [0, 0, 0]\naxis = [0, 0, 1]\n'
            '[[forces]]\nname = "spring"\ntype = "joint_spring"\njoints = ["axis"]\n'
            f'stiffness = 3\nrest = {rest}\n{choice}\n'
            f'[[stops]]\nname = "end"\njoint = "axis"\nupper = {rest}\n{choice}\n',
            encoding="utf-8")
        return gs.load_model(path)

    for choice in ("", 'coordinate = "travel"'):
        model = bolt(choice, "0.5")
        assert "nut_z" in str(model.system.quantities["end"])
    model = bolt('coordinate = "angle"', '"30 deg"')
    assert model.parameters["spring_rest"] == pytest.approx(np.pi / 6, rel=1e-15)
    assert model.parameters["end_at_upper"] == pytest.approx(np.pi / 6, rel=1e-15)
    assert "atan2" in str(model.system.quantities["end"])
    for choice, rest, word in (("", '"30 deg"', "rest"), ('coordinate = "turn"', "0.5", "'turn'")):
        with pytest.raises(gs.InputError, match=word):
            bolt(choice, rest)
