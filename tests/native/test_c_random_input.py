"""The generated C with random numbers, finite or not, under sanitizers and valgrind.

One program for every kind of stepper calls every function on memory of exactly the promised size,
its contents as ``malloc`` leaves them, or a byte. It ends with 1 where a status is none of the six,
or where a call that succeeds has a result that is not finite; the tools end it for any other error.
"""

import re
import shutil

import pytest

from c_programs import write
from compilers import MAIN, compiler
from fuzz.steppers import NAMES, case
from processes import ROOT, call

#: Conversions of a double that no int holds are undefined too, and not part of "undefined".
SANITIZE = ["-g1", "-O0", "-fsanitize=address,undefined,float-cast-overflow",
            "-fno-sanitize-recover=all"]

PROGRAM = r"""
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "NAME.h"

enum { N = COORDINATES, M = CONSTRAINTS, U = UNKNOWNS, L = MULTIPLIERS, PAR = PARAMETERS,
       VALUES = QUANTITIES, STATES = 5 };

static const double start_q[] = { START_Q }, start_p[] = { START_P }, start_par[] = { START_PAR };
static uint64_t random_state;
static long done, refused;
static int contents = -1;
static uint64_t results;

static uint64_t bits(void)
{
    random_state ^= random_state << 13;
    random_state ^= random_state >> 7;
    random_state ^= random_state << 17;
    return random_state;
}

static int below(int count)
{
    return (int)(bits() % (uint64_t)count);
}

static double any(void)
{
    static const double special[] = { 0.0, -0.0, 1, -1, 5e-324, -5e-324, 2.3e-308, 1e-160, 1e-16,
        2147483648.0, -2147483649.0, 9.3e18, -1e19, 1e30, 1e160, 1e300, 1.797e308, -1.797e308 };
    const uint64_t pattern = bits();
    double x;
    switch (below(6)) {
    case 0: return special[below(18)];
    case 1: return below(3) == 0 ? (double)NAN : below(2) ? (double)INFINITY : -(double)INFINITY;
    case 2: memcpy(&x, &pattern, sizeof x); return x;
    case 3: return ldexp(1.0 - (double)below(2000)/1000, below(200) - 100);
    default: return 2.0 - (double)below(4000)/1000;
    }
}

static void *room(size_t bytes)
{
    void *memory = malloc(bytes > 0 ? bytes : 1);
    if (contents >= 0)
        memset(memory, contents, bytes);
    return memory;
}

static double *reals(int count)
{
    return room((size_t)count*sizeof(double));
}

/* Memory that a call may be given or not. */
static double *optional(int count)
{
    return below(4) ? reals(count) : NULL;
}

/* Numbers as they should be, a little off, or some of them anything. */
static double *numbers(const double *base, int size, int count)
{
    double *made = reals(size*count);
    const int kind = below(4);
    const double factor = kind == 1 ? 1 + 1e-3*any() : kind == 3 && below(2) ? any() : 1;
    for (int i = 0; i < size*count; ++i)
        made[i] = (base ? base[i % size] : 0)*factor;
    for (int i = below(4); kind > 1 && size*count > 0 && i > 0; --i)
        made[below(size*count)] = any();
    return made;
}

static NAME_parameters *parameters(int count)
{
    NAME_parameters *made = room((size_t)count*sizeof *made);
    double *values = numbers(start_par, PAR, count);
    memcpy(made, values, (size_t)count*sizeof *made);
    free(values);
    return made;
}

static NAME_options options(void)
{
    static const int most[] = { 50, 50, 1, 0, 3, 200, -1, -2147483647 - 1 };
    static const int solvers[] = { 0, 0, 1, 2, 3, -1, 2147483647, -2147483647 - 1 };
    const NAME_options made = { below(2) ? any() : 0, most[below(8)], solvers[below(8)] };
    return made;
}

static double time_step(void)
{
    return below(2) ? 1e-3 : any();
}

static void judge(const char *what, int status, int count, const double *x)
{
    if (status == 0)
        ++done;
    else
        ++refused;
    if (status < 0 || status > 5) {
        fprintf(stderr, "%s: status %d\n", what, status);
        exit(1);
    }
    results = results*31 + (uint64_t)status;
    for (int i = 0; status == 0 && i < count; ++i) {
        uint64_t pattern;
        if (!isfinite(x[i])) {
            fprintf(stderr, "%s: done, and not finite\n", what);
            exit(1);
        }
        memcpy(&pattern, &x[i], sizeof pattern);
        results = results*31 + pattern;
    }
}

static void steps_of_one(void)
{
    NAME_parameters *par = parameters(1);
    NAME_options how = options();
    NAME_work *work = room(NAME_work_size());
    NAME_report report;
    static const long storing[] = { 1, 1, 2, 3, 1000000, 9223372036854775807 };
    const long every = storing[below(6)];
    const int steps = below(STATES + 1), rows = (int)(steps/every), twice = below(2);
    double *q = numbers(start_q, N, 1), *p = numbers(start_p, N, 1), *l = reals(L > 0 ? L : 1);
    int taken;
    const double dt = time_step();
    const int one = NAME_step(par, &how, dt, q, p, q, p, l, &taken, work);
    judge("step", one, N, q);
    judge("step", one, N, p);
    memset(&report, 0, sizeof report);
    for (int i = 0; i <= twice; ++i) {
        double *q_out = optional(rows*N), *p_out = optional(rows*N), *l_out = optional(rows*L);
        int *counts = below(4) ? room((size_t)rows*sizeof(int)) : NULL;
#if FORCES
        double *work_out = optional(rows);
#endif
        const int status = NAME_integrate(par, &how, dt, steps, every, q, p, q_out, p_out, l_out,
            counts,
#if FORCES
            work_out,
#endif
            &report, work);
        if (steps > 0) {
            judge("integrate", status, N, q);
            judge("integrate", status, N, p);
        }
#if FORCES
        free(work_out);
#endif
        free(q_out); free(p_out); free(l_out); free(counts);
    }
    free(par); free(work); free(q); free(p); free(l);
}

static void steps_of_many(void)
{
#if LANES
    const int count = 1 + below(NAME_lanes());
    NAME_parameters *par = parameters(count);
    NAME_options how = options();
    NAME_work *work = room(NAME_work_size());
    NAME_batch *batch = room(sizeof *batch);
    NAME_report *reports = calloc((size_t)count + 1, sizeof *reports);
    int *status = calloc((size_t)count + 1, sizeof *status);
    const int steps = below(STATES + 1), every = 1 + below(3), rows = steps/every;
    double *q = numbers(start_q, N, count), *p = numbers(start_p, N, count), *dt = reals(count),
           *q_out = optional(count*rows*N), *p_out = optional(count*rows*N),
           *l_out = optional(count*rows*L);
    int *counts = below(4) ? room((size_t)(count*rows)*sizeof(int)) : NULL;
    for (int i = 0; i < count; ++i)
        dt[i] = time_step();
#if FORCES
    double *work_out = optional(count*rows);
#endif
    NAME_integrate_lanes(count, par, &how, dt, steps, every, rows, q, p, q_out, p_out, l_out,
        counts,
#if FORCES
        work_out,
#endif
        reports, status, batch, work);
    for (int i = 0; i < count && steps > 0; ++i) {
        judge("lanes", status[i], N, q + i*N);
        judge("lanes", status[i], N, p + i*N);
    }
#if FORCES
    free(work_out);
#endif
    free(par); free(work); free(batch); free(reports); free(status); free(q); free(p); free(dt);
    free(q_out); free(p_out); free(l_out); free(counts);
#endif
}

static void halves_of_a_step(void)
{
    NAME_parameters *par = parameters(1);
    NAME_options how = options();
    NAME_work *work = room(NAME_work_size());
    double *q = numbers(start_q, N, 1), *p = numbers(start_p, N, 1), *x = numbers(NULL, U, 1),
           *r = reals(U), *J = reals(U*U), *l = reals(L > 0 ? L : 1), *q1 = reals(N),
           *p1 = reals(N);
    const double dt = time_step();
    int taken;
    NAME_residual(par, dt, q, p, x, r, work);
    NAME_jacobian(par, dt, q, p, x, J, work);
    (void)NAME_increment_size(dt, q, p, x, r, work);
    const int second = NAME_T2(par, dt, q, p, x, q1, p1, l, work);
    judge("T2", second, N, q1);
    judge("T2", second, N, p1);
    NAME_guess(par, dt, q, p, x, work);
    judge("T1", NAME_T1(par, &how, dt, q, p, x, &taken, work), U, x);
    free(par); free(work); free(q); free(p); free(x); free(r); free(J); free(l); free(q1);
    free(p1);
}

static void about_states(void)
{
    const int count = below(4);
    NAME_parameters *par = parameters(1);
    double *q = numbers(start_q, N, count), *p = numbers(start_p, N, count), *H = reals(count);
    NAME_hamiltonian(par, count, q, p, H);
#if CONSTRAINTS
    double *g = reals(count*M), *f = reals(count*M);
    NAME_defects(par, count, q, p, g, f);
    if (count > 0) {
        const int status = NAME_project(par, q, p);
        judge("project", status, N, q);
        judge("project", status, N, p);
    }
    free(g); free(f);
#endif
#if QUANTITIES
    double *t = numbers(NULL, 1, count), *values = reals(count*VALUES);
    NAME_quantities(par, count, t, q, p, values);
    free(t); free(values);
#endif
    free(par); free(q); free(p); free(H);
}

int main(int argc, char **argv)
{
    random_state = argc > 1 ? strtoull(argv[1], NULL, 10)*2862933555777941757u + 3037000493u : 1;
    contents = argc > 3 ? (int)strtol(argv[3], NULL, 10) : -1;
    for (long i = argc > 2 ? strtol(argv[2], NULL, 10) : 1000; i > 0; --i)
        switch (below(5)) {
        case 0: case 1: steps_of_one(); break;
        case 2: steps_of_many(); break;
        case 3: halves_of_a_step(); break;
        default: about_states();
        }
    printf("%ld done, %ld refused, %lu\n", done, refused, (unsigned long)results);
    return 0;
}
"""


def program(name):
    """Return the name of a stepper, and the files of its program."""
    entry = case(name)
    binding = entry.step.binding
    time = [0.5] if binding.time is not None else []
    words = {
        "NAME": entry.step.name, "COORDINATES": binding.n, "CONSTRAINTS": binding.m,
        "UNKNOWNS": binding.unknowns, "MULTIPLIERS": binding.multipliers,
        "PARAMETERS": len(entry.parameters) + len(time), "QUANTITIES": len(binding.quantity_names),
        "FORCES": int(binding.has_forces), "LANES": int(binding.lanes > 0),
        "START_Q": listed(entry.q), "START_P": listed(entry.p),
        "START_PAR": listed([*(entry.parameters[x] for x in entry.step.parameter_domains), *time]),
    }
    text = PROGRAM.replace("NAME", words.pop("NAME"))
    for word, value in words.items():
        text = re.sub(rf"\b{word}\b", str(value), text)
    return entry.step.name, {**entry.step.files, "random.c": text}


def listed(numbers):
    return ", ".join(repr(float(x)) for x in numbers)


def built(name, flags, folder, compiler_name=MAIN):
    """Compile the program of a stepper; skip where the tools of the flags are not there."""
    command = compiler(compiler_name)
    kernel, files = program(name)
    write(files, folder)
    # no stepper calls all inline functions of the engine, which clang counts and gcc does not
    process = call([*command, *flags, "-std=c11", "-Wall", "-Wextra", "-Wconversion", "-Werror",
                    "-Wno-unused-function", "random.c", f"{kernel}.c", "-lm", "-o", "random"],
                   cwd=folder)
    if process.returncode and re.search(r"lib(clang_rt\.)?(asan|ubsan)", process.stderr):
        pytest.skip(f"{compiler_name} has no sanitizer libraries")
    assert process.returncode == 0, process.stderr
    return folder / "random"


def attempt(command, folder):
    process = call(command, cwd=folder)
    assert process.returncode == 0, process.stdout + process.stderr
    finished, refused, results = map(int, re.findall(r"\d+", process.stdout))
    assert min(finished, refused) > 0
    return results


@pytest.mark.slow  # a compilation under sanitizers each; test_sanitizers.py has a quick one
@pytest.mark.parametrize("compiler_name", ["gcc", "clang"])
@pytest.mark.parametrize("name", NAMES)
def test_sanitizers_find_nothing_in_random_calls(name, compiler_name, tmp_path):
    """Scratch memory needs no preparation: with other contents the results are the same."""
    random, count = built(name, SANITIZE, tmp_path, compiler_name), 500 if name == "chain" else 5000
    zeros, ones = (attempt([random, "1", str(count // 10), fill], tmp_path)
                   for fill in ("0", "255"))
    assert zeros == ones
    for seed in range(2, 12):
        attempt([random, str(seed), str(count)], tmp_path)


# ---------------------------------------------------------------- valgrind

#: Uninitialised memory decides nothing, nothing is read or written outside, nothing is left.
VALGRIND = ["valgrind", "--quiet", "--error-exitcode=9", "--leak-check=full", "--track-origins=yes"]

needs_valgrind = pytest.mark.skipif(shutil.which("valgrind") is None,
                                    reason="valgrind is not installed")


@pytest.mark.slow
@needs_valgrind
@pytest.mark.parametrize("name", NAMES)
def test_memcheck_finds_nothing_in_random_calls(name, tmp_path):
    # -O0: from -O1 on gcc writes (a & m) | (b & ~m) as ((a ^ b) & m) ^ b, whose bits of an unused b
    # cancel, which memcheck does not see
    random = built(name, ["-g", "-O0"], tmp_path)
    attempt([*VALGRIND, random, "1", "100" if name == "chain" else "500"], tmp_path)


@pytest.mark.slow
@needs_valgrind
def test_memcheck_finds_nothing_in_the_plain_program(tmp_path):
    write(case("gl3").step.files, tmp_path)
    shutil.copy(ROOT / "examples" / "plain_c" / "main.c", tmp_path)
    process = call([*compiler(MAIN), "-g", "-O1", "-std=c11", "main.c", "heavy_top_gl3_gamma.c",
                    "-lm", "-o", "top"], cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    process = call([*VALGRIND, tmp_path / "top"], cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    assert not process.stderr
    assert process.stdout.startswith("status 0 after 2000 steps")
