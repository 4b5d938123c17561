"""A user has the source archive, the wheel, README and docs; commands are typed elsewhere.

A fresh environment holds the wheel and its dependencies: no extra, no other package of the tests.
There every command and every block of Python is typed in an empty folder. A command that needs an
extra must say so in one sentence, and so must the section of the document; it is typed again in the
environment of the tests, where it must work. ``documents.py`` says how long ones are shortened.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from dataclasses import dataclass
from email.parser import Parser
from importlib.util import find_spec
from pathlib import Path

import pytest

import documents
import gyrospark as gs
from gyrospark.core.extras import install
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import PAPER_SPECS
from gyrospark.studies.study_registry import chosen
from gyrospark.sweeps.study_file import load_study
from processes import PATIENCE, ROOT, call, environment
from warm_python import WarmPython

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
EXTRAS = {name: packages for name, packages in PROJECT["optional-dependencies"].items()
          if name not in ("test", "release", "docs")}

#: Types blocks of Python one after the other, as a reader would; prints what stopped each.
READER = """
import json, sys
stopped, namespace = [], {}
for where, text in json.load(sys.stdin):
    try:
        exec(compile(text, where, "exec"), namespace)
    except Exception as error:
        stopped.append([where, type(error).__name__, getattr(error, "name", None), str(error)])
with open("stopped.json", "w") as file:
    json.dump(stopped, file)
"""
#: Programs of the package, as arguments of Python.
PROGRAMS = {"gyrospark": ["-m", "gyrospark"],
            "generate": ["-c", "from gyrospark.__main__ import main_generate; main_generate()"]}


#: Files that the blocks of a page create, and checks of names after them.
MADE = {"README.md": {"double_top.html"}, "python.md": {"top.npz", "top.png"},
        "long_runs.md": {"evening.zarr"}, "sweeps.md": {"spins.zarr"}}
CHECKS = {"README.md": """
assert run.q.shape == (3001, 11) and pendulum.name == "pendulum" and swing.q.shape == (501, 2)
""", "python.md": """
assert trajectory.q.shape == (2001, 4) and trajectory.axis().shape == (2001, 3)
assert trajectory.angular_velocity().shape == (2001, 3)
assert trajectory.energy().shape == (2001,)
assert trajectory.multipliers.shape == (2000, 4)
assert q0.shape == p0.shape == (4,) and step.order == 6
"""}


def copy(folder: Path) -> Path:
    """Copy the project without its build products."""
    anywhere = shutil.ignore_patterns(".*_cache", "__pycache__", "*.egg-info")
    at_the_root = {".git", ".venv", ".hypothesis", "build", "dist"}
    return shutil.copytree(ROOT, folder, ignore=lambda where, names: anywhere(where, names) | (
        at_the_root if Path(where) == ROOT else set()))


def megabytes(folder: Path) -> float:
    """Return the size of a folder on a disk."""
    return sum(path.lstat().st_blocks * 512 for path in folder.rglob("*")) / 1e6


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
    """The source archive, and the wheel that is built from it alone."""
    pytest.importorskip("build")
    folder = tmp_path_factory.mktemp("archives")
    source = copy(folder / "source")
    # Isolation downloads setuptools; one that makes wheels by itself may be here.
    has_setuptools = find_spec("setuptools") and find_spec("setuptools.command.bdist_wheel")
    build_options = ["--no-isolation", "--skip-dependency-check"] * bool(has_setuptools)
    process = call([sys.executable, "-m", "build", *build_options, "--outdir", folder, source],
                   PYTHONWARNINGS=None, PYTHONDONTWRITEBYTECODE=None)
    assert process.returncode == 0, process.stderr
    printed = process.stdout + process.stderr
    assert re.findall(r"^.*(?:\bwarning:|Warning:|[Dd]eprecat|^WARNING).*$", printed, re.M) == []
    (sdist,), (wheel,) = folder.glob("*.tar.gz"), folder.glob("*.whl")
    return sdist, wheel


@pytest.mark.slow  # builds both archives
def test_source_archive_has_every_file_of_the_repository(archives):
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("this is no git checkout")
    with tarfile.open(archives[0]) as archive:
        packed = {name.partition("/")[2] for name in archive.getnames()}
    tracked = call(["git", "ls-files", "-z"], cwd=ROOT).stdout.split("\0")
    assert {name for name in tracked if (ROOT / name).is_file()} <= packed


@pytest.mark.slow  # builds both archives
def test_wheel_has_the_package_and_its_examples(archives):
    with zipfile.ZipFile(archives[1]) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert {name.partition("/")[0] for name in packed} == {"gyrospark"}
    examples = {str(path.relative_to(ROOT)) for path in (ROOT / "examples").rglob("*")
                if path.suffix in (".toml", ".json") or path.name == "main.c"}
    assert {f"gyrospark/{name}" for name in examples | {"py.typed"}} <= packed
    assert not [name for name in packed if re.search(r"/(setup|conftest|test_\w+)\.py$", name)]


@pytest.mark.slow  # builds both archives
def test_wheel_has_every_stepper_of_the_paper(archives):
    """Steppers that the repository lacks are derived while the wheel is built."""
    with zipfile.ZipFile(archives[1]) as archive:
        packed = [name for name in archive.namelist() if name.startswith("gyrospark/generated/")]
        assert {*packed} == {f"gyrospark/generated/{spec.name}.{end}"
                             for spec in PAPER_SPECS for end in ("c", "h", "json")}
        for spec in PAPER_SPECS[::7]:
            for name, text in generate(spec).source.files(standalone=False).items():
                assert archive.read(f"gyrospark/generated/{name}").decode("utf-8") == text


@pytest.mark.slow  # builds both archives
def test_an_index_shows_the_readme_without_what_it_has_not(archives):
    with zipfile.ZipFile(archives[1]) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        about = Parser().parsestr(archive.read(name).decode("utf-8"))
    assert about["License-Expression"] == "BSD-3-Clause"
    assert about["Description-Content-Type"] == "text/markdown"
    assert set(about.get_all("Provides-Extra")) == set(PROJECT["optional-dependencies"])
    description = about.get_payload()
    links = re.findall(r"\]\(([^)]*)\)", description)
    assert "![" not in description
    assert all(link.startswith(("https://", "#")) for link in links), links
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    for heading in re.findall(r"^##+ .*$", readme, flags=re.MULTILINE):
        assert heading in description


@pytest.mark.slow
def test_tests_of_the_source_archive_find_what_they_read(archives, tmp_path):
    """Unpacked elsewhere, under the package's name, all are collected, and the project's pass."""
    with tarfile.open(archives[0]) as archive:
        archive.extractall(tmp_path, filter="data")
    (folder,) = tmp_path.iterdir()
    folder.rename(tmp_path / "gyrospark")
    for command in (["--collect-only"], ["tests/project/test_packaging.py"]):
        process = call([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *command],
                       cwd=tmp_path / "gyrospark", PYTHONPATH=str(tmp_path))
        assert process.returncode == 0, process.stdout


@dataclass
class Machine:
    """An environment, and an empty folder to type in."""

    bin: Path
    folder: Path

    def __post_init__(self) -> None:
        self.warm = WarmPython(self.bin / "python", self.environment())
        self.typed: set[str] = set()

    def environment(self) -> dict[str, str]:
        return environment(PATH=f"{self.bin}{os.pathsep}{os.environ['PATH']}", PYTHONPATH=None,
                           GYROSPARK_OPTIMISE="0")

    def type(self, command: str) -> subprocess.CompletedProcess[str]:
        """Type a command into a shell."""
        program, *arguments = shlex.split(command)
        if program in self.typed and not re.search("[&|;<>$*]", command):
            return self.warm.call([*PROGRAMS[program], *arguments], self.environment(),
                                  cwd=self.folder)
        self.typed.update({program} & set(PROGRAMS))
        return subprocess.run(command, shell=True, cwd=self.folder, env=self.environment(),
                              text=True, capture_output=True, stdin=subprocess.DEVNULL,
                              timeout=PATIENCE, check=False, encoding="utf-8")

    def read(self, blocks: list[documents.Typed]) -> list[list[str]]:
        """Type blocks of Python into one interpreter; return the blocks that stopped, and why."""
        process = self.warm.call(["-c", READER], self.environment(), cwd=self.folder,
                                 text=json.dumps([[block.where, documents.quick(block.text)]
                                                  for block in blocks]))
        assert process.returncode == 0, process.stderr
        failures: list[list[str]] = json.loads((self.folder / "stopped.json").read_text("utf-8"))
        return failures


def furnish(folder: Path) -> Path:
    """Write the files of a reader: files of the pages, and main.c where its program is built."""
    for block in (b for path in documents.DOCUMENTS for b in documents.blocks(path, "toml")):
        few = re.sub(r"\bcount = 1000\b", "count = 2", block.text)
        name = tomllib.loads(block.text).get("name", "loops")  # beside a URDF
        (folder / ("few.toml" if "[grid]" in few else f"{name}.toml")).write_text(few, "utf-8")
    for program in ("plain_c", "run_c"):
        (folder / "examples" / program).mkdir(parents=True)
        shutil.copy(ROOT / "examples" / program / "main.c", folder / "examples" / program)
    return folder


@pytest.fixture(scope="module")
def bare(archives, tmp_path_factory):
    """An environment with the wheel and its dependencies."""
    folder = tmp_path_factory.mktemp("bare")
    process = call([sys.executable, "-m", "venv", "--without-pip", folder / "venv"])
    assert process.returncode == 0, process.stderr
    process = call([sys.executable, "-m", "pip", "--python", folder / "venv" / "bin" / "python",
                    "install", "--quiet", "--no-compile", "--disable-pip-version-check",
                    archives[1]], PYTHONWARNINGS=None, PYTHONPATH=None)
    assert process.returncode == 0, process.stderr
    return Machine(folder / "venv" / "bin", furnish(tmp_path_factory.mktemp("typed")))


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    """The environment of the tests."""
    folder = Path(sys.executable).parent
    if not (folder / "gyrospark").is_file():
        pytest.skip("the package is not installed, so there are no console scripts")
    return Machine(folder, furnish(tmp_path_factory.mktemp("typed")))


@pytest.mark.slow  # installs the wheel
def test_a_bare_environment_is_small_and_has_none_of_the_extras(bare):
    assert megabytes(bare.bin.parent) < 250  # SciPy, NumPy and SymPy 200 of them
    code = "from importlib.metadata import distributions\nfor d in distributions(): print(d.name)"
    process = call([bare.bin / "python", "-c", code], PYTHONPATH=None)
    present = set(process.stdout.lower().split())
    assert "gyrospark" in present
    extras = {re.split(r"[>=\[<;]", line)[0].lower() for lines in EXTRAS.values() for line in lines}
    assert not (extras | {"pytest"}) & present - {"gyrospark"}


@pytest.mark.slow
@pytest.mark.parametrize("target", ["demo", "ready"])
def test_make_demo_works_before_and_after_the_tests(target, tmp_path):
    """The demo alone installs 350 MB, SciPy 110 of them; the tests' packages are enough for it."""
    folder = copy(tmp_path / "project")
    for command in (f".venv/{target}", "demo", "demo"):
        process = call(["make", command], cwd=folder, PYTHONWARNINGS=None, PYTHONPATH=None)
        assert process.returncode == 0, process.stderr
    assert process.stdout.count("pip install") == 0
    assert (folder / "demo.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "demo.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    assert (megabytes(folder / ".venv") < 400) == (target == "demo")


def extra_told(message: str, section: str) -> str:
    """Return the extra that a sentence names, if the section names it or one it is a part of."""
    return _told([name for name in EXTRAS if install(name) in message], section)


def extra_with(package: str, section: str) -> str:
    """Return the extra that brings a package, under the same condition."""
    return _told([name for name, lines in EXTRAS.items()
                  if any(line.startswith(package.partition(".")[0]) for line in lines)], section)


def _told(names: list[str], section: str) -> str:
    wider = [name for name, lines in EXTRAS.items()
             for inner in re.findall(r"gyrospark\[([\w,]+)\]", " ".join(lines))
             if set(inner.split(",")) & set(names)]
    return next((name for name in (*names, *wider) if re.search(rf"\b{name}\b", section)), "")


@pytest.mark.slow  # installs the wheel, and derives and compiles a dozen systems
def test_commands_of_the_documents(bare, full):
    """Each works, or names its missing extra in a line and works where the extra is installed.

    (``make demo`` installs the extra it needs.)
    """
    typed, wrong = set(), []
    for command in (c for path in documents.DOCUMENTS for c in documents.commands(path)):
        text = command.shortened
        if text in typed or command.not_run:
            continue
        typed.add(text)
        process = bare.type(text)
        if process.returncode == 2 and process.stderr.count("\n") == 1 and (
                extra_told(process.stderr, command.section) or command.text == "make demo"):
            process = full.type(text)
        if process.returncode:
            wrong.append(f"{command.where}: {text}\n{process.stdout}{process.stderr}")
    assert len(typed) > 20
    assert not wrong, "\n".join(wrong)


def test_commands_that_are_not_typed_are_known():
    for path in documents.DOCUMENTS:
        for command in documents.commands(path):
            if command.text.startswith("gyrospark reproduce "):
                assert chosen(command.text.split()[2])


def test_every_rule_is_used():
    texts = [c.text for path in documents.DOCUMENTS for c in documents.commands(path)]
    for pattern, *_ in (*documents.SHORTER, *documents.NOT_RUN):
        assert any(re.search(pattern, text) for text in texts), pattern


@pytest.mark.slow  # installs the wheel, and runs every block of the pages
@pytest.mark.parametrize("path", [p for p in documents.DOCUMENTS if documents.blocks(p, "python")],
                         ids=lambda p: p.name)
def test_python_of_the_documents(path, bare, full):
    """Each block works; where no block lacks an extra, the blocks are typed once."""
    blocks = documents.blocks(path, "python")
    check = documents.Typed("what they made", CHECKS.get(path.name, ""), "")
    sections = {block.where: block.section for block in blocks}
    stopped = bare.read([*blocks, check])
    lacking = [failure for failure in stopped if failure[0] != check.where]
    for where, kind, package, message in lacking:
        extra = (extra_with(package, sections[where]) if kind == "ModuleNotFoundError"
                 else extra_told(message, sections[where]))
        assert extra, (where, kind, message)
    if lacking:
        stopped = full.read([*blocks, check])
    assert stopped == []
    created = {p.name for p in (full if lacking else bare).folder.iterdir()}
    assert MADE.get(path.name, set()) <= created


def test_files_of_the_documents(tmp_path):
    furnish(tmp_path)
    assert gs.load_model(tmp_path / "satellite.toml").steps == 3000
    assert load_study(tmp_path / "few.toml").study.size == 4
