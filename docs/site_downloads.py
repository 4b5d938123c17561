"""Sphinx extension: each page with cells as a notebook, with its outputs, and as a script."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

FOLDER = "_notebooks"


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the handlers to Sphinx's events."""
    app.connect("doctree-resolved", add_links)
    app.connect("build-finished", write_files)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def executed(app: Sphinx, name: str) -> Path:
    """Return where myst_nb writes the notebook of a page with its outputs."""
    return Path(app.outdir).parent / "jupyter_execute" / f"{name}.ipynb"


def add_links(app: Sphinx, tree: nodes.document, name: str) -> None:
    """Put links to both files below the first paragraph of a page with cells."""
    title = next(iter(tree.findall(nodes.title)), None)
    if app.builder.format != "html" or title is None or not executed(app, name).is_file():
        return
    up = "../" * name.count("/")
    links = " ".join(
        f'<a href="{up}{FOLDER}/{name}.{ending}" download>{label}</a>'
        for ending, label in (("ipynb", "notebook"), ("py", "script")))
    line = nodes.raw("", f'<p class="downloads">Download: {links}</p>', format="html")
    section = title.parent
    after = next((child for child in section if isinstance(child, nodes.paragraph)), title)
    section.insert(section.index(after) + 1, line)


def write_files(app: Sphinx, error: Exception | None) -> None:
    """Write the files to which the links lead."""
    if error is not None or app.builder.format != "html":
        return
    for name in sorted(app.env.found_docs):
        source = executed(app, name)
        if source.is_file():
            text = source.read_text(encoding="utf-8")
            for ending, content in (("ipynb", text), ("py", script(json.loads(text)))):
                target = Path(app.outdir) / FOLDER / f"{name}.{ending}"
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(content, encoding="utf-8")


def script(notebook: dict[str, Any]) -> str:
    """Return a notebook in percent format: text as comments, cells begin with ``# %%``."""
    parts = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            parts.append(f"# %%\n{source}")
        else:
            lines = "\n".join(f"# {line}".rstrip() for line in source.splitlines())
            parts.append(f"# %% [markdown]\n{lines}")
    return "\n\n".join(parts) + "\n"
