"""Closed lists of the elements and attributes of a format of robots.

Each is in one of three classes, with its default and the name that ignores it where it has one:

    read       used by the reader
    still      moves nothing, with all that is inside
    refused    refused unless it is at its default or ignored by name

What is in no class is refused by its name, and so is what is read and there twice. Elements and
attributes with a prefix belong to other programs, and are refused unless ``EXTENSION`` is ignored.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import field
from typing import NamedTuple

from ...core.arguments import proposal, shown
from ...core.errors import InputError
from ...core.records import dataclass
from .bounded_xml import Element

__all__ = ["EXTENSION", "Parts", "Refused", "Schema", "count_extras"]

#: Name that ignores elements and attributes of other programs.
EXTENSION = "extension"
#: Prefixes that XML itself defines.
_XML = ("xml", "xmlns")
_FLAGS = {"true": 1.0, "false": 0.0}


class Refused(NamedTuple):
    """Default, name in ``ignore`` and cure of a refused part."""

    default: str | None = None
    name: str = ""
    cure: str = ""


@dataclass(frozen=True)
class Parts:
    """The parts of an element by class: names of elements, and of attributes after ``@``.

    Attributes
    ----------
    once, many : str
        Names of parts that are read, once and any number of times.
    still : str
        Names of parts that move nothing.
    refused : mapping of str to Refused
        Names of parts that are refused.
    """

    once: str = ""
    many: str = ""
    still: str = ""
    refused: Mapping[str, Refused] = field(default_factory=dict)

    @property
    def names(self) -> list[str]:
        """All names of parts."""
        return [*self.once.split(), *self.many.split(), *self.still.split(), *self.refused]


class Schema(NamedTuple):
    """The parts of the elements of a format, by name or by ``above/name``."""

    format: str
    parts: Mapping[str, Parts]

    def of(self, element: Element, above: str) -> Parts:
        """Return the parts of an element inside an element of the name ``above``."""
        return self.parts.get(f"{above}/{element.name}") or self.parts.get(element.name, Parts())


def count_extras(top: Element, schema: Schema) -> Counter[str]:
    """Return the number of parts that each name would ignore.

    Raises InputError, "line 3: …; cure.", for the first part that is in no class, twice, or
    refused.
    """
    return Counter(_extras(top, "", "", schema))


def _extras(element: Element, above: str, owner: str, schema: Schema) -> Iterator[str]:
    """Yield the names, for ``ignore=``, of parts of an element that have no counterpart here.

    Refuses parts that the format does not have, that occur twice, or whose values no model here
    has. ``owner`` begins messages; attributes are named with an @.
    """
    if above and "name" in element.attributes:
        owner = f"{element.name} {shown(element.attributes['name'])}: "
    parts = schema.of(element, above)
    once, repeated, without_effect = (
        parts.once.split(), parts.many.split(), parts.still.split())
    counts = Counter(child.name for child in element.children)
    attributes = [(f"@{key}", text, element.line, None) for key, text in element.attributes.items()]
    inner = [(child.name, child.text, child.line, child) for child in element.children]
    for name, text, line, child in [*attributes, *inner]:
        label = f"{name[1:]}=" if child is None else f"<{shown(name)[1:-1]}>"
        prefix, colon, _ = name.strip("@").partition(":")
        # namespaces of XML itself have no effect; elements of any other one are extensions
        if name in without_effect or ((colon or name == "@xmlns") and prefix in _XML):
            continue
        if colon:
            yield EXTENSION
        elif name in parts.refused:
            default, ignored_by, cure = parts.refused[name]
            # a value that means "nothing" may stand
            if default is not None and _is_same(text, default):
                continue
            if ignored_by:
                yield ignored_by
                continue
            item = label + shown(text.strip()) if child is None or text.strip() else label
            usual = f"write {default}" if default else "remove it"
            raise InputError(f"line {line}: {owner}<{element.name}> has {item}, which no model "
                             f"here has; {cure or usual}.")
        elif name not in once and name not in repeated:
            suggestion = proposal(name.strip("@"), [key.strip("@") for key in parts.names])
            raise InputError(f"line {line}: {owner}{label} is no part of <{element.name}> in "
                             f"{schema.format}{suggestion}; remove it.")
        elif name in once and counts[name] > 1:
            raise InputError(f"line {line}: {owner}{label} is in <{element.name}> "
                             f"{counts[name]} times; write it once.")
        elif child is not None:
            yield from _extras(child, element.name, owner, schema)


def _is_same(text: str, default: str) -> bool:
    """Return whether two texts have the same words, numbers by value."""
    words, default_words = text.split(), default.split()
    return len(words) == len(default_words) and all(
        word == default_word or _value(word) == _value(default_word) is not None
        for word, default_word in zip(words, default_words, strict=True))


def _value(word: str) -> float | None:
    """Return a word as a number, flags as 0 or 1; None if it is neither."""
    try:
        return float(word)
    except ValueError:
        return _FLAGS.get(word.lower())
