"""Where the integers of a stepper's record and work memory are, read off its own C text.

The structs are the ones the compiler sees: a field that is added tomorrow is included as well.
"""

from __future__ import annotations

import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

from gyrospark.runtime.compilation.compiler import find_compiler

_INTEGERS = ("int", "long")


@dataclass(frozen=True)
class Place:
    """An integer, or an array of integers: path, offset, bytes, and bytes of one entry."""

    path: str
    offset: int
    size: int
    item: int


def integers_of(name: str, files: dict[str, str], folder: Path) -> dict[str, list[Place]]:
    """Return the integers of ``report``, of ``work`` and of the fast path in its memory."""
    command, flags = find_compiler().command, find_compiler().flags
    for file, text in files.items():
        (folder / file).write_text(text, encoding="utf-8")
    work = f"#define {name.upper()}_WORK"
    (folder / "seen.c").write_text(f'{work}\n#include "{name}.c"\n', encoding="utf-8")
    preprocessed = _run([*command, *flags, "-E", "-P", "seen.c"], folder)
    structs = _structs(preprocessed.replace("long double", "longdouble"))
    roots = {"report": f"{name}_report", "work": f"{name}_work", "fast": "fixed_point_t"}
    paths = [(kind, root, path) for kind, root in roots.items() if root in structs
             for path in _integers(structs, root)]
    lines = "\n".join(
        f'    {{ {root} x; printf("{kind} {path} %zu %zu %zu\\n", offsetof({root}, {path}), '
        f'sizeof x.{path}, sizeof x.{_first(path, structs, root)}); }}'
        for kind, root, path in paths)
    # the fast path is at the next multiple of 64 bytes behind the beginning of its memory
    if roots["fast"] in structs:
        lines += (f'\n    printf("start - %zu 0 0\\n", (offsetof({name}_work, memory) + 63) '
                  '& ~(size_t)63);')
    (folder / "probe.c").write_text(
        f'{work}\n#include <stdio.h>\n#include "{name}.c"\nint main(void)\n{{\n{lines}\n'
        "    return 0;\n}\n", encoding="utf-8")
    _run([*command, *flags, "-w", "-O0", "probe.c", "-lm", "-o", "probe"], folder)
    places: dict[str, list[Place]] = {kind: [] for kind in roots}
    start = 0
    for line in _run(["./probe"], folder).splitlines():
        kind, path, *numbers = line.split()
        if kind == "start":
            start = int(numbers[0])
        else:
            places[kind].append(Place(path, *map(int, numbers)))
    places["fast"] = [Place(place.path, place.offset + start, place.size, place.item)
                      for place in places["fast"]]
    return places


def _run(command: list[str], folder: Path) -> str:
    return subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True).stdout


def _structs(text: str) -> dict[str, list[tuple[str, str]]]:
    """Return the fields of every struct, (type, declarator); nested ones by a name of their own."""
    structs: dict[str, list[tuple[str, str]]] = {}
    for match in re.finditer(r"\bstruct\s*(\w*)\s*\{", text):
        depth, end = 1, match.end()
        while depth:
            depth += {"{": 1, "}": -1}.get(text[end], 0)
            end += 1
        body, declarator = text[match.end() : end - 1], re.match(r"\s*(\w*)\s*;", text[end:])
        inner = f"nested{match.start()}"
        fields = _fields(body, match.end())
        for struct in {match[1], declarator[1] if declarator else "", inner} - {""}:
            structs[struct] = fields
    return structs


def _fields(body: str, start: int) -> list[tuple[str, str]]:
    fields, position = [], 0
    while (nested := re.compile(r"\bstruct\s*\w*\s*\{").search(body, position)) is not None:
        depth, end = 1, nested.end()
        while depth:
            depth += {"{": 1, "}": -1}.get(body[end], 0)
            end += 1
        fields.append((f"nested{start + nested.start()}",
                       body[end : body.index(";", end)].strip()))
        body = body[: nested.start()] + " " * (body.index(";", end) + 1 - nested.start()) + body[
            body.index(";", end) + 1 :]
    for declaration in body.split(";"):
        words = declaration.replace("const ", "").split(None, 1)
        if len(words) == 2:
            fields += [(words[0], declarator.strip())
                       for declarator in re.split(r",(?![^\[]*\])", words[1])]
    return fields


def _integers(structs: dict[str, list[tuple[str, str]]], root: str, path: str = "") -> list[str]:
    paths = []
    for kind, declared in structs[root]:
        name = re.match(r"\w+", declared)
        if name is None:
            continue
        if kind in _INTEGERS:
            paths.append(path + name[0])
        elif kind in structs and "[" not in declared:
            paths += _integers(structs, kind, f"{path}{name[0]}.")
        elif kind in structs and _integers(structs, kind):
            raise ValueError(f"an array of structs with integers: {path}{declared}")
    return paths


def _first(path: str, structs: dict[str, list[tuple[str, str]]], root: str) -> str:
    """Return an expression for the first entry of an array, or the integer itself."""
    *outer, last = path.split(".")
    for field in outer:
        root = next(kind for kind, declared in structs[root]
                    if re.match(r"\w+", declared)[0] == field)
    declared = next(text for kind, text in structs[root]
                    if kind in _INTEGERS and re.match(r"\w+", text)[0] == last)
    return path + "[0]" * declared.count("[")
