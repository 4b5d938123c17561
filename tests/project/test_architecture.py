"""ARCHITECTURE.md against the files: what each package holds, and which imports which."""

from __future__ import annotations

import ast
import re

import pytest

from package_graph import API, OUTER, imports, packages, reachable, reduced
from processes import ROOT

ARCHITECTURE = ROOT / "ARCHITECTURE.md"
#: What is computed for one table of the paper: told by its index.
UNLISTED = {"studies"}


def graph() -> dict[str, set[str]]:
    """Return which package imports from which."""
    return {name: set(others) for name, others in imports().items()}


def test_no_circle():
    """Packages import downwards."""
    below = {name: reachable(graph(), name) for name in graph()}
    circles = {name: sorted(imports()[name]) for name, others in below.items() if name in others}
    assert not circles


def test_packages_list_their_modules():
    """Each module has a line in its package's docstring."""
    for name in set(packages()) - UNLISTED - {API}:
        words = set(re.findall(r"\w+", (ROOT / name / "__init__.py").read_text(encoding="utf-8")))
        assert {path.stem for path in packages()[name]} <= words, name


@pytest.mark.parametrize("outer", OUTER)
def test_a_package_lists_its_packages_from_below(outer):
    """Each package imports only from those that are listed above it."""
    text = (ROOT / outer / "__init__.py").read_text(encoding="utf-8")
    listed = re.findall(r"^    (\w+)/ ", text, flags=re.MULTILINE)
    known = {name for name in packages() if name.startswith(f"{outer}/")}
    assert {f"{outer}/{name}" for name in listed} == known
    for place, name in enumerate(listed):
        above = {f"{outer}/{other}" for other in listed[:place]}
        assert graph()[f"{outer}/{name}"] & known <= above, name


def picture() -> str:
    """Return the packages and the fewest arrows that say who can reach whom, as Mermaid."""
    def key(name: str) -> str:
        return name.replace("/", "_").replace(" ", "_")

    lines = ["```mermaid", "flowchart TD"]
    for outer in OUTER:
        lines += [f"  subgraph {outer}_", f'    {outer}["{outer}/ (beside its packages)"]']
        lines += [f'    {key(name)}["{name.partition("/")[2]}/"]' for name in packages()
                  if name.startswith(f"{outer}/")]
        lines.append("  end")
    lines += [f'  {key(name)}["{name}"]' for name in packages()
              if "/" not in name and name not in OUTER]
    lines += [f"  {key(name)} --> {key(other)}" for name, others in sorted(reduced(graph()).items())
              for other in others]
    return "\n".join([*lines, "```"])


def test_the_picture_is_drawn_from_the_imports(request):
    """``pytest tests/project/test_architecture.py --update`` draws it again."""
    text = ARCHITECTURE.read_text(encoding="utf-8")
    drawn, count = re.subn(r"```mermaid\n.*?```", lambda _: picture(), text, flags=re.DOTALL)
    assert count == 1
    if request.config.getoption("--update"):
        ARCHITECTURE.write_text(drawn, encoding="utf-8")
    assert ARCHITECTURE.read_text(encoding="utf-8") == drawn


def test_each_step_names_a_function_to_open_first():
    """Of the module that it names; the text is one that is read at once."""
    text = ARCHITECTURE.read_text(encoding="utf-8")
    first = re.findall(r"^\*\*(\d)\. .*?\(`(\w+)`\s+in\s+`([\w/.]+)`\)", text, flags=re.M | re.S)
    assert [int(number) for number, _, _ in first] == [1, 2, 3, 4, 5, 6]
    for _, name, module in first:
        tree = ast.parse((ROOT / module).read_text(encoding="utf-8"))
        assert name in {getattr(node, "name", None) for node in tree.body}, (module, name)
    assert text.count("\n") <= 160


def test_every_package_is_documented():
    text = ARCHITECTURE.read_text(encoding="utf-8")
    for name in packages():
        assert f"`{name}/`" in text or name in (API, *OUTER), name


def test_what_is_named_exists():
    """Files and folders in the text, but for those that a run makes."""
    text = ARCHITECTURE.read_text(encoding="utf-8")
    for name in re.findall(r"`([\w./]+/|[\w/]+\.(?:py|jinja|toml|md|h|c))`", text):
        assert (ROOT / name).exists(), name
