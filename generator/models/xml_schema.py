"""Closed lists of the elements and attributes of a format of robots.

Each is in one of three classes, with its default and the name that ignores it where it has one:

    read       used by the reader
    still      moves nothing, with all that is inside
    refused    refused unless it is at its default or ignored by name

A part in no class is refused by its name, and so is a part that is read once and there twice.
Elements and attributes with a prefix belong to other programs, and are refused unless ``EXTENSION``
is ignored.
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
    """A refused part: the default with which it may stand, its name in ``ignore``, and the cure."""

    default: str | None = None  # None if it is refused with any content
    name: str = ""  # "" if it cannot be ignored
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
    #: Whether elements that hold no others may hold text.
    has_text: bool = False

    def of(self, element: Element, above: str) -> Parts:
        """Return the parts of an element inside an element of the name ``above``."""
        return self.parts.get(f"{above}/{element.name}") or self.parts.get(element.name, Parts())


def count_extras(top: Element, schema: Schema) -> Counter[str]:
    """Return the number of parts that each name would ignore.

    Raises InputError, "line 3: …; cure.", for the first part that is in no class, twice, or
    refused.
    """
    return Counter(_extras(top, above="", owner="", schema=schema))


class _Part(NamedTuple):
    """An attribute, with the name "@KEY" and no ``child``, or a child of an element."""

    name: str
    text: str
    line: int
    child: Element | None

    @property
    def label(self) -> str:
        """The part in messages: "key=" or "<name>"."""
        # without "@", or without the quotes of ``shown``
        return f"{self.name[1:]}=" if self.child is None else f"<{shown(self.name)[1:-1]}>"


def _parts_in(element: Element) -> Iterator[_Part]:
    """Yield the attributes and then the children of an element."""
    for key, text in element.attributes.items():
        yield _Part(f"@{key}", text, element.line, child=None)
    for child in element.children:
        yield _Part(child.name, child.text, child.line, child)


def _extras(element: Element, above: str, owner: str, schema: Schema) -> Iterator[str]:
    """Yield the names, for ``ignore=``, of all parts of an element that have no counterpart here.

    Refuses parts that the format does not have, that occur twice, or whose values no model here
    has. ``above`` is the name of the parent element; ``owner`` begins messages.
    """
    if above and "name" in element.attributes:
        owner = f"{element.name} {shown(element.attributes['name'])}: "
    parts = schema.of(element, above)
    if element.text.strip() and not (
            schema.has_text and all(name.startswith("@") for name in parts.names)):
        raise InputError(f"line {element.line}: {owner}<{element.name}> holds the text "
                         f"{shown(element.text.strip())}, and {schema.format} has none there; "
                         "remove it.")
    without_effect = parts.still.split()
    for part in _parts_in(element):
        prefix, colon, _ = part.name.strip("@").partition(":")
        # namespaces of XML itself have no effect; elements of any other one are extensions
        if part.name in without_effect or ((colon or part.name == "@xmlns") and prefix in _XML):
            continue
        if colon:
            yield EXTENSION
        elif part.name in parts.refused:
            yield from _ignored_names(part, parts.refused[part.name], element, owner)
        else:
            _refuse_unknown_or_repeated(part, parts, element, owner, schema.format)
            if part.child is not None:
                yield from _extras(part.child, element.name, owner, schema)


def _ignored_names(part: _Part, refusal: Refused, element: Element, owner: str) -> Iterator[str]:
    """Yield the name that ignores a part, none if it is at its default; refuse any other part."""
    # a value that means "nothing" may stand
    if refusal.default is not None and _is_same(part.text, refusal.default):
        return
    if refusal.name:
        yield refusal.name
        return
    has_text = part.child is None or part.text.strip()
    item = part.label + shown(part.text.strip()) if has_text else part.label
    usual_cure = f"write {refusal.default}" if refusal.default else "remove it"
    raise InputError(f"line {part.line}: {owner}<{element.name}> has {item}, which no model "
                     f"here has; {refusal.cure or usual_cure}.")


def _refuse_unknown_or_repeated(
    part: _Part, parts: Parts, element: Element, owner: str, format_name: str
) -> None:
    """Refuse a part that an element of the format does not have, or has only once."""
    if part.name in parts.once.split():
        # counted for these few names only: an element may have thousands of other children
        count = sum(child.name == part.name for child in element.children)
        if count > 1:
            raise InputError(f"line {part.line}: {owner}{part.label} is in <{element.name}> "
                             f"{count} times; write it once.")
    elif part.name not in parts.many.split():
        suggestion = proposal(part.name.strip("@"), [key.strip("@") for key in parts.names])
        raise InputError(f"line {part.line}: {owner}{part.label} is no part of <{element.name}> in "
                         f"{format_name}{suggestion}; remove it.")


def _is_same(text: str, default: str) -> bool:
    """Return whether two texts have the same words, numbers by value."""
    words, default_words = text.split(), default.split()
    # words that are no numbers have the value None, by which they are not equal
    return len(words) == len(default_words) and all(
        word == default_word or _value(word) == _value(default_word) is not None
        for word, default_word in zip(words, default_words, strict=True))


def _value(word: str) -> float | None:
    """Return a word as a number, flags as 0 or 1; None if it is neither."""
    try:
        return float(word)
    except ValueError:
        return _FLAGS.get(word.lower())
