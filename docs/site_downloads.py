"""Sphinx extension: each page with cells as a notebook, with its outputs, and as a script."""

from __future__ import annotations

import ast
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
            program = script(json.loads(text), Path(name).name)
            for ending, content in (("ipynb", text), ("py", program)):
                target = Path(app.outdir) / FOLDER / f"{name}.{ending}"
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(content, encoding="utf-8")


def script(notebook: dict[str, Any], name: str) -> str:
    """Return a notebook in percent format: text as comments, cells begin with ``# %%``.

    The value that a cell shows is printed, or written as ``NAME_3.png``, with the cell's number.
    """
    parts: list[str] = []
    for cell in notebook["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "code":
            parts.append(f"# %%\n{as_program(cell, f'{name}_{len(parts) + 1}')}")
        else:
            lines = "\n".join(f"# {line}".rstrip() for line in source.splitlines())
            parts.append(f"# %% [markdown]\n{lines}")
    return "\n\n".join(parts) + "\n"


def as_program(cell: dict[str, Any], name: str) -> str:
    """Return the text of a cell, whose last value a program prints, or writes if it is a picture.

    Its outputs say what it shows: ``run.show()`` a page, what else has pixels a figure.
    """
    source = "".join(cell["source"])
    shown = [output["data"] for output in cell.get("outputs", ())
             if output["output_type"] == "execute_result"]
    if not shown:
        return source
    last = ast.parse(source).body[-1]
    value = ast.get_source_segment(source, last) or ""
    head, _, tail = source.rpartition(value)
    if "image/png" not in shown[0]:
        value = f"print({value})"
    elif value.endswith(".show()"):
        value = f'{value[:-1]}"{name}.html")'
    elif '.show(".png"' in value:
        value = value.replace('.show(".png"', f'.show("{name}.png"')
    else:
        value = f'{value}.savefig("{name}.png")'
    return f"{head}{value}{tail}"
