"""Identities in exact arithmetic: those that hold are seen, and differences of any size."""

from __future__ import annotations

from fractions import Fraction
from itertools import islice

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.generator.symbolic.finite_fields import (
    Residues,
    UnsuitablePrimeError,
    identically_zero,
    primes,
    vanish,
)
from gyrospark.generator.symbolic.null_spaces import NullSpace, echelon_form
from gyrospark.generator.symbolic.shared_subexpressions import share

x, y, z = sp.symbols("x y z", real=True)
r = sp.sqrt(x**2 + y**2)
NUMBER, RANDOM = sp.Rational(3, 10), "exact arithmetic at random points"

IDENTITIES = {
    "quotients": [1 / (x + y), -1 / (x * (1 + y / x))],
    "roots": [r**3, -r * x**2, -r * y**2],
    "roots of quotients": [1 / r, -r / (x**2 + y**2)],
    "cubic roots": [(x + y) ** sp.Rational(7, 3), -((x + y) ** 2) * sp.cbrt(x + y)],
    "theorems of addition": [sp.sin(x + y), -sp.sin(x) * sp.cos(y), -sp.cos(x) * sp.sin(y)],
    "multiple angles": [sp.cos(3 * x), 3 * sp.cos(x), -4 * sp.cos(x) ** 3],
    "halves of decimals": [sp.sin(0.3 * x), -2 * sp.sin(0.15 * x) * sp.cos(0.15 * x)],
    "exponentials": [sp.exp(2 * x + y), -sp.exp(x) ** 2 * sp.exp(y)],
    "hyperbolic": [sp.tanh(x), -sp.sinh(2 * x) / (1 + sp.cosh(2 * x))],
    "numbers": [sp.sin(NUMBER) ** 2, sp.cos(NUMBER) ** 2, sp.Integer(-1)],
    "roots of numbers": [sp.sqrt(3 + 2 * sp.sqrt(2)) ** 2 * x, -(1 + sp.sqrt(2)) ** 2 * x],
    "unknown functions": [(x + y) * sp.log(z), -x * sp.log(z), -y * sp.log(z)],
    "shared parts": [share(x * y) * z, -share(x * y) * z],
    "nothing": [sp.Integer(0)],
}
DIFFERENCES = {
    "a tiny number": [1e-300 * x],
    "a tiny part": [sp.sin(x) ** 2, sp.cos(x) ** 2, sp.Integer(-1), sp.Rational(1, 10**60)],
    "two near decimals": [sp.Float(0.1) * x, sp.Float(0.2) * x, -sp.Float(0.3) * x],
    "sums that round to nothing": [(sp.Float(1) + x) ** 2, -(x**2), -2 * x, sp.Float(-1 + 2**-52)],
    "roots": [sp.sqrt(x**2 + y**2), -x],
    "signs of roots": [sp.sqrt(x**2 * y), x * sp.sqrt(y)],
    "angles": [sp.sin(x), -sp.sin(y)],
    "numbers": [sp.sin(NUMBER), -sp.cos(NUMBER)],
    "unknown functions": [sp.log(x), -sp.log(y)],
}


@pytest.mark.parametrize("name", IDENTITIES)
def test_identities(name: str) -> None:
    assert identically_zero([IDENTITIES[name]])
    assert vanish([sp.Add(*IDENTITIES[name], evaluate=False)])  # decimals as they are


def test_only_what_is_multiplied_out_is_proved_and_what_is_long_is_not() -> None:
    assert identically_zero([[(x + y) ** 2, -(x**2), -2 * x * y, -(y**2)]]) == "expanded"
    assert identically_zero([IDENTITIES["theorems of addition"]]) == RANDOM
    # ((x + y + 1)⁹ + z)⁹ has billions of terms; at points it is a number.
    long = ((x + y + 1) ** 9 + z) ** 9
    assert identically_zero([[long, -long * (x + 1) / (1 + x)]]) == RANDOM
    assert identically_zero([[long, -long, sp.Rational(1, 10**30)]]) == ""


@pytest.mark.parametrize("name", DIFFERENCES)
def test_differences(name: str) -> None:
    assert identically_zero([DIFFERENCES[name]]) == ""
    assert identically_zero([[x, -x], DIFFERENCES[name]]) == ""


@settings(max_examples=40, derandomize=True)
@given(a=st.floats(-1e10, 1e10), b=st.floats(-1e10, 1e10))
def test_doubles_are_fractions(a: float, b: float) -> None:
    """a x + b x = (a + b) x in fractions, and in doubles only where nothing was rounded."""
    exact = Fraction(a) + Fraction(b) == Fraction(a + b)
    terms = [sp.Rational(a) * x, sp.Rational(b) * x, -sp.Rational(a + b) * x]
    assert bool(identically_zero([terms])) == exact


def test_values_are_those_of_the_expression() -> None:
    prime = next(primes())
    e = (x**3 / (1 + y) - sp.Rational(2, 7)) ** 2
    residues = Residues(prime, [x, y], [e], 50, {}, 1)
    for a, b, value in zip(
            residues[x].tolist(), residues[y].tolist(), residues[e].tolist(), strict=True):
        expected = (pow(a, 3, prime) * pow(1 + b, -1, prime) - 2 * pow(7, -1, prime)) ** 2
        assert value == expected % prime


def test_primes_without_a_root_are_passed_over() -> None:
    """Primes modulo which 3 has no root, half of all, are refused as unsuitable."""
    suitable = []
    for prime in islice(primes(), 12):
        try:
            root = Residues(prime, [x], [sp.sqrt(3) * x], 5, {}, 1)
        except UnsuitablePrimeError:
            assert pow(3, (prime - 1) // 2, prime) == prime - 1
            continue
        suitable.append(prime)
        assert (root[sp.sqrt(3) * x] ** 2 % prime == 3 * (root[x] ** 2 % prime) % prime).all()
    assert 0 < len(suitable) < 12


@settings(max_examples=30, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), rank=st.integers(0, 4), size=st.integers(1, 6))
def test_null_spaces_against_sympy(seed: int, rank: int, size: int) -> None:
    """Null vectors of matrices of doubles, fractions of hundreds of digits, equal SymPy's."""
    rng = np.random.default_rng(seed)
    matrix = sp.Matrix(rank, size, lambda i, j: sp.Rational(float(rng.standard_normal()))
                       * int(rng.integers(0, 2)))

    def conditions(prime: int):
        rows = [[int(e.p) * pow(int(e.q), -1, prime) % prime for e in matrix.row(i)]
                for i in range(rank)]
        yield lambda count: np.array(rows, dtype=np.int64).reshape(rank, size)

    space = NullSpace(size, conditions)
    rows = sp.Matrix(len(space.rows), size, lambda i, j: sp.Rational(
        space.rows[i][j].numerator, space.rows[i][j].denominator))
    expected = matrix.nullspace() if rank else [*sp.eye(size).columnspace()]
    assert len(space.rows) == len(expected)
    assert (matrix * rows.T).is_zero_matrix
    assert rows == rows.rref()[0]
    for vector in space.rows:
        assert space.contains(vector)
        shifted = [entry + Fraction(1, 10**40) for entry in vector]
        assert not space.contains(shifted) or matrix.is_zero_matrix


def test_elimination() -> None:
    prime = next(primes())
    rows = np.array([[0, 2, 4], [3, 0, 6], [3, 2, 10]])
    form, pivots = echelon_form(rows, prime)
    assert pivots == [0, 1]
    assert form.tolist() == [[1, 0, 2], [0, 1, 2]]
