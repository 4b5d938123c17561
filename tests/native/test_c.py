"""The generated C by itself: warnings, symbols, C++, a program without Python, vectors."""

import platform
import re
import shutil

import numpy as np
import pytest

import gyrospark as gs
from c_programs import STRICT, run, write
from compilers import COMPILERS, COMPILERS_OF_CPLUSPLUS, MAIN, OTHER, compiler, zig
from gyrospark.api import files_of
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import PAPER_SPECS, Spec
from processes import ROOT
from systems import case

SOME = [Spec("G-L", 3), Spec("EMS", None, "alpha")]
#: Of each family and type one is quick.
OTHER_TYPES = [Spec(scheme, stages, rep, real=real) for real in ("float", "long-double")
               for scheme, stages, rep in (("EMS", None, "gamma"), ("G-L", 3, "alpha"),
                                           ("LIIIA-B", 3, "gamma"))]


def name_of(spec):
    return spec.name


@pytest.mark.parametrize("name", ["gcc", "clang", "zig"])
@pytest.mark.parametrize("spec", [*SOME, Spec("IMS"), Spec("LIIIA-B", 2, "alpha"),
                                  Spec("EMS", real="float"),
                                  Spec("LIIIA-B", 3, real="long-double"),
                                  Spec("splitting", order=4)], ids=name_of)
def test_no_warning(name, spec, tmp_path):
    """PyPI's compiler has no warning, either, also not of shadowed names and prototypes."""
    command = zig() if name == "zig" else compiler(name)
    write(files_of(spec), tmp_path)
    further_warnings = ["-Wmissing-prototypes", "-Wstrict-prototypes", "-Wundef", "-Wvla",
                        "-Wcast-qual"]
    # -fsyntax-only is faster, and does not see functions that nothing calls
    is_compiled = name == "zig" or spec.scheme == "splitting"
    only = ["-c", "-o", "kernel.o"] if is_compiled else ["-fsyntax-only"]
    for std in ("c11", "c17") if spec == SOME[0] else ("c11",):
        run([*command, *STRICT, *further_warnings, f"-std={std}", *only, f"{spec.name}.c"],
            tmp_path)


@pytest.mark.slow  # two to four seconds each
@pytest.mark.parametrize("spec", [*PAPER_SPECS, *OTHER_TYPES, Spec("G-L", 8)], ids=name_of)
def test_no_warning_from_the_optimiser(spec, tmp_path):
    """gcc reports values that may not be set; most other tests compile with -O0."""
    write(files_of(spec), tmp_path)
    run([*compiler("gcc"), *STRICT, "-O2", "-c", f"{spec.name}.c", "-o", "kernel.o"], tmp_path)


@pytest.mark.slow  # derives and compiles the derivatives of two steppers, two seconds each
@pytest.mark.parametrize("spec", [Spec("EMS"), Spec("IMS", system="double_pendulum")],
                         ids=lambda spec: spec.name)
def test_derivatives_have_no_function_that_nothing_calls(spec, tmp_path):
    """Both ways to linearise a step: on lanes, and by element templates."""
    source = generate(spec, derivatives=True).source
    write(source.files(), tmp_path)
    run([*compiler("gcc"), *STRICT, "-O0", "-c", f"{source.name}.c", "-o", "kernel.o"], tmp_path)


@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_no_warning_from_the_optimiser_with_forces_and_the_widest_vectors(name, tmp_path):
    """The compiler checks AVX-512 even on a machine without it."""
    if platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("AVX-512 is a thing of x86-64")
    command = compiler(name)
    source = generate(Spec("EMS"), system=case("dragged_pendulum").system).source
    write(source.files(), tmp_path)
    run([*command, *STRICT, "-O1", "-mavx512f", "-mfma", "-c", f"{source.name}.c", "-o",
         "kernel.o"], tmp_path)
    assert run(["objdump", "-d", "kernel.o"], tmp_path).count("zmm") > 100


@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.parametrize("spec", [
    pytest.param(Spec("LIIIA-B", 2, "alpha"), marks=pytest.mark.slow), Spec("EMS")], ids=name_of)
def test_symbols_are_the_documented_functions(name, spec, tmp_path):
    """Nothing else is exported, and there is no writable data: re-entrant by construction.

    The needed symbols belong to the maths library.
    """
    command = compiler(name)
    files = files_of(spec)
    write(files, tmp_path)
    run([*command, "-std=c11", "-O0", "-fPIC", "-c", f"{spec.name}.c", "-o", "kernel.o"], tmp_path)
    lines = [line.split() for line in run(["nm", "kernel.o"], tmp_path).splitlines()]
    exported = {words[-1] for words in lines if words[-2] in "TDBRCVWG"}
    header = re.sub(r"/\*.*?\*/", "", files[f"{spec.name}.h"], flags=re.DOTALL)
    assert exported == set(re.findall(rf"\b({spec.name}_\w+)\(", header))
    assert {words[-2] for words in lines} <= set("TtrUu"), lines
    functions = {"step", "integrate", "T1", "T2", "guess", "residual", "jacobian",
                 "increment_size", "last_increment", "satisfies_constraints", "hamiltonian",
                 "defects", "is_consistent", "project", "lanes", "integrate_lanes",
                 "integrate_many", "work_size", "begin", "advance", "set_parameters", "report_of",
                 "near", "is_valid"}
    if spec.stages:
        functions |= {"coefficients"}
    assert exported == {f"{spec.name}_{function}" for function in functions}
    assert {words[-1] for words in lines if words[-2] == "U"} <= {
        "fma", "frexp", "ldexp", "pow", "sqrt", "memset", "memcpy", "memmove",
        "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}


@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.parametrize(("ending", "among", "flags"), [
    ("c", COMPILERS, STRICT),
    ("cpp", COMPILERS_OF_CPLUSPLUS, ["-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror"])])
def test_many_steppers_in_one_program(ending, among, flags, name, tmp_path):
    """Headers of several kinds, each included twice, do not clash in C and C++."""
    text = ""
    for spec in (Spec("EMS"), Spec("G-L", 2), Spec("IMS"), Spec("IMS", real="long-double")):
        write(files_of(spec), tmp_path)
        text += f'#include "{spec.name}.h"\n' * 2
    text += f"""int main(void) {{
        {spec.name}_options o = {{ 0, 50, 0 }};
        return o.max_iterations - 50;
    }}\n"""
    (tmp_path / f"all.{ending}").write_text(text, encoding="ascii")
    run([*compiler(name, among), *flags, "-fsyntax-only", f"all.{ending}"], tmp_path)


def test_plain_c_example_agrees_with_python(tmp_path):
    """The three commands of docs/c.md, with nothing but ``cc``, end where Python ends."""
    if shutil.which("cc") is None:
        pytest.skip("cc is not installed")
    spec = Spec("G-L", 3)
    shutil.copy(ROOT / "examples" / "plain_c" / "main.c", tmp_path)
    write(files_of(spec), tmp_path)
    page = (ROOT / "docs" / "c.md").read_text(encoding="utf-8")
    command = re.search(r"^cd plain_c && (cc .*) && \./top$", page, re.MULTILINE)
    assert command
    run([*command[1].split(), "-O0"], tmp_path)  # compiled in a third of the time
    lines = run([tmp_path / "top"], tmp_path).splitlines()
    assert lines[0] == "status 0 after 2000 steps"
    top = gs.problems.fast_top()
    trajectory = gs.stepper("G-L", 3, "gamma").integrate(
        top.q0, top.p0, dt=1e-3, steps=2000,
        parameters=top.parameters | {"gamma": gs.gamma(top.inertia)})
    q = np.array(lines[1].removeprefix("q = ").split(), dtype=float)
    assert abs(q - trajectory.q[-1]).max() < 1e-11
    numbers = [float(x) for x in re.findall(r"[0-9.]+e[+-][0-9]+", lines[2])]
    assert numbers[0] < 1e-12
    assert max(numbers[1:]) < 1e-14


@pytest.mark.slow  # -O3 takes some seconds; lanes of any width compare contraction at -O1
@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_optimisation_and_contraction_do_not_change_the_answer(name, tmp_path):
    """Runs without optimisation and FMA, and with both, differ by round-off over 2000 steps."""
    command = compiler(name)
    spec = Spec("G-L", 3)
    shutil.copy(ROOT / "examples" / "plain_c" / "main.c", tmp_path)
    write(files_of(spec), tmp_path)
    ends = []
    for flags in (["-O0", "-ffp-contract=off"], ["-O3", "-march=native", "-ffp-contract=fast"]):
        run([*command, "-std=c11", *flags, "main.c", f"{spec.name}.c", "-lm", "-o", "top"],
            tmp_path)
        line = run([tmp_path / "top"], tmp_path).splitlines()[1]
        ends.append(np.array(line.removeprefix("q = ").split(), dtype=float))
    assert abs(np.array(ends) - ends[0]).max() < 1e-11


WIDTHS = """\
#include <stdio.h>
#include <stdlib.h>
#include "NAME.h"

enum { TOPS = 5, STEPS = 120 };

int main(void)
{
    const double I1 = 0.002, I3 = 0.0008, spin = 125.66370614359172;
    const NAME_options options = { .tolerance = 0, .max_iterations = 50 };
    NAME_work *work = malloc(NAME_work_size());
    static NAME_batch batch;
    printf("%d\\n", NAME_lanes());
    for (int from = 0; from < TOPS; from += NAME_lanes()) {
        const int rest = TOPS - from, count = rest < NAME_lanes() ? rest : NAME_lanes();
        NAME_parameters tops[TOPS];
        NAME_report reports[TOPS] = { { 0 } };
        double q[4*TOPS], p[4*TOPS], dt[TOPS];
        int status[TOPS] = { 0 };
        for (int i = 0; i < count; ++i) {
            const double faster = 1 + 0.03*(from + i);
            tops[i] = (NAME_parameters){ .I1 = I1, .I2 = I1, .I3 = I3, .mgl = 9.81*0.04,
                                         .gamma = (2*I1 + I3)/3 };
            q[4*i] = 0.9659258262890683;
            q[4*i + 1] = 0.25881904510252074;
            q[4*i + 2] = q[4*i + 3] = p[4*i] = p[4*i + 1] = 0;
            p[4*i + 2] = -2*q[4*i + 1]*I3*spin*faster;
            p[4*i + 3] = 2*q[4*i]*I3*spin*faster;
            dt[i] = 2e-3;
        }
        NAME_integrate_lanes(count, tops, &options, dt, STEPS, STEPS, 0, q, p, NULL, NULL, NULL,
                             NULL, reports, status, &batch, work);
        for (int i = 0; i < count; ++i)
            printf("%d %.17g %.17g %.17g %.17g\\n", status[i], q[4*i], q[4*i + 1], q[4*i + 2],
                   q[4*i + 3]);
    }
    free(work);
    return 0;
}
"""


@pytest.mark.parametrize(("spec", "name"), [
    (Spec("EMS"), MAIN),
    *(pytest.param(*pair, marks=pytest.mark.slow)  # three compilations each
      for pair in ((Spec("EMS"), OTHER), (Spec("G-L", 3), MAIN), (Spec("G-L", 8), OTHER))),
], ids=lambda x: getattr(x, "name", x))
def test_lanes_of_any_width_give_the_same(name, spec, tmp_path):
    """Plain numbers and the machine's widest vectors have the same tops to round-off.

    With contraction off the width alone differs, and lanes do not share arithmetic: same bits.
    """
    command = compiler(name)
    write({**files_of(spec), "main.c": WIDTHS.replace("NAME", spec.name)}, tmp_path)
    native = "-march=native" if platform.machine() in ("x86_64", "AMD64") else "-mcpu=native"
    tops = {}
    builds = {"plain": ["-DGYROSPARK_PLAIN"], "native": [native],
              "fused": [native, "-O1", "-ffp-contract=fast"]}
    if (spec, name) == (Spec("EMS"), MAIN):  # two seconds to compile; the slow ones have it
        del builds["fused"]
    for label, flags in builds.items():
        run([*command, "-std=c11", "-O0", "-ffp-contract=off", *flags, "main.c", f"{spec.name}.c",
             "-lm", "-o", label], tmp_path)
        lanes, *rows = run([tmp_path / label], tmp_path).splitlines()
        tops[label] = (int(lanes), np.array([[float(x) for x in row.split()] for row in rows]))
    assert tops["plain"][0] == 1 <= tops["native"][0]
    for label, (_, rows) in tops.items():
        assert rows.shape == (5, 5)
        assert not rows[:, 0].any()
        assert np.abs(rows - tops["plain"][1]).max() <= (0 if label != "fused" else 1e-13)
