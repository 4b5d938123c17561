"""The site: ``make docs``. Nothing is fetched, warnings are errors, cells are run, cached."""

from __future__ import annotations

import hashlib
import os
import runpy
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE))  # site_pages, in this folder

project = "gyrospark"
version = release = runpy.run_path(str(ROOT / "_version.py"))["__version__"]
author = "the gyrospark authors"
project_copyright = "the gyrospark authors"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax",
              "sphinx_click", "sphinx_copybutton", "site_pages", "site_cells", "site_search",
              "site_downloads"]
exclude_patterns = ["writing.md", "reference/parts"]


def digest() -> str:
    """Return a digest of the package, which identifies the cached outputs of the cells."""
    found = hashlib.sha256()
    packages = [path for path in ROOT.iterdir() if path.is_dir() and path.name[0] != "."
                and path.name not in ("build", "dist", "docs", "tests")]
    inside = [path for package in packages for path in package.rglob("*")]
    for path in sorted([*ROOT.glob("*.py"), *inside]):
        if path.suffix in (".py", ".h", ".jinja", ".toml", ".html", ".css", ".js"):
            found.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return found.hexdigest()[:16]


# Steppers of pages take few steps: most of the time would be the compiler's.
os.environ.setdefault("GYROSPARK_OPTIMISE", "0")
# Elsewhere than on Linux a page has a kernel: what the first compiles of a module the others read.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Cells run in their own folder; the outputs of unchanged cells are cached.
nb_execution_mode = "cache"
nb_execution_cache_path = str(ROOT / "build" / "cells" / digest())
nb_execution_in_temp = True
nb_execution_timeout = 1200  # a cell takes half a minute, on a busy machine ten times that
nb_execution_raise_on_error = True
nb_merge_streams = True
nb_render_markdown_format = "myst"
myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

# Docstrings are NumPy's, in the words of the project: bars are absolute values, not substitutions.
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
add_module_names = False

html_theme = "furo"
html_title = f"gyrospark {release}"  # on each page, above its list of pages and in its title
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "a11y-high-contrast-dark"
mathjax_path = "mathjax/tex-chtml.js"  # site_pages copies it from a package
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
copybutton_exclude = ".linenos, .gp, .go"
intersphinx_mapping: dict[str, str] = {}
