"""Compiled kernels agree with their statements, unless a compiler emits wrong code."""

from __future__ import annotations

import dataclasses
import json
import re
import shlex
import shutil
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from gyrospark import api
from gyrospark.commands.verify import spec_of_name
from gyrospark.core.errors import CompilerError, InputWarning
from gyrospark.core.manifest import Manifest
from gyrospark.core.real_types import REALS
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.symbolic.switching_functions import Max
from gyrospark.runtime.compilation import kernel_check, kernel_text, verified_build
from gyrospark.runtime.compilation.compiler import compile_module, find_compiler
from gyrospark.runtime.compilation.stepper_module import load_module


@cache
def files_of(name: str) -> dict[str, str]:
    """Return the files of a stepper of the paper."""
    return api.files_of(spec_of_name(name))


@cache
def curved() -> gs.System:
    """Return a system of roots, powers, cardinal functions, two sides, time and forces."""
    q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    k, a = sp.symbols("k a", positive=True)
    t = sp.Symbol("t", real=True)
    H = ((p[0]**2 + p[1]**2) / 2 + k * sp.sqrt(1 + q[0]**2) + sp.exp(-q[1]**2) + sp.cosh(a * q[0])
         + Max(q[0], 0)**2 + sp.atan(q[1]) + sp.asinh(q[0] * a) + q[1] * sp.sin(t))
    drag = [-k * x * sp.sqrt(p[0]**2 + p[1]**2) for x in p]
    return gs.System(q, p, (k, a), H, forces=drag, time=t, name="curved",
                     quantities={"reach": sp.sqrt(q[0]**2 + q[1]**2)})


SPECS = {
    "G-L": lambda: generate(Spec.from_arguments("G-L", 3)),
    "EMS": lambda: generate(Spec.from_arguments("EMS")),
    "curved EMS": lambda: generate(Spec.from_arguments("EMS"), system=curved()),
    "curved": lambda: generate(Spec.from_arguments("LIIIA-B", 2), system=curved()),
    "forms": lambda: generate(Spec.from_arguments("G-L", 2, system="double_pendulum")),
    "float": lambda: generate(Spec.from_arguments("IMS", real="float")),
    "long-double": lambda: generate(Spec.from_arguments("G-L", 1, real="long-double")),
}


@cache
def source_of(name: str):
    """Return the derived source of a stepper."""
    return SPECS[name]().source


CATALOGUE = {"frame": ("heavy_top_in_frame",), "float128": ("heavy_top", "G-L", 2, "float128")}


@pytest.mark.parametrize("name", [*CATALOGUE, *(
    pytest.param(name, marks=[pytest.mark.slow] * (name != "curved EMS"))
    for name in SPECS)])  # each is a derivation
def test_every_kernel_is_read(name):
    """Every kernel whose operations the manifest counts is read, as is the one of constants."""
    if name in CATALOGUE:
        step = systems.stepper(*CATALOGUE[name])
        manifest, text = step.manifest, step.files[f"{step.name}.c"]
    else:
        source = source_of(name)
        manifest, text = Manifest.from_text(source.manifest), source.source
    read = {kernel.name for kernel in kernel_text.kernels_of(text)}
    counted = {*manifest.operations, *manifest.fast_path.operations}
    assert read >= counted
    assert "prepare" in read
    on_lanes = set(re.findall(r"\b(lanes_(?:\w+_)?(?:energy|gradient|velocity|force))\(const",
                              text))
    assert read >= {k for k in on_lanes if f"{k}(const lanes_constants *c, const lanes q[N]"
                    not in text}


@cache
def compiled(name: str, folder):
    """Return the module of a stepper with the check functions of each of its objects."""
    source = source_of(name)
    path, checks = compile_module(source.name, source.files(), find_compiler(), folder)
    real = REALS[json.loads(source.manifest)["real"]]
    return verified_build.import_module(source.name, path), checks, real


@pytest.fixture(scope="module", params=[
    "curved EMS", pytest.param("long-double", marks=pytest.mark.slow)])  # seconds of arithmetic
def module(request, tmp_path_factory):
    return compiled(request.param, tmp_path_factory.mktemp("build"))


def test_compiled_kernels_agree(module):
    mismatches, compared, unchecked = kernel_check.differences(*module)
    assert not mismatches
    assert not unchecked
    assert len(compared) >= 8
    assert all(compared.values())


def test_variables_have_both_signs_and_constants_one(module, monkeypatch):
    drawn, evaluate = {}, kernel_check.evaluate

    def evaluated(kernel, by, values):
        for name, numbers in values.items():
            if not isinstance(numbers, kernel_text.Bounded):
                drawn.setdefault("->" in name, []).append(np.asarray(numbers, float))
        return evaluate(kernel, by, values)

    monkeypatch.setattr(kernel_check, "evaluate", evaluated)
    assert not kernel_check.differences(*module)[0]
    assert np.min(drawn[True]) >= 0.25
    assert np.min(drawn[False]) < -0.9


def damaged(kernel: kernel_text.KernelText):
    """Yield each output, and the kernel with its statement changed by a hundred-millionth."""
    for output in kernel_check.outputs_of(kernel):
        assigned = rf"(?<![\w.>])(?:c->)?{re.escape(output)} =" if output else "return"
        text = re.sub(rf"({assigned}) ([^;]+);", r"\1 1.00000001*(\2) + 1.0e-8;", kernel.body,
                      count=1)
        if text != kernel.body:
            yield output, dataclasses.replace(kernel, body=text)


def test_each_wrong_output_is_found(module):
    """A wrong output is a mismatch of its kernel alone, at its place."""
    loaded, checks, real = module
    for function in checks:
        for number, kernel in enumerate(function.kernels):
            wrong_ones = list(damaged(kernel))
            assert wrong_ones, kernel.name
            for output, wrong in wrong_ones:
                kernels = (*function.kernels[:number], wrong, *function.kernels[number + 1 :])
                mismatches, *_ = kernel_check.differences(
                    loaded, [dataclasses.replace(function, kernels=kernels)], real)
                assert [(d.kernel, d.place) for d in mismatches] == [(kernel.name, output)]


def wrong_compiler(folder, pattern: str, right_with: str) -> str:
    """Return a compiler that errs in a kernel, unless a flag is given."""
    path, right = folder / "wrong-cc", shlex.join(find_compiler().command)
    path.write_text(f"""#!/bin/sh
for argument in "$@"; do
    [ "$argument" = "{right_with}" ] && exec {right} "$@"
done
for argument in "$@"; do
    case "$argument" in *heavy_top*.c) [ -f "$argument" ] && sed -i '{pattern}' "$argument" ;; esac
done
exec {right} "$@"
""", encoding="utf-8")
    path.chmod(0o755)
    return str(path)


@pytest.mark.skipif(shutil.which("sed") is None, reason="the wrong compiler needs sed")
@pytest.mark.parametrize(("module_kind", "pattern", "kernel"), [
    pytest.param("runs", r"s/^    H_q\[1\] = /&1.0e-9 + /", "gradient", marks=pytest.mark.slow),
    pytest.param("lanes", r"s/^    H_p\[2\] = /&-/", "lanes_velocity", marks=pytest.mark.slow),
])  # three compilations with optimisation each
def test_a_wrong_object_is_compiled_again(module_kind, pattern, kernel, tmp_path, monkeypatch):
    """Flags with which kernels agree are recorded; the warning comes once."""
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("CC", wrong_compiler(tmp_path, pattern, "-O1"))
    monkeypatch.setattr(verified_build, "SAFER_FLAGS", ((), ("-O1",), ("-O0",)))
    files = files_of("heavy_top_gl1_gamma")
    with pytest.warns(InputWarning, match=kernel):
        load_module("heavy_top_gl1_gamma", files, module_kind)
    (record,) = (tmp_path / "cache").glob("*.so.json")
    recorded = json.loads(record.read_text("utf-8"))
    assert recorded["flags"] == ["-O1"]
    assert recorded["left_out"] == {}
    load_module("heavy_top_gl1_gamma", files, module_kind)


@pytest.mark.skipif(shutil.which("sed") is None, reason="the wrong compiler needs sed")
def test_an_object_that_never_agrees_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "0")
    monkeypatch.setattr(verified_build, "SAFER_FLAGS", ((), ("-O0",)))
    monkeypatch.setenv("CC", wrong_compiler(tmp_path, r"s/^    G\[0\]\[0\] = /&1.0e-9 + /", "none"))
    with pytest.raises(CompilerError, match="constraint_jacobian"):
        load_module("heavy_top_ims_gamma", files_of("heavy_top_ims_gamma"))
    assert not list((tmp_path / "cache").glob("*.so"))


@pytest.mark.parametrize(("text", "value"), [
    ("a + b*c - -d", lambda a, b, c, d: a + b * c - -d),
    ("-(a - b)/c", lambda a, b, c, d: -(a - b) / c),
    ("a*b/c*d", lambda a, b, c, d: a * b / c * d),
    ("a - (b - c)", lambda a, b, c, d: a - (b - c)),
    ("pow(a, -2.0)*sqrt(b)", lambda a, b, c, d: np.power(a, -2.0) * np.sqrt(b)),
    ("1.0/3.0*a", lambda a, b, c, d: 1.0 / 3.0 * a),
    ("-a*-b", lambda a, b, c, d: -a * -b),
    ("lanes_atan2(c->_used, c, d)", lambda a, b, c, d: np.arctan2(c, d)),
])
def test_expressions_are_those_of_python(text, value):
    """C and Python read expressions alike: precedence, left to right, signs."""
    kernel = kernel_text.KernelText("x", "void", "constants", dict.fromkeys("abcd", ()),
                                    {"y": ()}, (), f"y = {text};\n")
    values = {name: np.array([x]) for name, x in zip("abcd", (0.7, 1.3, 0.45, 2.9), strict=True)}
    by = kernel_text.arithmetic(REALS["double"], wide=False)
    assert kernel_text.evaluate(kernel, by, values)["y"] == value(*values.values())


@pytest.mark.parametrize(("literal", "value"), [
    ("0x1.8p+1", 3.0), ("0X.8P-1f", 0.25), ("0xAp0", 10.0), (".5", 0.5), ("2.5E-1L", 0.25)])
def test_literals_of_every_spelling_are_read(literal, value):
    kernel = kernel_text.KernelText("x", "void", "constants", {}, {"y": ()}, (), f"y = {literal};")
    for real in ("float", "double", "long-double", "float128"):
        for wide in (False, True):
            by = kernel_text.arithmetic(REALS[real], wide=wide)
            assert kernel_text.evaluate(kernel, by, {})["y"] == value


def test_unused_arguments_are_read():
    (kernel,) = kernel_text.kernels_of(
        "static void even(const constants *c, const double a[1], double y[1])\n"
        "{\n    (void)c, (void)a;\n    y[0] = 1.0;\n}\n")
    assert not kernel.refusal


def test_a_hexadecimal_literal_has_the_digits_of_its_type():
    by = kernel_text.arithmetic(REALS["float128"], wide=False)
    assert by.number("0x1.0000000000000000000000000001p0") - 1 == 2.0**-112


@pytest.mark.parametrize("body", ["for (;;) x = 1;\n", "y[0] = a[0] ? 1.0 : 2.0;\n",
                                  "y[0] = f(a[0]);\n", "if (a) y[0] = 1.0;\n", "y[0] = (a;\n"])
def test_a_kernel_that_is_not_read_is_named_with_its_c(body):
    text = ("static void odd(const constants *c, const double a[1], double y[1])\n"
            f"{{\n    {body}}}\n")
    (kernel,) = kernel_text.kernels_of(text)
    assert kernel.refusal
    (function,) = kernel_check.check_functions("x", [kernel], ["numbers"])
    assert set(function.unread) == {"odd"}


def test_a_kernel_that_is_not_checked_is_recorded_and_told(tmp_path, monkeypatch):
    """Record and warning name kernels that are not read, have no values, or are not in the text."""
    monkeypatch.setenv("GYROSPARK_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("GYROSPARK_OPTIMISE", "0")
    name, files = "heavy_top_gl1_gamma", dict(files_of("heavy_top_gl1_gamma"))
    text = files[f"{name}.c"]
    gradient = next(k for k in kernel_text.kernels_of(text) if k.name == "gradient").body
    text = text.replace(gradient, f"{gradient}    if (0) H_p[0] = 0;\n", 1)
    text = re.sub(r"(\n    g\[0\] = )", r"\1log(-4.0)*", text, count=1)
    manifest = json.loads(files[f"{name}.json"])
    assert "velocity" not in manifest["operations"]  # it is in the text as lanes_velocity alone
    manifest["operations"] |= {"velocity": {"add": 1}, "absent": {"add": 1}}
    files |= {f"{name}.c": text, f"{name}.json": json.dumps(manifest)}
    with pytest.warns(InputWarning, match="not checked") as caught:
        load_module(name, files)
    (record,) = (tmp_path / "cache").glob("*.so.json")
    unchecked = json.loads(record.read_text("utf-8"))["left_out"]
    assert set(unchecked) == {"gradient", "constraint", "absent"}
    assert all(kernel in str(caught[0].message) for kernel in unchecked)
