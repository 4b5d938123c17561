"""Study files of sweeps: small ones with a few changes in their text or tables, or any bytes."""

from __future__ import annotations

import tomllib
from functools import cache
from typing import Any

from gyrospark.core.errors import GyrosparkError
from gyrospark.sweeps.study_file import load_study

from .choices import Choices
from .model_texts import toml
from .mutations import changed_text, changed_tree
from .scratch import scratch
from .sentences import refuse_unless_sentence

EXAMPLES = (
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
WORDS = ("from", "to", "count", "spacing", '"log"', '"linear"', "seed", "grid", "[settings]", "dt",
         "start", "scheme", '"EMS"', "model", '"fast-top"', "steps", "keep", "nan", "inf", "-1",
         "0", "1e308", "[]", "{}", "true", '""', "9" * 30)


@cache
def trees() -> tuple[dict[str, Any], ...]:
    return tuple(tomllib.loads(text) for text in EXAMPLES)


def value(choices: Choices) -> Any:
    kind = choices.below(4)
    if kind == 0:
        return [choices.double() for _ in range(choices.below(5))]
    return choices.pick(("EMS", "log", "m", "fast-top", "status")) if kind == 1 else (
        choices.value())


def check(data: bytes) -> str:
    """Read one study file, its steppers made and its axes laid out."""
    choices = Choices(data)
    kind = choices.below(8)
    path = scratch() / "study.toml"
    if kind < 4:
        text = toml(changed_tree(choices.pick(trees()), choices, value))
    else:
        text = changed_text(choices.pick(EXAMPLES), choices, WORDS)
    path.write_bytes(choices.rest() if kind == 7 else text.encode("utf-8", "surrogatepass"))
    try:
        load_study(path)
    except GyrosparkError as error:
        refuse_unless_sentence(error)
        return "refused"
    return "accepted"
