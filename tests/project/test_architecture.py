"""ARCHITECTURE.md beside the files: what each package holds, and who imports whom."""

from __future__ import annotations

import re

import pytest

from package_graph import API, HALLS, imports, reachable, reduced, rooms
from processes import ROOT

ARCHITECTURE = ROOT / "ARCHITECTURE.md"
#: Lists of what is printed, and what is computed for one table of the paper: told by their index.
UNLISTED = {"studies", "benchmarks"}


def graph() -> dict[str, set[str]]:
    """Return which package imports from which."""
    return {room: set(others) for room, others in imports().items()}


def test_no_circle():
    """Packages import downwards."""
    below = {room: reachable(graph(), room) for room in graph()}
    circles = {room: sorted(imports()[room]) for room, others in below.items() if room in others}
    assert not circles


@pytest.mark.parametrize("room", sorted(set(rooms()) - UNLISTED))
def test_packages_list_their_modules(room):
    """Each module has a line in its package's docstring."""
    files = rooms()[room]
    if room != API:
        text = (ROOT / room / "__init__.py").read_text(encoding="utf-8")
        missing = [path.stem for path in files if not re.search(rf"\b{path.stem}\b", text)]
        assert not missing, missing


@pytest.mark.parametrize("hall", HALLS)
def test_a_hall_lists_its_rooms_from_below(hall):
    """Each package imports only from those that are listed above it."""
    text = (ROOT / hall / "__init__.py").read_text(encoding="utf-8")
    listed = re.findall(r"^    (\w+)/ ", text, flags=re.MULTILINE)
    known = {room for room in rooms() if room.startswith(f"{hall}/")}
    assert {f"{hall}/{name}" for name in listed} == known
    for place, name in enumerate(listed):
        above = {f"{hall}/{other}" for other in listed[:place]}
        assert graph()[f"{hall}/{name}"] & known <= above, name


def picture() -> str:
    """Return the packages and the fewest arrows that say who can reach whom, as Mermaid."""
    def key(room: str) -> str:
        return room.replace("/", "_").replace(" ", "_")

    lines = ["```mermaid", "flowchart TD"]
    for hall in HALLS:
        lines += [f"  subgraph {hall}_", f'    {hall}["{hall}/ (beside its packages)"]']
        lines += [f'    {key(room)}["{room.partition("/")[2]}/"]' for room in rooms()
                  if room.startswith(f"{hall}/")]
        lines.append("  end")
    lines += [f'  {key(room)}["{room}"]' for room in rooms()
              if "/" not in room and room not in HALLS]
    lines += [f"  {key(room)} --> {key(other)}" for room, others in sorted(reduced(graph()).items())
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


def test_every_room_is_told():
    text = ARCHITECTURE.read_text(encoding="utf-8")
    for room in rooms():
        assert f"`{room}/`" in text or room in (API, *HALLS), room


def test_what_is_named_exists():
    """Files and folders in the text, but for those that a run makes."""
    text = ARCHITECTURE.read_text(encoding="utf-8")
    for name in re.findall(r"`([\w./]+/|[\w/]+\.(?:py|jinja|toml|md|h|c))`", text):
        assert (ROOT / name).exists(), name
