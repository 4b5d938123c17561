"""The public names and signatures, which a change touches on purpose.

``pytest tests/project/test_public_api.py --update`` writes tests/data/public_api.txt again; its
diff shows what was added or removed (docs/stability.md says what each means).
"""

from __future__ import annotations

import ast
import difflib
import inspect
import re
from collections.abc import Iterator

import click
import pytest

import gyrospark as gs
from gyrospark.commands import gyrospark as command_line
from gyrospark.commands.generate import generate
from gyrospark.core.former_names import FORMER_MEMBERS, FORMER_NAMES, FORMER_OPTIONS
from processes import ROOT
from result_classes import RESULT_CLASSES, result_class

STORED = ROOT / "tests" / "data" / "public_api.txt"


def signature(value: object) -> str:
    """Return the public parameters with their kinds and defaults; types are mypy's."""
    full = inspect.signature(value)
    bare = []
    for parameter in full.parameters.values():
        default = ... if inspect.isfunction(parameter.default) else parameter.default
        if not parameter.name.startswith("_"):
            bare.append(parameter.replace(annotation=parameter.empty, default=default))
    return str(full.replace(parameters=bare, return_annotation=full.empty))


def members(cls: type) -> Iterator[tuple[str, str]]:
    """Yield each public member of a class, with its parameters."""
    owners = {name: owner for owner in reversed(cls.__mro__) for name in vars(owner)
              if owner.__module__.startswith("gyrospark")}
    for name, owner in sorted(owners.items()):
        member = vars(owner)[name]
        if name.startswith("_"):
            continue
        bound = member.__func__ if isinstance(member, classmethod | staticmethod) else member
        yield name, signature(bound) if inspect.isfunction(bound) else ""


def listed(name: str, value: object) -> Iterator[str]:
    """Yield the lines of a public name."""
    if inspect.ismodule(value):
        yield name
        for inner in sorted(value.__all__):
            yield from listed(f"{name}.{inner}", getattr(value, inner))
    elif isinstance(value, type):
        bases = ", ".join(base.__name__ for base in value.__bases__ if base is not object)
        has_init = "__init__" in vars(value) and not issubclass(value, Exception)
        yield f"class {name}{f' of {bases}' if bases else ''}{signature(value) if has_init else ''}"
        yield from (f"{name}.{inner}{parameters}" for inner, parameters in members(value))
    else:
        yield f"{name}{signature(value)}" if callable(value) else name


def options(words: str, command: click.Command) -> Iterator[str]:
    """Yield the lines of a command: arguments, options, choices."""
    yield words
    if isinstance(command, click.Group):
        context = click.Context(command)
        for name in sorted(command.list_commands(context)):
            yield from options(f"{words} {name}", command.get_command(context, name))
    for parameter in command.params:
        choices = parameter.type.choices if isinstance(parameter.type, click.Choice) else ()
        yield " ".join([words, *(parameter.opts if isinstance(parameter, click.Option) else
                                 [(parameter.name or "").upper()]), *map(str, choices)])


def public() -> list[str]:
    """Return one line for each public name, sorted by Python and command line."""
    python = [line for name in sorted(gs.__all__) for line in listed(name, getattr(gs, name))]
    python += [line for path in RESULT_CLASSES
               for line in listed(path.removeprefix("gyrospark."), result_class(path))]
    return [*python, *options("generate", generate), *options("gyrospark", command_line)]


def test_public_names_and_signatures_are_those_that_were_looked_at(request):
    text = "\n".join(public()) + "\n"
    if request.config.getoption("--update"):
        STORED.write_text(text, encoding="utf-8")
    diff = list(difflib.unified_diff(
        STORED.read_text(encoding="utf-8").splitlines(), text.splitlines(), STORED.name,
        f"{STORED.name} (of the package)", lineterm="", n=0))
    if diff:
        pytest.fail("\n".join([*diff, "", "If this is meant: pytest --update, and CHANGELOG.md"]),
                    pytrace=False)


def test_what_is_stored_depends_on_no_machine():
    text = STORED.read_text(encoding="utf-8")
    assert " at 0x" not in text
    assert str(ROOT) not in text


def test_a_stepper_has_few_public_attributes():
    """Public names integrate; the rest of the package uses private ones."""
    assert len(dict(members(gs.Stepper))) <= 23


def test_integrate_has_few_arguments():
    """The arguments of the call with a start are few: p is the other part of an array q."""
    assert len({*inspect.signature(gs.Stepper.integrate).parameters} - {"self", "p"}) <= 14


def test_there_are_few_public_names():
    assert len([name for name in gs.__all__ if not name.startswith("_")]) <= 45


def test_the_first_program_of_the_readme_is_short():
    """It has no γ, q or p, and no more than five lines."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    program = readme.split("```python\n")[1].split("```")[0]
    assert len([line for line in program.splitlines() if line]) <= 5
    names = {node.attr if isinstance(node, ast.Attribute) else node.id
             for node in ast.walk(ast.parse(program))
             if isinstance(node, ast.Attribute | ast.Name)}
    assert names.isdisjoint({"gamma", "q", "p", "q0", "p0", "parameters"})


def test_the_table_of_the_changelog_has_every_former_name():
    lines = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()
    table = "\n".join(line.split(" | ")[0] for line in lines if line.startswith("| "))
    former = [*FORMER_NAMES, *(name for names in FORMER_MEMBERS.values() for name in names),
              *(option.split()[1] for option in FORMER_OPTIONS)]
    assert [name for name in former if not re.search(rf"{name}\b", table)] == []
