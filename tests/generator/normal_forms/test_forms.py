"""Normal forms of single expressions: one for all equivalent expressions, and the shortest."""

import pytest
import sympy as sp

from equivalent_forms import HALF, stand_ins
from gyrospark.generator.normal_forms.additive_terms import split, total
from gyrospark.generator.normal_forms.canonical_expressions import CanonicalForms

x, y, z = sp.symbols("x y z", real=True)
a, b = sp.symbols("a b", real=True)
m, k, L = sp.symbols("m k L", positive=True)
ROOT = sp.sqrt(x**2 + y**2)


def form(e, *moving):
    """Return the canonical form of an expression in which these symbols move."""
    names = stand_ins(moving, sorted(e.free_symbols - set(moving), key=str))
    canonical_form = CanonicalForms().expression(e.xreplace(names))
    return canonical_form.xreplace({stand: s for s, stand in names.items()})


@pytest.mark.parametrize("spellings", [
    (x**2 / (a + b) + k * y**2, (x**2 + k * y**2 * (a + b)) / (a + b)),
    ((x / m + y / k) ** -2, (m * k) ** 2 / (k * x + m * y) ** 2),
    (x / 2, 0.5 * x, x - HALF * x, sp.Mul(sp.Float(0.25), x, 2, evaluate=False)),
    (-(x - y) * k, (y - x) * k, (-1) * k * x + k * y),
    (x**3, x * x * x, x**5 / x**2, sp.Mul(x, x, x, evaluate=False)),
    (sp.sqrt(m) ** 2 * x, m * x, m**sp.Rational(3, 2) * x / sp.sqrt(m)),
    ((x**2 - 1) / (x - 1), x + 1), (x / (1 + x), 1 - 1 / (1 + x)),
    (x / (1 / a + 1 / b), a * b * x / (a + b)),
    (1 / (x**2 - y**2), 1 / ((x - y) * (x + y)), -1 / ((y - x) * (y + x))),
    (sp.sqrt(4 * x**2 + 4 * y**2), 2 * ROOT, 2 * sp.sqrt(y * y + x * x)),
    (sp.sqrt(x**2 - 2 * x * y + y**2 + z**2), sp.sqrt((y - x) ** 2 + z**2)),
    (sp.sqrt(k * x**2 + k * y**2), sp.sqrt(k) * ROOT),
    ((x**2 + 2 * y**2) / ROOT**3, 1 / ROOT + y**2 / ROOT**3),
    (sp.exp(x) * sp.exp(-y) * sp.exp(a * x), sp.exp(x - y + a * x),
     sp.exp((1 + a) * x) / sp.exp(y)),
    (sp.sin(a * (x + y)), sp.sin(a * x + a * y), -sp.sin(-a * (y + x))),
    (x**a * x**b, x ** (a + b)), (sp.sqrt(2) * sp.sqrt(6) * x, 2 * sp.sqrt(3) * x),
    ((x - a) ** 2 + y**2 - L**2, x**2 + y**2 - 2 * a * x + (a - L) * (a + L)),
    (sp.log((x + y) ** 2), sp.log(x**2 + 2 * x * y + y**2)),
    (sp.atan2(2 * (x - y) + y, x), sp.atan2(2 * x - y, x)),
    (sp.Max(x * (y + 1), 0), sp.Max(x * y + x, 0)),
    (sp.Piecewise((x * (y + 1), x > 0), (0, True)), sp.Piecewise((x * y + x, x > 0), (0, True))),
], ids=str)
def test_equivalent_forms_of_an_expression(spellings):
    assert len({form(e, x, y, z) for e in spellings}) == 1


@pytest.mark.parametrize("e", [
    (x - y) ** 2, (x - y) ** 4, k * (x - y) ** 2 / 2, k * (ROOT - L) ** 2 / 2,
    (x + a * y + b) ** 2, (x**2 + y**2 - L**2) ** 2, (x + y) * (x * y + z), (1 + x**2) * (y - z),
    (1 + y / x) / x**2, (x * y - z) / (x + y), sp.sin(x) * (x + y) + sp.cos(y) * (x - y)], ids=str)
def test_what_is_short_stays_as_it_is(e):
    assert form(e, x, y, z) == form(sp.expand(e), x, y, z) == e


def test_decimals_are_exact_and_products_multiplied_out_as_far_as_their_pieces_need():
    assert form(0.1 * x, x).coeff(x) == sp.Rational(*(0.1).as_integer_ratio())
    product = k * (x + y) * (z + L)
    for limit, count in ((4, 1), (2, 2), (1, 4)):
        pieces = list(split(
            CanonicalForms(), product, lambda terms, limit=limit: len(terms) <= limit))
        assert len(pieces) == count
        assert sp.expand(total(pieces) - product) == 0
