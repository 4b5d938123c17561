"""The guard of MJCF files: MuJoCo gets no text and opens no file that is not checked here.

    XML          bounded in bytes, elements, depth and in the elements that <replicate> makes
    files        each name in file, meshdir, … is in the folder of the model or below it
    <include>    read here, once, and handed to MuJoCo; <model> of <asset>, too
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path

from ...core.arguments import shown
from ...core.errors import InputError
from ..parsing.text_file import UnusableFileError, read_text
from .bounded_xml import MAX_ELEMENTS, Element, read_xml
from .xml_numbers import NUMBER

__all__ = ["check_document", "is_within"]

#: Included files, and bytes of all of them together: a file may come from a stranger.
MAX_FILES = 16
MAX_BYTES = 2**20
#: Attributes that name folders; those that begin with "file" name files.
_FOLDERS = ("meshdir", "texturedir", "assetdir")
#: Elements that make others, as many as ``count`` says.
_COUNTED = ("replicate", "flexcomp", "composite")
#: Cells of a height field that count as an element.
_CELLS = 200
#: Attributes whose words are names, so that "nan" is no number there.
_NAMES = ("name", "class", "childclass", "model", "prefix")
_NOT_FINITE = re.compile(r"[+-]?(nan|inf|infinity)(\(.*\))?", re.IGNORECASE)


def check_document(text: str, path: Path) -> tuple[Element, dict[str, bytes]]:
    """Return <mujoco> of a text, read from a file, and name → content of the files it includes.

    Raises InputError, "line 3: …; cure."
    """
    guard = _Guard(path.parent)
    guard.names.append(path.name)
    top = read_xml(text)
    # [1:-1] takes off the quotes of ``shown``
    if top.name != "mujoco":
        raise InputError(f"line {top.line}: its outermost element is <{shown(top.name)[1:-1]}>, "
                         "not <mujoco>; give an MJCF file.")
    guard.check(top, len(text.encode()))
    return top, guard.files


def is_within(folder: Path, name: str) -> bool:
    """Return whether a file name, from a folder, is in that folder, with links resolved."""
    try:
        return (folder / name).resolve().is_relative_to(folder.resolve())
    # a NUL in the name, a link to itself
    except (OSError, ValueError, RuntimeError):
        return False


class _Guard:
    """Count of files, bytes and elements of a document, with their limits."""

    def __init__(self, folder: Path) -> None:
        """Begin with no file read; all files that the document names must be in ``folder``."""
        self.folder = folder
        self.names: list[str] = []
        self.files: dict[str, bytes] = {}
        self.bytes = 0
        #: Elements of the largest <model> of the file that is being checked.
        self.attached = 0.0

    def check(self, top: Element, size: int) -> float:
        """Check the elements of a file and of the files it includes; return their number.

        ``top`` is the outermost element, which gets the content of included files; ``size`` is the
        number of bytes. Elements that MuJoCo makes of <replicate> and the like count.
        """
        self.bytes += size
        self._include(top)
        strip = any(e.attributes.get("strippath") == "true" for e in _descendants(top, "compiler"))
        folders = [e.attributes[key] for e in _descendants(top, "compiler") for key in _FOLDERS
                   if key in e.attributes]
        model_sizes = [self.check(*self._read(element)) for element in _descendants(top, "model")]
        self.attached = max(model_sizes, default=0.0)
        count = self._count(top, strip, ["", *folders])
        if count > MAX_ELEMENTS:
            raise InputError(f"line {top.line}: with what <replicate>, <attach> and the like make "
                             f"of it, it has more than {MAX_ELEMENTS} elements; leave some out.")
        return count

    def _include(self, element: Element) -> None:
        """Put the content of included files in place of <include>."""
        children = []
        for child in element.children:
            if child.name == "include":
                child, size = self._read(child)
                self.bytes += size
                self._include(child)
                children += child.children
            else:
                self._include(child)
                children.append(child)
        element.children = children

    def _count(self, element: Element, strip: bool, folders: list[str]) -> float:
        """Check an element and all elements in it; return the number of elements they become.

        File names are relative to one of ``folders``; with ``strip`` their own folder is dropped.
        An attached model counts with its elements, a height field with its cells.
        """
        for key, value in element.attributes.items():
            if key not in _NAMES and any(map(_NOT_FINITE.fullmatch, value.split())):
                raise InputError(f"line {element.line}: <{shown(element.name)[1:-1]}> has "
                                 f"{key}={shown(value)}; write finite numbers.")
            if key.startswith("file"):
                name = re.split(r"[/\\]", value)[-1] if strip else value
                self._check_path(element, key, name, folders)
            elif key in _FOLDERS or (element.name, key) == ("config", "value"):
                self._check_path(element, key, value, [""])
        count = 1 + sum(self._count(child, strip, folders) for child in element.children)
        # the compiler replaces <attach> by a model, <replicate> by copies, …: a short file may
        # describe millions of elements
        if element.name == "attach":
            count += self.attached
        if element.name in _COUNTED:
            count *= _product(element, "count")
        if element.name == "hfield":
            count += _product(element, "nrow") * _product(element, "ncol") / _CELLS
        return count

    def _check_path(self, element: Element, key: str, name: str, folders: list[str]) -> None:
        """Refuse a file name that leads out of the document's folder, from any of ``folders``.

        ``key`` is the attribute of the element that has the name.
        """
        # drives and absolute paths first, which the folder would not precede
        if re.match(r"[A-Za-z]:|[/\\]", name) or not all(
                is_within(self.folder, f"{folder}/{name}" if folder else name)
                for folder in folders):
            raise InputError(f"line {element.line}: <{shown(element.name)[1:-1]}> has {key}="
                             f"{shown(element.attributes[key])}, which is not in the folder of the "
                             "file; move it there.")

    def _read(self, element: Element) -> tuple[Element, int]:
        """Return the outermost element of the file that an element names, and its bytes."""
        name = element.attributes.get("file", "")
        self._check_path(element, "file", name, [""])
        # one spelling of a path, so that a file that is included twice is noticed
        path = (self.folder / name).resolve().relative_to(self.folder.resolve()).as_posix()

        def refuse(why: str) -> InputError:
            """Return an error with the line and the name of the file; ``why`` ends it."""
            return InputError(f"line {element.line}: it includes {shown(name)}, {why}")

        if element.name == "model" and "/" in path:
            raise refuse("a <model> below the folder of the file; move it into the folder, where "
                         "its meshes are looked for.")
        if path in self.names:
            raise refuse("which is there already; a file is included once.")
        if len(self.names) >= MAX_FILES:
            raise refuse(f"and {MAX_FILES} files are the most; put some into one.")
        self.names.append(path)
        try:
            text = read_text(self.folder / path, MAX_BYTES - self.bytes)
            self.files[name] = text.encode()
            return read_xml(text), len(self.files[name])
        except (UnusableFileError, InputError) as error:
            raise refuse(f"which is not usable: {error}") from None


def _product(element: Element, key: str) -> float:
    """Return the product of the numbers of an attribute, without their signs; 1 without it."""
    words = element.attributes.get(key, "1").split()
    return math.prod(abs(float(word)) for word in words if NUMBER.fullmatch(word))


def _descendants(element: Element, name: str) -> Iterator[Element]:
    """Yield the elements with a name at any depth below an element."""
    for child in element.children:
        if child.name == name:
            yield child
        yield from _descendants(child, name)
