"""What the site makes of the package: tables, cross-references, pictures' words, and MathJax.

    {{ name }}     on a page is replaced by what ``tables`` makes of the package
    docstrings     of public names, and commands, end with the pages and examples that use them
    pictures       without words for those who do not see them are a warning, hence an error
"""

from __future__ import annotations

import importlib.util
import re
import shutil
from pathlib import Path
from typing import Any

import site_tables
import site_uses
from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util import logging

LOGGER = logging.getLogger(__name__)
#: What MathJax needs in a browser, of the files that its package has.
MATHJAX = ("tex-chtml.js", "output/chtml", "input/tex/extensions", "a11y/assistive-mml.js",
           "ui")


def setup(app: Sphinx) -> dict[str, bool]:
    """Tell Sphinx what is done when."""
    app.connect("source-read", fill_in)
    app.connect("autodoc-process-docstring", end_docstring)
    app.connect("sphinx-click-process-epilog", end_command)
    app.connect("doctree-resolved", ask_for_words)
    app.connect("build-finished", copy_mathjax)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def fill_in(app: Sphinx, name: str, source: list[str]) -> None:
    """Replace ``{{ name }}`` by a table that the package makes."""
    source[0] = re.sub(r"^\{\{ (\w+) \}\}$", lambda found: site_tables.TABLES[found[1]](),
                       source[0], flags=re.MULTILINE)


def end_docstring(app: Sphinx, what: str, name: str, thing: Any, options: Any,
                  lines: list[str]) -> None:
    """Escape bars, which are absolute values, and say who uses a public name."""
    lines[:] = [re.sub(r"(?<!\\)\|", r"\\|", line) for line in lines]
    users = site_uses.users_of(name)
    if users:
        lines += ["", "Used in " + ", ".join(users) + ".", ""]


def end_command(app: Sphinx, context: Any, lines: list[str]) -> None:
    """Say which pages type a command."""
    users = site_uses.users_of_command(context.command.name)
    if users and context.parent is not None:
        lines += ["", "Used in " + ", ".join(users) + ".", ""]


def ask_for_words(app: Sphinx, tree: nodes.document, name: str) -> None:
    """Warn of pictures without words."""
    for picture in tree.findall(nodes.image):
        if not picture.get("alt"):
            LOGGER.warning("the picture %s has no words for those who do not see it; see "
                           "docs/writing.md", picture["uri"], location=name)


def copy_mathjax(app: Sphinx, error: Exception | None) -> None:
    """Copy MathJax, so that pages ask no other machine for it."""
    if error is not None or app.builder.format != "html":
        return
    spec = importlib.util.find_spec("sphinx-mathjax-offline")
    assert spec is not None
    assert spec.origin is not None
    origin = Path(spec.origin).parent / "static" / "mathjax"
    for inner in MATHJAX:
        target = Path(app.outdir) / "_static" / "mathjax" / inner
        target.parent.mkdir(parents=True, exist_ok=True)
        if (origin / inner).is_dir():
            shutil.copytree(origin / inner, target, dirs_exist_ok=True)
        else:
            shutil.copy(origin / inner, target)
