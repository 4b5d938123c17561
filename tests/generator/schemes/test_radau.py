"""Radau-L: coefficients, order, properties that it gives up, and dampers that do not ring."""

from __future__ import annotations

import json
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.certificates.observed_order import observed_order
from gyrospark.generator.spec import Spec
from gyrospark.generator.tableaux.conditions import check_tableau, counts
from gyrospark.generator.tableaux.families import gauss_lobatto, lobatto_iiiab, radau_lobatto
from gyrospark.generator.tableaux.nodes import radau_polynomial
from gyrospark.generator.tableaux.stability import _drop_round_off, stability, z
from gyrospark.generator.tableaux.tableau import FIELDS
from gyrospark.generator.tableaux.tableau_file import read_tableau
from own_tableaux import FOLDER, in_decimals, make
from python_newton import one_step
from reference import doubles, reference
from strategies import EPS, make_case

X = sp.Symbol("x")
SIX = sp.sqrt(6)
STAGES = (1, 2, 3, 5, 8)


@pytest.mark.parametrize("s", STAGES)
def test_nodes_are_those_of_radau(s):
    """The right Radau nodes are the roots of P_(s−1) − P_s on [−1, 1]."""
    legendre = sp.legendre(s - 1, 2 * X - 1) - sp.legendre(s, 2 * X - 1)
    assert sp.Poly(legendre, X, domain="QQ").monic() == radau_polynomial(s)


def test_coefficients_are_those_of_ehle_and_axelsson_and_rounding_is_dropped():
    two, three = radau_lobatto(2), radau_lobatto(3)
    assert two.A == two.A_hat == ((sp.Rational(5, 12), -sp.Rational(1, 12)),
                                  (sp.Rational(3, 4), sp.Rational(1, 4)))
    first = (88 - 7 * SIX) / 360, (296 - 169 * SIX) / 1800, (-2 + 3 * SIX) / 225
    weights = (16 - SIX) / 36, (16 + SIX) / 36, sp.Rational(1, 9)
    for derived, published in ((three.A[0], first), (three.A[-1], weights), (three.b, weights)):
        assert all(sp.expand(a - b) == 0 for a, b in zip(derived, published, strict=True))
    # A coefficient of z^k counts (2s)^k: a small one that decides |R| far out stays.
    unit = sp.Rational(1, 100)
    small = sp.Poly(1 + sp.Rational(1, 10_000) * z**4, z, domain="QQ")
    assert _drop_round_off(small, unit) == small  # 8^4/10^4 is no rounding beside 1
    tiny = sp.Poly(1 + sp.Rational(1, 10**7) * z**4, z, domain="QQ")
    assert _drop_round_off(tiny, unit) == sp.Poly(1, z, domain="QQ")


@pytest.mark.parametrize("s", STAGES)
def test_conditions_hold_as_far_as_claimed_and_fail_at_the_next_k(s):
    tableau = radau_lobatto(s)
    exact = {label: tableau.claims[label] for label in
             ("B", "B_hat", "B_tilde", "C", "C_hat", "C_tilde", "C_bar")}
    assert counts(tableau) == exact | {"D": s - 1, "D_hat": s - 1, "D_tilde": s, "D_bar": s - 1}
    assert tableau.order == 2 * s - 1
    report = {line.name: line for line in check_tableau(tableau)}
    assert all(line.holds for line in report.values())
    assert report["stability"].found == "L-stable, |R(∞)| = 0"
    assert report["symplectic, constraints"].found == "yes"
    assert report["symplectic, forces"].found == report["symmetric"].found == "no"


@pytest.mark.parametrize("s", [1, 2])
def test_order_is_measured(s):
    assert observed_order(radau_lobatto(s)) == pytest.approx(2 * s - 1, abs=0.1)


def pade(k, j):
    """Return numerator and denominator of Padé's approximant (k, j) of exp(z)."""
    z = sp.Symbol("z")

    def part(a, b, sign):
        return sp.Poly(sum(sp.Rational(sp.binomial(a, i), sp.ff(a + b, i)) * (sign * z) ** i
                           for i in range(a + 1)), z, domain="QQ")

    return part(k, j, 1), part(j, k, -1)


@pytest.mark.parametrize("s", range(1, 7))
def test_R_is_the_approximant_of_pade(s):
    """R is Padé's (s − 1, s) for Radau IIA and (s, s) for Gauss, of the highest order possible."""
    radau, gauss = stability(radau_lobatto(s)), stability(gauss_lobatto(s))
    assert (radau.numerator, radau.denominator) == pade(s - 1, s)
    assert (gauss.numerator, gauss.denominator) == pade(s, s)
    assert radau.l_stable
    assert gauss.kind == "A-stable"
    assert abs(gauss.at_infinity) == 1
    assert gauss.damping is None
    share, power = radau.damping  # |R(iy)|² = 1 − 2Cy^2k + …
    numerator, denominator = (
        sp.expand(polynomial.as_expr().subs("z", sp.I * X) * polynomial.as_expr().subs(
            "z", -sp.I * X)) for polynomial in (radau.numerator, radau.denominator))
    remainder = sp.Poly(numerator - denominator * (1 - 2 * share * X**power), X)
    assert min(k for (k,), c in remainder.terms()) > power
    assert radau.holds_with_constraints
    assert gauss.holds_with_constraints


def test_R_of_given_tableaux_and_of_those_that_have_none(tmp_path):
    assert stability(lobatto_iiiab(3)) is None
    assert stability(read_tableau(FOLDER / "radau_iia_2.json")) is None
    plain = stability(read_tableau(FOLDER / "radau_plain_2.json"))
    assert str(plain) == "L-stable, |R(∞)| = 0"
    assert plain.damping == (sp.Rational(1, 72), 4)
    few = stability(read_tableau(FOLDER / "gauss_3_2.json"))
    assert str(few) == "A-stable, |R(∞)| = 1"
    assert not few.holds_with_constraints  # three stages, two constraint nodes
    for entry, kind, size in (("1/3", "not A-stable", 2), ("2/3", "A-stable", sp.S.Half),
                              ("0", "not A-stable", None), ("-1", "not A-stable", 2)):
        table = make().collocation("theta", [sp.S(1) / 3], [sp.S(0), sp.S(1)], 1)
        path = tmp_path / "theta.json"
        path.write_text(make().text(table | {"A": [[sp.S(entry)]], "A_hat": [[sp.S(entry)]]}))
        method = stability(read_tableau(path))
        assert method.kind == kind
        assert method.at_infinity is None if size is None else abs(method.at_infinity) == size


@pytest.mark.parametrize("digits", [10, 16])
def test_decimals_are_checked_to_their_digits(tmp_path, digits):
    rounded = in_decimals({key: getattr(radau_lobatto(3), key) for key in FIELDS}, digits)
    path = tmp_path / "radau_3.json"
    path.write_text(json.dumps({"name": "radau_3"} | rounded), encoding="utf-8")
    method = stability(read_tableau(path))
    assert method.kind == "L-stable"
    assert method.damping[1] == 6


few = pytest.mark.parametrize("s", [2, *(pytest.param(s, marks=pytest.mark.slow) for s in (1, 3))])


@few
def test_a_step_is_the_root_that_fifty_digits_find(s):
    case = make_case("gamma", (1.0, 1.7, 0.6), 0.2, 0.9, (0.5, -0.3, 0.7, 0.4), (0.9, -1.4, 1.1),
                     0.05)
    exact = reference(Spec("Radau-L", s), case).step()
    for solver in ("auto", "newton", "fixed-point", "python"):
        q, p = one_step(gs.stepper("Radau-L", s), case.q, case.p, solver=solver, **case.run)
        assert np.abs(q - doubles(exact.q)).max() < 16 * EPS
        assert np.abs(p - doubles(exact.p)).max() < 64 * EPS


@cache
def held() -> gs.System:
    """Return a particle on the line 2x + y − 2z = 0, x = y: damped along z, or on a spring."""
    q, p = sp.symbols("x y z", real=True), sp.symbols("u v w", real=True)
    c, k = sp.symbols("c k")
    return gs.System(q, p, (c, k), (p[0]**2 + p[1]**2 / 2 + p[2]**2 / 3 + k * q[2]**2) / 2,
                     (2 * q[0] + q[1] - 2 * q[2], q[0] - q[1]), name="held",
                     forces=(0, 0, -c * p[2]))


@pytest.mark.slow  # a stepper of one system for each scheme
@pytest.mark.parametrize("scheme", [("Radau-L", 1), ("Radau-L", 2), ("Radau-L", 3), ("G-L", 2)])
def test_a_constrained_damper_falls_by_R(scheme):
    """q = (2, 2, 3) r: T = ½ (4 + 8 + 27) ṙ², and the damper takes 3c · 9ṙ: λ = 27c/39."""
    step, method = gs.stepper(*scheme, system=held()), stability(gs.tableau(*scheme))
    start = np.array([2.0, 4.0, 9.0])  # M (2, 2, 3)
    for size in (0.1, 10.0, 1e3, 1e6):
        run = step.integrate(np.zeros(3), start, dt=0.01, steps=1,
                             parameters={"c": size * 39 / 27 / 0.01, "k": 0})
        R = float(method.numerator.eval(-sp.Rational(size)) / method.denominator.eval(
            -sp.Rational(size)))
        assert run.p[1] == pytest.approx(R * start, abs=64 * EPS * 9)


def test_the_certificate_tells_what_is_given_up():
    lines = {line.quantity.split(",")[0]: line for line in gs.certify(
        gs.problems.fast_top(), "Radau-L", 2, dt=1e-3, steps=50).lines}
    assert lines["loop invariant ∮p·dq"].expected == "not guaranteed"
    assert "b_i â_ij + b̂_j a_ji = b_i b̂_j" in lines["loop invariant ∮p·dq"].why
    assert lines["reversal"].expected == "not guaranteed"
    assert lines["numerical damping"].found.startswith("0.014 (ωΔt)^4")
    assert "dampers" not in lines
    assert lines["order"].holds
