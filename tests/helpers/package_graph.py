"""The packages, and which of them import from which, read from the files."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

from processes import ROOT

#: Packages of packages, and packages of modules.
OUTER = ("generator", "runtime")
FLAT = ("certificates", "commands", "core", "interop", "references", "storage", "studies",
        "sweeps", "targets")
#: Where generator and runtime meet, imported by those above them.
API = "api"


def files_of(folder: Path) -> list[Path]:
    """Return the modules of a package."""
    return sorted(path for path in folder.glob("*.py") if path.name != "__init__.py")


@cache
def packages() -> dict[str, list[Path]]:
    """Return the modules of each package; those beside inner packages have the outer one's name."""
    modules = {API: [ROOT / "api.py", ROOT / "errors.py"]}
    for outer in OUTER:
        inner = sorted(path.parent for path in (ROOT / outer).glob("*/__init__.py"))
        modules |= {f"{outer}/{folder.name}": files_of(folder) for folder in inner}
        modules[outer] = files_of(ROOT / outer)
    return modules | {flat: files_of(ROOT / flat) for flat in FLAT} | {
        "commands": [*files_of(ROOT / "commands"), *files_of(ROOT / "commands" / "run")]}


@cache
def imports() -> dict[str, dict[str, set[str]]]:
    """Return package → package it imports from → the pairs "module -> module" that do so.

    Imports of type checkers alone are left out.
    """
    home = {".".join(path.relative_to(ROOT).with_suffix("").parts): name
            for name, paths in packages().items() for path in paths}
    graph: dict[str, dict[str, set[str]]] = {name: {} for name in packages()}
    for module, name in home.items():
        path = ROOT / f"{module.replace('.', '/')}.py"
        for target in _imported(path, module, home):
            if home[target] != name:
                graph[name].setdefault(home[target], set()).add(f"{module} -> {target}")
    return graph


@cache
def statements(path: Path) -> list[ast.stmt]:
    """Return every statement of a file but those that only type checkers read."""
    visited: list[ast.stmt] = []
    waiting: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.stmt):
            visited.append(node)
        inner = [child for name in ("body", "orelse", "finalbody", "handlers", "cases")
                 for child in getattr(node, name, None) or [] if isinstance(child, ast.AST)]
        if not (isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"):
            waiting += inner
    return visited


def _imported(path: Path, module: str, home: Mapping[str, str]) -> Iterator[str]:
    package = module.split(".")[:-1]
    for node in statements(path):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = package[: len(package) - node.level + 1]
            source = ".".join([*base, *([node.module] if node.module else [])])
            for alias in node.names:
                inner = f"{source}.{alias.name}" if source else alias.name
                if inner in home or source in home:
                    yield inner if inner in home else source


def reachable(graph: Mapping[str, set[str]], start: str) -> set[str]:
    """Return the nodes that can be reached from a node."""
    reached: set[str] = set()
    waiting = [start]
    while waiting:
        for successor in graph.get(waiting.pop(), set()) - reached:
            reached.add(successor)
            waiting.append(successor)
    return reached


def reduced(graph: Mapping[str, set[str]]) -> dict[str, list[str]]:
    """Return a graph without circles with the fewest arrows that reach the same."""
    return {node: sorted(target for target in targets if not any(
        target in reachable(graph, between) for between in targets - {target}))
        for node, targets in graph.items()}
