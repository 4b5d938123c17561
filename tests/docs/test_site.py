"""The site: cells of its pages run, its reference is complete, and it builds without a warning."""

from __future__ import annotations

import ast
import base64
import html
import importlib.util
import inspect
import json
import re
import shutil
import subprocess
import sys
import warnings
from pathlib import Path
from urllib.parse import unquote

import pytest

import documents
import gyrospark as gs
from processes import PATIENCE, ROOT, call, environment, warm_call
from result_classes import RESULT_CLASSES

DOCS = ROOT / "docs"
CELL = re.compile(r"^```\{code-cell\} python\n(?:---\n.*?^---\n|(?::.*\n)*)(.*?)^```$",
                  flags=re.DOTALL | re.MULTILINE)
PAGES = [path for path in sorted(DOCS.rglob("*.md"))
         if "\n```{code-cell}" in path.read_text(encoding="utf-8")]
#: Types cells one after the other as Jupyter does: the last value of each is shown.
RUNNER = """
import ast, json, sys, warnings
import matplotlib
matplotlib.use("agg")
warnings.simplefilter("error")
warnings.filterwarnings("ignore", "FigureCanvasAgg is non-interactive")  # plt.show()
namespace = {"__name__": "__main__"}
for place, text in enumerate(json.loads(sys.argv[1])):
    tree = ast.parse(text, f"cell {place}")
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, f"cell {place}", "exec"), namespace)
    if last is not None:
        value = eval(compile(ast.Expression(last.value), f"cell {place}", "eval"), namespace)
        if value is not None:
            getattr(value, "_repr_html_", value.__repr__)()
"""


def names(path: Path) -> str:
    return path.relative_to(DOCS).with_suffix("").as_posix()


def cells(path: Path) -> list[str]:
    text = path.read_text(encoding="utf-8")
    texts = CELL.findall(text)
    assert len(texts) == text.count("\n```{code-cell}")
    return [documents.quick(cell) for cell in texts]


#: Pages that compile little; the build runs all, too.
QUICK_PAGES = {"citing", "conventions", "gallery/chaplygin_sleigh"}


@pytest.mark.parametrize("path", [
    pytest.param(path, marks=[pytest.mark.slow] * (names(path) not in QUICK_PAGES))
    for path in PAGES], ids=names)
def test_cells_of_a_page(path, tmp_path):
    process = warm_call(["-c", RUNNER, json.dumps(cells(path))], cwd=tmp_path)
    assert process.returncode == 0, process.stderr


def test_the_quick_pages_are_there():
    assert {names(path) for path in PAGES} > QUICK_PAGES


def test_no_figure_is_shown_twice():
    """pyplot shows a figure at the end of a cell; as the last value it would come again."""
    for path in PAGES:
        for cell in cells(path):
            last = cell.rstrip().splitlines()[-1]
            assert not (re.search(rf"^{re.escape(last)}\b.*= plt\.", cell, flags=re.MULTILINE)
                        and f"plt.close({last})" not in cell), f"{names(path)}: {last}"


def test_pages_with_cells_can_be_opened_as_notebooks():
    for path in PAGES:
        text = path.read_text(encoding="utf-8")
        head = re.match(r"---\n(.*?)\n---\n\n# ", text, flags=re.DOTALL)
        assert head, path
        assert "kernelspec: {name: python3" in head[1], path
        for cell in cells(path):
            assert ast.parse(cell).body, path


def module(name: str):
    """Return a module of the site's build."""
    spec = importlib.util.spec_from_file_location(name, DOCS / f"{name}.py")
    loaded = importlib.util.module_from_spec(spec)
    sys.modules[name] = loaded
    spec.loader.exec_module(loaded)
    return loaded


@pytest.fixture(scope="module")
def uses():
    return module("site_uses")


@pytest.fixture(scope="module")
def tables(uses):
    return module("site_tables")


def test_the_reference_has_every_public_name_once(tables):
    names = [name for page in tables.API.values() for name in page if "." not in name]
    assert sorted([*names, "__version__"]) == sorted(gs.__all__)
    results = {f"gyrospark.{name}" for page in tables.API.values() for name in page if "." in name}
    assert results == set(RESULT_CLASSES)
    for page in tables.API:
        text = tables.api(page)
        assert text.count("```") == 2
        assert (DOCS / "reference" / f"{page}.md").is_file()


def test_tables_are_those_of_the_package(tables):
    for name in tables.TABLES:
        assert tables.TABLES[name]()
        assert any(f"{{{{ {name} }}}}" in path.read_text("utf-8") for path in DOCS.rglob("*.md"))
    assert "| `revolute` |" in tables.joints()
    assert "(#example-slider-crank-toml)" in tables.joints()
    assert "`heaviside`" in tables.functions()


def test_names_lead_to_what_uses_them(uses):
    assert ":doc:`/sweeps`" in uses.users_of("gyrospark.sweep")
    assert ":doc:`/systems`" in uses.users_of("gyrospark.System")
    assert ":doc:`/bodies`" in uses.users_of("gyrospark.Multibody.ball")
    assert uses.users_of("gyrospark.Trajectory.nothing") == []
    assert ":doc:`/long_runs`" in uses.users_of_command("export")
    assert all((ROOT / path).is_file() for path in uses.examples().values())


@pytest.fixture(scope="module")
def search():
    return module("site_search")


def test_words_that_are_searched_for_lead_to_headings_that_exist(search):
    words = [word.strip() for line_of_words in search.SYNONYMS.values()
             for word in line_of_words.split(",")]
    assert len(words) == len({word.lower() for word in words})
    assert {"reaction wheel", "timestep", "lyapunov", "limits", "hinge", "degrees of freedom",
            "gimbal lock", "dae", "controller", "step size"} <= set(words)
    for address in search.SYNONYMS:
        page, _, heading = address.partition("#")
        text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
        assert not heading or heading in documents.headings(text), address


def literals() -> str:
    """Return the strings of the package, with … in place of inserted values."""
    def text(node: ast.AST) -> str:
        if isinstance(node, ast.JoinedStr):
            return "".join(map(text, node.values))
        return str(node.value) if isinstance(node, ast.Constant) else "…"

    texts = [text(node) for folder in ("core", "runtime/compilation", "runtime/integration",
                                       "storage")
             for path in sorted((ROOT / folder).rglob("*.py"))
             for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
             if isinstance(node, ast.JoinedStr | ast.Constant)]
    return "\n".join(" ".join(text.split()) for text in texts)


def test_quoted_sentences_are_printed_by_the_program():
    text = (DOCS / "troubleshooting.md").read_text(encoding="utf-8")
    quotes = [" ".join(quote.replace("\n> ", " ")[2:].split())
              for quote in re.findall(r"^> .*(?:\n> .*)*", text, flags=re.MULTILINE)]
    assert len(quotes) >= 4
    printed = literals()
    for sentence in (piece for quote in quotes for piece in re.split(r"(?<=[.;]) ", quote)):
        assert re.search(re.escape(sentence).replace("…", "[^\n]*?"), printed), sentence


@pytest.mark.parametrize("page", ["cheat_sheet", "coming_from"])
def test_names_of_a_table_exist(page):
    """Names such as ``build.revolute`` and ``run.joint`` exist."""
    owners = {"gs": gs, "build": gs.Multibody, "step": gs.Stepper, "run": gs.Trajectory,
              "sim": gs.Simulation, "model": gs.Model}
    spans = re.findall(r"`([^`\n]+)`", (DOCS / f"{page}.md").read_text(encoding="utf-8"))
    names_of_owners = {name_of_owner for span in spans
                       for name_of_owner in re.findall(r"\b(gs|build|step|run|sim|model)\.(\w+)",
                                                       span)}
    assert len(names_of_owners) >= 20 or page == "cheat_sheet"
    fields = {name for owner in owners.values() if isinstance(owner, type)
              for name in inspect.signature(owner).parameters} | {"ground", "redundancy",
                                                               "time"}
    missing = {f"{owner}.{name}" for owner, name in names_of_owners
               if not hasattr(owners[owner], name) and name not in fields}
    assert not missing


def test_a_script_has_the_text_of_a_page_as_comments():
    script = module("site_downloads").script({"cells": [
        {"cell_type": "markdown", "source": ["# Title\n", "\n", "Text."]},
        {"cell_type": "code", "source": "x = 1\nx", "outputs": []}]}, "page")
    assert script == "# %% [markdown]\n# # Title\n#\n# Text.\n\n# %%\nx = 1\nx\n"


@pytest.mark.parametrize(("cell", "kinds", "program"), [
    ("x = 1\nx, x  # twice", ("text/plain",), "x = 1\nprint(x, x)  # twice"),
    ("run.show()", ("image/png", "text/html"), 'run.show("page_1.html")'),
    ('run.show(".png",\n  time=1)', ("image/png",), 'run.show("page_1.png",\n  time=1)'),
    ('run.plot("x", "y")', ("image/png",), 'run.plot("x", "y").savefig("page_1.png")'),
    ("run.report", ("text/html", "text/plain"), "print(run.report)"),
])
def test_what_a_cell_shows_is_printed_or_written_by_its_script(cell, kinds, program):
    outputs = [{"output_type": "stream", "text": ""},
               {"output_type": "execute_result", "data": dict.fromkeys(kinds, "")}]
    script = module("site_downloads").script({"cells": [
        {"cell_type": "code", "source": cell, "outputs": outputs}]}, "page")
    assert script == f"# %%\n{program}\n"


def test_cells_run_in_a_fork(tmp_path):
    """They have the outputs of a notebook, up to the first cell that fails, in a folder."""
    pytest.importorskip("myst_nb", reason="the site needs the extra docs: make docs")
    from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

    sources = ["from pathlib import Path\nPath('here').touch()\nprint(1)\nx = 2\nx",
               "import matplotlib.pyplot as plt\nplt.plot([0, 1]); plt.show()", "1/0", "print(3)"]
    notebook = new_notebook(cells=[new_markdown_cell("Text."), *map(new_code_cell, sources)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of threads beside a fork, and of packages
        client = module("site_cells").run_cells(notebook, str(tmp_path), timeout=60)
    assert (tmp_path / "here").exists()
    assert "ZeroDivisionError" in str(client.err)
    first, figure, _, after = (cell.outputs for cell in notebook.cells[1:])
    assert [(output.output_type, output.get("text") or output.data["text/plain"])
            for output in first] == [("stream", "1\n"), ("execute_result", "2")]
    assert [output.output_type for output in figure] == ["display_data"]
    assert base64.b64decode(figure[0].data["image/png"]).startswith(b"\x89PNG")
    assert not after


def built(target: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Build pages of the site as ``make docs`` does."""
    return subprocess.run([sys.executable, "-m", "sphinx", "-W", "--keep-going", "--quiet",
                           *options, DOCS, target], cwd=ROOT, text=True, capture_output=True,
                          env=environment(PYTHONWARNINGS=None), timeout=10 * PATIENCE, check=False)


#: Pages without cells, which have every public docstring and the help of every command.
REFERENCE = [f"reference/{page}" for page in (
    "index", "runs", "systems", "tuning", "stores", "artefacts", "commands")]
#: Of ``make docs``, without cells, theme and MathJax; links to pages that are not built are let be.
SHORT = ["-b", "dummy", "-D", "root_doc=reference/index",
         "-D", "extensions=myst_parser,sphinx.ext.autodoc,sphinx.ext.napoleon,sphinx_click,"
               "site_pages",
         "-D", "include_patterns=" + ",".join(f"{page}.md" for page in REFERENCE),
         "-D", "suppress_warnings=ref.doc,ref.ref,myst.xref_missing,toc.not_readable"]


@pytest.mark.slow  # Sphinx reads all docstrings for ten seconds
def test_the_reference_is_built_without_a_warning(tmp_path):
    """The site reads all public docstrings and commands' help, and prints a line a page."""
    process = built(tmp_path, *SHORT)
    assert process.returncode == 0, process.stderr
    assert all(f"] {page} (" in process.stdout for page in REFERENCE)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    pytest.importorskip("myst_nb", reason="the site needs the extra docs: make docs")
    target = tmp_path_factory.mktemp("site")
    process = built(target, "-j", "auto")
    assert process.returncode == 0, process.stderr
    return target


@pytest.mark.slow
def test_the_site_asks_nothing_of_other_machines(site):
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        sources = re.findall(r'<(?:script|img|iframe|source|video)\b[^>]* src="([^"]*)"', text)
        sources += re.findall(r'<link\b[^>]* href="([^"]*)"', text)
        assert not [url for url in sources if url.startswith(("http", "//"))], path
    for path in site.rglob("*.css"):
        assert not re.search(r"url\(['\"]?(https?:)?//", path.read_text(encoding="utf-8")), path


@pytest.mark.slow
def test_every_link_of_the_site_leads_somewhere(site):
    anchors = {path: set(map(html.unescape, re.findall(r'\bid="([^"]*)"', path.read_text("utf-8"))))
               for path in site.rglob("*.html")}
    for path in anchors:
        for link in re.findall(r'<a\b[^>]* href="([^"]*)"', path.read_text(encoding="utf-8")):
            if re.match(r"[a-z]+:", link) or link == "#":
                continue
            file, _, anchor = unquote(html.unescape(link)).partition("#")
            target = (path.parent / file).resolve() if file else path
            assert target.exists(), (path, link)
            assert not anchor or target not in anchors or anchor in anchors[target], (path, link)


@pytest.mark.slow
def test_what_the_site_makes_of_its_pages(site):
    """Pages have signs, pictures of the gallery, uses of names and commands, and landmarks."""
    def read(name: str) -> str:
        return (site / f"{name}.html").read_text(encoding="utf-8")

    assert "g<sub>q</sub>" in read("theory/symplecticity")
    pictures = re.findall(r'<img [^>]*class="thumbnail"[^>]*src="\.\./([^"]*)"', read(
        "gallery/index")) + re.findall(r'<img [^>]*src="\.\./([^"]*)"[^>]*thumbnail', read(
            "gallery/index"))
    assert len(pictures) >= 24
    assert sum((site / picture).stat().st_size for picture in pictures) < 1e6
    assert read("reference/runs").count("Used in") >= 8
    assert "Used in" in read("reference/commands")
    for path in site.rglob("*.html"):
        text = path.read_text(encoding="utf-8")
        assert "<pre>" not in text
        assert 'role="heading">' not in text


#: Sphinx's search of the site itself, on a page without elements: the first result of each query.
SEARCH = """
const fs = require("fs"), path = require("path"), vm = require("vm");
const [site, queries] = [process.argv[1], JSON.parse(process.argv[2])];
const read = name => fs.readFileSync(path.join(site, name), "utf8");
const ignore = () => {};
const page = {documentElement: {dataset: {content_root: ""}}, addEventListener: ignore,
  getElementById: () => null, readyState: "loading", currentScript: {}};
const here = vm.createContext({document: page, window: {}, URLSearchParams, console, Set, Map,
  localStorage: {setItem: ignore}, location: {search: ""}, setTimeout: ignore,
  SPHINX_HIGHLIGHT_ENABLED: false, DOCUMENTATION_OPTIONS: JSON.parse(process.argv[3])});
here.window = here;
for (const name of ["_static/base-stemmer.js", "_static/english-stemmer.js",
    "_static/language_data.js", "_static/doctools.js", "_static/searchtools.js", "searchindex.js"])
  vm.runInContext(read(name), here);
here.queries = queries;
console.log(vm.runInContext(`JSON.stringify(queries.map(query => {
  const found = Search._performSearch(...Search._parseQuery(query));
  const first = found[found.length - 1];
  return first[0] + first[2];
}))`, here));
"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("node") is None, reason="the search is JavaScript")
def test_the_search_leads_to_the_right_page_first(site, search):
    expected = {word.strip(): address.removesuffix("-γ")  # ids in HTML are ASCII
                for address, words in search.SYNONYMS.items() for word in words.split(",")}
    options = {"FILE_SUFFIX": ".html", "BUILDER": "html", "LINK_SUFFIX": ".html"}
    process = call(["node", "-e", SEARCH, site, json.dumps(list(expected)), json.dumps(options)])
    assert process.returncode == 0, process.stderr
    assert dict(zip(expected, json.loads(process.stdout), strict=True)) == expected
