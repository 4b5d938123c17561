"""Rules for the text of profile ``control``: one dialect, MISRA C:2012, analyzers, stack."""

import re
import shutil
from collections import Counter
from functools import cache

import pytest

from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from processes import ROOT, call

SPECS = [Spec("G-L", 2, real="float"), Spec("EMS"), Spec.from_arguments("splitting", order=4),
         Spec.from_arguments("G-L", 2, None, str(ROOT / "examples/bungee.toml"))]
PAGE = ROOT / "docs" / "controllers.md"
#: Left out, with reasons in the page.
CHECKS = ("clang-analyzer-*,bugprone-*,cert-*,misc-*,-misc-include-cleaner,"
          "-bugprone-easily-swappable-parameters,"
          "-bugprone-implicit-widening-of-multiplication-result")


@cache
def made(spec):
    return generate(spec.with_profile("control")).source


@pytest.fixture(params=SPECS, ids=lambda spec: spec.name)
def written(request, tmp_path):
    """Return name, text and folder of a stepper."""
    source = made(request.param)
    for name, text in source.files().items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    return source.name, source.source, tmp_path


def run(folder, *command):
    """Return the output of a program that finds nothing; skip where it is missing."""
    if shutil.which(command[0]) is None:
        pytest.skip(f"{command[0]} is not installed")
    process = call([*command], cwd=folder)
    assert process.returncode == 0, process.stdout + process.stderr
    return process.stdout + process.stderr


def test_the_text_is_one_dialect(written):
    """C++ has no compound literals and no designated initialisers; no function has a pointer."""
    code = re.sub(r"/\*.*?\*/", "", written[1], flags=re.DOTALL)
    assert not re.search(r"\)\{", code)
    assert not re.search(r"[{,]\s*\.\w+\s*=", code)
    assert not re.search(r"\(\*\w+\)\s*\(|: \w+\)\(", code)
    assert not re.search(r"\b(malloc|goto|setjmp|long|static \w+ \w+ =)\b", code)


def test_it_is_c_plus_plus(written):
    name, _, folder = written
    assert run(folder, "g++", "-x", "c++", "-std=c++17", "-pedantic", "-Wall", "-Wextra", "-Werror",
               "-fsyntax-only", f"{name}.c") == ""


def test_deviations_from_misra_are_those_of_the_page(written):
    """There are at most ten, each by a rule of the table and not more often."""
    name, _, folder = written
    output = run(folder, "cppcheck", "--std=c11", "--enable=style", "--addon=misra",
                 "--suppress=missingIncludeSystem", "--template={line}: {id}", f"{name}.c")
    hits = Counter(re.findall(r"misra-c2012-([\d.]+)", output))
    table = dict(re.findall(r"^\| ([\d.]+) \(advisory\) \| (\d+) \|", PAGE.read_text("utf-8"),
                            re.MULTILINE))
    assert 0 < hits.total() <= 10
    assert hits <= Counter({rule: int(count) for rule, count in table.items()})


def test_analyzers_find_nothing(written):
    name, _, folder = written
    assert "warning" not in run(folder, "clang", "--analyze", "-std=c11", f"{name}.c")
    output = run(folder, "clang-tidy", "--quiet", f"--checks={CHECKS}", f"{name}.c", "--",
                 "-std=c11")
    assert "warning:" not in output


def test_the_stack_of_a_step_is_bounded(tmp_path):
    """The deepest path of calls on a Cortex-M4 is bounded; gcc calls each part static."""
    source = made(SPECS[0])
    for name, text in source.files().items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    run(tmp_path, "arm-none-eabi-gcc", "-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard",
        "-mfpu=fpv4-sp-d16", "-std=c11", "-Os", "-ffp-contract=off", "-fcallgraph-info=su", "-c",
        f"{source.name}.c", "-o", "top.o")
    graph = (tmp_path / "top.ci").read_text(encoding="utf-8")
    bytes_of = {name: int(size) for name, size in re.findall(
        r'node: \{ title: "([^"]+)" label: "[^"]*\\n(\d+) bytes \(static\)', graph)}
    calls = [*re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', graph)]
    outside = {callee for _, callee in calls} - {*bytes_of}
    assert outside <= {"fmaxf", "sqrtf", "memcpy", "memset"}

    def deepest(name, callers=()):
        assert name not in callers, "recursion"
        return bytes_of.get(name, 0) + max(
            (deepest(callee, (*callers, name)) for caller, callee in calls if caller == name),
            default=0)

    assert 0 < deepest(f"{source.name}_advance") <= 512
