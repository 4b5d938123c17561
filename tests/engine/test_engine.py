"""The engine by itself: its C files against a toy whose kernels are written by hand.

The toy is ``toy_engine.c``: a mass on a spring, free, on a sphere (W is constant) or on an
ellipsoid (W varies), with a second constraint or without. What a step must give is solved for
here, from the scheme's equations in 30 digits.
"""

from __future__ import annotations

import re
from fractions import Fraction
from functools import cache

import cffi
import mpmath as mp
import numpy as np
import pytest

import gyrospark as gs
from compilers import MAIN, compiler
from gyrospark.core.real_types import REALS
from gyrospark.generator.codegen import emit
from gyrospark.generator.codegen.c_lines import WIDTH
from gyrospark.generator.codegen.emit_control import control_files, work_files
from gyrospark.generator.codegen.engine import ENGINE, Proved, engine_of, with_times
from gyrospark.generator.schemes.fast_tableau import FastTableau
from gyrospark.generator.tableaux.tableau import FIELDS
from processes import DATA, ROOT, call

FILES = sorted(ENGINE.glob("*.h"))
DECLARATIONS = """
typedef struct { double k; } parameters_t;
typedef struct { double tolerance; int max_iterations, solver; } options_t;
int toy_step(const parameters_t *, const options_t *, double, const double *, const double *,
    double *, double *, double *, int *, void *);
int toy_project(const parameters_t *, double *, double *);
void toy_integrate_many(long, const parameters_t *, const options_t *, const double *, long, long,
    double *, double *, double *, double *, void *, int *, void *, void *);
int toy_lanes(void);
"""
ROOM = 1 << 19  # bytes of memory, more than the toy's own


def compiled(text, declarations, folder):
    """Return a library of some C and the engine."""
    (folder / "toy.c").write_text(text, encoding="utf-8")
    command = [*compiler(MAIN), "-std=c11", "-O1", "-ffp-contract=off", "-Wall", "-Wextra",
               "-Wpedantic", "-Wconversion", "-Werror", "-shared", "-fPIC", f"-I{ENGINE}",
               f"-I{DATA}", "toy.c", "-o", "toy.so", "-lm"]
    done = call(command, cwd=folder)
    assert done.returncode == 0, done.stderr
    ffi = cffi.FFI()
    ffi.cdef(declarations)
    return ffi, ffi.dlopen(str(folder / "toy.so"))


# ---------------------------------------------------------------- the files


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_files_are_plain_c(path):
    text = path.read_text(encoding="ascii")
    assert not re.search(r"\{%|\{#|\{\{ \w+ \}\}", text)  # of a template
    assert not re.search(r"^#if(?!.*(__|LANE))", text, re.MULTILINE)
    assert all(len(line) <= WIDTH for line in text.splitlines())
    assert text.endswith("\n")
    assert not text.endswith("\n\n")


def test_every_file_is_put_in_somewhere():
    named = set()
    for m in (0, 1, 2):
        for bits in range(1024):
            stages, structured, forced, constant, scalar, separable, timed, fed, framed, halves = (
                bool(bits >> i & 1) for i in range(10))
            for lagrangian, ends in ((True, True), (True, False), (False, False)):
                proved = Proved(4, m, stages, structured, forced, constant, scalar, separable,
                                timed, fed, lagrangian, framed, halves, ends and not stages,
                                definite=not forced)
                named |= {*proved.solver_files(fast=True)["files"],
                          *(file for files in proved.sweep_files("mean", "mean")["sweep_files"
                                                                 ].values() for file in files),
                          *proved.scheme_files()["finish_files"],
                          *proved.legendre_lane_files(), *proved.scheme_files()["stage_files"]}
            for found in (proved.solver_files(fast=True), proved.scheme_files(),
                          proved.sweep_files(*("stages", "trajectories") if stages
                                             else ("mean", "mean"))):
                for files in found.values():
                    lists = files.values() if isinstance(files, dict) else [files]
                    named |= {file for some in lists for file in some}
            named |= {*control_files(stages=stages, bound=m > 0, constant=constant, scalar=scalar,
                                     separable=separable),
                      *work_files(stages=stages, bound=m > 0, forced=forced)}
    templates = "".join(path.read_text(encoding="utf-8")
                        for path in (ROOT / "templates").glob("*.jinja"))
    calls = "".join(re.findall(r"engine\(.*?\)", templates))
    named |= set(re.findall(r'"(\w+)"', calls))
    assert {path.stem for path in FILES} <= named


def test_macros_are_written_out():
    put = engine_of("top", REALS["float"], "stages", "trajectories")
    timed = engine_of("top", REALS["float"], "stages", "trajectories", timed=True, fed=True)
    for path in FILES:
        for run in ("stages", "trajectories"):
            for text in (put(path.stem, run=run), timed(path.stem, run=run)):
                assert not re.search(r"\b(NAME|MATH|LIMIT|ON|ONE|MANY|RUN|TABLE|(LANES_)?AT"
                                     r"|(LANES_)?BETWEEN|TIMED|INPUT|TURNED|CARRIED)\(|\b(NUMBER|HELD)\b",
                                     text)
            if not path.stem.endswith(("drive", "drive_free", "inputs", "inputs_lanes")):
                assert not re.search("at_time|between\\(|span|_drive|inputs",
                                     put(path.stem, run=run))
    assert "fabsf(" in put("measure")
    assert "int top_step(" in put("single")
    framed = engine_of("top", REALS["float"], "stages", "trajectories", framed=True)
    assert "    turn_runs(count, parameters, " in framed("many")
    assert "turn_runs" not in put("many")
    assert with_times("f(AT(&c,\n  u(t, 1)), q);\n", timed=False) == "f(&c, q);\n"
    assert with_times("f(AT(&c,\n  u(t, 1)), q);\n", timed=True) == "f(at_time(&c, u(t, 1)), q);\n"
    assert with_times("{\n    TIMED(a(b);)\n}", timed=False) == "{\n}"
    assert with_times("f(TIMED(\n  real *t,) int n)", timed=False) == "f(int n)"
    assert "static void factor(real W" in put("elimination")
    assert "static void lanes_factor(lanes W" in put("elimination", "lanes_")
    assert "lanes_factor_mass(const lane_constants *c, const lanes q" in put("mass", "lanes_")


# ---------------------------------------------------------------- angles of a frame

ANGLES = """
#include <math.h>
#define MATH(function) function
typedef double turning;
static const turning quarter[3] = { QUARTER };
#include "twofold.h"
void angle(long k, double dt, double rate, double out[2])
{
    const twofold t = plus(product_of((double)k, dt), product_of(0.5, 0));
    circle(times(t, product_of(0.5, rate)), &out[0], &out[1]);
}
double size(double x, double y, double z)
{
    const twofold length = length_of(x, y, z);
    return length.low/length.high;
}
"""


def test_angles_lose_no_digit_in_any_run(tmp_path):
    """cos and sin of ½ k Δt ω, up to 10^9 steps and 10^9 rad, beside 60 digits."""
    quarters = ", ".join(emit._quarter(REALS["double"]))
    ffi, lib = compiled(ANGLES.replace("QUARTER", quarters),
                        "void angle(long, double, double, double *);"
                        "double size(double, double, double);", tmp_path)
    out, draw, worst = ffi.new("double[2]"), np.random.default_rng(7), 0.0
    cases = [(10**9, 1e-3, 125.7), (10**9, -1e-3, 2e3), (1, 1e-3, 75.4), (10**9, 0.1, 0.0),
             (3, 0.5, float(mp.pi)), *zip(draw.integers(1, 10**9, 200).tolist(),
                                          (10 ** draw.uniform(-5, -1, 200)).tolist(),
                                          draw.normal(0, 100, 200).tolist(), strict=True)]
    for k, dt, rate in cases:
        lib.angle(k, dt, rate, out)
        with mp.workdps(60):
            angle = mp.mpf(k) * mp.mpf(dt) * mp.mpf(rate) / 2
            worst = max(worst, abs(out[0] - mp.cos(angle)), abs(out[1] - mp.sin(angle)))
    assert worst <= 2**-53  # each is rounded once, but for the last bit of sin and cos
    with mp.workdps(60):
        x, y, z = 1.25, 1e-3, 77.7
        exact = mp.sqrt(sum(mp.mpf(c) ** 2 for c in (x, y, z)))
        high = float(exact)
        assert lib.size(x, y, z) * high == pytest.approx(float(exact - high), rel=1e-10)


# ---------------------------------------------------------------- linear algebra

LINEAR = """
#pragma GCC diagnostic ignored "-Wunused-function"
#include <float.h>
#include <math.h>
#include <stddef.h>
#define MATH(function) function
#define ON(function) function
#define NUMBER real
typedef double real;
enum { OK, SINGULAR, NOT_FINITE };
static const real epsilon = DBL_EPSILON;
enum { U = 5, BAND = 2, M = 3, FACTOR = 5 };
/* unknowns 0..4 stand in this order in the band */
static const int position[U] = { 2, 0, 4, 1, 3 };
/* W couples 0-1 and 1-2: entries W00, W11, W22, W10, W21 */
static const int pivot_order[M] = { 0, 1, 2 }, pivot_rows[M] = { 1, 1, 0 };
static const int below_row[2] = { 1, 2 }, below_target[1] = { 0 };
static const int before_rows[M] = { 0, 1, 1 }, before_row[2] = { 0, 1 }, before_slot[2] = { 3, 4 };
#include "measure.h"
#include "lu.h"
#include "solve.h"
#include "band.h"
#include "elimination.h"
int solve_dense(int n, double *A, double *b)
{
    int exponents[8], pivots[8];
    return solve(n, A, b, exponents, pivots);
}
int solve_banded(const double *A, double *b)
{
    real J[U*WIDTH] = { 0 }, forward[U], dense[U*U];
    int exponents[U], pivots[U];
    long products;
    unsigned chance = 1;
    if (fabs(nudge(&chance)) != 2*epsilon || larger(1, 2) != 2)
        return -1;
    for (int i = 0; i < U; ++i)
        for (int j = 0; j < U; ++j)
            if (A[i*U + j] != 0)
                *entry(J, i, j) = A[i*U + j];
    band_spread(J, dense);
    for (int e = 0; e < U*U; ++e)
        if (dense[e] != A[e])
            return -2;
    const int status = band_factorise(J, exponents, pivots, &products);
    return status == OK ? band_substitute(J, exponents, pivots, b, forward) : status;
}
void solve_cells(double *W, double *b)
{
    factor(W);
    substitute(W, b);
}
"""


@pytest.fixture(scope="module")
def linear(tmp_path_factory):
    return compiled(LINEAR, "int solve_dense(int, double *, double *); "
                    "int solve_banded(const double *, double *); "
                    "void solve_cells(double *, double *);", tmp_path_factory.mktemp("linear"))


def rational_system(n, seed, band=None, order=None):
    """Return A, the exact x, and b = A x in whole numbers."""
    rng = np.random.default_rng(seed)
    A = rng.integers(-9, 10, (n, n)) + 30 * np.eye(n, dtype=int)[::-1 if band is None else 1]
    if band is not None:
        A[abs(np.subtract.outer(order, order)) > band] = 0
    x = rng.integers(-9, 10, n)
    return A.astype(float), x.astype(float), (A @ x).astype(float)


@pytest.mark.parametrize("n", [1, 2, 5, 8])
@pytest.mark.parametrize("power", [0, 600, -600])
def test_dense_systems_with_known_solutions(linear, n, power):
    """Rows in other units have the same solution, to the bit: they are scaled by powers of two."""
    ffi, lib = linear
    A, x, b = rational_system(n, n)
    expected = None
    for scale in (0, power):
        rows = 2.0 ** (scale * (np.arange(n) % 2))
        made, right = np.ascontiguousarray(A * rows[:, None]), b * rows
        assert lib.solve_dense(n, ffi.from_buffer("double *", made),
                               ffi.from_buffer("double *", right)) == 0
        np.testing.assert_allclose(right, x, rtol=0, atol=64 * n * np.finfo(float).eps * 10)
        expected = right if expected is None else expected
        assert np.array_equal(right, expected)


@pytest.mark.parametrize(("entry", "status"), [(0.0, 1), (np.nan, 2), (np.inf, 2)])
def test_dense_systems_without_solution_say_so(linear, entry, status):
    ffi, lib = linear
    A, b = np.array([[1.0, 2.0], [2.0, 4.0]]), np.ones(2)
    A[1] = [entry, entry] if not entry else [entry, 4.0]
    assert lib.solve_dense(2, ffi.from_buffer("double *", A),
                           ffi.from_buffer("double *", b)) == status


def test_equal_rows_are_singular(linear):
    ffi, lib = linear
    A, b = np.array([[0.1, 0.7], [0.1, 0.7]]), np.ones(2)
    assert lib.solve_dense(2, ffi.from_buffer("double *", A),
                           ffi.from_buffer("double *", b)) == 1


@pytest.mark.parametrize("seed", range(4))
def test_a_band_in_another_order_has_the_known_solution(linear, seed):
    ffi, lib = linear
    A, x, b = rational_system(5, seed, 2, np.array([2, 0, 4, 1, 3]))
    assert lib.solve_banded(ffi.from_buffer("double *", A),
                            ffi.from_buffer("double *", b)) == 0
    np.testing.assert_allclose(b, x, rtol=0, atol=1e3 * np.finfo(float).eps)


def test_elimination_without_zeros_has_the_known_solution(linear):
    ffi, lib = linear
    W = np.array([[4.0, 1.0, 0.0], [1.0, 5.0, -2.0], [0.0, -2.0, 6.0]])
    x = np.array([3.0, -1.0, 2.0])
    entries, b = np.array([4.0, 5.0, 6.0, 1.0, -2.0]), W @ x
    lib.solve_cells(ffi.from_buffer("double *", entries), ffi.from_buffer("double *", b))
    np.testing.assert_allclose(b, x, rtol=8 * np.finfo(float).eps)


# ---------------------------------------------------------------- products by halves

HALVES = """
#pragma GCC diagnostic ignored "-Wunused-function"
#include <math.h>
#define MATH(function) function
typedef double real;
enum { N = 3, S = %d, P = S };
#include "lanes_of_vectors.h"
#include "lanes.h"
#include "load_again.h"
typedef struct { lanes q[N], p[N], zero[N]; } trajectories_t;
#define RUN(name) trajectories_##name
%s
#include "halves_of_stages.h"
#include "halves_of_nodes.h"
void product(int which, const double *base, const double *x, double *y)
{
    static trajectories_t w;
    lanes from[P*N], to[P*N];
    for (int a = 0; a < N; ++a)
        w.q[a] = w.p[a] = splat(base[a]);
    for (int e = 0; e < P*N; ++e)
        from[e] = splat(x[e]);
    if (which == 0)
        trajectories_places(&w, from, to);
    else if (which == 1)
        trajectories_pushes(&w, w.p, 0, from, to);
    else if (which == 2)
        trajectories_displace(&w, from, to);
    else
        trajectories_pulls(&w, from, to);
    for (int e = 0; e < P*N; ++e)
        y[e] = part(&to[e], LANES - 1);
}
"""


@pytest.mark.parametrize("s", [7, 8])
def test_products_by_sums_and_differences(s, tmp_path):
    """Beside the whole tables, which are rounded once more; three numbers: a pair and one left."""
    fast = FastTableau(gs.tableau("G-L", s))
    halves = fast.halves(REALS["double"])
    tables = "\n".join(f"static const real half_{name}[{len(rows)}][{len(rows[0])}] = "
                       f"{braced(rows)};" for name, rows in halves.items())
    ffi, lib = compiled(HALVES % (s, tables),
                        "void product(int, const double *, const double *, double *);", tmp_path)
    draw = np.random.default_rng(s)
    for which, name in enumerate(("mu", "mu_hat", "nu", "nu_tilde")):
        table = np.array(fast.tables(REALS["double"])[name], dtype=float)
        base, x, y = draw.normal(size=3), draw.normal(size=(s, 3)), np.zeros((s, 3))
        lib.product(which, *(ffi.from_buffer("double *", a) for a in (base, x, y)))
        wanted = table @ x + base * (name != "nu")
        np.testing.assert_allclose(y, wanted, rtol=0, atol=32 * np.finfo(float).eps)


# ---------------------------------------------------------------- steps of the toy


class Toy:
    """A stepper of the toy: sizes, squares s_a of the constraint, scheme, and its library."""

    def __init__(self, n, squares, m, stages, folder):
        self.n, self.m, self.stages = n, m, stages
        self.squares = squares
        self.tableau = gs.tableau("G-L", stages) if stages else None
        constant = m == 1 and set(squares) == {1}
        self.proved = Proved(n, m, bool(stages), False, False, constant, constant, stages > 0)
        self.ffi, self.lib = compiled(self.text(), DECLARATIONS, folder)

    def text(self):
        sizes = {"N": self.n, "M": self.m, "S": max(self.stages, 1), "P": max(self.stages, 1),
                 "STAGES": int(bool(self.stages)), "HISTORY": 32 if self.stages else 16}
        lines = ['#pragma GCC diagnostic ignored "-Wunused-const-variable"',
                 "enum { " + ", ".join(f"{k} = {v}" for k, v in sizes.items()) + " };",
                 f"static const double squares[N] = {{ {', '.join(map(str, self.squares))} }};"]
        one, many = ("stages", "trajectories") if self.stages else ("mean", "mean")
        lines += [f"#define ONE_(name) {one}_##name", f"#define MANY_(name) {many}_##name",
                  '#include "toy_engine.c"']
        if self.tableau:
            lines += self.tables()
        proved = self.proved
        before = ["measure", "lu", "jacobian_dense"]
        solver, sweeps = proved.solver_files(fast=True), proved.sweep_files(one, many)
        scheme = proved.scheme_files()
        lines += includes([*before, *solver["files"], *scheme["stage_files"],
                           *scheme["finish_files"], *solver["solver_files"], "objects", "picks",
                           "judge"])
        lines += ["#undef ON", "#undef NUMBER", "#define ON(name) lanes_##name",
                  "#define NUMBER lanes", *includes(["judge"]), "#undef ON", "#undef NUMBER",
                  "#define ON(name) name", "#define NUMBER real"]
        lines += includes(["predict", *sweeps["lane_files"]])
        for run in dict.fromkeys((one, many)):
            lines += as_run(run, run == one, sweeps["sweep_files"][run])
        lines += as_run(one, True, sweeps["one_files"])
        lines += ["enum { SWEEP_COST = 10*U };"]
        lines += includes(["objects_of_past", "sweeps", "run_by_sweeps", "rows", "single",
                           "integrate", *sweeps["batch_files"], "many"])
        return "\n".join([*lines, ""])

    def tables(self):
        numeric = self.tableau.numeric(20)
        kinds = {"s": "S", "p": "P + 1"}
        shape = {f: "".join(f"[{kinds[k]}]" for k in ks) for f, ks in FIELDS.items()}
        lines = ["static const struct {",
                 *(f"    real {field}{shape[field]};" for field in FIELDS), "} tableau = {",
                 *(f"    .{field} = {braced(getattr(numeric, field))}," for field in FIELDS), "};"]
        for name, rows in FastTableau(self.tableau).tables(REALS["double"]).items():
            lines.append(f"static const real fast_{name}[{len(rows)}][{len(rows[0])}] = "
                         f"{braced(rows)};")
        return lines

    def start(self):
        """Return a state on both constraints, |q|² measured with the squares."""
        q = np.linspace(0.3, 1.0, self.n)
        p = np.cos(1 + np.arange(self.n))
        if self.m > 1:
            q[-1] = q[0]
        if self.m:
            q /= np.sqrt(np.dot(self.squares, q**2))
            assert self.lib.toy_project(*self.pointers({"k": 2.0}, q, p)) == 0
        return q, p

    def pointers(self, parameters, *arrays):
        return (self.ffi.new("parameters_t *", parameters),
                *(self.ffi.from_buffer("double *", a) for a in arrays))

    def step(self, q, p, h, solver):
        """Return status, end and multipliers of a step with k = 2."""
        q1, p1, multipliers = np.zeros(self.n), np.zeros(self.n), np.zeros(16)
        options = self.ffi.new("options_t *", {"max_iterations": 50, "solver": solver})
        work = self.ffi.new("double[]", ROOM // 8)
        par, *arrays = self.pointers({"k": 2.0}, q, p, q1, p1, multipliers)
        status = self.lib.toy_step(par, options, h, *arrays, self.ffi.new("int *"), work)
        return status, q1, p1, multipliers

    # what a step must give, in 30 digits

    def g(self, q):
        values = [mp.fdot(self.squares, [x * x for x in q]) - 1, q[0] - q[-1]]
        return values[: self.m]

    def G(self, q):
        last = [mp.mpf(0)] * self.n
        last[0], last[-1] = mp.mpf(1), mp.mpf(-1)
        return [[2 * s * x for s, x in zip(self.squares, q, strict=True)], last][: self.m]

    def pull(self, q, impulses):
        rows = self.G(q)
        return [mp.fdot(impulses, [row[a] for row in rows]) for a in range(self.n)]

    @cache  # noqa: B019 - a toy lives as long as this module's tests
    def expected(self, h):
        """Return the end of a step from the start."""
        with mp.workdps(30):
            q, p = ([mp.mpf(x) for x in side] for side in self.start())
            h = mp.mpf(h)
            solve = self.expected_spark if self.stages else self.expected_mean
            q1, p1 = solve(q, p, h)
            return np.array([float(x) for x in q1]), np.array([float(x) for x in p1])

    def expected_mean(self, q, p, h):
        n, m = self.n, self.m

        def residual(*x):
            q1, p1, lam = x[:n], x[n:2*n], x[2*n:]
            mean = [(a + b) / 2 for a, b in zip(q, q1, strict=True)]
            pull = self.pull(mean, lam) if m else [0] * n
            return [*(q1[a] - q[a] - h * (p[a] + p1[a]) / 2 for a in range(n)),
                    *(p1[a] - p[a] + h * (2 * mean[a] + pull[a]) for a in range(n)), *self.g(q1)]

        guess = [*(a + h * b for a, b in zip(q, p, strict=True)), *p, *[mp.mpf(0)] * m]
        x = list(mp.findroot(residual, guess))
        return x[:n], x[n:2*n]

    def expected_spark(self, q, p, h):
        n, m, s = self.n, self.m, self.stages
        t = self.tableau.numeric(30)
        nodes = s + 1

        def stages(k, lam):
            ways = [[h * mp.fdot(t.A_bar[node], [k[j][a] for j in range(s)]) for a in range(n)]
                    for node in range(nodes)]
            forces = [self.pull([q[a] + ways[node][a] for a in range(n)], lam[node]) if m
                      else [0] * n
                      for node in range(s)]
            return ways, forces

        def rates(x):
            k = [x[i*n:(i + 1)*n] for i in range(s)]
            k_hat = [x[(s + i)*n:(s + i + 1)*n] for i in range(s)]
            lam = [x[2*s*n + node*m: 2*s*n + (node + 1)*m] for node in range(s)]
            return k, k_hat, lam

        def residual(*x):
            k, k_hat, lam = rates(x)
            ways, forces = stages(k, lam)
            r = []
            for i in range(s):
                r += [k[i][a] - p[a] - h * mp.fdot(t.A_hat[i], [y[a] for y in k_hat])
                      + h * mp.fdot(t.A_tilde[i][:s], [f[a] for f in forces]) for a in range(n)]
                r += [k_hat[i][a] + 2 * (q[a] + h * mp.fdot(t.A[i], [y[a] for y in k]))
                      for a in range(n)]
            for node in range(1, nodes):
                r += self.g([q[a] + ways[node][a] for a in range(n)])
            return r

        guess = [*p * s, *[-2 * a for a in q] * s, *[mp.mpf(0)] * (m * s)]
        x = list(mp.findroot(residual, guess))
        k, k_hat, lam = rates(x)
        ways, forces = stages(k, lam)
        q1 = [q[a] + ways[-1][a] for a in range(n)]
        p1 = [p[a] + h * mp.fdot(t.b_hat, [y[a] for y in k_hat])
              - h * mp.fdot(t.b_tilde[:s], [f[a] for f in forces]) for a in range(n)]
        if not m:
            return q1, p1
        G = mp.matrix(self.G(q1))
        last = mp.lu_solve(G * G.T, G * mp.matrix(p1))
        return q1, [p1[a] - (G.T * last)[a] for a in range(n)]


def includes(files):
    return [f'#include "{file}.h"' for file in files]


def as_run(run, of_stages, files):
    table = "w->name" if of_stages else "&fast_##name[0][0]"
    return [f"#define RUN(name) {run}_##name", f"#define TABLE(name) {table}",
            *includes(files), "#undef RUN", "#undef TABLE"]


def braced(part):
    if isinstance(part, (list, tuple)):
        return "{ " + ", ".join(map(braced, part)) + " }"
    return repr(float(part)) if isinstance(part, Fraction) else mp.nstr(part, 20)


SPHERE, ELLIPSOID = (1, 1, 1), (1, 2, 4)
TOYS = {
    "free, one stage": (3, SPHERE, 0, 1), "free, mean": (3, SPHERE, 0, 0),
    "sphere, one stage": (3, SPHERE, 1, 1),
    "sphere, mean": (3, SPHERE, 1, 0), "ellipsoid, one stage": (3, ELLIPSOID, 1, 1),
    "ellipsoid, two stages": (3, ELLIPSOID, 1, 2), "ellipsoid, mean": (3, ELLIPSOID, 1, 0),
    "two of three": (3, ELLIPSOID, 2, 2), "two of three, mean": (3, ELLIPSOID, 2, 0),
}


@pytest.fixture(scope="module", params=TOYS)
def toy(request, tmp_path_factory):
    return Toy(*TOYS[request.param], tmp_path_factory.mktemp("toy"))


@pytest.mark.parametrize("solver", [0, 1, 2], ids=["auto", "newton", "sweeps"])
def test_a_step_is_what_its_equations_say(toy, solver):
    q, p = toy.start()
    status, q1, p1, _ = toy.step(q, p, 0.1, solver)
    assert status == 0
    q_exact, p_exact = toy.expected(0.1)
    eps = np.finfo(float).eps
    np.testing.assert_allclose(q1, q_exact, rtol=0, atol=16 * eps)
    np.testing.assert_allclose(p1, p_exact, rtol=0, atol=64 * eps)


def test_trajectories_side_by_side_are_single_steps(toy):
    """More of them than lanes, each with a step of its own; lanes share sweeps, not results."""
    q, p = toy.start()
    steps = np.array([0.1, -0.1, 0.05, 0.02, 0.1])
    Q, P = np.tile(q, (5, 1)), np.tile(p, (5, 1))
    ffi = toy.ffi
    par = ffi.new("parameters_t[]", [{"k": 2.0}] * 5)
    options = ffi.new("options_t *", {"max_iterations": 50})
    memory = [ffi.new("double[]", ROOM // 8) for _ in range(3)]
    status = ffi.new("int[]", 5)
    buffers = [ffi.from_buffer("double *", a) for a in (steps, Q, P)]
    toy.lib.toy_integrate_many(5, par, options, buffers[0], 1, 1, *buffers[1:], ffi.NULL,
                               ffi.NULL, memory[0], status, memory[1], memory[2])
    assert list(status) == [0] * 5
    for i, h in enumerate(steps):
        _, q1, p1, _ = toy.step(q, p, h, 0)
        np.testing.assert_allclose(Q[i], q1, rtol=0, atol=16 * np.finfo(float).eps)
        np.testing.assert_allclose(P[i], p1, rtol=0, atol=64 * np.finfo(float).eps)
    assert np.array_equal(Q[0], Q[4])


def test_projection_brings_a_state_onto_the_constraints(toy):
    if not toy.m:
        pytest.skip("this toy has no constraints")
    q, p = toy.start()
    q, p = q + 1e-3, p - 1e-2
    assert toy.lib.toy_project(*toy.pointers({"k": 2.0}, q, p)) == 0
    eps = np.finfo(float).eps
    assert max(abs(float(g)) for g in toy.g(q)) <= 8 * eps
    assert max(abs(float(mp.fdot(row, p))) for row in toy.G(q)) <= 16 * eps
