"""Model files, studies of sweeps, tableau files: examples with a few changes, or any bytes."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from gyrospark.core.errors import GyrosparkError
from gyrospark.generator.models.model_file import load_model
from gyrospark.generator.tableaux.tableau_file import read_tableau
from gyrospark.sweeps.study_file import load_study
from processes import ROOT

from .choices import Choices
from .formulas import formula, grown
from .judging import refuse_unless_sentence, scratch
from .mutations import changed_text, changed_tree

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
MODEL_WORDS = (
    "name", "[body]", "[system]", "[[bodies]]", "[[joints]]", "[start]", "[run]", "[parameters]",
    "[quantities]", "[forces]", "inertia", "mass", "rep", "gamma", "alpha", '"alpha"', "euler",
    "quaternion", "rotation", "angular_velocity", "coordinates", "momenta", "constraints", "dt",
    "steps", "0", "-1", "1e308", "nan", "inf", "true", "1979-05-27", "12:00:00", '""', "[]", "{}",
    "= ", ".", "'''", '"""', "#", "\n", "x", "q0", "R31", "t", "pi", "sqrt(", "I1", "{a = 1}",
)
NAMES = ("x", "y", "px", "m", "g", "l", "q0", "R33", "omega1", "I1", "t", "mass", "b_omega1", "x1")

STUDIES = (
    """name = "gamma and dt"
model = "fast-top"
scheme = "EMS"
steps = 10
keep = ["energy_error_max"]
[grid]
gamma = { from = 4e-4, to = 4e-3, count = 5, spacing = "log" }
dt = [1e-3, 2e-3]
""",
    """model = "free-body"
scheme = "IMS"
t_end = 0.1
rep = "alpha"
tolerance = 1e-12
[settings]
inertia = [0.002, 0.0013, 0.0008]
[parameters]
alpha = "h"
[grid]
start = { angular_velocity = [[0, 0, 100], [0, 0, 120]] }
drawn = { count = 5, seed = 7, dt = { from = 5e-4, to = 9e-4 } }
""",
    """model = "fast-top"
dt = 1e-3
steps = 5
every = 2
[grid]
scheme = ["IMS", "EMS"]
point = { I1 = [2e-3, 3e-3], mgl = [0.4, 0.5] }
""",
)
STUDY_WORDS = ("from", "to", "count", "spacing", '"log"', '"linear"', "seed", "grid", "[settings]",
               "dt", "start", "scheme", '"EMS"', "model", '"fast-top"', "steps", "keep", "nan",
               "inf", "-1", "0", "1e308", "[]", "{}", "true", '""', "9" * 30)

TABLEAU_WORDS = (
    '"name"', '"A"', '"A_hat"', '"A_tilde"', '"A_bar"', '"b"', '"b_tilde"', '"c"', '"order"',
    '"symmetric"', "true", "false", "null", "NaN", "Infinity", "-0", "1e999", "1E-5000", "[]", "{}",
    "[", "]", "{", "}", ",", ":", '""', '"1/2"', '"sqrt(3)/6"', '"sqrt(-1)"', '"1/0"', "\\ud800",
    '"x"', "0.21132486540519", "1" * 101,
)
ENTRIES = ("1/2", "sqrt(3)/6", "-sqrt(15)/10", "2**64", "2**65", "sqrt(2)**63", "1/(1/3 - 1/3)",
           "sqrt(sqrt(2) - 1)", "sqrt(1 - sqrt(2))", "0", "-0", "0.1", "0.21132486540518711775")


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


def text_of(tree: Any) -> str:
    """Return a tree as JSON, integers of any length written out."""
    if isinstance(tree, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))}: {text_of(v)}" for k, v in tree.items()) + "}"
    if isinstance(tree, list):
        return "[" + ", ".join(map(text_of, tree)) + "]"
    if isinstance(tree, int) and not isinstance(tree, bool):
        return digits(tree)
    return json.dumps(tree)


def examples(pattern: str) -> list[str]:
    """Return the texts of examples."""
    return [path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples").glob(pattern))]


def model_value(choices: Choices) -> Any:
    """Return a value of any kind, a formula, a list, or a name of the format."""
    kind = choices.below(5)
    if kind == 0:
        return formula(choices, NAMES)
    if kind == 1:
        return [choices.double() for _ in range(choices.below(6))]
    if kind == 2:
        return choices.pick(MODEL_WORDS)
    if kind == 3:
        return [formula(choices, NAMES) for _ in range(choices.below(4))]
    return choices.value()


def study_value(choices: Choices) -> Any:
    kind = choices.below(4)
    if kind == 0:
        return [choices.double() for _ in range(choices.below(5))]
    return choices.pick(("EMS", "log", "m", "fast-top", "status")) if kind == 1 else (
        choices.value())


def tableau_value(choices: Choices) -> Any:
    kind = choices.below(4)
    if kind == 0:
        return choices.pick(ENTRIES)
    if kind == 1:
        return grown(choices, ENTRIES, 3).replace("sin", "sqrt").replace("cos", "sqrt")
    if kind == 2:
        return [choices.pick(ENTRIES) for _ in range(choices.below(40))]
    return choices.value()


@dataclass(frozen=True)
class Format:
    """A kind of file: its name, examples, words, values, and what reads and writes it."""

    file: str
    find: Callable[[], Sequence[str]]
    words: Sequence[str]
    value: Callable[[Choices], Any]
    read: Callable[..., Any]
    parse: Callable[[str], Any] = tomllib.loads
    write: Callable[[Any], str] = toml

    @cached_property
    def examples(self) -> Sequence[str]:
        return self.find()

    @cached_property
    def trees(self) -> Sequence[Any]:
        return [self.parse(text) for text in self.examples]

    def content(self, choices: Choices) -> bytes:
        """Return a file, good or bad."""
        kind = choices.below(8)
        if kind < 4:
            text = self.write(changed_tree(choices.pick(self.trees), choices, self.value))
        elif kind < 7:
            text = changed_text(choices.pick(self.examples), choices, self.words)
        else:
            return choices.rest()
        return text.encode("utf-8", "surrogatepass")

    def check(self, data: bytes) -> str:
        """Read one file; a model's with or without a rep chosen at the command line."""
        choices, path = Choices(data), scratch() / self.file
        rep = [choices.pick((None, None, "gamma", "alpha"))] if self is MODEL else []
        path.write_bytes(self.content(choices))
        try:
            self.read(path, *rep)
        except GyrosparkError as error:
            refuse_unless_sentence(error, *([] if self is STUDY else [self.file]))
            return "refused"
        return "accepted"


MODEL = Format("model.toml", lambda: [*examples("*.toml"), *MORE], MODEL_WORDS, model_value,
               load_model)
STUDY = Format("study.toml", lambda: STUDIES, STUDY_WORDS, study_value, load_study)
TABLEAU = Format("tableau.json", lambda: examples("tableaux/*.json"), TABLEAU_WORDS, tableau_value,
                 read_tableau, json.loads, text_of)
