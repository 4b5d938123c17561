"""Compositions of exact flows: numbers, order conditions, certificates, search."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from fractions import Fraction
from math import factorial

import mpmath as mp
import numpy as np
import pytest

from gyrospark.certificates.composition_checks import (
    _interval_text,
    check_composition,
    error_constant,
    force_gradient_residuals,
    step_coefficients,
)
from gyrospark.certificates.composition_order import observed_composition_order
from gyrospark.certificates.composition_proofs import OrderConditions
from gyrospark.certificates.lyndon_words import (
    exponential,
    factors_of,
    is_lyndon,
    lyndon_words,
    target,
    words_up_to,
)
from gyrospark.core.errors import InputError
from gyrospark.generator.tableaux.compositions import (
    COMPOSITIONS,
    PATH,
    composition,
    composition_named,
    flatten,
)
from gyrospark.studies import composition_search
from gyrospark.studies.composition_search import FloatConditions, search

#: Closed forms: Chin's a₀ and c, Suzuki's w, and w where the base has order 4.
CLOSED = {
    "G4": lambda: [(1 - 1 / mp.sqrt(3)) / 2, (2 - mp.sqrt(3)) / 48],
    "Suzuki4": lambda: [1 / (4 - mp.cbrt(4))] * 2,
    "G6": lambda: [1 / (4 - mp.root(4, 5))] * 2,
}


def test_an_interval_is_rounded_outwards_to_three_digits():
    assert _interval_text(mp.iv.mpf([1.2345, 1.2345])) == "[1.23e+0, 1.24e+0]"


def moved(original, kind, i, shift):
    """Return a composition with one number, and its mirror image, moved by this much."""
    numbers = list(getattr(original, kind))
    for j in {i, len(numbers) - 1 - i}:
        numbers[j] += shift
    middle = len(numbers) // 2
    if kind != "gradients" and i != middle:
        for j in {middle, len(numbers) - 1 - middle}:
            numbers[j] -= 2 * shift / (2 - len(numbers) % 2)
    return replace(original, **{kind: tuple(numbers)})


@pytest.mark.parametrize("order", [2, 4, 6, 8, 10])
@pytest.mark.parametrize("gradients", [False, True])
def test_each_order_has_a_composition(order, gradients):
    chosen = composition(order, gradients)
    assert chosen.order == order
    assert chosen is COMPOSITIONS[chosen.name]
    assert chosen.has_gradients == (gradients and 2 < order < 10)
    assert len(chosen.drifts) == chosen.stages + 1 == len(chosen.gradients) + 1


@pytest.mark.parametrize("order", [7, 0, -4, 12, "8", None, 4.5, True])
def test_other_orders_are_refused(order):
    with pytest.raises(InputError, match="2, 4, 6, 8 or 10"):
        composition(order)


def test_names_are_proposed():
    with pytest.raises(InputError, match="SABAG6"):
        composition_named("sabag-6")


@pytest.mark.parametrize("name", COMPOSITIONS)
def test_numbers_are_symmetric_and_consistent(name):
    entry = COMPOSITIONS[name]
    assert sum(entry.drifts) == sum(entry.kicks) == 1
    for numbers in (entry.drifts, entry.kicks, entry.gradients, entry.weights):
        assert numbers == numbers[::-1]
    if entry.base:
        parts = (entry.drifts, entry.kicks, entry.gradients)
        assert flatten(COMPOSITIONS[entry.base], entry.weights) == parts


def test_only_force_gradients_go_forward_beyond_order_two():
    """Without them, an order above 2 takes a negative time (Sheng 1989, Suzuki 1991)."""
    forward = {name for name, entry in COMPOSITIONS.items() if entry.forward}
    assert forward == {"Strang", "G4", "SABAG6"}


@pytest.mark.parametrize("name", CLOSED)
def test_closed_forms(name):
    with mp.workdps(70):
        for value, exact in zip(OrderConditions(COMPOSITIONS[name]).unknowns, CLOSED[name](),
                                strict=True):
            assert abs(mp.mpf(value.numerator) / value.denominator - exact) < mp.mpf(10) ** -60


def test_nodes_of_sabag_are_gaussian():
    """T has Gauss nodes, V has Gauss weights, and c has the least norm."""
    sabag, (x, w) = COMPOSITIONS["SABAG6"], np.polynomial.legendre.leggauss(6)
    assert np.allclose(np.cumsum([float(a) for a in sabag.drifts])[:-1], (x + 1) / 2, atol=1e-15)
    assert np.allclose([float(b) for b in sabag.kicks], w / 2, atol=1e-15)
    conditions = OrderConditions(sabag)
    x = np.array([float(value) for value in conditions.unknowns])
    F, J = (values[: len(conditions.words)] for values in FloatConditions(conditions).evaluate(x))
    direction = np.linalg.svd(J)[2][-1]  # the family: its direction has no part in c
    assert abs(direction[5:] @ x[5:]) < 1e-7
    assert np.abs(F).max() < 1e-14


def test_lyndon_words_are_counted_by_their_formula():
    """Witt's formula counts them, for free Lie algebras of two generators."""
    counts = [sum(len(w) == n and is_lyndon(w) for w in words_up_to("AB", 9)) for n in range(10)]
    assert counts == [0, 2, 1, 2, 3, 6, 9, 18, 30, 56]
    assert [len(lyndon_words("13579", order - 1)) for order in (4, 6, 8, 10)] == [2, 4, 8, 16]
    assert [len(lyndon_words("1579", order - 1)) for order in (6, 8)] == [2, 4]


def test_the_exponential_of_a_sum_of_numbers_has_its_square():
    """exp((a + 2b) A) has (a + 2b)²/2 at AA."""
    series = exponential({"A": {(1, 0): Fraction(1), (0, 1): Fraction(2)}}, 2)
    assert series["AA"] == {(2, 0): Fraction(1, 2), (1, 1): Fraction(2), (0, 2): Fraction(2)}


def test_every_word_follows_from_lyndon_words():
    """All coefficients up to the order equal coefficients of the exact flow, as in the theory."""
    with mp.workdps(70):
        for name in ("BM4", "G6"):
            entry = COMPOSITIONS[name]
            words = words_up_to("AB", entry.order)
            coefficients = step_coefficients(entry, words,
                                             lambda x: mp.mpf(x.numerator) / x.denominator)
            assert all(abs(coefficients[w] - mp.mpf(1) / factorial(len(w))) < 1e-55 for w in words)
            assert set(factors_of(words)) == set(words)


def test_conditions_agree_with_composed_maps():
    """Matrices have the same coefficients: A and B nilpotent, products by NumPy, eleven letters."""
    entry = COMPOSITIONS["G4"]
    for word in ("AAB", "ABB", "AABAB"):
        size = len(word) + 1
        A, B = ([[Fraction(word[i] == letter) if j == i + 1 else Fraction(0) for j in range(size)]
                 for i in range(size)] for letter in "AB")
        A, B = np.array(A), np.array(B)
        C = 2 * B @ A @ B - B @ B @ A - A @ B @ B
        step = np.array([[Fraction(i == j) for j in range(size)] for i in range(size)])
        kicks = [None, *zip(entry.kicks, entry.gradients, strict=True)]
        for a, kick in zip(entry.drifts, kicks, strict=True):
            for element in ([] if kick is None else [kick[0] * B + kick[1] * C]) + [a * A]:
                power = term = np.array([[Fraction(i == j) for j in range(size)]
                                         for i in range(size)])
                for n in range(1, size):
                    term = term @ element / n
                    power = power + term
                step = step @ power
        residual = step[0, -1] - target(word)
        if word == "AABAB":
            assert abs(residual) > Fraction(1, 10**4)  # of order 5: not a condition
        else:
            assert abs(residual) < Fraction(1, 10**60)


def test_the_kick_of_a_force_gradient_is_a_potential():
    assert force_gradient_residuals() == (0,) * 7


LONG = ("SS10", "ABA1064", "G6", "G8", "KL8")
each = pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in COMPOSITIONS])


@each
def test_stored_numbers_are_certified(name):
    lines = check_composition(COMPOSITIONS[name])
    assert all(line.holds for line in lines), [line for line in lines if not line.holds]
    text = " ".join(line.name for line in lines)
    for word in ("consistency", "symmetry", "order", "symplectic", "measured", "error constant"):
        assert word in text


@pytest.mark.parametrize("name", ["Suzuki4", "KL8", "G8", "BM4", "ABA1064"])
def test_the_proof_encloses_the_stored_numbers(name):
    conditions = OrderConditions(COMPOSITIONS[name])
    for value, box in zip(conditions.unknowns, conditions.enclose(), strict=True):
        with mp.workdps(90):
            value = mp.mpf(value.numerator) / value.denominator
            assert max(abs(mp.mpf(end) - value) for end in (box.a, box.b)) < mp.mpf(10) ** -59


@pytest.mark.parametrize(("name", "part", "i"), [
    ("G4", "drifts", 0), ("G4", "gradients", 0), ("BM4", "kicks", 1), ("G6", "weights", 1)])
def test_a_wrong_digit_is_found(name, part, i):
    shift = Fraction(1, 10**45) if i else Fraction(-1, 10**12)
    spoilt = moved(COMPOSITIONS[name], part, i, shift)
    if spoilt.base:
        drifts, kicks, gradients = flatten(COMPOSITIONS[spoilt.base], spoilt.weights)
        spoilt = replace(spoilt, drifts=drifts, kicks=kicks, gradients=gradients)
    failed = [line.name for line in check_composition(spoilt) if not line.holds]
    assert any("order" in name for name in failed), failed
    if abs(shift) > Fraction(1, 10**40):  # no solution in the box; else one beside its middle
        assert "exact solution" in failed


def test_numbers_that_are_not_the_composition_are_found():
    entry = COMPOSITIONS["KL6"]
    failed = {line.name for line in check_composition(
        replace(entry, drifts=(*entry.drifts[:-1], Fraction(1, 5))))
        if not line.holds}
    assert {"consistency", "symmetry", "composition", "order"} <= failed
    failed = {line.name for line in check_composition(replace(entry, order=8, orders=(8,)))
              if not line.holds}
    assert {"order condition 7", "exact solution", "order", "order, measured"} <= failed


@pytest.mark.parametrize("name", ["Strang", "G4", "SABAG6"])
def test_measured_order_with_one_kick(name):
    """The order with many kicks is among the certificates above."""
    entry = COMPOSITIONS[name]
    assert abs(observed_composition_order(entry, one_kick=True) - entry.orders[0]) < 0.1


def test_error_constant_of_strang():
    """T(h/2) K(h) T(h/2) has h³ ([A, [A, B]]/24 + [B, [A, B]]/12), by hand."""
    e = {"AAB": 1, "ABA": -2, "BAA": 1}, {"BAB": 2, "BBA": -1, "ABB": -1}
    exact = sum((e[0].get(w, 0) / 24 + e[1].get(w, 0) / 12) ** 2 for w in {*e[0], *e[1]}) ** 0.5
    assert error_constant(COMPOSITIONS["Strang"]) == pytest.approx(exact, rel=1e-14)


@pytest.mark.parametrize(("name", "starts"), [
    ("G4", 3), pytest.param("KL6", 60, marks=pytest.mark.slow)])
def test_a_search_finds_what_is_stored(name, starts):
    x, value, solved = search(name, seed=1, starts=starts)
    conditions = OrderConditions(COMPOSITIONS[name])
    floats = FloatConditions(conditions)
    assert solved > 0
    stored = floats.objective(np.array([float(v) for v in conditions.unknowns]))
    assert value == pytest.approx(stored, rel=1e-6)
    F, _ = floats.evaluate(x)
    assert np.abs(F[: len(conditions.words)]).max() < 1e-12
    assert search(name, seed=1, starts=starts)[1] == value  # the seed says it all


@pytest.mark.parametrize("name", ["G4", "BM4"])  # without free numbers, and with some
def test_digits_from_doubles_are_those_stored(name, tmp_path, monkeypatch):
    copied, expected = tmp_path / "compositions.json", json.loads(PATH.read_text(encoding="utf-8"))
    shutil.copy(PATH, copied)
    monkeypatch.setattr(composition_search, "PATH", copied)
    x = [float(value) for value in OrderConditions(COMPOSITIONS[name]).unknowns]
    composition_search.store(name, x, "a test")
    expected[name]["found"] = "a test"
    assert json.loads(copied.read_text(encoding="utf-8")) == expected
