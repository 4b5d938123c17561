"""What the ending of a file's name says of the file to write."""

from __future__ import annotations

from pathlib import Path

__all__ = ["ENDINGS", "FILMS", "PAGES", "PICTURES", "ending_of"]

#: What states are written as.
ENDINGS = (".npz", ".csv", ".nc")
#: What pictures are written as.
PICTURES = (".png", ".svg", ".pdf")
#: What films are written as.
FILMS = (".gif", ".mp4")
#: What moving pages are written as.
PAGES = (".html", ".htm")


def ending_of(path: Path) -> str:
    """Return the ending of a file's name in small letters."""
    return path.suffix.lower()
