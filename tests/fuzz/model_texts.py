"""Model files: the examples with a few changes in their text or in their tables, or any bytes."""

from __future__ import annotations

import json
import tomllib
from functools import cache
from typing import Any

from gyrospark.core.errors import InputError
from gyrospark.generator.models.model_file import load_model

from .choices import Choices
from .formulas import formula
from .mutations import changed_text, changed_tree
from .scratch import scratch
from .sentences import refuse_unless_sentence

#: Small relatives of the examples, with what those do not have.
MORE = (
    """name = "bead"
[system]
coordinates = ["x", "y"]
momenta = ["u", "v"]
hamiltonian = "(u**2 + v**2)/(2*m) + m*g*y"
constraints = ["x**2 + y**2 - 1"]
forces = ["-c*u + sin(t)", "-c*v"]
time = "t"
[parameters]
m = 1
g = "3*pi"
c = 0.1
[start]
q = [1, 0]
p = [0, "m/2"]
""",
    """name = "linkage"
gravity = [0, 0, -9.81]
without = ["closing: x"]
[[bodies]]
name = "a"
mass = 1
inertia = [0.1, 0.1, 0.02]
position = [0, 0, -0.5]
rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
rep = "alpha"
[[bodies]]
name = "b"
mass = 0.5
inertia = [0.02, 0.03, 0.04]
position = [0, 0, -1.5]
velocity = [0, 0.1, 0]
[[joints]]
name = "top"
type = "revolute"
bodies = ["ground", "a"]
at = [0, 0, 0]
axis = [1, 0, 0]
rate = 0.5
[[joints]]
name = "bar"
type = "rod"
bodies = ["a", "b"]
on_a = [0, 0, -0.5]
on_b = [0, 0, 0]
length = 0.5
[[forces]]
name = "s"
type = "spring"
bodies = ["ground", "b"]
stiffness = 10
length = 0.2
[[forces]]
type = "torque"
bodies = ["b"]
torque = ["-b_omega1", "-b_omega2", "sin(t)*k"]
[parameters]
k = 0.1
""",
)
WORDS = (
    "name", "[body]", "[system]", "[[bodies]]", "[[joints]]", "[start]", "[run]", "[parameters]",
    "[quantities]", "[forces]", "inertia", "mass", "rep", "gamma", "alpha", '"alpha"', "euler",
    "quaternion", "rotation", "angular_velocity", "coordinates", "momenta", "constraints", "dt",
    "steps", "0", "-1", "1e308", "nan", "inf", "true", "1979-05-27", "12:00:00", '""', "[]", "{}",
    "= ", ".", "'''", '"""', "#", "\n", "x", "q0", "R31", "t", "pi", "sqrt(", "I1", "{a = 1}",
)
NAMES = ("x", "y", "px", "m", "g", "l", "q0", "R33", "omega1", "I1", "t", "mass", "b_omega1", "x1")


@cache
def examples() -> tuple[str, ...]:
    from processes import ROOT

    files = sorted((ROOT / "examples").glob("*.toml"))
    return (*(path.read_text(encoding="utf-8") for path in files), *MORE)


@cache
def trees() -> tuple[dict[str, Any], ...]:
    return tuple(tomllib.loads(text) for text in examples())


def value(choices: Choices) -> Any:
    """Return what may stand for a value: of any kind, a formula, a list, a name of the format."""
    kind = choices.below(5)
    if kind == 0:
        return formula(choices, NAMES)
    if kind == 1:
        return [choices.double() for _ in range(choices.below(6))]
    if kind == 2:
        return choices.pick(WORDS)
    if kind == 3:
        return [formula(choices, NAMES) for _ in range(choices.below(4))]
    return choices.value()


def content(choices: Choices) -> bytes:
    """Return a model file, good or bad."""
    kind = choices.below(8)
    if kind < 4:
        return toml(changed_tree(choices.pick(trees()), choices, value)).encode(
            "utf-8", "surrogatepass")
    if kind < 7:
        text = changed_text(choices.pick(examples()), choices, WORDS)
        return text.encode("utf-8", "surrogatepass")
    return choices.rest()


def toml(tree: Any) -> str:
    """Return a tree as TOML; what TOML has no word for is written as JSON would."""
    lines = [f"{key(k)} = {inline(v)}" for k, v in tree.items()] if isinstance(tree, dict) else [
        inline(tree)]
    return "\n".join(lines) + "\n"


def inline(tree: Any) -> str:
    if isinstance(tree, dict):
        return "{" + ", ".join(f"{key(k)} = {inline(v)}" for k, v in tree.items()) + "}"
    if isinstance(tree, list):
        return "[" + ", ".join(map(inline, tree)) + "]"
    if isinstance(tree, bool) or tree is None:
        return json.dumps(tree)
    if isinstance(tree, str):
        return json.dumps(tree, ensure_ascii=False).replace("\x7f", "\\u007f")
    return digits(tree)


def digits(number: float) -> str:
    """Return a number's text; Python refuses to write out an integer of 5000 digits."""
    return repr(number) if isinstance(number, float) or abs(number) < 10**4000 else "9" * 5001


def key(name: Any) -> str:
    return str(name) if str(name).isidentifier() and str(name).isascii() else json.dumps(
        str(name), ensure_ascii=False)


def check(data: bytes) -> str:
    """Read one model file, with or without a rep chosen at the command line."""
    choices = Choices(data)
    rep = choices.pick((None, None, "gamma", "alpha"))
    path = scratch() / "model.toml"
    path.write_bytes(content(choices))
    try:
        load_model(path, rep)
    except InputError as error:
        refuse_unless_sentence(error, "model.toml")
        return "refused"
    return "accepted"
