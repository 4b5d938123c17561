"""Packaging, imports, public names, README and pages."""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import pkgutil
import re
import shutil
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import click
import pytest

import documents
import gyrospark
import systems
from gyrospark.commands import gyrospark as command_line
from gyrospark.commands.generate import generate
from gyrospark.core.extras import install, packages_of
from package_graph import statements
from processes import FAST_TOP, ROOT, call, cli, python

HALLS = ("certificates", "commands", "core", "generator", "runtime", "storage", "sweeps",
         "targets")
#: Where code of the package lies; studies, examples and tests are no part of it.
FACE = [p for p in ROOT.glob("*.py") if p.name != "setup.py"]
SOURCES = sorted([*FACE, *(p for hall in HALLS for p in (ROOT / hall).rglob("*.py"))])
README = (ROOT / "README.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
HEAVY = ("sympy", "matplotlib", "scipy", "rich", "jinja2", "mpmath", "zarr", "xarray", "dask",
         "filelock")


@functools.cache
def imports_of(path: Path) -> set[str]:
    """Return the modules a file imports, relative ones resolved to ``gyrospark...``."""
    package = ["gyrospark", *path.relative_to(ROOT).parent.parts]
    found = set()
    for node in statements(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            whole = ".".join([*base, *([node.module] if node.module else [])])
            found |= {whole} | {f"{whole}.{alias.name}" for alias in node.names}
    return found


# ---------------------------------------------------------------- packaging


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
    listed = call(["git", "ls-files", "-z", "."], cwd=folder).stdout.split("\0")
    return [folder / name for name in listed if name and "/" not in name]


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
    """What somebody tried out at the root does not stay there."""
    if shutil.which("git") is None or not (ROOT / ".git").exists():
        pytest.skip("this is no git checkout")
    listed = call(["git", "ls-files", "-z"], cwd=ROOT).stdout.split("\0")
    present = [Path(name) for name in listed if name and (ROOT / name).exists()]
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


def test_dependencies_are_those_imported():
    """What the package imports is declared, as a dependency or as an extra.

    mpl_toolkits are a part of matplotlib, cuda is the namespace of cuda-core and cuda-bindings.
    """
    declared = [*PROJECT["project"]["dependencies"],
                *(d for e in PROJECT["project"]["optional-dependencies"].values() for d in e)]
    names = {re.split(r"[>=\[<]", line)[0].lower().replace("-", "_") for line in declared}
    lines = re.compile(r"^ *(?:from (\w+)[\w.]* import .*"
                       r"|import (\w+)[\w.]*(?: as \w+)?(?: +#.*)?)$", re.MULTILINE)
    imported = {name for path in SOURCES
                for pair in lines.findall(path.read_text(encoding="utf-8")) for name in pair}
    foreign = imported - set(sys.stdlib_module_names) - {"gyrospark", "", "mpl_toolkits", "cuda"}
    assert {"numpy", "sympy", "zarr"} <= foreign <= names


# ---------------------------------------------------------------- who imports whom


def loaded(code: str, **changes: str | None) -> set[str]:
    """Return which heavy packages Python has imported after some code."""
    text = python(f"{code}\nimport sys\nprint([m for m in {HEAVY} if m in sys.modules])", **changes)
    return set(ast.literal_eval(text.splitlines()[-1]))


def test_import_is_light():
    """Nor do the commands and the names of steppers need what is heavy."""
    assert loaded("import gyrospark.generator.spec\nfrom gyrospark import commands") == set()


def test_steppers_that_are_there_import_no_sympy():
    """Those checked in, one that an earlier process has generated, and the command that runs."""
    systems.stepper("heavy_top", real="float")
    arguments = ["run", "fast-top", "--scheme", "G-L", "--stages", "2", "--dt", "1e-3",
                 "--steps", "3", "--json"]
    code = FAST_TOP + (
        "for scheme in (('G-L', 3), ('EMS',)):\n    gs.stepper(*scheme).integrate("
        "top.q0, top.p0, dt=1e-3, steps=3, parameters=parameters)\n"
        "gs.stepper('G-L', 2, real='float')\n"
        f"import sys\nsys.argv = ['gyrospark', *{arguments}]\n"
        "from gyrospark.commands import main\n"
        "try:\n    main()\nexcept SystemExit as end:\n    assert end.code == 0")
    assert loaded(code) == set()


def test_runtime_and_generator_do_not_know_each_other():
    for path in (ROOT / "runtime").rglob("*.py"):
        for name in imports_of(path):
            assert not name.startswith(("gyrospark.generator", "gyrospark.api", "sympy",
                                        "jinja2", "gyrospark.commands")), (path, name)
    for path in (ROOT / "generator").rglob("*.py"):
        for name in imports_of(path):
            assert not name.startswith(("gyrospark.runtime", "gyrospark.api", "cffi",
                                        "gyrospark.commands", "subprocess")), (path, name)


#: Names that make code of text.
EVALUATE = {"eval", "exec", "compile", "__import__", "sympify", "S", "parse_expr", "lambdify",
            "system", "popen"}
SUSPECT = re.compile(rf"\b({'|'.join(EVALUATE)})\s*\(|\b(shell|allow_pickle)\s*=")


def test_imports_are_relative_and_nothing_evaluates_text():
    """No file's content can become code: the names that would do it are not even called."""
    for path in SOURCES:
        allowed = {("re", "compile"), ("module", "compile"), ("cuda_program", "compile"),
                   ("spec", "compile")}  # of C and MJCF
        if path.name == "observed_order.py":
            allowed.add(("sp", "lambdify"))  # of its own test problem, which no file can change
        for node in statements(path):
            if isinstance(node, ast.ImportFrom):
                assert node.level > 0 or not (node.module or "").startswith("gyrospark"), path
            if isinstance(node, ast.Import):
                assert not any(alias.name.startswith("gyrospark") for alias in node.names), path
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                assert not any("pickle" in alias.name for alias in node.names), path
        text = path.read_text(encoding="utf-8")
        if SUSPECT.search(text):
            for node in ast.walk(ast.parse(text)):
                if isinstance(node, ast.Call):
                    check_call(node, allowed, path)


def check_call(node: ast.Call, allowed: set[tuple[str, str]], path: Path) -> None:
    f = node.func
    owner = f.value.id if isinstance(f, ast.Attribute) and isinstance(f.value, ast.Name) else ""
    name = f.attr if isinstance(f, ast.Attribute) else getattr(f, "id", "")
    literal = bool(node.args) and isinstance(node.args[0], ast.Constant)  # no user's text
    assert name not in EVALUATE or literal or (owner, name) in allowed, (path, node.lineno, name)
    assert not any(k.arg == "shell" for k in node.keywords), (path, node.lineno)
    assert not any(k.arg == "allow_pickle" and getattr(k.value, "value", 1)
                   for k in node.keywords), (path, node.lineno)


# ---------------------------------------------------------------- the public face


def test_public_names_resolve():
    for name in gyrospark.__all__:
        assert getattr(gyrospark, name) is not None
    assert set(dir(gyrospark)) == set(gyrospark.__all__)
    assert len(set(gyrospark.__all__)) == len(gyrospark.__all__)
    with pytest.raises(AttributeError, match="nonsense"):
        _ = gyrospark.nonsense


@pytest.mark.parametrize("package", ["zarr", "xarray", "filelock"])
@pytest.mark.slow  # a process each
def test_names_of_an_extra_that_is_not_installed_say_so_when_they_are_called(package):
    """To look at them, and to import all, is no error; their command ends in the same sentence."""
    said = python(
        f"import sys\nsys.modules[{package!r}] = None\n"
        "import inspect, gyrospark as gs\nfrom gyrospark import *\n"
        "assert len(inspect.getmembers(gs)) >= len(gs.__all__)\n"
        "for name, arguments in (('resume', ('x',)), ('load', ('x.zarr',)),\n"
        "                        ('load_sweep', ('x',)), ('sweep', ('x', {}))):\n"
        "    try:\n        getattr(gs, name)(*arguments)\n"
        "    except gs.errors.MissingDependencyError as error:\n        print(error)\n"
        "for name, word in (('resume', 'store'), ('sweep', 'over')):\n"
        "    assert word in inspect.getdoc(getattr(gs, name)), name\n"
        "from gyrospark import commands\n"
        "sys.argv, sys.stderr = ['gyrospark', 'export', 'a.zarr', 'a.csv'], sys.stdout\n"
        "try:\n    commands.main()\nexcept SystemExit as end:\n    assert end.code == 2")
    lines = said.splitlines()
    assert len(lines) == 5
    assert all(package in line and install("storage") in line for line in lines)
    assert lines == lines[:1] * 4 + [f"gyrospark: {lines[0]}"]


def test_hints_name_the_packages_of_an_extra(monkeypatch):
    """Those of pyproject.toml in a checkout, and the same ones where it is installed."""
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
        "optional-dependencies"]
    checkout = {extra: packages_of(extra) for extra in extras}
    assert checkout["storage"] == extras["storage"]
    assert checkout["netcdf"] == [*extras["storage"], *extras["netcdf"][1:]]
    assert all("gyrospark" not in one for found in checkout.values() for one in found)
    assert "ziglang" in checkout["compiler"][0]  # which the message on compilers says
    monkeypatch.setattr(Path, "is_file", lambda self: False)
    listed = [f'{one}{" and" if ";" in one else ";"} extra == "{extra}"'
              for extra, found in extras.items() for one in found]
    monkeypatch.setattr("importlib.metadata.requires", lambda name: listed)
    assert {extra: packages_of(extra) for extra in extras} == checkout


def modules() -> list[ModuleType]:
    names = [f"gyrospark.{p.stem}" for p in FACE if p.stem not in ("__init__", "__main__")]
    for hall in HALLS:
        package = importlib.import_module(f"gyrospark.{hall}")
        names += [m.name for m in pkgutil.walk_packages(package.__path__, f"gyrospark.{hall}.")]
    return [importlib.import_module(name) for name in names]


def test_public_things_have_docstrings():
    for module in modules():
        assert module.__doc__, module
        for name, thing in vars(module).items():
            if name.startswith("_") or getattr(thing, "__module__", None) != module.__name__:
                continue
            if inspect.isclass(thing) or inspect.isfunction(thing):
                assert inspect.getdoc(thing), f"{module.__name__}.{name}"
            if inspect.isclass(thing):
                for method, function in vars(thing).items():
                    if inspect.isfunction(function) and not method.startswith("_"):
                        assert inspect.getdoc(function), f"{module.__name__}.{name}.{method}"


def test_all_lists_what_is_there():
    for module in modules():
        for name in getattr(module, "__all__", ()):
            assert hasattr(module, name), f"{module.__name__}.{name}"


# ---------------------------------------------------------------- README and pages


def commands_of(text: str) -> list[list[str]]:
    """Return the gyrospark command lines in a text, continuation lines joined."""
    lines = re.sub(r"\\\n\s*", " ", text).splitlines()
    found = [line.strip("`$ ").split() for line in lines]
    return [words for words in found if words and words[0] in ("generate", "gyrospark")]


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
    """Check that a command and every option it is given exist."""
    command: click.Command = generate if words[0] == "generate" else command_line
    rest = words[1:]
    while isinstance(command, click.Group) and rest and not rest[0].startswith("-"):
        context = click.Context(command)
        assert rest[0] in command.list_commands(context), words
        command, rest = command.get_command(context, rest[0]), rest[1:]
    known = {opt for parameter in command.params for opt in parameter.opts}
    for word in rest:
        assert not word.startswith("--") or word in known, (word, words)


def test_commands_of_the_documents_exist():
    told = told_commands()
    assert len(told) >= 40
    for words in told:
        check_command(words)


def test_examples_in_help_exist():
    for where, text in help_pages():
        lines = commands_of(text)
        assert lines or where == "gyrospark cache", where
        for words in lines:
            check_command(words)


def test_documents_name_what_exists():
    """Targets of make, files and headings that links lead to, extras."""
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
        for named in re.findall(r'pip install "\.\[([\w,]+)\]', text):
            assert set(named.split(",")) <= set(PROJECT["project"]["optional-dependencies"]), path


def test_a_readme_is_read_in_two_minutes():
    assert len(README.splitlines()) <= 150


def test_extras_are_documented():
    extras = PROJECT["project"]["optional-dependencies"]
    told = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    table = re.search(r"^\| extra \|.*?\n\n", told, flags=re.MULTILINE | re.DOTALL)
    assert table
    rows = re.findall(r"^\| `(\w+)` \|.*\| (.*) \|$", table[0], flags=re.MULTILINE)
    assert {name for name, _ in rows} == set(extras) - {"test", "docs", "release"}
    for name, brings in rows:
        for package in brings.split(", "):
            assert re.search(rf"\b{package}\b", " ".join(extras[name])), (name, package)


def test_ci_calls_the_readme_test_command():
    assert "make test" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert "make test" in README


def test_module_is_the_command_line():
    done = cli("--version")
    assert done.returncode == 0
    assert done.stdout.split()[-1] == gyrospark.__version__
    script = shutil.which("gyrospark", path=str(Path(sys.executable).parent))
    if script:  # installed, not only on the path
        assert call([script, "--version"]).stdout == done.stdout
