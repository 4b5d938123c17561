"""Cross-references: pages and examples that use a public name, a command or a TOML key."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import gyrospark as gs

__all__ = ["examples", "pages", "users_of", "users_of_command", "users_of_key"]

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
#: The largest number of users in a list.
MOST = 8
FENCE = re.compile(r"^```(?:\{code-cell\} *)?(?:i?python|sh|toml)?\n(.*?)^```$",
                   flags=re.DOTALL | re.MULTILINE)


@cache
def examples() -> dict[str, str]:
    """Return the label of each example that is one file → its path from the root."""
    found = [path for path in (ROOT / "examples").rglob("*")
             if path.suffix in (".py", ".toml", ".urdf", ".xml", ".sdf")
             and path.name != "__init__.py"]
    return {f"example-{path.relative_to(ROOT / 'examples').as_posix()}".lower().replace("/", "-")
            .replace(".", "-").replace("_", "-"): path.relative_to(ROOT).as_posix()
            for path in sorted(found)}


@cache
def pages() -> dict[str, str]:
    """Return the name of each page → its code blocks and code spans."""
    found = {}
    for path in sorted(HERE.rglob("*.md")):
        name = path.relative_to(HERE).with_suffix("").as_posix()
        if name.partition("/")[0] in ("reference", "writing", "paper", "references"):
            continue
        text = path.read_text(encoding="utf-8")
        found[name] = "\n".join([*FENCE.findall(text), *re.findall(r"`([^`\n]+)`", text)])
    return found


def users_of(name: str) -> list[str]:
    """Return links, as reStructuredText, to what uses ``gyrospark.name`` or a method."""
    inner = name.removeprefix("gyrospark.")
    head, _, method = inner.partition(".")
    if method:
        if head not in _owners().get(method, ()) or len(_owners()[method]) > 1:
            return []
        return _users(rf"\.{method}\(")
    return _users(rf"\bgs\.{head}\b") if head in gs.__all__ else []


def users_of_command(name: str) -> list[str]:
    """Return links to pages with a command."""
    return _users(r"(?m)(?:^|gyrospark )generate -" if name == "generate" else
                  rf"\bgyrospark {name}\b")


def users_of_key(matches: Any) -> list[str]:
    """Return links, as Markdown, to the model files and studies for whose content it is true."""
    return [f"[{path.removeprefix('examples/')}](#{label})" for label, path in examples().items()
            if path.endswith(".toml") and matches(tomllib.loads((ROOT / path).read_text("utf-8")))]


@cache
def _owners() -> dict[str, set[str]]:
    """Return each method → the public classes that have it."""
    found: dict[str, set[str]] = {}
    for name in gs.__all__:
        thing = getattr(gs, name)
        if isinstance(thing, type):
            for method in dir(thing):
                found.setdefault(method, set()).add(name)
    return found


def _users(pattern: str) -> list[str]:
    uses = {name: len(re.findall(pattern, code)) for name, code in pages().items()}
    names = [name for name, count in uses.items() if count]
    names.sort(key=lambda name: ("/" in name, -uses[name]))  # the guide before the gallery
    found = [f":doc:`/{name}`" for name in names]
    found += [f":ref:`{path} <{label}>`" for label, path in _programs()
              if re.search(pattern, (ROOT / path).read_text(encoding="utf-8"))]
    return found[:MOST]


def _programs() -> Iterator[tuple[str, str]]:
    yield from ((label, path) for label, path in examples().items() if path.endswith(".py"))
