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
        """Yield the children of a name."""
        return (child for child in self.children if child.name == name)

    def first(self, name: str) -> Element | None:
        """Return the first child of a name, if there is one."""
        return next(self.all(name), None)


def read_xml(text: str) -> Element:
    """Return the outermost element of a text.

    Raises InputError, "line 3: …; cure.", for text that is no XML, has a document type, or is
    beyond a bound.
    """
    parser = expat.ParserCreate("utf-8")
    open_elements: list[Element] = []
    outermost: list[Element] = []
    count = 0

    def refuse(why: str) -> InputError:
        return InputError(f"line {parser.CurrentLineNumber}: {why}")

    def begin(name: str, attributes: dict[str, str]) -> None:
        """Add an element to the innermost open one, within the limits."""
        nonlocal count
        count += 1
        if count > MAX_ELEMENTS:
            raise refuse(f"it has more than {MAX_ELEMENTS} elements; leave some out.")
        if len(open_elements) >= MAX_DEPTH:
            raise refuse(f"its elements are nested more than {MAX_DEPTH} deep; write them flat.")
        element = Element(name, attributes, parser.CurrentLineNumber)
        (open_elements[-1].children if open_elements else outermost).append(element)
        open_elements.append(element)

    def end(name: str) -> None:
        open_elements.pop()

    def characters(text: str) -> None:
        open_elements[-1].text += text

    def document_type(name: str, *more: object) -> None:
        raise refuse(f"it declares a document type, <!DOCTYPE {shown(name)[1:-1]}>, which may "
                     "define entities of any size; remove the declaration.")

    # expat calls these as it reads, so that a text beyond a bound is refused before it is whole
    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    parser.CharacterDataHandler = characters
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = document_type
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        raise InputError(f"line {error.lineno}: it is no XML ({expat.ErrorString(error.code)}); "
                         "correct it.") from None
    return outermost[0]
