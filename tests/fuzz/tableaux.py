"""Tableau files: the examples with changes, or any bytes."""

from __future__ import annotations

import json
from functools import cache
from typing import Any

from gyrospark.core.errors import InputError
from gyrospark.generator.tableaux.tableau_file import read_tableau

from .choices import Choices
from .formulas import grown
from .model_texts import digits
from .mutations import changed_bytes, changed_text, changed_tree
from .scratch import scratch
from .sentences import refuse_unless_sentence

WORDS = (
    '"name"', '"A"', '"A_hat"', '"A_tilde"', '"A_bar"', '"b"', '"b_tilde"', '"c"', '"order"',
    '"symmetric"', "true", "false", "null", "NaN", "Infinity", "-0", "1e999", "1E-5000", "[]", "{}",
    "[", "]", "{", "}", ",", ":", '""', '"1/2"', '"sqrt(3)/6"', '"sqrt(-1)"', '"1/0"', "\\ud800",
    '"x"', "0.21132486540519", "1" * 101,
)
ENTRIES = ("1/2", "sqrt(3)/6", "-sqrt(15)/10", "2**64", "2**65", "sqrt(2)**63", "1/(1/3 - 1/3)",
           "sqrt(sqrt(2) - 1)", "sqrt(1 - sqrt(2))", "0", "-0", "0.1", "0.21132486540518711775")


@cache
def examples() -> tuple[str, ...]:
    from processes import ROOT

    files = sorted((ROOT / "examples" / "tableaux").glob("*.json"))
    return tuple(path.read_text(encoding="utf-8") for path in files)


@cache
def trees() -> tuple[Any, ...]:
    return tuple(json.loads(text) for text in examples())


def value(choices: Choices) -> Any:
    kind = choices.below(4)
    if kind == 0:
        return choices.pick(ENTRIES)
    if kind == 1:
        return grown(choices, ENTRIES, 3).replace("sin", "sqrt").replace("cos", "sqrt")
    if kind == 2:
        return [choices.pick(ENTRIES) for _ in range(choices.below(40))]
    return choices.value()


def content(choices: Choices) -> bytes:
    kind = choices.below(8)
    if kind < 4:
        return text_of(changed_tree(choices.pick(trees()), choices, value)).encode(
            "utf-8", "surrogatepass")
    if kind < 6:
        text = changed_text(choices.pick(examples()), choices, WORDS)
        return text.encode("utf-8", "surrogatepass")
    if kind == 6:
        return changed_bytes(choices.pick(examples()).encode(), choices)
    return choices.rest()


def text_of(tree: Any) -> str:
    """Return a tree as JSON, integers of any length written out."""
    if isinstance(tree, dict):
        return "{" + ", ".join(f"{json.dumps(str(k))}: {text_of(v)}" for k, v in tree.items()) + "}"
    if isinstance(tree, list):
        return "[" + ", ".join(map(text_of, tree)) + "]"
    if isinstance(tree, int) and not isinstance(tree, bool):
        return digits(tree)
    return json.dumps(tree)


def check(data: bytes) -> str:
    """Read one tableau file."""
    path = scratch() / "tableau.json"
    path.write_bytes(content(Choices(data)))
    try:
        read_tableau(path)
    except InputError as error:
        refuse_unless_sentence(error, "tableau.json")
        return "refused"
    return "accepted"
