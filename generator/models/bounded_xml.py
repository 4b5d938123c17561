"""XML of unknown origin: elements with attributes, bounded in size, number and depth.

Document types, and with them entities, are refused before anything of them is read: nothing can
grow, and nothing else is fetched.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat

from ...core.arguments import shown
from ...core.errors import InputError

__all__ = ["Element", "read_xml"]

#: MJCF nests bodies as deep as a robot's chains; readers here call themselves once a level.
MAX_DEPTH = 64
MAX_ELEMENTS = 50_000


@dataclass
class Element:
    """An element: its name, attributes, children in order, text, and the line where it begins."""

    name: str
    attributes: dict[str, str]
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    def all(self, name: str) -> Iterator[Element]:
        """Yield the child elements with this name."""
        return (child for child in self.children if child.name == name)

    def first(self, name: str) -> Element | None:
        """Return the first child element with this name, or None."""
        return next(self.all(name), None)


def read_xml(text: str) -> Element:
    """Return the outermost element of a text.

    Raises InputError, "line 3: …; cure.", for text that is no XML, has a document type, or is
    beyond a bound.
    """
    parser = expat.ParserCreate("utf-8")
    elements = _BoundedElements(parser)
    # one call of ``characters`` for a text, not one for each line of it
    parser.buffer_text = True
    try:
        # True: the text is complete
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        raise InputError(f"line {error.lineno}: it is no XML ({expat.ErrorString(error.code)}); "
                         "correct it.") from None
    return elements.outermost[0]


class _BoundedElements:
    """The elements of a text, which expat reports while it reads.

    A text beyond a bound is refused at that place, before the rest of it is read.
    """

    def __init__(self, parser: expat.XMLParserType) -> None:
        """Let the parser report to this object."""
        self.parser = parser
        self.outermost: list[Element] = []
        self.open: list[Element] = []  # elements that have begun and not ended, outermost first
        self.count = 0
        parser.StartElementHandler = self.begin
        parser.EndElementHandler = self.end
        parser.CharacterDataHandler = self.characters
        parser.StartDoctypeDeclHandler = self.document_type

    def begin(self, name: str, attributes: dict[str, str]) -> None:
        """Add an element to the innermost open one, within the bounds."""
        self.count += 1
        if self.count > MAX_ELEMENTS:
            raise self._error(f"it has more than {MAX_ELEMENTS} elements; leave some out.")
        if len(self.open) >= MAX_DEPTH:
            raise self._error(f"its elements are nested more than {MAX_DEPTH} deep; write them "
                              "flat.")
        element = Element(name, attributes, self.parser.CurrentLineNumber)
        (self.open[-1].children if self.open else self.outermost).append(element)
        self.open.append(element)

    def end(self, name: str) -> None:
        """Close the innermost open element; expat has checked that it has this name."""
        self.open.pop()

    def characters(self, text: str) -> None:
        """Add text to the innermost open element."""
        self.open[-1].text += text

    def document_type(self, name: str, *identifiers: object) -> None:
        """Refuse a document type."""
        raise self._error(f"it declares a document type, <!DOCTYPE {shown(name)[1:-1]}>, which may "
                          "define entities of any size; remove the declaration.")

    def _error(self, reason: str) -> InputError:
        """Return an error with the line that the parser has reached."""
        return InputError(f"line {self.parser.CurrentLineNumber}: {reason}")
