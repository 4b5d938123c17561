"""Zero or not, for numbers written with radicals: decided by proof."""

from __future__ import annotations

import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from gyrospark.core.errors import TableauError
from gyrospark.generator.tableaux.separation_bounds import enclosure, vanishes

r2, r3, r5, r6 = map(sp.sqrt, (2, 3, 5, 6))

ZEROS = [
    sp.Add(r2 * r3, -r6, evaluate=False), sp.sqrt(5 + 2 * r6) - r2 - r3,
    sp.sqrt(3 + 2 * r2) - 1 - r2, sp.Pow(r2 + r3, 2, evaluate=False) - 5 - 2 * r6,
    1 / (1 + r2) + 1 - r2, sp.sqrt(sp.sqrt(49 + 20 * r6)) - r2 - r3, (r2 + 1) * (r2 - 1) - 1,
    sp.Pow(1 + r5, -2, evaluate=False) - (3 - r5) / 8,
]


@pytest.mark.parametrize("zero", ZEROS, ids=str)
def test_hidden_zeros_are_proved(zero: sp.Expr) -> None:
    assert vanishes(zero)


@pytest.mark.parametrize("zero", ZEROS, ids=str)
@pytest.mark.parametrize("digits", [3, 40, 90, 300])
def test_a_tiny_difference_from_a_hidden_zero_is_seen(zero: sp.Expr, digits: int) -> None:
    assert not vanishes(zero + sp.Rational(1, 10**digits))


def test_near_identities_are_refuted_and_enclosures_narrow() -> None:
    assert not vanishes(sp.sqrt(sp.sqrt(5 + r2)) - sp.Rational("1.5908290171").limit_denominator())
    assert not vanishes(sp.sqrt(1000001) + sp.sqrt(1000025) - sp.sqrt(1000013) * 2)
    interval = enclosure(r2, 256)
    assert 0 not in interval - 1
    assert 0 in interval**2 - 2
    assert interval.delta < 2**-250


@settings(max_examples=30)
@given(
    st.lists(st.integers(-40, 40), min_size=4, max_size=4),
    st.lists(st.integers(-40, 40), min_size=4, max_size=4),
)
def test_the_field_of_two_roots_is_decided_as_its_normal_form_says(
    a: list[int], b: list[int]
) -> None:
    u, v = (sum(c * r for c, r in zip(x, (1, r2, r3, r6), strict=True)) for x in (a, b))
    product = sp.Mul(u, v, evaluate=False)
    assert vanishes(product - sp.expand(u * v))
    assert vanishes(product) == (not any(a) or not any(b))


def test_a_proof_that_would_take_too_many_bits_is_refused_in_words() -> None:
    primes = [sp.sqrt(p) for p in (2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47)]
    X = sp.Add(*primes)
    hidden = sp.Add(sp.Mul(X, X + 1, evaluate=False), -sp.Pow(X, 2, evaluate=False), -X,
                    evaluate=False)
    with pytest.raises(TableauError, match="bits"):
        vanishes(sp.Pow(hidden, 8, evaluate=False))
