"""Butcher tableaux completed to SPARK tableaux, from Python and from files."""

import json
from decimal import Decimal
from fractions import Fraction

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from gyrospark.certificates.observed_order import observed_order
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from gyrospark.generator.tableaux.conditions import check_tableau, remarks
from gyrospark.generator.tableaux.families import gauss_lobatto, lobatto_iiiab, radau_lobatto
from gyrospark.generator.tableaux.tableau import FIELDS

GAUSS = {"A": [["1/4", "1/4 - sqrt(3)/6"], ["1/4 + sqrt(3)/6", "1/4"]], "b": ["1/2", "1/2"]}
RADAU = {"A": [["5/12", "-1/12"], ["3/4", "1/4"]], "b": ["3/4", "1/4"]}
TRAPEZOID = {"A": [[0, 0], ["1/2", "1/2"]], "b": ["1/2", "1/2"]}
RUNGE_KUTTA = {"A": [[0, 0, 0, 0], ["1/2", 0, 0, 0], [0, "1/2", 0, 0], [0, 0, 1, 0]],
               "b": ["1/6", "1/3", "1/3", "1/6"]}
HEUN = {"A": [[0, 0, 0], ["1/3", 0, 0], [0, "2/3", 0]], "b": ["1/4", 0, "3/4"]}
RADAU_FILE = "examples/tableaux/radau_iia_2.json"


def numbers(tableau, digits=40):
    numeric = tableau.numeric(digits)
    return [mp.matrix(getattr(numeric, name)) for name in FIELDS]


def assert_same(tableau, expected, digits=40):
    """Compare two tableaux to so many digits in every part."""
    with mp.workdps(digits + 10):
        for matrix, expected_matrix in zip(
                numbers(tableau, digits), numbers(expected, digits), strict=True):
            assert mp.norm(matrix - expected_matrix, mp.inf) < mp.mpf(10) ** (2 - digits)


@pytest.mark.parametrize("family", [
    gauss_lobatto(1), gauss_lobatto(2), lobatto_iiiab(2), lobatto_iiiab(3)], ids=lambda t: t.name)
def test_a_family_is_completed_from_its_butcher_tableau(family):
    """A completion by Lagrange polynomials and partners equals the family's by the conditions."""
    tableau = gs.tableau(A=family.A, b=family.b, c=family.c)
    assert_same(tableau, family)
    assert tableau.order == tableau.free_order == family.order
    assert all(line.holds for line in check_tableau(tableau))


def test_radau_is_completed_with_its_partner_or_without():
    completed = gs.tableau(**RADAU)
    assert_same(completed, gs.tableau(RADAU_FILE))
    plain = gs.tableau(**RADAU, A_hat=RADAU["A"])
    assert_same(plain, radau_lobatto(2))
    assert (completed.order, plain.order) == (3, 3)


def test_entries_are_numbers_of_any_kind():
    """Exact entries stay exact; floats, long doubles and mpmath numbers make a rounded tableau."""
    exact = gs.tableau(**RADAU)
    as_fractions = [[Fraction(entry) for entry in row] for row in RADAU["A"]]
    for A, b in ((as_fractions, [Fraction(3, 4), Decimal("0.25")]),
                 (sp.Matrix(as_fractions), (sp.Rational(3, 4), 0.25))):
        assert_same(gs.tableau(A=A, b=b), exact)
    with mp.workdps(40):
        wide = [[mp.mpf(entry.numerator) / entry.denominator for entry in row]
                for row in as_fractions]
    long = np.array([[np.longdouble(entry.numerator) / entry.denominator for entry in row]
                     for row in as_fractions])
    assert gs.tableau(A=long, b=long[1]).order == 3  # its number of digits is the machine's
    for A, digits in ((np.array(as_fractions, float), 14), (wide, 38)):
        rounded = gs.tableau(A=A, b=[0.75, 0.25])
        assert_same(rounded, exact, digits)
        # one digit is lost by the 1/b of partners, with the smallest b = .25
        assert (rounded.decimal_digits, rounded.order) == (digits + 1, 3)
    assert exact.decimal_digits is None


def test_five_stages_in_decimals_keep_their_order():
    numeric = gauss_lobatto(5).numeric(20)
    tableau = gs.tableau(A=numeric.A, b=numeric.b, c=numeric.c)
    assert (tableau.order, tableau.p) == (10, 5)
    assert_same(tableau, gauss_lobatto(5), 17)


@pytest.mark.parametrize(("parts", "order", "p"), [
    ({**HEUN, "A_hat": HEUN["A"]}, 2, 1), *(
        pytest.param(*case, marks=pytest.mark.slow)  # three more orders to measure
        for case in ((RUNGE_KUTTA, 2, 1), (TRAPEZOID, 2, 1), ({"A": [[1]], "b": [1]}, 1, 1)))])
def test_the_proved_order_is_measured(parts, order, p):
    """Where nodes c coincide or a weight b is zero, there is one interval of constraint nodes."""
    tableau = gs.tableau(**parts)
    assert (tableau.order, tableau.p) == (order, p)
    assert observed_order(tableau) == pytest.approx(order, abs=0.2)


def test_a_method_is_of_its_own_order_without_constraints():
    """RK4 and its partner are a symplectic pair of order 2 with constraints, 3 without."""
    tableau = gs.tableau(**RUNGE_KUTTA, name="rk4")
    assert repr(tableau) == ("<Tableau rk4: 4 stages, p = 1, proved order 2 with constraints, "
                             "3 without>")
    assert any("order 2" in text for text in remarks(tableau))
    assert any("order 3" in text for text in remarks(tableau, constrained=False))
    generated = generate(
        Spec.of_tableau(None), system=systems.case("kepler").system, tableau=tableau)
    assert generated.scheme.order == 3


@pytest.mark.slow  # a stepper of one tableau
def test_a_method_has_the_order_without_constraints_that_is_proved():
    case = systems.case("kepler")
    step = gs.stepper(tableau=gs.tableau(**RUNGE_KUTTA, name="rk4"), **case.options)
    assert step.order == 3
    ends = [step.integrate(case.q, case.p, dt=1 / steps, steps=steps,
                           parameters=case.parameters).q[-1] for steps in (64, 128, 256)]
    slope = np.log2(np.linalg.norm(ends[0] - ends[1]) / np.linalg.norm(ends[1] - ends[2]))
    assert slope > 2.8


def test_a_file_is_completed_too(tmp_path):
    path = tmp_path / "own.json"
    path.write_text(json.dumps({"name": "own", **GAUSS, "order": 4, "symmetric": True}))
    assert_same(gs.tableau(path), gs.tableau("G-L", 2))
    path.write_text(json.dumps({"name": "own", **RADAU, "symmetric": True}))
    with pytest.raises(gs.errors.TableauError, match="symmetric"):
        gs.tableau(path)


@pytest.mark.parametrize(("parts", "words"), [
    (HEUN, "b_2 = 0.*A_hat"), ({"A": [["1/4"]], "b": ["1/2"]}, "residual 0.5"),
    ({**GAUSS, "c": ["1/4", "1/2"]}, r"C \("), ({"A": [[1, 2]], "b": [1]}, "A.*row 1"),
    ({**GAUSS, "b_tilde": ["1/2", "1/2"]}, "'b_tilde'.*'A_tilde'"),
    ({**GAUSS, "c_tilde": [0, 1]}, "'c_tilde'"), ({"A": [["x"]], "b": [1]}, "x"),
    ({"A": [[float("nan")]], "b": [1]}, "A.*nan"), ({"A": [[None]], "b": [1]}, "None"),
    ({"A": [[True]], "b": [1]}, "True"), ({"b": [1]}, "'A'"), ({**GAUSS, "name": "int"}, "'int'"),
    ({**GAUSS, "scheme": "G-L"}, "scheme"), ({**GAUSS, "stages": 2}, "stages"), ({}, "'A'")])
def test_what_cannot_be_completed_is_refused(parts, words):
    with pytest.raises(gs.InputError, match=words):
        gs.tableau(**parts)
