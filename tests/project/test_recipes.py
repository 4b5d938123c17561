"""The recipes of CONTRIBUTING.md, each applied to a copy of the project and run there."""

from __future__ import annotations

import functools
import json
import re
import shlex
import shutil
import sys
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import gyrospark as gs
from processes import ROOT, call, environment
from warm_python import WarmPython

TEXT = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
#: The folders of the package.
PACKAGES = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))[
    "tool"]["setuptools"]["packages"]
WANTED = {name.split(".")[1] for name in PACKAGES if "." in name}
MOST_FILES, MOST_LINES = 2, 20


@dataclass(frozen=True)
class Change:
    """The change of a file in a recipe: at each place, lines that become others."""

    path: str
    places: list[list[str]]

    @property
    def written(self) -> int:
        """The number of lines that a person writes, blank ones aside."""
        return sum(line.startswith("+") and line != "+" for lines in self.places for line in lines)

    def apply(self, root: Path) -> None:
        """Change the file, or create it; every place must be there, and only once."""
        target = root / self.path
        text = target.read_text(encoding="utf-8") if target.is_file() else None
        for lines in self.places:
            old = "".join(f"{line[1:]}\n" for line in lines if line[:1] != "+")
            new = "".join(f"{line[1:]}\n" for line in lines if line[:1] != "-")
            if text is None:
                assert not old, f"{self.path} is not there"
                text = new
            else:
                assert text.count(old) == 1, f"{self.path}: {text.count(old)} times {old!r}"
                text = text.replace(old, new)
        target.write_text(str(text), encoding="utf-8")


@dataclass(frozen=True)
class Recipe:
    """A section of CONTRIBUTING.md."""

    text: str

    @property
    def room(self) -> str:
        """The package in which the recipe says that the change goes."""
        return re.search(r"^Package: `?([\w/]+)", self.text, flags=re.MULTILINE)[1]

    @property
    def changes(self) -> list[Change]:
        """The changes of its ``diff`` block, file by file."""
        (diff,) = re.findall(r"^```diff\n(.*?)^```", self.text, flags=re.MULTILINE | re.DOTALL)
        files = re.split(r"^--- (.+)\n", diff, flags=re.MULTILINE)[1:]
        return [Change(path, [hunk.splitlines() for hunk in re.split(r"^@@\n", body,
                                                                    flags=re.MULTILINE)])
                for path, body in zip(files[::2], files[1::2], strict=True)]

    @property
    def files(self) -> dict[str, str]:
        """The texts of its ``toml`` blocks, by the name in them."""
        blocks = re.findall(r"^```toml\n(.*?)^```", self.text, flags=re.MULTILINE | re.DOTALL)
        return {re.search(r'name = "(\w+)"', block)[1] + ".toml": block for block in blocks}

    @property
    def commands(self) -> list[list[str]]:
        """The commands of its ``sh`` or ``python`` block, as arguments of Python."""
        (match,) = re.findall(r"^```(sh|python)\n(.*?)^```", self.text,
                              flags=re.MULTILINE | re.DOTALL)
        language, block = match
        if language == "python":
            return [["-c", block]]
        return [["-m", *shlex.split(line)] for line in block.splitlines()]


RECIPES = {title: Recipe(text) for title, text in re.findall(
    r"^### A(?:n)? ([\w-]+(?: problem)?).*?\n(.*?)(?=^##)", TEXT, flags=re.MULTILINE | re.DOTALL)}
PARTS = ["scheme", "named problem", "floating-point", "output", "joint", "command", "target",
         "study"]


def test_there_is_one_for_each():
    assert list(RECIPES) == PARTS


@pytest.mark.parametrize("title", PARTS)
def test_a_recipe_is_short_and_begins_in_its_package(title):
    changes = RECIPES[title].changes
    assert len(changes) <= MOST_FILES
    assert sum(change.written for change in changes) <= MOST_LINES
    room = RECIPES[title].room
    first = str(Path(changes[0].path).parent.as_posix())
    assert room.rstrip("/") == ("root" if first == "." else first)
    row = next(line for line in TEXT.splitlines() if line.startswith("|") and title in line)
    assert f"`{room}`" in row or room in row


def applied(title: str, folder: Path) -> Path:
    """Return a folder with a copy of the package in which a recipe was followed."""
    copy = folder / "gyrospark"
    copy.mkdir()
    for path in ROOT.iterdir():
        if path.name in WANTED:
            shutil.copytree(path, copy / path.name)  # with bytecode, which fits its files
        elif path.suffix in (".py", ".pyi") or path.name in ("py.typed", "pyproject.toml"):
            shutil.copy(path, copy)
    for change in RECIPES[title].changes:
        change.apply(copy)
    for name, text in RECIPES[title].files.items():
        (folder / name).write_text(text, encoding="utf-8")
    return folder


@functools.cache
def warm() -> WarmPython:
    """Python with other packages imported, for each copy imports its own."""
    return WarmPython(sys.executable, environment(), code="")


def followed(title: str, folder: Path) -> list[str]:
    """Follow a recipe and run its commands; return the output of each."""
    applied(title, folder)
    outputs = []
    for words in RECIPES[title].commands:
        process = warm().call(words, environment(), cwd=folder)
        assert process.returncode == 0, process.stderr
        outputs.append(process.stdout)
    return outputs


@pytest.fixture(scope="module")
def checkout(tmp_path_factory):
    """A copy of the project in which all recipes were followed."""
    copy = tmp_path_factory.mktemp("recipes") / "gyrospark"
    ignored = shutil.ignore_patterns(".git", ".venv", ".*_cache", ".hypothesis", "__pycache__",
                                     "build", "dist", "*.egg-info")
    shutil.copytree(ROOT, copy, ignore=ignored)
    for recipe in RECIPES.values():
        for change in recipe.changes:
            change.apply(copy)
    return copy


@pytest.mark.parametrize("tool", [
    "ruff", pytest.param("mypy", marks=pytest.mark.slow)])  # reads the package in another place
def test_what_recipes_write_passes_the_lint(tool, checkout):
    pytest.importorskip("mypy")
    arguments = ["check", "--no-cache", checkout]
    if tool == "mypy":
        paths = {Path(change.path) for recipe in RECIPES.values() for change in recipe.changes}
        modules = {".".join(("gyrospark", *path.with_suffix("").parts)).removesuffix(".__init__")
                   for path in paths}
        linted = Path(sys.prefix, "src", ".mypy_cache")  # by `make lint`, of the same packages
        if linted.is_dir():
            shutil.copytree(linted, checkout.parent / "cache")
        arguments = ["--config-file", checkout / "pyproject.toml", "--cache-dir", "cache",
                     *(word for module in sorted(modules) for word in ("-m", module))]
    process = call([sys.executable, "-m", tool, *arguments], cwd=checkout.parent, PYTHONPATH=None,
                   MYPYPATH=".", PYTHONWARNINGS=None)
    assert process.returncode == 0, process.stdout + process.stderr


@pytest.mark.slow  # a run of pytest in a copy
def test_what_recipes_write_passes_the_tests_of_the_project(checkout):
    """Tests of processes and of single runs are left out, for recipes do not change these."""
    files = [f"tests/project/test_{name}.py" for name in ("architecture", "docstrings",
                                                          "packaging")]
    process = call([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p",
                    "no:xdist", *files, "-k", "not (no_sympy or not_installed or fit)"],
                   cwd=checkout, PYTHONPATH=str(checkout.parent), PYTHONWARNINGS=None)
    assert process.returncode == 0, process.stdout


#: A file that a recipe's commands write, or a part of what they print.
RESULTS = {
    "scheme": '"stepper": "heavy_top_rattle_gamma"', "named problem": "run.npz",
    "floating-point": '"stepper": "heavy_top_ims_gamma_float64"', "output": "run.csv",
    "joint": '"steps": 20', "command": "IMS", "target": "the bits of C after 9 steps",
    "study": "proved: A and Â are Verlet's"}


@pytest.mark.parametrize("title", [  # most derive and compile in a copy of the package
    pytest.param(title, marks=[pytest.mark.slow] * (title != "command")) for title in PARTS])
def test_a_recipe_does_what_it_says(title, tmp_path):
    outputs = followed(title, tmp_path)
    assert RESULTS[title] in outputs[0] or (tmp_path / RESULTS[title]).is_file()
    if title == "scheme":  # RATTLE is 2-LIIIA-B, to the bit
        top = gs.problems.fast_top()
        run = gs.stepper("LIIIA-B", 2).integrate(top, dt=1e-3, steps=100)
        assert json.loads(outputs[0])["energy_error_max"] == run.report.energy_error_max
    if title == "output":  # the same in each file; gravity leaves the vertical part as it is
        with np.load(tmp_path / "run.npz") as file:
            momenta = file["angular_momenta"]
        stored = gs.load(tmp_path / "run.zarr")._group["angular_momentum"][:]
        assert np.array_equal(stored, momenta)
        assert np.ptp(momenta[:, 0, 2]) < 1e-14 * np.abs(momenta).max() < np.ptp(momenta[:, 0, 0])
