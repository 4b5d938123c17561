"""The generated C by itself: warnings, symbols, sanitizers, C++, a program without Python."""

from __future__ import annotations

import platform
import re
import shutil
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from c_programs import STRICT, run, write
from compilers import COMPILERS_OF_CPLUSPLUS, MAIN, OTHER, compiler, zig
from forced_systems import pendulum as forced_pendulum
from gyrospark.api import files_of
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import PAPER_SPECS, Spec
from mechanisms import slider_crank
from processes import ROOT, call
from strategies import usual

SANITIZE = ["-g", "-O0", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]

SOME = [Spec("G-L", 3), Spec("EMS", None, "alpha")]
#: Of each family and type one is quick.
OTHER_TYPES = [Spec(scheme, stages, rep, real=real) for real in ("float", "long-double")
               for scheme, stages, rep in (("EMS", None, "gamma"), ("G-L", 3, "alpha"),
                                           ("LIIIA-B", 3, "gamma"))]


def name_of(spec):
    return spec.name


# ---------------------------------------------------------------- warnings


@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.parametrize("spec", [
    *usual(PAPER_SPECS), Spec("EMS", real="float"), Spec("LIIIA-B", 3, real="long-double"),
    *(pytest.param(spec, marks=pytest.mark.slow) for spec in [*OTHER_TYPES, Spec("G-L", 8)])],
    ids=name_of)
def test_no_warning(name, spec, tmp_path):
    command = compiler(name)
    write(files_of(spec), tmp_path)
    run([*command, *STRICT, "-fsyntax-only", f"{spec.name}.c"], tmp_path)


@pytest.mark.parametrize("spec", [
    *(pytest.param(spec, marks=pytest.mark.slow)  # two to four seconds each
      for spec in [*PAPER_SPECS, *OTHER_TYPES, Spec("G-L", 8)])], ids=name_of)
def test_no_warning_from_the_optimiser(spec, tmp_path):
    """What gcc sees of values that may not be set; most other tests compile with -O0."""
    write(files_of(spec), tmp_path)
    run([*compiler("gcc"), *STRICT, "-O2", "-c", f"{spec.name}.c", "-o", "kernel.o"], tmp_path)


@pytest.mark.parametrize(("make", "spec"), [
    (forced_pendulum, Spec("EMS")),
    *(pytest.param(slider_crank, spec, marks=pytest.mark.slow)  # two to three seconds each
      for spec in (Spec("IMS"), Spec("G-L", 2)))],
    ids=lambda x: getattr(x, "name", x.__name__ if callable(x) else x))
def test_no_warning_from_the_optimiser_of_other_systems(make, spec, tmp_path):
    """Nor with forces, and with several constraints."""
    made = generate(spec, system=make()).source
    write(made.files(), tmp_path)
    run([*compiler("gcc"), *STRICT, "-O2", "-c", f"{made.name}.c", "-o", "kernel.o"], tmp_path)


@pytest.mark.parametrize("spec", SOME, ids=name_of)
def test_no_warning_from_the_compiler_of_pypi(spec, tmp_path):
    command = zig()
    write(files_of(spec), tmp_path)
    run([*command, *STRICT, "-c", f"{spec.name}.c", "-o", "kernel.o"], tmp_path)


@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.parametrize("spec", SOME, ids=name_of)
def test_no_warning_at_other_settings(name, spec, tmp_path):
    """C17 as well; shadowed names and missing prototypes are not there either."""
    command = compiler(name)
    write(files_of(spec), tmp_path)
    more = ["-Wmissing-prototypes", "-Wstrict-prototypes", "-Wundef", "-Wvla", "-Wcast-qual"]
    for std in ("c11", "c17"):
        run([*command, *STRICT, *more, f"-std={std}", "-fsyntax-only", f"{spec.name}.c"], tmp_path)


# ---------------------------------------------------------------- symbols


def declared(spec, header):
    """Return the functions that a header declares."""
    text = re.sub(r"/\*.*?\*/", "", header, flags=re.DOTALL)
    return set(re.findall(rf"\b({spec.name}_\w+)\(", text))


@pytest.mark.parametrize("name", ["gcc", "clang"])
@pytest.mark.parametrize(
    "spec", [Spec("G-L", 3), Spec("LIIIA-B", 2, "alpha"), Spec("EMS"), Spec("IMS", None, "alpha")],
    ids=name_of)
def test_symbols_are_the_documented_functions(name, spec, tmp_path):
    """Nothing else is exported, and there is no writable data: re-entrant by construction."""
    command = compiler(name)
    files = files_of(spec)
    write(files, tmp_path)
    run([*command, "-std=c11", "-O0", "-fPIC", "-c", f"{spec.name}.c", "-o", "kernel.o"], tmp_path)
    lines = [line.split() for line in run(["nm", "kernel.o"], tmp_path).splitlines()]
    exported = {words[-1] for words in lines if words[-2] in "TDBRCVWG"}
    assert exported == declared(spec, files[f"{spec.name}.h"])
    assert {words[-2] for words in lines} <= set("TtrUu"), lines
    functions = {"step", "integrate", "T1", "T2", "guess", "residual", "jacobian",
                 "increment_size", "last_increment", "satisfies_constraints", "hamiltonian",
                 "defects",
                 "project", "lanes", "integrate_lanes", "integrate_many", "work_size",
                 "begin", "advance", "set_parameters", "report_of", "near", "is_valid"}
    if spec.stages:
        functions |= {"coefficients"}
    assert exported == {f"{spec.name}_{function}" for function in functions}


def test_symbols_needed_are_of_the_maths_library(tmp_path):
    spec = Spec("LIIIA-B", 2)
    write(files_of(spec), tmp_path)
    run([*compiler(MAIN), "-std=c11", "-O1", "-c", f"{spec.name}.c", "-o", "kernel.o"], tmp_path)
    lines = [line.split() for line in run(["nm", "kernel.o"], tmp_path).splitlines()]
    needed = {words[-1] for words in lines if words[-2] == "U"}
    assert needed <= {"fma", "frexp", "ldexp", "pow", "sqrt", "memset", "memcpy", "memmove",
                      "_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}


# ---------------------------------------------------------------- headers


@pytest.mark.parametrize("spec", [*SOME, Spec("IMS", real="long-double")], ids=name_of)
@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_header_is_cplusplus_and_can_be_included_twice(name, spec, tmp_path):
    command = compiler(name, COMPILERS_OF_CPLUSPLUS)
    write(files_of(spec), tmp_path)
    (tmp_path / "user.cpp").write_text(
        f'#include "{spec.name}.h"\n#include "{spec.name}.h"\n'
        f"int main() {{ {spec.name}_options o = {{ 0, 50, 0 }}; return o.max_iterations - 50; }}\n",
        encoding="ascii")
    run([*command, "-std=c++17", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only",
         "user.cpp"], tmp_path)


def test_two_steppers_in_one_program(tmp_path):
    """Names do not clash: all of the paper's headers together."""
    text = ""
    for spec in PAPER_SPECS:
        write(files_of(spec), tmp_path)
        text += f'#include "{spec.name}.h"\n'
    (tmp_path / "all.c").write_text(text + "int main(void) { return 0; }\n", encoding="ascii")
    run([*compiler(MAIN), *STRICT, "-fsyntax-only", "all.c"], tmp_path)


# ---------------------------------------------------------------- a program without Python


def test_plain_c_example_agrees_with_python(tmp_path):
    """The three commands of docs/c.md, with nothing but ``cc``; the same end as in Python."""
    if shutil.which("cc") is None:
        pytest.skip("cc is not installed")
    spec = Spec("G-L", 3)
    shutil.copy(ROOT / "examples" / "plain_c" / "main.c", tmp_path)
    write(files_of(spec), tmp_path)
    page = (ROOT / "docs" / "c.md").read_text(encoding="utf-8")
    command = re.search(r"^cd plain_c && (cc .*) && \./top$", page, re.MULTILINE)
    assert command
    run(command[1].split(), tmp_path)
    lines = run([tmp_path / "top"], tmp_path).splitlines()
    assert lines[0] == "status 0 after 2000 steps"
    top = gs.problems.fast_top()
    made = gs.stepper("G-L", 3, "gamma").integrate(
        top.q0, top.p0, dt=1e-3, steps=2000,
        parameters=top.parameters | {"gamma": gs.gamma_m(top.inertia)})
    q = np.array(lines[1].removeprefix("q = ").split(), dtype=float)
    assert abs(q - made.q[-1]).max() < 1e-11
    numbers = [float(x) for x in re.findall(r"[0-9.]+e[+-][0-9]+", lines[2])]
    assert numbers[0] < 1e-12
    assert max(numbers[1:]) < 1e-14


@pytest.mark.slow  # -O3 takes some seconds; lanes of any width compare contraction at -O1
@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_optimisation_and_contraction_do_not_change_the_answer(name, tmp_path):
    """Without optimisation and FMA, and with both: round-off only, over 2000 steps."""
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


# ---------------------------------------------------------------- sanitizers

#: Calls everything, with good and with hopeless input, on memory of exactly the promised size.
DRIVER = r"""
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "NAME.h"

typedef REAL real;

static real *reals(int count)
{
    real *made = malloc((size_t)(count > 0 ? count : 1)*sizeof(real));
    memset(made, 0xff, (size_t)(count > 0 ? count : 1)*sizeof(real));
    return made;
}

static NAME_work *work_of(int fill)
{
    NAME_work *work = malloc(NAME_work_size());
    memset(work, fill, NAME_work_size());
    return work;
}

static void show(const char *what, int status, int n, const real *x)
{
    printf("%s %d", what, status);
    for (int i = 0; i < n; ++i)
        printf(" %.17Lg", (long double)x[i]);
    printf("\n");
}

static void everything(const char *label, const NAME_parameters *par, const real *q_start,
    const real *p_start, real dt, int max_iterations, int fill)
{
    enum { N = COORDINATES, U = UNKNOWNS, L = MULTIPLIERS, ROOM = L > 0 ? L : 1, STEPS = 7 };
    NAME_options options = { 0, max_iterations };
    NAME_work *work = work_of(fill);
    NAME_report report;
    real *q = reals(N), *p = reals(N), *q1 = reals(N), *p1 = reals(N), *x = reals(U), *r = reals(U),
         *J = reals(U*U), *l = reals(ROOM), *H = reals(STEPS), *q_out = reals(STEPS*N),
         *p_out = reals(STEPS*N), *l_out = reals(STEPS*L), *g = reals(STEPS*CONSTRAINTS),
         *f = reals(STEPS*CONSTRAINTS);
    int *counts = malloc(STEPS*sizeof(int)), taken = -1, status;
    printf("%s\n", label);
    for (int i = 0; i < N; ++i) {
        q[i] = q_start[i];
        p[i] = p_start[i];
    }
    status = NAME_step(par, &options, dt, q, p, q1, p1, l, &taken, work);
    show("step", status, status ? 0 : N, q1);
    status = NAME_T1(par, &options, dt, q, p, x, &taken, work);
    show("T1", status, status ? 0 : U, x);
    status = NAME_T2(par, dt, q, p, x, q1, p1, l, work);
    show("T2", status, status ? 0 : N, q1);
    NAME_guess(par, dt, q, p, x, work);
    NAME_residual(par, dt, q, p, x, r, work);
    show("residual", 0, U, r);
    NAME_jacobian(par, dt, q, p, x, J, work);
    show("jacobian", 0, U*U, J);
    real size[1] = { NAME_increment_size(dt, q, p, x, r, work) };
    show("increment", 0, 1, size);
    status = NAME_step(par, &options, dt, q, p, q, p, l, &taken, work); /* in place */
    show("in place", status, status ? 0 : N, q);
    memset(&report, 0, sizeof report);
    for (int a = 0; a < N; ++a) {
        q[a] = q_start[a];
        p[a] = p_start[a];
    }
    status = NAME_integrate(par, &options, dt, STEPS, 1, q, p, q_out, p_out, l_out, counts, &report,
        work);
    show("integrate", status, (int)report.steps*N, q_out);
    for (int a = 0; a < N; ++a) {
        q1[a] = q_start[a];
        p1[a] = p_start[a];
    }
    NAME_begin(work, par, &options, dt, q1, p1); /* held, in pieces: the same bits */
    for (int k = 1; k < STEPS && NAME_advance(work, k, q1, p1) == 0; k *= 2)
        ;
    if (NAME_report_of(work)->steps != report.steps || memcmp(q, q1, N*sizeof *q) != 0
        || memcmp(p, p1, N*sizeof *p) != 0)
        abort();
    NAME_set_parameters(work, par);
    show("held", NAME_advance(work, 1, q1, p1), N, q1);
    status = NAME_integrate(par, &options, -dt, STEPS, 3, q, p, q_out, NULL, l_out, NULL, &report,
        work);
    show("every 3", status, 0, q_out);
    status = NAME_integrate(par, &options, dt, 0, 1, q, p, NULL, NULL, NULL, NULL, &report, work);
    show("no step", status, 0, q_out);
    for (int a = 0; a < N; ++a) {
        q_out[a] = q_start[a];
        p_out[a] = p_start[a];
    }
    NAME_hamiltonian(par, 1, q_out, p_out, H);
    show("H", 0, 1, H);
    NAME_hamiltonian(par, 0, NULL, NULL, NULL);
#if CONSTRAINTS > 0
    NAME_defects(par, 1, q_out, p_out, g, f);
    show("g", 0, CONSTRAINTS, g);
    NAME_defects(par, 0, NULL, NULL, NULL, NULL);
    for (int a = 0; a < N; ++a) {
        q_out[a] *= (real)1.1;
        p_out[a] += q_out[a]/7;
    }
    status = NAME_project(par, q_out, p_out);
    show("project", status, status ? 0 : N, q_out);
#endif
    free(q); free(p); free(q1); free(p1); free(x); free(r); free(J); free(l); free(H); free(q_out);
    free(p_out); free(l_out); free(g); free(f); free(counts); free(work);
}

int main(int argc, char **argv)
{
    const int fill = argc > 1 ? atoi(argv[1]) : 0;
    NAME_parameters par = { PARAMETERS }, odd = par;
    const real q[] = { START_Q }, p[] = { START_P };
    real bad[COORDINATES], far[COORDINATES], zero[COORDINATES];
    for (int i = 0; i < COORDINATES; ++i) {
        bad[i] = i ? q[i] : (real)NAN;
        far[i] = q[i]*(real)1e30;
        zero[i] = 0;
    }
    (void)argv;
    everything("fine", &par, q, p, (real)1e-3, 50, fill);
    everything("one iteration", &par, q, p, (real)1e-3, 1, fill);
    everything("no iteration", &par, q, p, (real)1e-3, 0, fill);
    everything("huge dt", &par, q, p, (real)1e6, 50, fill);
    everything("hopeless dt", &par, q, p, (real)1e30, 50, fill);
    everything("no dt", &par, q, p, 0, 50, fill);
    everything("NaN dt", &par, q, p, (real)NAN, 50, fill);
    everything("NaN state", &par, bad, p, (real)1e-3, 50, fill);
    everything("far off", &par, far, p, (real)1e-3, 50, fill);
    everything("zero", &par, zero, zero, (real)1e-3, 50, fill);
    odd.ODD = HUGE;
    everything("huge parameter", &odd, q, p, (real)1e-3, 50, fill);
    odd.ODD = 0;
    everything("zero parameter", &odd, q, p, (real)1e-3, 50, fill);
    odd.ODD = (real)INFINITY;
    everything("infinite parameter", &odd, q, p, (real)1e-3, 50, fill);
    return 0;
}
"""


@cache
def other_systems():
    """Return systems that are no rigid body: no constraint, one, two."""
    x, y, z = sp.symbols("x y z", real=True)
    px, py, pz = sp.symbols("px py pz", real=True)
    m, g, l = sp.symbols("m g l", positive=True)  # noqa: E741
    T = (px**2 + py**2) / (2 * m)
    return {
        "oscillator": gs.System((x, y), (px, py), (m, g),
                                H=T + g * (x**2 + y**2) / 2 + x**4, name="oscillator"),
        "pendulum": gs.System((x, y), (px, py), (m, g, l), H=T + m * g * y,
                              constraints=[x**2 + y**2 - l**2], name="pendulum"),
        "curve": gs.System((x, y, z), (px, py, pz), (m, g), H=T + pz**2 / (2 * m)
                           + m * g * z, constraints=[x**2 + y**2 - 1, x + z - x * y**2],
                           name="curve"),
    }


def driver_cases():
    top = {"PARAMETERS": "2, 1.3, 0.8, 0.4, 1.4", "ODD": "WEIGHT", "HUGE": "(real)1e30",
           "START_Q": "0.6, 0, 0.8, 0", "START_P": "-0.8, 1, 0.6, -2"}
    cases = {}
    for spec in (Spec("G-L", 3), Spec("LIIIA-B", 3, "alpha"), Spec("EMS", None, "alpha"),
                 Spec("IMS"), Spec("EMS", real="float"), Spec("G-L", 2, real="long-double"),
                 Spec("G-L", 2, system="free_body")):
        words = {**top, "ODD": spec.rep}
        if spec.system == "free_body":
            words["PARAMETERS"] = "2, 1.3, 0.8, 1.4"
        cases[spec.name] = (spec, None, words)
    plain = {"ODD": "m", "HUGE": "(real)1e30"}
    two = {**plain, "PARAMETERS": "1.5, 9.81", "START_Q": "1, 0", "START_P": "0, 1"}
    for scheme, stages in (("G-L", 2), ("EMS", None)):
        cases[f"oscillator_{scheme}"] = (Spec(scheme, stages), "oscillator", two)
    cases["pendulum"] = (Spec("LIIIA-B", 3), "pendulum", {**two, "PARAMETERS": "1.5, 9.81, 1"})
    for scheme, stages in (("G-L", 2), ("IMS", None)):
        cases[f"curve_{scheme}"] = (Spec(scheme, stages), "curve", {
            **plain, "PARAMETERS": "1.5, 9.81", "START_Q": "1, 0, -1", "START_P": "0, 1, 1"})
    return cases


CASES = driver_cases()
#: Of each kind one that random calls (test_c_random_input.py) do not have; the others are slow
#: tests.
FEW = ("heavy_top_ems_gamma_float",)


def driver(case):
    """Return the files of a driver program, and its name."""
    spec, system, words = CASES[case]
    made = generate(spec, system=other_systems()[system] if system else None)
    scheme, name = made.scheme, made.source.name
    types = {"double": "double", "float": "float", "long-double": "long double"}
    words = {
        **words, "NAME": name, "REAL": types[spec.real], "COORDINATES": made.system.n,
        "UNKNOWNS": scheme.size, "MULTIPLIERS": scheme.multipliers * made.system.m,
        "CONSTRAINTS": made.system.m,
    }
    text = DRIVER.replace("REAL", words.pop("REAL"))
    # \b keeps HUGE from HUGE_VAL; NAME stands inside longer names.
    text = text.replace("NAME", words.pop("NAME"))
    for word, value in words.items():
        text = re.sub(rf"\b{word}\b", str(value), text)
    return name, {**made.source.files(), "driver.c": text}


@pytest.mark.parametrize(("case", "name"), [
    *(pytest.param(case, MAIN, marks=[] if case in FEW else [pytest.mark.slow]) for case in CASES),
    *((case, OTHER) for case in ("heavy_top_gl3_gamma", "heavy_top_ems_alpha", "curve_G-L")),
])
def test_sanitizers_find_nothing(name, case, tmp_path):
    """Memory of the caller is kept to, integers do not overflow, whatever the input is.

    The scratch memory needs no preparation: other contents before, the same results.
    """
    command = compiler(name)
    kernel, files = driver(case)
    write(files, tmp_path)
    done = call([*command, *SANITIZE, "-std=c11", "driver.c", f"{kernel}.c", "-lm", "-o", "driver"],
                cwd=tmp_path)
    if done.returncode and re.search(r"lib(clang_rt\.)?(asan|ubsan)", done.stderr):
        pytest.skip(f"{name} has no sanitizer libraries")
    assert done.returncode == 0, done.stderr
    texts = [run([tmp_path / "driver", str(fill)], tmp_path) for fill in (0, 255)]
    assert texts[0] == texts[1]
    results = outcome(texts[0])
    assert len(results) == 13
    for what in ("step", "T1", "T2", "in place", "integrate", "held", "every 3", "no step"):
        assert results["fine"][what] == 0
    assert results["fine"].get("project", 0) == 0
    for label in ("no iteration", "NaN dt", "NaN state"):
        for what in ("step", "T1", "in place", "integrate"):
            assert results[label][what] != 0, (label, what)
    for line in texts[0].splitlines():  # what is called done is finite
        if re.match("(step|T1|T2|in place|integrate|project) 0", line):
            assert "nan" not in line
            assert "inf" not in line


def outcome(text):
    """Return label → call → status."""
    found, label = {}, ""
    for line in text.splitlines():
        match = re.match(r"(step|T1|T2|in place|integrate|every 3|no step|project|H|g|residual|"
                         r"jacobian|increment|held) (-?\d+)", line)
        if match is None:
            label = line
            found[label] = {}
        else:
            found[label][match[1]] = int(match[2])
    return found


# ---------------------------------------------------------------- vectors of any width

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
    *(pytest.param(*pair, marks=pytest.mark.slow)  # four compilations each
      for pair in ((Spec("EMS"), OTHER), (Spec("G-L", 3), MAIN), (Spec("G-L", 8), OTHER))),
], ids=lambda x: getattr(x, "name", x))
def test_lanes_of_any_width_give_the_same(name, spec, tmp_path):
    """Plain numbers, the baseline of the machine, and all it has: the same tops to round-off.

    With contraction off the width alone differs, and lanes do not share arithmetic: same bits.
    """
    command = compiler(name)
    write({**files_of(spec), "main.c": WIDTHS.replace("NAME", spec.name)}, tmp_path)
    native = "-march=native" if platform.machine() in ("x86_64", "AMD64") else "-mcpu=native"
    found = {}
    for label, flags in (("plain", ["-DGYROSPARK_PLAIN"]), ("baseline", []), ("native", [native]),
                         ("fused", [native, "-O1", "-ffp-contract=fast"])):
        run([*command, "-std=c11", "-O0", "-ffp-contract=off", *flags, "main.c", f"{spec.name}.c",
             "-lm", "-o", label], tmp_path)
        lanes, *rows = run([tmp_path / label], tmp_path).splitlines()
        found[label] = (int(lanes), np.array([[float(x) for x in row.split()] for row in rows]))
    assert found["plain"][0] == 1 <= found["baseline"][0] <= found["native"][0]
    for label, (_, rows) in found.items():
        assert rows.shape == (5, 5)
        assert not rows[:, 0].any()
        assert np.abs(rows - found["plain"][1]).max() <= (0 if label != "fused" else 1e-13)


@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_the_widest_vectors_compile(name, tmp_path):
    """AVX-512 is checked by the compiler where the machine does not have it."""
    if platform.machine() not in ("x86_64", "AMD64"):
        pytest.skip("AVX-512 is a thing of x86-64")
    spec = Spec("EMS")
    write(files_of(spec), tmp_path)
    run([*compiler(name), *STRICT, "-O1", "-mavx512f", "-mfma", "-c", f"{spec.name}.c", "-o",
         "kernel.o"], tmp_path)
    assembly = run(["objdump", "-d", "kernel.o"], tmp_path)
    assert assembly.count("zmm") > 100
