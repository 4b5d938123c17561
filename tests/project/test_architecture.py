"""ARCHITECTURE.md against the files: what each package holds, and which imports which."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest

import systems
from package_graph import API, OUTER, imports, packages, reachable, reduced, statements
from processes import FAST_TOP, ROOT, python

ARCHITECTURE = ROOT / "ARCHITECTURE.md"
HALLS = ("certificates", "commands", "core", "generator", "runtime", "storage", "sweeps",
         "targets")
#: Where code of the package lies; studies, examples and tests are no part of it.
SOURCES = sorted([*(p for p in ROOT.glob("*.py") if p.name != "setup.py"),
                  *(p for hall in HALLS for p in (ROOT / hall).rglob("*.py"))])
HEAVY = ("sympy", "matplotlib", "scipy", "rich", "jinja2", "mpmath", "zarr", "xarray", "dask",
         "filelock")
#: Packages of modules for one table of the paper each, which their index lists.
UNLISTED = {"studies"}


def graph() -> dict[str, set[str]]:
    """Return which package imports from which."""
    return {name: set(targets) for name, targets in imports().items()}


def test_no_circle():
    """Packages import downwards."""
    below = {name: reachable(graph(), name) for name in graph()}
    circles = {name: sorted(imports()[name]) for name, reached in below.items() if name in reached}
    assert not circles


def test_packages_list_their_modules():
    """Each module has a line in its package's docstring."""
    for name in set(packages()) - UNLISTED - {API}:
        words = set(re.findall(r"\w+", (ROOT / name / "__init__.py").read_text(encoding="utf-8")))
        assert {path.stem for path in packages()[name]} <= words, name


@pytest.mark.parametrize("outer", OUTER)
def test_a_package_lists_its_packages_from_below(outer):
    """Each package imports only from packages that are listed above it."""
    text = (ROOT / outer / "__init__.py").read_text(encoding="utf-8")
    listed = re.findall(r"^    (\w+)/ ", text, flags=re.MULTILINE)
    inner = {name for name in packages() if name.startswith(f"{outer}/")}
    assert {f"{outer}/{name}" for name in listed} == inner
    for index, name in enumerate(listed):
        above = {f"{outer}/{earlier}" for earlier in listed[:index]}
        assert graph()[f"{outer}/{name}"] & inner <= above, name


def picture() -> str:
    """Return the packages and the fewest arrows that show all imports, as Mermaid."""
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
    lines += [f"  {key(name)} --> {key(target)}"
              for name, targets in sorted(reduced(graph()).items()) for target in targets]
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
    """The module of the step has the function; the text is short enough to be read at once."""
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
    """Files and folders in the text exist, except files that a run creates."""
    text = ARCHITECTURE.read_text(encoding="utf-8")
    for name in re.findall(r"`([\w./]+/|[\w/]+\.(?:py|jinja|toml|md|h|c))`", text):
        assert (ROOT / name).exists(), name


@cache
def imports_of(path: Path) -> set[str]:
    """Return the modules a file imports, relative ones resolved to ``gyrospark...``."""
    package = ["gyrospark", *path.relative_to(ROOT).parent.parts]
    modules = set()
    for node in statements(path):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base_module = ".".join([*base, *([node.module] if node.module else [])])
            modules |= {base_module} | {f"{base_module}.{alias.name}" for alias in node.names}
    return modules


def test_dependencies_are_those_imported():
    """Each imported package is declared, as a dependency or as an extra.

    mpl_toolkits are a part of matplotlib, cuda is the namespace of cuda-core and cuda-bindings.
    """
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = [*project["dependencies"],
                *(d for extra in project["optional-dependencies"].values() for d in extra)]
    names = {re.split(r"[>=\[<]", line)[0].lower().replace("-", "_") for line in declared}
    foreign = {name.partition(".")[0] for path in SOURCES for name in imports_of(path)} - {
        *sys.stdlib_module_names, "gyrospark", "mpl_toolkits", "cuda"}
    assert {"numpy", "sympy", "zarr"} <= foreign <= names


def loaded(code: str, **changes: str | None) -> set[str]:
    """Return which heavy packages Python has imported after some code."""
    text = python(f"{code}\nimport sys\nprint([m for m in {HEAVY} if m in sys.modules])", **changes)
    return set(ast.literal_eval(text.splitlines()[-1]))


def test_import_is_light():
    """The commands and the names of steppers import no heavy package, either."""
    assert loaded("import gyrospark.generator.spec\nfrom gyrospark import commands") == set()


def test_steppers_that_are_there_import_no_sympy(gyrospark):
    """Steppers are checked in or generated by an earlier process; commands run them, and models."""
    systems.stepper("heavy_top", real="float")
    choice = ["--scheme", "G-L", "--stages", "2", "--steps", "3"]
    runs = [["gyrospark", "run", model, *choice] for model in (
        "double-top", str(ROOT / "examples" / "pendulum.toml"))]
    for run in runs:
        gyrospark(*run[1:])
    runs.append(["gyrospark", "run", "fast-top", *choice, "--dt", "1e-3", "--json"])
    code = FAST_TOP + (
        "for scheme in (('G-L', 3), ('EMS',)):\n    gs.stepper(*scheme).integrate("
        "top.q0, top.p0, dt=1e-3, steps=3, parameters=parameters)\n"
        "gs.stepper('G-L', 2, real='float')\n"
        "import sys\nfrom gyrospark.commands import main\n"
        f"for sys.argv in {runs}:\n    try:\n        main()\n"
        "    except SystemExit as end:\n        assert end.code == 0")
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
    """No file's content can become code: functions that could do so are not even called."""
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
