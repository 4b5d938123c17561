"""Sphinx extension: tables of the package, cross-references, alternative texts, and MathJax.

    {{ name }}     on a page is replaced by a table of ``site_tables``
    docstrings     of public names, and commands, end with a list of their users
    g_q, e^{hA}    in running text get subscripts and superscripts
    gallery        its list of pages shows the first picture of bodies, or of curves, of each
    pictures       without an alternative text are a warning, hence an error
    simulations    pages that integrate, of WebAssembly, are built beside the site's own
    progress       a line for each page that is read, its cells with it; time and size at the end
"""

from __future__ import annotations

import importlib.util
import logging as python_logging
import multiprocessing
import os
import re
import shutil
import time
from pathlib import Path
from typing import Any

import site_tables
import site_uses
from docutils import nodes
from PIL import Image
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging

import gyrospark

LOGGER = logging.getLogger(__name__)
#: A letter with an optional combining mark, and its subscript or superscript.
SIGNS = re.compile(r"(?<![^\W\d])(?<![/.<-])([^\W\d_][\u0300-\u036f]?)"
                   r"(?:_(?:\{([^}]*)\}|([A-Za-z0-9]{1,5}))|\^\{([^}]*)\})(?![A-Za-z0-9_=])")
#: Accessibility attributes that the theme lacks (screen readers, keyboard).
MENDED = {
    '<p class="caption" role="heading">': '<p class="caption" role="heading" aria-level="2">',
    '<aside class="sidebar-drawer">': '<aside class="sidebar-drawer" aria-label="All pages">',
    '<aside class="toc-drawer">': '<aside class="toc-drawer" aria-label="This page">',
    "<pre>": '<pre tabindex="0">',
    '<div class="table-wrapper': '<div tabindex="0" class="table-wrapper',
    "<table>": '<table tabindex="0">',
    '<th class="head"><p></p></th>': "<td></td>",
    "<th></th>": "<td></td>",
}
#: Files of the MathJax package that a browser needs.
MATHJAX = ("tex-chtml.js", "output/chtml", "input/tex/extensions", "a11y/assistive-mml.js",
           "ui")

#: Page that integrates, in the site's _static → arguments of ``gyrospark.build``.
SIMULATIONS = {
    "heavy_top": {"system": "fast-top", "dt": 1e-3,
                  "scheme": ["3-G-L", "1-G-L", "2-G-L", "3-LIIIA-B", "IMS", "EMS"]},
    "double_pendulum": {"system": "double-pendulum", "dt": 5e-3, "scheme": ["3-G-L", "EMS"]},
}

#: Number of pages read so far, in all processes, and the total number.
READ = multiprocessing.Value("i", 0)
TO_READ = multiprocessing.Value("i", 0)
BEGAN = time.monotonic()
#: CPU seconds that this process had used, with its children, when it had read its last page.
LAST = [0.0]


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect the handlers to Sphinx's events."""
    app.connect("builder-inited", prepare_cells)
    app.connect("env-before-read-docs", count_pages)
    app.connect("doctree-read", remove_empty_outputs)
    app.connect("doctree-read", show_progress)
    app.connect("source-read", fill_in)
    app.connect("autodoc-process-docstring", end_docstring)
    app.connect("sphinx-click-process-epilog", end_command)
    app.connect("doctree-resolved", ask_for_words)
    app.connect("doctree-resolved", set_signs)
    app.connect("doctree-resolved", show_first_pictures)
    app.connect("build-finished", copy_mathjax)
    app.connect("build-finished", mend_pages)
    app.connect("build-finished", build_simulations, priority=600)  # after pages are mended
    app.connect("build-finished", show_size, priority=900)  # after all that write files
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def prepare_cells(app: Sphinx) -> None:
    """Create the cache that the cell processes share, and encrypt the kernels' connections.

    The tables of jupyter-cache: two processes that find none both make them, and one fails.
    Notebook kernels warn of an unencrypted connection, so those that support encryption use it.
    """
    if "myst_nb" not in app.extensions:
        return
    from jupyter_cache import get_cache
    from jupyter_client.manager import KernelManager

    get_cache(app.config.nb_execution_cache_path).db.dispose()
    if hasattr(KernelManager, "transport_encryption"):
        KernelManager.transport_encryption.default_value = "auto"
    python_logging.getLogger("traitlets").setLevel("WARNING")  # each kernel logs its start


def count_pages(app: Sphinx, env: BuildEnvironment, names: list[str]) -> None:
    """Store the number of pages to be read."""
    READ.value, TO_READ.value, LAST[0] = 0, len(names), cpu_seconds()


def cpu_seconds() -> float:
    """Return the CPU time of this process and of its children that have ended."""
    return sum(os.times()[:4])


def remove_empty_outputs(app: Sphinx, tree: nodes.document) -> None:
    """Remove the outputs of cells that are empty texts: progress ends as one."""
    for bundle in list(tree.findall(nodes.container)):
        if bundle.get("nb_element") == "mime_bundle" and bundle.parent is not None and all(
                part.get("mime_type") == "text/plain" and not part.astext()
                for part in bundle.children):
            outputs = bundle.parent
            outputs.remove(bundle)
            if not outputs.children:
                outputs.parent.remove(outputs)


def show_progress(app: Sphinx, tree: nodes.document) -> None:
    """Print that a page has been read, and its CPU time with its cells, whatever process reads it.

    A process that was forked for some pages begins anew.
    """
    last, LAST[0] = LAST[0], cpu_seconds()
    spent = LAST[0] - last if LAST[0] >= last else LAST[0]
    with READ.get_lock():
        READ.value += 1
        print(f"{time.strftime('%H:%M:%S')} [{READ.value}/{TO_READ.value}] {app.env.docname} "
              f"({spent:.1f} s)", flush=True)


def show_size(app: Sphinx, error: Exception | None) -> None:
    """Print the number of pages, their size and the time."""
    if error is None and app.builder.format == "html":
        size = sum(path.stat().st_size for path in Path(app.outdir).rglob("*") if path.is_file())
        print(f"{TO_READ.value} of {len(app.env.found_docs)} pages read, {size / 1e6:.0f} MB in "
              f"{app.outdir}, {time.monotonic() - BEGAN:.0f} s, {cpu_seconds():.0f} s of CPU",
              flush=True)


def fill_in(app: Sphinx, name: str, source: list[str]) -> None:
    """Replace ``{{ name }}`` by a table that the package makes."""
    source[0] = re.sub(r"^\{\{ (\w+) \}\}$", lambda found: site_tables.TABLES[found[1]](),
                       source[0], flags=re.MULTILINE)


def end_docstring(app: Sphinx, what: str, name: str, thing: Any, options: Any,
                  lines: list[str]) -> None:
    """Escape bars, which are absolute values, and list the users of a public name."""
    lines[:] = [re.sub(r"(?<!\\)\|", r"\\|", line) for line in lines]
    users = site_uses.users_of(name)
    if users:
        lines += ["", "Used in " + ", ".join(users) + ".", ""]


def end_command(app: Sphinx, context: Any, lines: list[str]) -> None:
    """List the pages that contain a command."""
    users = site_uses.users_of_command(context.command.name)
    if users and context.parent is not None:
        lines += ["", "Used in " + ", ".join(users) + ".", ""]


def ask_for_words(app: Sphinx, tree: nodes.document, name: str) -> None:
    """Warn of pictures without an alternative text."""
    for picture in tree.findall(nodes.image):
        if not picture.get("alt"):
            LOGGER.warning("the picture %s has no alternative text; see "
                           "docs/writing.md", picture["uri"], location=name)


def set_signs(app: Sphinx, tree: nodes.document, name: str) -> None:
    """Set g_q, γ_m and e^{hA} of running text as signs; names of the reference are names."""
    if name.startswith("reference/"):
        return
    for text in list(tree.findall(nodes.Text)):
        outside = (nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.raw)
        parent = text.parent
        if isinstance(parent, outside) or not SIGNS.search(text):
            continue
        parent.replace(text, _set(text.astext()))


def _set(text: str) -> list[nodes.Node]:
    """Return text with its signs as nodes."""
    made: list[nodes.Node] = []
    end = 0
    for sign in SIGNS.finditer(text):
        below, above = sign[2] or sign[3], sign[4]
        made += [nodes.Text(text[end:sign.start()] + sign[1]),
                 nodes.subscript("", below) if below else nodes.superscript("", above)]
        end = sign.end()
    return [*made, nodes.Text(text[end:])]


def show_first_pictures(app: Sphinx, tree: nodes.document, name: str) -> None:
    """Make the gallery's lists of pages grids: the first picture of each, and its title."""
    if name != "gallery/index":
        return
    for pages in list(tree.findall(addnodes.toctree)):
        grid = nodes.container(classes=["gallery"])
        for _, page in pages["entries"]:
            link = nodes.reference(refuri=app.builder.get_relative_uri(name, page), internal=True)
            images = list(app.env.get_doctree(page).findall(nodes.image))
            first = next(filter(_shows_bodies, images), images[0] if images else None)
            if first is not None:
                link += nodes.raw("", _thumbnail(app, first["uri"]), format="html")
            link += nodes.Text(app.env.titles[page].astext())
            grid += nodes.paragraph("", "", link)
        heading = nodes.paragraph("", "", nodes.strong("", pages["caption"]))
        pages.parent.insert(pages.parent.index(pages), [heading, grid])
        pages["hidden"] = True


def _thumbnail(app: Sphinx, uri: str) -> str:
    """Write a picture in the size of the grid's cells, twice for dense screens; return its HTML."""
    path = Path(app.outdir) / "_images" / f"thumbnail_{Path(uri).stem}.webp"
    path.parent.mkdir(exist_ok=True)
    with Image.open(Path(app.srcdir) / uri) as picture:
        small = picture.convert("RGBA")
    small.thumbnail((400, 300))
    small.save(path, quality=80)
    return (f'<img alt="" class="thumbnail" loading="lazy" width="{small.width}" '
            f'height="{small.height}" src="../_images/{path.name}">')


def _shows_bodies(image: nodes.image) -> bool:
    """Return whether a picture is the output of ``run.picture`` or of ``run.view``."""
    bundle = image.parent.parent if image.parent is not None else None
    return bundle is not None and bundle.get("nb_element") == "mime_bundle" and any(
        other.get("mime_type") == "text/html" or other.astext().startswith("<picture of")
        for other in bundle.children)


def mend_pages(app: Sphinx, error: Exception | None) -> None:
    """Give landmarks names, headings a level, and code that scrolls to the keyboard."""
    if error is None and app.builder.format == "html":
        for path in Path(app.outdir).rglob("*.html"):
            text = path.read_text(encoding="utf-8")
            for old, new in MENDED.items():
                text = text.replace(old, new)
            path.write_text(text, encoding="utf-8")


def build_simulations(app: Sphinx, error: Exception | None) -> None:
    """Build the pages that integrate, which the site's pages have in frames."""
    if error is None and app.builder.format == "html":
        for name, arguments in SIMULATIONS.items():
            target = Path(app.outdir) / "_static" / f"{name}.html"
            target.unlink(missing_ok=True)
            gyrospark.build("web", **arguments, out=target)


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
