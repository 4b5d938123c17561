"""Changes of texts and of trees (as in JSON and TOML), each drawn from ``Choices``."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Sequence
from typing import Any

from .choices import Choices

PIECE = re.compile(r"[A-Za-z_][A-Za-z_0-9]*|[0-9.]+(?:[eE][-+]?[0-9]+)?|\*\*|\s+|.", re.DOTALL)


def changed_text(text: str, choices: Choices, words: Sequence[str]) -> str:
    """Return a text with one to four pieces changed: left out, doubled, swapped, replaced."""
    pieces = PIECE.findall(text)
    for _ in range(1 + choices.below(4)):
        if not pieces:
            break
        index = choices.below(len(pieces))
        kind = choices.below(7)
        if kind == 0:
            pieces[index] = choices.pick(words)
        elif kind == 1:
            del pieces[index : index + 1 + choices.below(5)]
        elif kind == 2:
            pieces.insert(index, choices.text(4))
        elif kind == 3:
            second = choices.below(len(pieces))
            pieces[index], pieces[second] = pieces[second], pieces[index]
        elif kind == 4:
            pieces[index:index] = pieces[index : index + 1 + choices.below(20)] * (
                1 + choices.below(3))
        elif kind == 5:
            pieces[index] = repr(choices.double())
        else:
            pieces[index] = str(choices.below(10)) * (1 + choices.below(120))
    return "".join(pieces)


def changed_tree(
    tree: Any, choices: Choices, value: Callable[[Choices], Any], limit: int = 4
) -> Any:
    """Return a copy of a tree with one to ``limit`` places changed.

    A place is left out, doubled, renamed, wrapped in a list, replaced by a result of ``value``, or
    by a copy of another place.
    """
    root = [copy.deepcopy(tree)]  # so that the tree itself has a place too
    for _ in range(1 + choices.below(limit)):
        parent, key = choices.pick(places(root))
        kind = choices.below(8)
        if kind < 4:
            parent[key] = value(choices)
        elif kind == 4 and parent is not root:
            del parent[key]
        elif kind == 5:
            source, name = choices.pick(places(root))
            parent[key] = copy.deepcopy(source[name])
        elif kind == 6:
            parent[key] = [parent[key]] * choices.below(4)
        elif isinstance(parent, dict):
            parent[choices.text()] = parent.pop(key) if choices.below(2) else parent[key]
        elif parent is not root:
            parent.insert(key, copy.deepcopy(parent[key]))
    return root[0]


def places(tree: Any) -> list[tuple[Any, Any]]:
    """Return every (parent, key) below a tree."""
    pairs: list[tuple[Any, Any]] = []
    open_ones = [tree]
    while open_ones and len(pairs) < 5000:
        parent = open_ones.pop()
        keys = list(parent) if isinstance(parent, dict) else range(len(parent))
        for key in keys:
            pairs.append((parent, key))
            if isinstance(parent[key], (dict, list)):
                open_ones.append(parent[key])
    return pairs


def changed_bytes(data: bytes, choices: Choices) -> bytes:
    """Return bytes of which some are flipped, cut out, doubled or overwritten."""
    content = bytearray(data)
    for _ in range(1 + choices.below(6)):
        if not content:
            break
        start = choices.below(len(content))
        kind = choices.below(5)
        if kind == 0:
            content[start] ^= 1 << choices.below(8)
        elif kind == 1:
            content[start] = choices.byte()
        elif kind == 2:
            del content[start : start + 1 + choices.below(40)]
        elif kind == 3:
            content[start:start] = content[start : start + 1 + choices.below(40)]
        else:
            width = choices.pick((1, 2, 4, 8))
            content[start : start + width] = choices.pick(
                (b"\0", b"\xff", b"\x7f", b"\x80")) * width
    return bytes(content)
