"""Nodes, coefficients and conditions of the families, against the paper and independent sums."""

import dataclasses
import itertools
from fractions import Fraction
from functools import cache

import mpmath
import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.core.errors import InputError, TableauError
from gyrospark.core.real_types import REALS, round_binary
from gyrospark.generator.tableaux.conditions import check_tableau, counts, holds_to, order
from gyrospark.generator.tableaux.enclosures import horner
from gyrospark.generator.tableaux.families import gauss_lobatto, lobatto_iiiab, solve_rows
from gyrospark.generator.tableaux.node_algebra import PolynomialNodes, column, power
from gyrospark.generator.tableaux.nodes import (
    BITS,
    Enclosure,
    enclose_roots,
    exact_roots,
    gauss_polynomial,
    lobatto_polynomial,
)
from gyrospark.generator.tableaux.tableau import FIELDS

X = sp.Symbol("x")
GAUSS, LOBATTO = (1, 2, 3, 5), (2, 3, 6)
FAMILY = [("gl", s) for s in GAUSS] + [("liiiab", s) for s in LOBATTO]
every = pytest.mark.parametrize(("family", "s"), FAMILY, ids=[f"{f}{s}" for f, s in FAMILY])
WHICH = {"gauss": (gauss_polynomial, 1), "lobatto": (lobatto_polynomial, 2)}
nodes_of_each = pytest.mark.parametrize(
    ("kind", "s"), [(kind, s) for kind, (_, least) in WHICH.items() for s in (1, 2, 3, 8)
                    if s >= least])


def make(family, s):
    return gauss_lobatto(s) if family == "gl" else lobatto_iiiab(s)


# ---------------------------------------------------------------- nodes


@nodes_of_each
def test_nodes_are_roots_of_A17_and_A18_that_is_of_legendre_polynomials(kind, s):
    polynomial = WHICH[kind][0](s).as_expr().subs(sp.Symbol("x"), X)
    if kind == "gauss":
        definition = sp.diff(sp.expand((X * (X - 1)) ** s), X, s)
        legendre = sp.legendre(s, 2 * X - 1)
    else:
        definition = sp.diff(sp.expand((X * (X - 1)) ** (s - 1)), X, s - 2)
        legendre = X * (X - 1) * sp.diff(sp.legendre(s - 1, X), X).subs(X, 2 * X - 1)
    for reference in (definition, legendre):
        assert sp.Poly(reference, X, domain="QQ").monic() == sp.Poly(polynomial, X, domain="QQ")


def value_at(polynomial, point):
    return sum(Fraction(int(c.p), int(c.q)) * point**k for (k,), c in polynomial.terms())


@nodes_of_each
def test_enclosures_are_certified_by_sign_changes_disjoint_and_complete(kind, s):
    polynomial = WHICH[kind][0](s)
    enclosures = enclose_roots(polynomial)
    assert len(enclosures) == s
    for e in enclosures:
        if e.radius == 0:
            assert value_at(polynomial, e.centre) == 0
        else:
            assert e.radius == Fraction(1, 2**512)
            low = value_at(polynomial, e.centre - e.radius)
            assert low * value_at(polynomial, e.centre + e.radius) < 0
    for e, after in itertools.pairwise(enclosures):
        assert e.centre + e.radius < after.centre - after.radius
    assert enclosures[0].centre >= 0
    assert enclosures[-1].centre <= 1


@cache
def independent_nodes(kind, s):
    """Return the nodes by Newton's method from NumPy's, to 100 digits."""
    with mpmath.workdps(110):
        if kind == "gauss":
            start = np.polynomial.legendre.leggauss(s)[0]
            roots = [mpmath.findroot(lambda t: mpmath.legendre(s, t), mpmath.mpf(float(t)))
                     for t in start]
        else:
            inner = np.polynomial.legendre.Legendre.basis(s - 1).deriv().roots()
            # (1 − t²) P′_n = n (P_{n−1} − t P_n)
            roots = [mpmath.findroot(lambda t: mpmath.legendre(s - 2, t)
                                     - t * mpmath.legendre(s - 1, t), mpmath.mpf(float(t)))
                     for t in np.sort(inner)]
            roots = [mpmath.mpf(-1), *roots, mpmath.mpf(1)]
        return [(1 + t) / 2 for t in roots]


@pytest.mark.parametrize(("kind", "s"), [(k, s) for k in WHICH for s in (2, 3, 6)])
def test_exact_roots_lie_in_the_enclosures_in_the_same_order(kind, s):
    polynomial = WHICH[kind][0](s)
    for root, e in zip(exact_roots(polynomial), enclose_roots(polynomial), strict=True):
        assert abs(sp.N(root, 120) - sp.Rational(e.centre)) < sp.Float("1e-115")


@pytest.mark.parametrize("kind", WHICH)
def test_exact_roots_are_radicals_while_short_and_satisfy_the_polynomial(kind):
    polynomial = WHICH[kind][0](5)
    for root in exact_roots(polynomial):
        assert not root.has(sp.CRootOf)
        assert sp.radsimp(sp.expand(polynomial.as_expr().subs(polynomial.gen, root))) == 0


def test_conditions_that_all_hold_are_counted_to_the_limit():
    tableau = gauss_lobatto(1)
    for first_wrong, count in ((1, 0), (3, 2), (4, 3), (5, 3)):
        assert holds_to(lambda k, wrong=first_wrong: column([sp.QQ(k == wrong)], sp.QQ),
                        tableau, 3) == count


def test_what_gives_no_tableau_is_refused():
    for call in (lambda: lobatto_polynomial(1), lambda: lobatto_iiiab(1)):
        with pytest.raises(TableauError, match="at least 2"):
            call()
    with pytest.raises(TableauError, match=r"1 stage.* 0"):
        gauss_lobatto(0)
    nodes = PolynomialNodes(gauss_polynomial(3))
    with pytest.raises(TableauError, match=r"2 .* 3 columns"):
        solve_rows(nodes, nodes, 2)
    with pytest.raises(AttributeError, match="'A_check'"):
        _ = gauss_lobatto(1).A_check
    with pytest.raises(ArithmeticError, match="too wide"):
        REALS["double"].round(Enclosure(Fraction(1, 3), Fraction(1, 10**10)))


@pytest.mark.parametrize("polynomial", [
    sp.Poly((X - 1) ** 2, X), sp.Poly(X**2 + 1, X),
    # two roots that are one number of 512 bits
    sp.Poly((X - 1) * (X - 1 - sp.Rational(1, 2**514)), X)])
def test_polynomial_without_simple_real_roots_is_refused(polynomial):
    with pytest.raises(TableauError, match=r"change|distinct|simple"):
        enclose_roots(polynomial)


def test_roots_of_any_sign_are_enclosed():
    enclosures = enclose_roots(sp.Poly((X + 2) * (X + 1) * (X - 3), X))
    assert enclosures == tuple(Enclosure(Fraction(x), Fraction(0)) for x in (-2, -1, 3))


fixed = st.tuples(st.integers(-(2**600), 2**600), st.integers(0, 2**300))
in_unit = st.tuples(st.integers(-(2**BITS) + 2**301, 2**BITS - 2**301), st.integers(0, 2**300))
corners = st.lists(st.sampled_from([-1, 0, 1]), min_size=6, max_size=6)


@settings(max_examples=100, derandomize=True)
@given(st.lists(fixed, min_size=1, max_size=5), in_unit, corners)
def test_enclosure_of_a_polynomial_contains_its_value_at_any_members(coefficients, ball, corner):
    centre, radius = horner(coefficients, ball, BITS)
    point = Fraction(ball[0] + corner[-1] * ball[1], 2**BITS)
    value = sum((c + t * r) * point**k
                for k, ((c, r), t) in enumerate(zip(coefficients, corner, strict=False)))
    assert abs(value - centre) <= radius


# ---------------------------------------------------------------- the printed tableaux


def matrix(rows):
    return tuple(tuple(sp.sympify(e) for e in row) for row in rows)


def vector(entries):
    return tuple(sp.sympify(e) for e in entries)


IIIA2, IIIB2 = [[0, 0], ["1/2", "1/2"]], [["1/2", 0], ["1/2", 0]]
IIIA3 = [[0, 0, 0], ["5/24", "1/3", "-1/24"], ["1/6", "2/3", "1/6"]]
IIIB3 = [["1/6", "-1/6", 0], ["1/6", "1/3", 0], ["1/6", "5/6", 0]]
PRINTED = {
    ("gl", 1): {
        "A": matrix([["1/2"]]), "A_hat": matrix([["1/2"]]), "A_tilde": matrix([["1/2", 0]]),
        "A_bar": matrix([[0], [1]]), "b": vector([1]), "b_hat": vector([1]),
        "b_tilde": vector(["1/2", "1/2"]), "c": vector(["1/2"]), "c_tilde": vector([0, 1]),
    },
    ("gl", 2): {
        "A": matrix([["1/4", "1/4 - sqrt(3)/6"], ["1/4 + sqrt(3)/6", "1/4"]]),
        "A_hat": matrix([["1/4", "1/4 - sqrt(3)/6"], ["1/4 + sqrt(3)/6", "1/4"]]),
        "A_tilde": matrix([["1/6", "1/3 - sqrt(3)/6", 0], ["1/6", "1/3 + sqrt(3)/6", 0]]),
        "A_bar": matrix([[0, 0], ["1/4 + sqrt(3)/8", "1/4 - sqrt(3)/8"], ["1/2", "1/2"]]),
        "b": vector(["1/2", "1/2"]), "b_hat": vector(["1/2", "1/2"]),
        "b_tilde": vector(["1/6", "2/3", "1/6"]),
        "c": vector(["1/2 - sqrt(3)/6", "1/2 + sqrt(3)/6"]), "c_tilde": vector([0, "1/2", 1]),
    },
    ("liiiab", 2): {
        "A": matrix(IIIA2), "A_hat": matrix(IIIB2), "A_tilde": matrix(IIIB2),
        "A_bar": matrix(IIIA2), **dict.fromkeys(["b", "b_hat", "b_tilde"],
                                                vector(["1/2", "1/2"])),
        "c": vector([0, 1]), "c_tilde": vector([0, 1]),
    },
    ("liiiab", 3): {
        "A": matrix(IIIA3), "A_hat": matrix(IIIB3), "A_tilde": matrix(IIIB3),
        "A_bar": matrix(IIIA3), **dict.fromkeys(["b", "b_hat", "b_tilde"],
                                                vector(["1/6", "2/3", "1/6"])),
        "c": vector([0, "1/2", 1]), "c_tilde": vector([0, "1/2", 1]),
    },
}


@pytest.mark.parametrize(("family", "s"), PRINTED, ids=[f"{f}{s}" for f, s in PRINTED])
def test_printed_tableaux_and_erratum_14_exactly(family, s):
    for field in FIELDS:
        assert getattr(make(family, s), field) == PRINTED[family, s][field], field


# ---------------------------------------------------------------- conditions, exactly


@every
def test_conditions_hold_as_far_as_claimed_and_fail_at_the_next_k(family, s):
    tableau = make(family, s)
    counted = counts(tableau)
    exact = {label: tableau.claims[label] for label in
             ("B", "B_hat", "B_tilde", "C", "C_hat", "C_tilde", "C_bar")}
    if family == "gl":
        # C̄ holds one further than the paper needs: ∫₀ᶜ of the Gauss polynomial vanishes at
        # every Lobatto node c; D̃ likewise.
        exact["C_bar"] = s + 1
        exact |= {"D": s, "D_hat": s, "D_tilde": s + 1, "D_bar": s}
    else:
        exact |= {"D": s - 2, "D_hat": s, "D_tilde": s, "D_bar": s - 2}
    assert counted == exact


@every
def test_order_symplecticity_symmetry_and_structure_are_proved(family, s):
    tableau = make(family, s)
    report = check_tableau(tableau)
    assert all(line.holds for line in report)
    assert {line.residual for line in report} == {"0"}
    assert tableau.order == order(tableau) == (2 * s if family == "gl" else 2 * s - 2)
    for name in ("symplectic, forces", "symplectic, constraints", "symmetric"):
        assert next(line for line in report if line.name == name).required
    (line,) = [line for line in report if line.name == "symmetric"]
    assert line.found == "yes"


@pytest.mark.parametrize(("family", "s"), [("gl", 8), ("liiiab", 8)])
def test_order_is_proved_in_rational_arithmetic_alone(family, s, monkeypatch):
    """No residual of a derived tableau becomes a SymPy expression; that took seconds."""
    tableau = dataclasses.replace(make(family, s))  # not proved before
    for name in ("conditions.vanishes_to", "node_algebra.enclosure"):
        monkeypatch.setattr(f"gyrospark.generator.tableaux.{name}", None)
    assert tableau.order == (2 * s if family == "gl" else 2 * s - 2)


@nodes_of_each
def test_functions_on_the_nodes_multiply_as_polynomials_modulo_M(kind, s):
    polynomial = sp.Poly(WHICH[kind][0](s).as_expr(), sp.Symbol("x"), domain="QQ")
    nodes = PolynomialNodes(polynomial)
    f = column([sp.QQ(1, k + 2) - k for k in range(s)], sp.QQ)
    for k in (0, 1, s - 1, s, s + 2):
        product = to_polynomial(f) * sp.Poly(sp.Symbol("x") ** k, sp.Symbol("x"), domain="QQ")
        assert to_polynomial(nodes.multiply(f) * power(nodes, k)) == product.rem(polynomial)


def to_polynomial(f):
    return sp.Poly([sp.QQ.to_sympy(c) for c in reversed(f.to_list_flat())], sp.Symbol("x"),
                   domain="QQ")


# ---------------------------------------------------------------- numbers


@cache
def numbers(family, s):
    return make(family, s).numeric(60)


def flat(entries):
    return ([e for row in entries for e in row] if isinstance(entries[0], list | tuple)
            else list(entries))


def lagrange_integral(nodes, j, upper):
    """Return ∫₀^upper ℓ_j by polynomial arithmetic."""
    coefficients, scale = [mpmath.mpf(1)], mpmath.mpf(1)  # lowest power first
    for i, node in enumerate(nodes):
        if i != j:
            shifted = [mpmath.mpf(0), *coefficients]
            coefficients = [up - node * down for up, down in
                            zip(shifted, [*coefficients, mpmath.mpf(0)], strict=True)]
            scale *= nodes[j] - node
    return sum(c * upper ** (k + 1) / (k + 1) for k, c in enumerate(coefficients)) / scale


def independent_tableau(family, s):
    """Return the tableau from Lagrange integrals and erratum 13, in the working precision."""
    c = independent_nodes("gauss" if family == "gl" else "lobatto", s)
    c_tilde = independent_nodes("lobatto", s + 1) if family == "gl" else c
    b = [lagrange_integral(c, j, mpmath.mpf(1)) for j in range(len(c))]
    b_tilde = [lagrange_integral(c_tilde, j, mpmath.mpf(1)) for j in range(len(c_tilde))]
    A = [[lagrange_integral(c, j, u) for j in range(s)] for u in c]
    A_bar = [[lagrange_integral(c, j, u) for j in range(s)] for u in c_tilde]

    def conjugate(of, weights):
        return [[weights[j] * (1 - of[j][i] / b[i]) for j in range(len(weights))] for i in range(s)]

    return {"A": A, "A_hat": conjugate(A, b), "A_tilde": conjugate(A_bar, b_tilde),
            "A_bar": A_bar, "b": b, "b_hat": b, "b_tilde": b_tilde, "c": c, "c_tilde": c_tilde}


@pytest.mark.parametrize(("family", "s"), [("gl", 7), ("liiiab", 8)])
def test_numeric_entries_are_lagrange_integrals_to_60_digits(family, s):
    numeric = numbers(family, s)
    with mpmath.workdps(100):
        for field, integrals in independent_tableau(family, s).items():
            entries = zip(flat(getattr(numeric, field)), flat(integrals), strict=True)
            assert max(abs(a - b) for a, b in entries) < mpmath.mpf("1e-60"), field


@every
def test_numbers_have_the_exact_structure_of_the_step(family, s):
    """Zeros and ones make Q̃_0 = q_k, Q̃_p = q_{k+1} and Λ_p only in T2, without round-off."""
    numeric = numbers(family, s)
    assert all(e == 0 for e in numeric.A_bar[0])
    assert numeric.A_bar[-1] == pytest.approx(numeric.b, rel=1e-55, abs=0)
    assert all(row[-1] == 0 for row in numeric.A_tilde)
    assert (numeric.c_tilde[0], numeric.c_tilde[-1]) == (0, 1)


def test_numeric_has_the_digits_asked_for():
    with mpmath.workdps(420):
        half_width = mpmath.sqrt(3) / 6
        for digits in (5, 50, 120, 400, np.int64(160)):
            entry = gauss_lobatto(2).numeric(digits).c[0]
            assert abs(entry - (mpmath.mpf(1) / 2 - half_width)) < mpmath.mpf(10) ** -int(digits)


@pytest.mark.parametrize(("family", "s"), [("gl", 8), ("liiiab", 7)])
def test_numeric_refines_until_every_digit_is_certain(family, s):
    coarse, fine = make(family, s).numeric(200), make(family, s).numeric(450)
    with mpmath.workdps(500):
        for field in FIELDS:
            pairs = zip(flat(getattr(coarse, field)), flat(getattr(fine, field)), strict=True)
            assert all(abs(a - b) < mpmath.mpf("1e-200") for a, b in pairs), field
        moments = [mpmath.fsum(fine.b), mpmath.fdot(fine.b, fine.c)]
        assert abs(moments[0] - 1) < mpmath.mpf("1e-445")
        assert abs(moments[1] - mpmath.mpf(1) / 2) < mpmath.mpf("1e-445")


@pytest.mark.parametrize("digits", [0, -5, 1001, 10**9, True, 50.0, "50", None])
def test_digits_that_numeric_cannot_give_are_refused(digits):
    with pytest.raises(InputError, match=r"digits.* 1 to 1000") as refusal:
        gauss_lobatto(2).numeric(digits)
    assert repr(digits) in str(refusal.value)


# ---------------------------------------------------------------- rounding


def is_correctly_rounded(rounded, value, bits):
    """Return whether a fraction has that many bits and is within half a unit of its last place."""
    if rounded == 0:
        return value == 0
    odd = rounded.numerator
    while odd % 2 == 0:
        odd //= 2
    fits = odd.bit_length() <= bits and rounded.denominator & (rounded.denominator - 1) == 0
    size = abs(rounded)
    exponent = size.numerator.bit_length() - size.denominator.bit_length()
    if size < Fraction(2) ** exponent:
        exponent -= 1
    ulp = Fraction(2) ** (exponent + 1 - bits)
    below = ulp / 2 if size == Fraction(2) ** exponent and abs(value) < size else ulp
    return fits and abs(rounded - value) <= below / 2


@every
def test_emitted_numbers_are_the_correctly_rounded_exact_values(family, s):
    numeric = numbers(family, s)
    tableau = make(family, s)
    for real in REALS.values():
        rounded = tableau.map_enclosures(real.round)
        for field in FIELDS:
            entries = zip(flat(rounded[field]), flat(getattr(numeric, field)), strict=True)
            for fraction, number in entries:
                digits = mpmath.nstr(number, 60, min_fixed=0, max_fixed=0)
                assert is_correctly_rounded(fraction, Fraction(digits), real.bits)
                if real.name == "double":
                    assert float(fraction) == float(digits)


@pytest.mark.parametrize("real", REALS.values(), ids=REALS)
def test_literals_read_back_to_the_rounded_value(real):
    for e in (0, 1, -2, Fraction(1, 3), Fraction(-7, 10**9), Fraction(10**30, 7), 123456789,
              Fraction(5, 8), Fraction(1, 10)):
        text = real.literal(Fraction(e))
        assert text.endswith(real.suffix)
        assert any(mark in text for mark in ".e")  # a floating-point constant, not an int
        digits = Fraction(text.removesuffix(real.suffix))
        assert round_binary(digits, real.bits) == round_binary(Fraction(e), real.bits)


@settings(max_examples=60, derandomize=True)
@given(st.integers(2**52, 2**60), st.integers(0, 8))
def test_ties_go_to_even_as_in_python(integer, shift):
    value = Fraction(integer, 2**shift)
    assert round_binary(value, 53) == Fraction(float(value))
    assert round_binary(-value, 53) == -round_binary(value, 53)


@settings(max_examples=40, derandomize=True)
@given(st.fractions(), st.sampled_from([24, 53, 64, 113]))
def test_rounding_is_to_nearest_and_idempotent_at_any_width(value, bits):
    rounded = round_binary(value, bits)
    assert is_correctly_rounded(rounded, value, bits)
    assert round_binary(rounded, bits) == rounded


# ---------------------------------------------------------------- mutation


def mutated(tableau, field, i, j, change):
    matrix = tableau.basis[field]
    rows = [list(row) for row in matrix.to_list()]
    rows[i][j] += sp.QQ(*change)
    changed = type(matrix)(rows, matrix.shape, matrix.domain)
    return dataclasses.replace(tableau, basis=tableau.basis | {field: changed})


def is_refuted(tableau):
    return any(line.required and not line.holds for line in check_tableau(tableau))


@pytest.mark.parametrize("field", FIELDS)
def test_one_wrong_coefficient_anywhere_is_refuted(field):
    tableau = gauss_lobatto(2)
    rows, columns = tableau.basis[field].shape
    for i, j in itertools.product(range(rows), range(columns)):
        assert is_refuted(mutated(tableau, field, i, j, (1, 10**6))), (i, j)


def test_small_errors_wrong_nodes_and_claims_beyond_the_truth_are_refuted():
    for field in ("A_hat", "b_tilde"):
        assert is_refuted(mutated(lobatto_iiiab(4), field, -1, -1, (1, 10**30)))
    tableau = gauss_lobatto(2)  # c̃ + ε x(1 − x): the ends stay
    for i, change in ((1, (1, 1000)), (2, (-1, 1000))):
        tableau = mutated(tableau, "c_tilde", i, 0, change)
    assert is_refuted(tableau)
    tableau = gauss_lobatto(2)
    for label in ("B", "B_tilde", "C", "C_hat", "C_tilde", "order"):
        beyond = tableau.claims | {label: tableau.claims[label] + 1}
        assert is_refuted(dataclasses.replace(tableau, claims=beyond)), label
