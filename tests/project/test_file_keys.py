"""Each key that a reader of files asks for stands in a file that some test gives to it.

The keys are the readers' own closed lists, so that a new one needs a test.
"""

from __future__ import annotations

import ast
import importlib
import re
from functools import cache

import pytest

from gyrospark.generator.models import multibody_file
from gyrospark.generator.models.sdf_schema import SDF
from gyrospark.generator.models.urdf_schema import URDF
from gyrospark.generator.tableaux import tableau_file
from gyrospark.sweeps import study_file
from processes import ROOT

#: Where tests write such files.
FOLDERS = ("api", "commands", "engine", "fuzz", "generator", "matrix", "project", "storage",
           "studies", "sweeps")


#: A literal in quotes of any kind; each alternative has its own group.
LITERAL = re.compile(r'''"""(.*?)"""|"((?:[^"\\\n]|\\.)*)"|\'((?:[^\'\\\n]|\\.)*)\'''', re.DOTALL)


@cache
def literals() -> set[str]:
    """Return the texts in the tests' code, and the examples, each of which a test loads."""
    examples = {path.read_text(encoding="utf-8") for path in (ROOT / "examples").rglob("*")
                if path.suffix in (".toml", ".urdf", ".sdf", ".json")}
    return examples.union(*(
        ("".join(quoted).replace("\\n", "\n")
         for quoted in LITERAL.findall(path.read_text(encoding="utf-8")))
        for name in FOLDERS for path in (ROOT / "tests" / name).rglob("*.py")
        if path.name != "test_file_keys.py"))


@cache
def text() -> str:
    return "\n".join(sorted(literals()))


def names_before(end: str) -> set[str]:
    """Return the names in the literals that stand before a sign, and those in brackets."""
    return set(re.findall(rf"(?<![\w.])(\w+)(?:\.\w+)*{end}", text()))


def allowed_keys() -> set[str]:
    """Return the arguments of ``TomlTable.allow`` in the readers of model files."""
    keys = {key for of_kind in multibody_file.FORCES.values() for key in of_kind} | {
        key for of_kind in multibody_file.JOINTS.values() for key, parameter in of_kind.items()
        if parameter.kind is parameter.KEYWORD_ONLY}
    for path in sorted((ROOT / "generator" / "models").glob("*.py")):
        names = vars(importlib.import_module(f"gyrospark.generator.models.{path.stem}"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not (isinstance(node, ast.Call) and getattr(node.func, "attr", "") == "allow"):
                continue
            for argument in node.args:
                if isinstance(argument, ast.Constant):
                    keys.add(argument.value)
                elif isinstance(argument, ast.Starred) and isinstance(argument.value, ast.Name):
                    keys |= {*names[argument.value.id]}
    return keys


def test_keys_of_toml_files():
    """Each key of model files and of studies stands in some test."""
    keys = allowed_keys() | study_file._KEYS
    assert len(keys) > 80
    missing = keys - names_before(" ?=") - set(re.findall(r"\[\[?(\w+)[\].]", text()))
    assert not missing, " ".join(sorted(missing))


def test_keys_of_tableau_files():
    keys = {*tableau_file.REQUIRED, *tableau_file.FIELDS, *tableau_file.CLAIMS}
    assert keys <= literals()


@pytest.mark.parametrize("schema", [URDF, SDF], ids=lambda schema: schema.format)
def test_elements_and_attributes_that_are_read_of_robots(schema):
    names = {name for parts in schema.parts.values()
             for name in (*parts.once.split(), *parts.many.split())}
    missing = names - {f"@{name}" for name in names_before("=")} - set(
        re.findall(r"<(\w+)[\s/>]", text()))
    assert not missing, " ".join(sorted(missing))
