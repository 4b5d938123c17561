"""The engine by itself: headers compile alone, and internal functions of a stepper.

The toy (``tests/data/toy``) is a particle on a spring that is described by hand; each header
compiles beside it in each of its variants. Steps are tested with steppers, in laws/ and
test_step_reference.py.
"""

from __future__ import annotations

import re
from collections import defaultdict

import cffi
import mpmath as mp
import numpy as np
import pytest

import gyrospark as gs
from compilers import MAIN, compiler
from gyrospark.core.real_types import REALS
from gyrospark.engine.amalgamate import FOLDER
from gyrospark.generator.codegen.splitting_flows import half_pi_words
from gyrospark.generator.schemes.fast_tableau import FastTableau
from processes import call
from toy import FLAGS, HEADERS, TOY, flags_of, tables, variants

EPS = float(np.finfo(float).eps)


@pytest.fixture(scope="module")
def other_tables(tmp_path_factory):
    """Return a folder with the tables of one stage and of seven."""
    folder = tmp_path_factory.mktemp("tables")
    for stages in (1, 3, 7):
        (folder / f"tables{stages}.h").write_text(tables(stages), encoding="ascii")
    return folder


@pytest.fixture(scope="module")
def checking(other_tables):
    """Return the command that reads headers beside the toy."""
    return [*compiler(MAIN), "-fsyntax-only", "-x", "c", "-Werror", *FLAGS, f"-I{other_tables}",
            "-include", "toy.h"]


def defined(macros):
    return [f"-D{name}={value}" for name, value in macros.items()]


# ---------------------------------------------------------------- each header alone


def test_tables_of_the_toy_are_those_of_the_generator():
    assert (TOY / "tables.h").read_text(encoding="ascii") == tables(2)


def is_guarded(path):
    """Whether a header guards itself; others are templates, included under several names."""
    guard = "GS_" + "_".join(path.relative_to(FOLDER / "gyrospark").with_suffix("").parts).upper()
    return f"#ifndef {guard}_H\n#define {guard}_H\n" in path.read_text(encoding="ascii")


def grouped(flags_of_header):
    """Return flags → headers, from pairs of flags and header."""
    headers_of_flags = defaultdict(list)
    for flags, header in flags_of_header:
        headers_of_flags[tuple(sorted(flags))].append(header)
    return headers_of_flags


def assert_compiles(command, headers, folder=None):
    process = call([*command, *headers], cwd=folder)
    assert process.returncode == 0, f"{' '.join(map(str, command))}\n{process.stderr}"


def in_one_unit(headers):
    """Return arguments by which a compiler reads several headers that guard themselves."""
    return [*(word for header in headers[:-1] for word in ("-include", header)), headers[-1]]


@pytest.mark.slow  # every variant of every header that its text tells apart, alone
def test_headers_compile_alone_in_each_variant(checking):
    flags_of_headers = [(defined(macros), header) for header in HEADERS
                        for macros in variants(header).values()]
    for flags, headers in grouped(flags_of_headers).items():
        assert_compiles([*checking, *flags], headers)


@pytest.mark.slow  # a process for each set of features
@pytest.mark.parametrize("name", ["gcc", "clang"])
def test_an_editor_opens_headers_without_errors(name):
    """The flags are those files', as for clangd; guarded headers are opened together."""
    folder = FOLDER / "gyrospark"
    common = (folder / "compile_flags.txt").read_text(encoding="ascii").split()
    checking = [*compiler(name), "-fsyntax-only", "-Werror", *common]
    flags_of_headers = [(defined(flags_of(header)), header) for header in HEADERS]
    for flags, headers in grouped(flags_of_headers).items():
        guarded = [header for header in headers if is_guarded(header)]
        if guarded:
            assert_compiles([*checking, *flags], in_one_unit(guarded), folder)
        if len(guarded) < len(headers):
            assert_compiles([*checking, *flags], sorted({*headers} - {*guarded}), folder)


def test_every_header_is_included():
    texts = "".join(path.read_text(encoding="utf-8")
                    for folder, ending in ((FOLDER, "h"), (FOLDER.parent / "templates", "jinja"))
                    for path in folder.rglob(f"*.{ending}"))
    # A template chooses folder and profile: "gyrospark/{{ ... }}/residual.h".
    texts = re.sub(r'(gyrospark/\S*)\{\{ "(\w+)" if \w+ else "(\w+)" \}\}(\S*)',
                   r"\1\2\4 \1\3\4", texts)
    for header in HEADERS:
        name = header.relative_to(FOLDER).as_posix()
        parent = name.replace("gyrospark/", "")
        assert name in texts or parent in texts, name


# ---------------------------------------------------------------- libraries


def compiled(folder, source, declarations, *flags, tables=None):
    """Return a library of a file of the toy."""
    folder.mkdir(parents=True, exist_ok=True)
    include = [f"-I{tables}"] if tables else []
    library = folder / "toy.so"
    process = call([*compiler(MAIN), "-O0", "-ffp-contract=off", "-Wpedantic", "-Wconversion",
                    "-Werror", "-shared", "-fPIC", *FLAGS, *include, *flags, TOY / source, "-o",
                    library, "-lm"])
    assert process.returncode == 0, process.stderr
    ffi = cffi.FFI()
    ffi.cdef(declarations)
    return ffi, ffi.dlopen(str(library))


def pointer(ffi, array, kind="double"):
    assert array.flags.c_contiguous
    return ffi.from_buffer(f"{kind} *", array)


# ---------------------------------------------------------------- linear algebra

LINEAR_ALGEBRA = """
int solve_dense(int n, double *A, double *b);
int solve_band(const double *A, double *b);
void eliminate(double *W, double *b);
void eliminate_lanes(double *W, double *b);
void invert_mass(int indefinite, const double *m, const double *b, const double *p, double *v);
void angle(long k, double dt, double rate, double out[2]);
double length_rest(double x, double y, double z);
"""


@pytest.fixture(scope="module")
def linear(tmp_path_factory):
    quarters = ",".join(half_pi_words(REALS["double"], 3))
    return compiled(tmp_path_factory.mktemp("linear"), "linear_algebra.c", LINEAR_ALGEBRA,
                    f"-DQUARTER={quarters}")


def test_angles_lose_no_digit_in_any_run(linear):
    """cos and sin of ½ k Δt ω, up to 10^9 steps and 10^9 rad, agree with 60 digits."""
    ffi, lib = linear
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


def test_the_length_of_a_vector_has_twice_the_digits(linear):
    _, lib = linear
    x, y, z = 1.25, 1e-3, 77.7
    with mp.workdps(60):
        exact = mp.sqrt(sum(mp.mpf(c) ** 2 for c in (x, y, z)))
        high = float(exact)
        assert lib.length_rest(x, y, z) * high == pytest.approx(float(exact - high), rel=1e-10)
    assert np.isnan(lib.length_rest(0, 0, 0))  # 0/0: the low word is 0


def rational_system(n, seed, band=None, order=None):
    """Return A, the exact x, and b = A x, all of integer entries."""
    rng = np.random.default_rng(seed)
    A = rng.integers(-9, 10, (n, n)) + 30 * np.eye(n, dtype=int)[::-1 if band is None else 1]
    if band is not None:
        A[abs(np.subtract.outer(order, order)) > band] = 0
    x = rng.integers(-9, 10, n)
    return A.astype(float), x.astype(float), (A @ x).astype(float)


@pytest.mark.parametrize("n", [1, 2, 5, 8])
def test_dense_systems_with_known_solutions(linear, n):
    """Rows in other units have the same solution, to the bit: they are scaled by powers of two."""
    ffi, lib = linear
    A, x, b = rational_system(n, n)
    expected = None
    for scale in (0, 600, -600):
        rows = 2.0 ** (scale * (np.arange(n) % 2))
        scaled, right = np.ascontiguousarray(A * rows[:, None]), b * rows
        assert lib.solve_dense(n, pointer(ffi, scaled), pointer(ffi, right)) == 0
        np.testing.assert_allclose(right, x, rtol=0, atol=640 * n * EPS)
        expected = right if expected is None else expected
        assert np.array_equal(right, expected)


SINGULAR, NOT_FINITE = 2, 3


@pytest.mark.parametrize(("rows", "status"), [
    ([[1.0, 2.0], [0.0, 0.0]], SINGULAR), ([[1.0, 2.0], [2.0, 4.0]], SINGULAR),
    ([[0.1, 0.7], [0.1, 0.7]], SINGULAR), ([[1.0, 2.0], [np.nan, 4.0]], NOT_FINITE),
    ([[1.0, 2.0], [np.inf, 4.0]], NOT_FINITE)])
def test_dense_systems_without_solution_have_a_status(linear, rows, status):
    ffi, lib = linear
    A, b = np.array(rows), np.ones(2)
    assert lib.solve_dense(2, pointer(ffi, A), pointer(ffi, b)) == status


def test_a_band_in_another_order_has_the_known_solution_or_a_status(linear):
    ffi, lib = linear
    for seed in range(4):
        A, x, b = rational_system(5, seed, 2, np.array([2, 0, 4, 1, 3]))
        assert lib.solve_band(pointer(ffi, A), pointer(ffi, b)) == 0
        np.testing.assert_allclose(b, x, rtol=0, atol=1e3 * EPS)
    A[1] = 0
    assert lib.solve_band(pointer(ffi, A), pointer(ffi, b)) == SINGULAR


@pytest.mark.parametrize("function", ["eliminate", "eliminate_lanes"])
def test_elimination_without_zeros_has_the_known_solution(linear, function):
    ffi, lib = linear
    W = np.array([[4.0, 1.0, 0.0], [1.0, 5.0, -2.0], [0.0, -2.0, 6.0]])
    x = np.array([3.0, -1.0, 2.0])
    entries, b = np.array([4.0, 5.0, 6.0, 1.0, -2.0]), W @ x
    getattr(lib, function)(pointer(ffi, entries), pointer(ffi, b))
    np.testing.assert_allclose(b, x, rtol=8 * EPS)


@pytest.mark.parametrize(("indefinite", "entries"), [
    (False, (2.0, 3.0, 4.0, 1.0, -2.0)), (True, (2.0, -3.0, 4.0, 1.0, -2.0)),
    (True, (1e-9, 1e-9, 1.0, 1.0, 1.0))])  # of which L D Lᵀ divides by 1e-9
def test_velocities_from_momenta(linear, indefinite, entries):
    """M v = p - b is solved by L D Lᵀ for a definite matrix, by Q R for any."""
    ffi, lib = linear
    M = np.diag(entries[:3])
    M[[1, 2], [0, 1]] = M[[0, 1], [1, 2]] = entries[3:]
    b, v = np.array([0.5, -1.0, 2.0]), np.array([3.0, -1.0, 2.0])
    p, velocities = M @ v + b, np.zeros(3)
    lib.invert_mass(indefinite, *(pointer(ffi, a) for a in (np.array(entries), b, p, velocities)))
    np.testing.assert_allclose(velocities, v, rtol=0, atol=32 * EPS * np.linalg.cond(M))


# ---------------------------------------------------------------- steppers of the toy

DECLARATIONS = """
int toy_lanes(void);
int toy_converges(int, const double *, const double *, double, int, int *);
void toy_converges_lanes(int, const double *, const double *, double, int, int *, int *);
void toy_predict(int, const double *, double *);
void toy_product_sum(int, int, const double *, double *);
void toy_crossings(long, const double *, double, double *, long *);
void toy_masks(const double *, const double *, const double *, const double *, double *);
int toy_least_squares(int, int, int, const double *, const double *, double, double *);
int toy_least_squares_limits(int);
void toy_table_product(int, const double *, const double *, double *);
void toy_small_lu(const double *, double *);
"""


class Toy:
    """A stepper of the toy; its steps are the steps of generated files, for which laws hold."""

    def __init__(self, folder, tables, macros):
        self.ffi, self.lib = compiled(folder, "calls.c", DECLARATIONS, *defined(macros),
                                      tables=tables)

    def pointers(self, *arrays):
        return [pointer(self.ffi, array) for array in arrays]


@pytest.fixture(scope="module")
def toy(tmp_path_factory, other_tables):
    """A stepper with two stages and two constraints."""
    return Toy(tmp_path_factory.mktemp("toys"), other_tables, {"TOY_CONSTRAINTS": 2})


# ---------------------------------------------------------------- lanes and sums


def test_masks_and_functions_of_lanes(toy):
    n, draw = toy.lib.toy_lanes(), np.random.default_rng(3)
    a, b, x, y = draw.normal(size=(4, n))
    b[0], x, out = a[0], abs(x), np.zeros((6, n))
    toy.lib.toy_masks(*toy.pointers(a, b, x, y, out))
    is_below = a < b
    expected = [np.where(is_below, x, y), np.maximum(a, b), np.minimum(a, b), np.sqrt(x), x**y,
                np.where(is_below, x, y)]
    np.testing.assert_allclose(out, expected, rtol=4 * EPS)
    assert np.array_equal(out[[0, 1, 2, 5]], [expected[i] for i in (0, 1, 2, 5)])


def test_each_lane_has_its_own_factors(toy):
    n, draw = toy.lib.toy_lanes(), np.random.default_rng(5)
    half = draw.normal(size=(n, 2, 2))
    W, x = half @ half.transpose(0, 2, 1) + np.eye(2), draw.normal(size=(n, 2))
    b = np.ascontiguousarray(np.einsum("lij,lj->il", W, x))
    toy.lib.toy_small_lu(*toy.pointers(np.ascontiguousarray(W.transpose(1, 2, 0)), b))
    np.testing.assert_allclose(b, x.T, rtol=0, atol=400 * EPS)


def test_sums_of_products_have_twice_the_digits(toy):
    """1e8·1e8 + 1 - 1e8·1e8, and products of random factors, agree with exact sums."""
    for factors in (np.array([[1e8, 1e8, 1], [1, 1, 1], [-1e8, 1e8, 1]]),
                    np.random.default_rng(1).normal(size=(40, 3))):
        sums = np.zeros(2)
        toy.lib.toy_product_sum(*factors.shape, *toy.pointers(factors, sums))
        with mp.workdps(60):
            exact = sum(mp.fprod(map(mp.mpf, row)) for row in factors)
            assert abs(mp.mpf(sums[0]) + mp.mpf(sums[1]) - exact) <= 1e-29 * abs(factors).max()**3


def test_products_by_even_and_odd_parts(tmp_path, other_tables):
    """Products agree with the full tables, rounded once more; of three numbers two are a pair."""
    s = 7
    toy = Toy(tmp_path, other_tables, {"TOY_STAGES": s, "TOY_TABLES": f'"tables{s}.h"',
                                       "GS_EVEN_ODD": 1})
    tables = FastTableau(gs.tableau("G-L", s)).tables(REALS["double"])
    draw = np.random.default_rng(s)
    for number, name in enumerate(("mu", "mu_hat", "nu", "nu_tilde")):
        table = np.array(tables[name], dtype=float)
        base, x, y = draw.normal(size=3), draw.normal(size=(s, 3)), np.zeros((s, 3))
        toy.lib.toy_table_product(number, *toy.pointers(base, x, y))
        expected = table @ x + base * (name != "nu")
        np.testing.assert_allclose(y, expected, rtol=0, atol=32 * EPS)


# ---------------------------------------------------------------- convergence test


def converges(toy, changes, defects=None, tolerance=0.0, max_iterations=50):
    """Return the iteration that ends a sequence of changes (no squares), and whether it failed."""
    change = np.array(changes, float) ** 2
    defect = np.zeros(len(change)) if defects is None else np.array(defects, float) ** 2
    failed = toy.ffi.new("int *")
    ended = toy.lib.toy_converges(len(change), *toy.pointers(change, defect), tolerance,
                                  max_iterations, failed)
    return ended, bool(failed[0])


def linear_changes(rate, start=0.1, floor=1e-17, count=60):
    return [max(start * rate**k, floor) for k in range(count)]


def test_iterations_end_where_the_next_change_is_round_off(toy):
    for rate in (1e-1, 1e-2, 1e-3):
        changes = linear_changes(rate, floor=0.0)
        ended, failed = converges(toy, changes)
        expected = [change * max(rate, 1e-2) for change in changes]  # of the next: no faster
        assert expected[ended - 1] < EPS / 256 < expected[ended - 2]
        assert not failed


def test_iterations_end_below_the_tolerance_and_where_they_stagnate(toy):
    assert converges(toy, linear_changes(0.1), tolerance=1.5e-6) == (6, False)  # 0.1, ..., 1e-6
    ended, failed = converges(toy, [1e-2, 1e-6, 1e-10, 1e-14] + [3e-15] * 20)
    assert 5 <= ended <= 12
    assert not failed


def test_iterations_go_on_while_constraints_are_not_met(toy):
    changes = [1e-2, 1e-6, 1e-10] + [1e-17] * 20
    early, _ = converges(toy, changes)
    late, failed = converges(toy, changes, [10.0 ** -k for k in range(23)])
    assert early < late
    assert not failed


@pytest.mark.parametrize("changes", [
    [0.1, 0.2, 0.4, 0.8, 1.6, 2.0], [0.1, 4.0], [np.nan], [0.1, np.nan],
    [0.1 * 0.99**k for k in range(60)]], ids=["grow", "far", "NaN", "NaN later", "slow"])
def test_iterations_fail_that_grow_or_are_too_slow(toy, changes):
    ended, failed = converges(toy, changes)
    assert failed
    assert 1 <= ended <= 9


def test_lanes_converge_as_numbers_do(toy):
    """Each lane ends at the iteration at which its numbers end by themselves."""
    n, draw = toy.lib.toy_lanes(), np.random.default_rng(11)
    sequences = [linear_changes(rate) for rate in 10 ** draw.uniform(-3, -0.5, n - 1)]
    sequences.append([0.1 * 1.5**k for k in range(60)])
    change = np.ascontiguousarray(np.array(sequences).T ** 2)
    ended, failed = np.zeros(n, np.int32), np.zeros(n, np.int32)
    toy.lib.toy_converges_lanes(60, *toy.pointers(change, np.zeros_like(change)), 0.0, 50,
                                *(pointer(toy.ffi, x, "int") for x in (ended, failed)))
    singles = [converges(toy, sequence) for sequence in sequences]
    assert list(zip(ended.tolist(), failed.astype(bool).tolist(), strict=True)) == singles


# ---------------------------------------------------------------- predictor


def predictions(toy, values):
    out = np.zeros_like(values)
    toy.lib.toy_predict(len(values), *toy.pointers(values, out))
    return out


def test_polynomials_are_continued_exactly(toy):
    """The order rises with the steps, to what the first series needs: a cubic takes four values."""
    k = np.arange(16.0)
    values = np.stack([k**3 / 8, 1 - k**2, 2 + k], axis=1)  # whose differences are not rounded
    predicted = predictions(toy, values)
    assert np.any(predicted[:5] != values[:5], axis=1).all()
    assert np.array_equal(predicted[5:], values[5:])
    lower = predictions(toy, values[:, ::-1].copy())
    assert np.array_equal(lower[3:, 0], values[3:, 2])
    assert np.all(lower[3:, 1:] != values[3:, 1::-1])  # as straight lines


def test_sums_of_exponentials_obey_the_fitted_recurrence(toy):
    """Spinning and damped motions have a recurrence for each series."""
    k = np.arange(120.0)
    values = np.stack([np.cos(0.7 * k) + 0.5 * np.sin(1.3 * k), np.exp(-0.01 * k) * np.cos(0.4*k),
                       1 + np.cos(0.2 * k + 1)], axis=1)
    predicted = predictions(toy, values)
    fitted = 17 + 2 * 23 + 2  # after the samples of the first fit
    assert abs(predicted[fitted:] - values[fitted:]).max() <= 1e-12
    assert abs(predicted[20:40] - values[20:40]).max() > 1e-9  # polynomials before it


@pytest.mark.parametrize("extra", [0, 1, 40])
def test_least_squares(toy, extra):
    """The solutions agree with numpy; the ridge is of the size of round-off."""
    draw = np.random.default_rng(extra)
    unknowns_max, sides = (toy.lib.toy_least_squares_limits(limit) for limit in (0, 1))
    for unknowns in (1, 4, unknowns_max):
        A = draw.normal(size=(unknowns + extra, unknowns)) + 4 * np.eye(unknowns + extra, unknowns)
        b, x = draw.normal(size=(unknowns + extra, sides)), np.zeros((unknowns, sides))
        assert toy.lib.toy_least_squares(unknowns, sides, unknowns + extra,
                                         *toy.pointers(A, b), 1e-14, pointer(toy.ffi, x)) == 0
        expected = np.linalg.lstsq(A, b, rcond=None)[0]
        np.testing.assert_allclose(x, expected, rtol=0, atol=1e-11)


def test_the_ridge_of_least_squares(toy):
    """|A x - b|² + r² |x|² is minimal, also where A does not have full rank."""
    A = np.array([[1.0, 2.0], [2.0, 4.0], [3.0, 6.0]])
    b, x, ridge = np.array([[1.0], [2.5], [2.0]]), np.zeros((2, 1)), 0.5
    assert toy.lib.toy_least_squares(2, 1, 3, *toy.pointers(A, b), ridge,
                                     pointer(toy.ffi, x)) == 0
    expected = np.linalg.solve(A.T @ A + ridge**2 * np.eye(2), A.T @ b)
    np.testing.assert_allclose(x, expected, rtol=0, atol=64 * EPS)


# ---------------------------------------------------------------- crossings


def test_rows_near_a_level_hold_every_crossing(toy):
    values = np.cos(0.3 * np.arange(40.0))
    last, rows = np.array([np.nan, np.nan]), np.array([-1, -1])
    toy.lib.toy_crossings(40, pointer(toy.ffi, values), 0.5, pointer(toy.ffi, last),
                          pointer(toy.ffi, rows, "long"))
    changes = np.nonzero(np.diff(np.sign(values - 0.5)))[0] + 1
    assert rows[0] <= changes.min()
    assert rows[1] >= changes.max()
    rows[:] = -1
    toy.lib.toy_crossings(40, pointer(toy.ffi, values / 100), 0.5, pointer(toy.ffi, last),
                          pointer(toy.ffi, rows, "long"))
    assert rows[0] == 0  # no earlier change shows that it is far
    rows[:] = -1
    toy.lib.toy_crossings(40, pointer(toy.ffi, values / 100), 0.5, pointer(toy.ffi, last),
                          pointer(toy.ffi, rows, "long"))
    assert list(rows) == [-1, -1]


# ---------------------------------------------------------------- README


def test_readme_lists_every_header():
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    table = text.partition("## Folders and headers")[2].partition("\n## ")[0]
    folder, names_of_headers = "", set()
    for row in re.findall(r"^\| (.*?) \|", table, re.MULTILINE):
        names = re.findall(r"`([\w./]+)`", row)
        if row.startswith("**"):
            (folder,) = names
        else:
            names_of_headers |= {folder + name.removesuffix(".h") for name in names}
    assert names_of_headers == {path.relative_to(FOLDER / "gyrospark").with_suffix("").as_posix()
                                for path in HEADERS}


def test_readme_names_what_exists():
    """Names of C and of files exist; those of the generated part, in the toy or in a template."""
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    sources = [*HEADERS, *TOY.iterdir(), *(FOLDER.parent / "templates").iterdir()]
    words = set(re.findall(r"\w+", "".join(
        path.read_text(encoding="utf-8") for path in sources if path.is_file())))
    files = {path.stem for path in HEADERS}
    for code in re.findall(r"`([A-Za-z_]\w*)(?:\([^`]*\))?`", text):
        assert code in words | files | {"lanes_f", "VARIANTS", "gyrospark"}, code
