"""What a stepper's C can come to from its header; the rest is not written.

The engine is put together of whole files. What nothing calls, because this system has no use for
it or this profile does not declare it, is found here from the text itself: functions, types, tables
and constants at the top level, the names that each defines and those that it mentions. Nor are
functions called that do nothing, such as those for the work of forces where there are none.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

__all__ = ["reachable"]

_COMMENT = re.compile(r"/\*.*?\*/", re.DOTALL)
_NAME = re.compile(r"[A-Za-z_]\w*")
#: A function that does nothing.
_IDLE = re.compile(r"^static (?:inline )?void (\w+)\([^()]*\)\n\{\n(?: +\(void\).*\n)+\}\n",
                   re.MULTILINE)
#: A heading of a section: a comment of one line that begins with a rule.
_HEADING = re.compile(r"/\* -{3,} ?.*\*/$")


def reachable(source: str, header: str) -> str:
    """Return the C without what no function declared in the header leads to."""
    source = _without_idle(source)
    start = source.index("\nenum {") + 1
    items = list(_items(source[start:]))
    defined = [_defined(item) for item in items]
    mentioned = [frozenset(_NAME.findall(_COMMENT.sub("", item))) for item in items]
    homes: dict[str, list[int]] = {}
    for i, names in enumerate(defined):
        for name in names:
            homes.setdefault(name, []).append(i)
    wanted = set(re.findall(r"\b(\w+)\(", _COMMENT.sub("", header)))
    kept, waiting = set[int](), [*wanted]
    while waiting:
        for i in homes.pop(waiting.pop(), ()):
            if i not in kept:
                kept.add(i)
                waiting += mentioned[i]
    return source[:start] + _joined(items, defined, kept)


def _without_idle(source: str) -> str:
    """Return the C without calls of functions that do nothing, where a call is a line by itself.

    A call stays where it is all that its caller does with something.
    """
    for name in _IDLE.findall(source):
        call = re.compile(rf"(?<=[;{{}}]\n) +{name}\([^;{{}}]*\);\n")
        bare = source
        while (found := call.search(bare)) is not None:
            begin = bare.rfind("\n}\n", 0, found.start())
            end = bare.find("\n}\n", found.end() - 1)
            caller = _COMMENT.sub("", bare[begin : found.start()] + bare[found.end() : end])
            given = set(_NAME.findall(found[0])) - {name}
            if any(len(re.findall(rf"(?<![.>\w]){x}\b", caller)) < 2 for x in given):
                break
            bare = bare[: found.start()] + bare[found.end() :]
        if len(re.findall(rf"\b{name}\b", _COMMENT.sub("", bare))) == 1:  # its own definition
            source = bare
    return source


def _items(text: str) -> Iterator[str]:
    """Yield what stands at the top level, each with the comment before it, and empty lines."""
    item: list[str] = []
    depth = conditions = 0
    commented = False
    for line in text.split("\n"):
        item.append(line)
        if commented or (line.startswith("/*") and depth == conditions == 0):
            commented = "*/" not in line
            if _HEADING.match(line):
                yield line
                item = []
            continue
        code = re.sub(r"/\*.*?(\*/|$)", "", line)
        if code.startswith("#"):
            conditions += code.startswith("#if") - code.startswith("#endif")
        else:
            depth += code.count("{") - code.count("}")
        ends = not line or line.startswith("#") or code.rstrip().endswith((";", "}"))
        if ends and depth == conditions == 0:
            yield "\n".join(item)
            item = []
    if item:
        yield "\n".join(item)


def _defined(item: str) -> frozenset[str]:
    """Return the names that an item defines: none of a heading or an empty line."""
    code = _COMMENT.sub("", item).strip()
    if code.startswith("#"):
        found = re.findall(r"#define (\w+)|^typedef .*?(\w+)(?: __attribute__.*)?;$", code,
                           flags=re.MULTILINE)
        return frozenset(a or b for a, b in found)
    if code.startswith("typedef"):
        match = re.search(r"(\w+)(?:\[[^;]*\])?;$", code)
        return frozenset(match.groups() if match else ())
    if code.startswith("enum"):
        inner = re.sub(r"=[^,}]*(?=[,}])", "", code[code.index("{") : code.rindex("}") + 1])
        names = set(_NAME.findall(inner))
        tag = re.match(r"enum (\w+)", code)
        return frozenset(names | ({tag[1]} if tag else set()))
    if code.startswith("_Static_assert"):
        return frozenset()
    head = code[: code.find("{")] if "{" in code else code
    if "=" in head:
        head = head[: head.index("=")]
    match = re.search(r"(\w+)\s*(?:\(|\[|$|;)", head.strip())
    return frozenset(match.groups() if match else ())


def _joined(items: list[str], defined: list[frozenset[str]], kept: set[int]) -> str:
    """Return the items that are kept, with the headings of sections that have some."""
    lines: list[str] = []
    heading: str | None = None
    for i, item in enumerate(items):
        if _HEADING.match(item):
            heading = item
        elif item and not defined[i]:  # an assertion goes with what stands before it
            if item.startswith("_Static_assert") and _before(i, items) in kept:
                lines.append(item)
        elif i in kept:
            if heading is not None:
                lines += ["", heading, ""]
                heading = None
            lines.append(item)
        elif not item:
            lines.append("")
    return "\n".join(lines).rstrip() + "\n"


def _before(i: int, items: list[str]) -> int:
    """Return the place of the item before, empty lines aside."""
    return next(j for j in range(i - 1, -1, -1) if items[j])
