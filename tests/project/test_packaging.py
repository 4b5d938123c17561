"""Packaging, public names, README and pages; sizes that keep the project readable."""

from __future__ import annotations

import importlib
import re
import shutil
import tomllib
from pathlib import Path

import click
import pytest

import documents
import gyrospark
from gyrospark.commands import gyrospark as command_line
from gyrospark.commands.generate import generate
from gyrospark.core.extras import packages_of
from processes import ROOT, call
from toy import HEADERS

README = (ROOT / "README.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def folders_to_install() -> list[Path]:
    """Return the folders of the package: of modules, and of data that are installed as well."""
    data = [ROOT / name for name in ("examples", "generated", "templates", "targets/texts")]
    engine = [ROOT / "engine", *(path for path in (ROOT / "engine").rglob("*") if path.is_dir())]
    modules = [path.parent for depth in ("*", "*/*") for path in ROOT.glob(f"{depth}/__init__.py")
               if path.parts[len(ROOT.parts)] not in ("benchmarks", "build", "tests", ".venv")]
    inner = [path for path in (ROOT / "examples").iterdir() if path.is_dir()]
    return [path for path in (*data, *engine, *modules, *inner) if path.name != "__pycache__"]


def checked_in(folder: Path) -> list[Path]:
    """Return the files of a folder that belong to the project: all, if this is no git checkout."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        return [path for path in folder.iterdir() if path.is_file()]
    tracked = call(["git", "ls-files", "-z", "."], cwd=folder).stdout.split("\0")
    return [folder / name for name in tracked if name and "/" not in name]


def test_packages_in_pyproject_are_the_folders():
    folders = {".".join(p.relative_to(ROOT).parts) for p in folders_to_install()}
    setuptools = PROJECT["tool"]["setuptools"]
    assert set(setuptools["packages"]) == {"gyrospark"} | {f"gyrospark.{f}" for f in folders}
    assert setuptools["package-dir"] == {"gyrospark": "."}


def test_every_data_file_is_packaged():
    patterns = PROJECT["tool"]["setuptools"]["package-data"]
    for folder in folders_to_install():
        package = ".".join(["gyrospark", *folder.relative_to(ROOT).parts])
        for path in checked_in(folder):
            if path.suffix != ".py":
                assert any(path.match(p) for p in (*patterns["*"], *patterns.get(package, ()))), (
                    path)
    assert (ROOT / "py.typed").is_file()


def test_version_is_the_same_everywhere():
    assert PROJECT["project"]["version"] == gyrospark.__version__
    assert gyrospark.__version__ in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_nothing_generated_is_checked_in_elsewhere():
    """Files of experiments at the root do not stay there."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("this is no git checkout")
    tracked = call(["git", "ls-files", "-z"], cwd=ROOT).stdout.split("\0")
    present = [Path(name) for name in tracked if name and (ROOT / name).exists()]
    for path in present:
        if path.suffix in (".c", ".h"):
            assert path.parts[0] in ("engine", "generated", "examples", "benchmarks", "targets",
                                     "tests"), path
        assert path.suffix not in (".so", ".o", ".pyc"), path
        assert path.suffix != ".npz" or path.parent == Path("tests/data/stores"), path


def test_console_scripts_point_at_functions():
    for target in PROJECT["project"]["scripts"].values():
        module, function = target.split(":")
        assert callable(getattr(importlib.import_module(module), function))


def test_public_names_resolve():
    for name in gyrospark.__all__:
        assert getattr(gyrospark, name) is not None
    assert set(dir(gyrospark)) == set(gyrospark.__all__)
    assert len(set(gyrospark.__all__)) == len(gyrospark.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = gyrospark.nonsense


def test_hints_name_the_packages_of_an_extra(monkeypatch):
    """A checkout takes them from pyproject.toml, an installed package from its metadata."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"]
    checkout = {extra: packages_of(extra) for extra in extras}
    assert checkout["storage"] == extras["storage"]
    assert checkout["netcdf"] == [*extras["storage"], *extras["netcdf"][1:]]
    assert all("gyrospark" not in package for packages in checkout.values() for package in packages)
    assert "ziglang" in checkout["compiler"][0]  # the message on compilers names it
    monkeypatch.setattr(Path, "is_file", lambda self: False)
    requirements = [f'{package}{" and" if ";" in package else ";"} extra == "{extra}"'
                    for extra, packages in extras.items() for package in packages]
    monkeypatch.setattr("importlib.metadata.requires", lambda name: requirements)
    assert {extra: packages_of(extra) for extra in extras} == checkout


def commands_of(text: str) -> list[list[str]]:
    """Return the gyrospark command lines in a text, continuation lines joined."""
    lines = re.sub(r"\\\n\s*", " ", text).splitlines()
    words_of_lines = [line.strip("`$ ").split() for line in lines]
    return [words for words in words_of_lines if words and words[0] in ("generate", "gyrospark")]


def help_pages() -> list[tuple[str, str]]:
    pages = [("generate", generate.help or "")]
    context = click.Context(command_line)
    for name in command_line.list_commands(context):
        command = command_line.get_command(context, name)
        assert command is not None
        pages.append((f"gyrospark {name}", command.help or ""))
    return [*pages, ("gyrospark", command_line.help or "")]


def told_commands() -> list[list[str]]:
    """Return the command lines of README and pages, forms of commands included."""
    texts = [path.read_text(encoding="utf-8") for path in documents.DOCUMENTS]
    return [words for text in texts for words in (
        *commands_of("\n".join(block for language, block in re.findall(
            r"^```(\S*)[^\n]*\n(.*?)^```$", text, re.DOTALL | re.MULTILINE) if not language)),
        *commands_of("\n".join(re.findall(r"`((?:generate|gyrospark) [^`]*)`", text))))]


def check_command(words: list[str]) -> None:
    """Check that a command and every option in it exist."""
    command: click.Command = generate if words[0] == "generate" else command_line
    arguments = words[1:]
    while isinstance(command, click.Group) and arguments and not arguments[0].startswith("-"):
        context = click.Context(command)
        assert arguments[0] in command.list_commands(context), words
        command, arguments = command.get_command(context, arguments[0]), arguments[1:]
    options = {opt for parameter in command.params for opt in parameter.opts}
    for word in arguments:
        assert not word.startswith("--") or word in options, (word, words)


def test_commands_of_the_documents_exist():
    commands = told_commands()
    assert len(commands) >= 40
    for words in commands:
        check_command(words)


def test_examples_in_help_exist():
    for where, text in help_pages():
        lines = commands_of(text)
        assert lines or where == "gyrospark cache", where
        for words in lines:
            check_command(words)


def test_documents_name_what_exists():
    """Targets of make, files and headings of links, and extras exist."""
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    targets = set(re.findall(r"^([a-z]+):", makefile, flags=re.MULTILINE))
    for path in documents.DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        for target in re.findall(r"(?:^|`|\$ )make ([a-z]+)", text, flags=re.MULTILINE):
            assert target in targets, (path, target)
        for link in re.findall(r"\]\((?!https?:|#)([^)]+)\)", text):
            file, _, heading = link.partition("#")
            assert (path.parent / file).exists(), (path, link)
            assert not heading or heading in documents.headings(
                (path.parent / file).read_text("utf-8")), (path, link)
        for extras in re.findall(r'pip install "\.\[([\w,]+)\]', text):
            assert set(extras.split(",")) <= set(PROJECT["project"]["optional-dependencies"]), path


def test_a_readme_is_read_in_two_minutes():
    assert len(README.splitlines()) <= 150


def test_extras_are_documented():
    extras = PROJECT["project"]["optional-dependencies"]
    page = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    table = re.search(r"^\| extra \|.*?\n\n", page, flags=re.MULTILINE | re.DOTALL)
    assert table
    rows = re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", table[0], flags=re.MULTILINE)
    assert {name for name, _ in rows} == set(extras) - {"test", "docs", "release"}
    for name, brings in rows:
        for package in brings.split(", "):
            assert re.search(rf"\b{package}\b", " ".join(extras[name])), (name, package)


def test_ci_calls_the_readme_test_command():
    assert "make test" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "make test" in README


#: Files of the root that tools ask for by name.
TOOLING = {"CITATION.cff", "LICENSE", "MANIFEST.in", "Makefile", "__main__.py", "_version.py",
           "__init__.pyi", "py.typed", "pyproject.toml", "setup.py"}


def lines(path):
    return path.read_text(encoding="utf-8").count("\n")


def test_generated_files_hold_what_was_derived():
    files = sorted((ROOT / "generated").glob("*.c"))
    assert len(files) == 6
    assert lines(ROOT / "generated" / "heavy_top_gl3_gamma.c") <= 750
    assert max(map(lines, files)) <= 900


def test_the_engine_has_few_headers_none_of_them_long():
    """A test of the engine checks that each compiles alone."""
    assert 40 <= len(HEADERS) <= 110
    assert max(map(lines, HEADERS)) <= 600


def test_the_root_has_few_files():
    if not (ROOT / ".git").exists():
        pytest.skip("this is no git checkout")
    tracked = call(["git", "ls-files", "-z"], cwd=ROOT).stdout.split("\0")
    files = {name for name in tracked if name and "/" not in name and not name.startswith(".")}
    assert files >= TOOLING
    assert len(files - TOOLING) <= 8, sorted(files - TOOLING)
