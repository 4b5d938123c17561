"""The heavy top's exact motion as Taylor series, seen from the body at t = 0.

All that the schemes do commutes with a fixed turn of space, q → r∘q, p → r∘p. With r = q̄(0) the
motion starts at x(0) = 1 and only the momentum l and the vertical Γ = R(q)ᵀe₃ in body axes are
left of the state:

    l̇ = l × Ω − mgl e₃ × Γ,   Γ̇ = Γ × Ω,   Ω = J⁻¹ l
    ẋ = ½ x∘(0, Ω),   y = 2 x∘(0, l)                (q = q(0)∘x,  p = q(0)∘y)

Only sums and products are used (and division by integers): the state may be rational, a
polynomial, or an array of many states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ..core.inertia import quaternion_product

__all__ = ["BodyFrameTop", "conjugate", "dot", "motion", "over"]

Vector = list[Any]


@dataclass(frozen=True)
class BodyFrameTop:
    """A state of the heavy top in body axes, with its parameters.

    Angular momentum l, vertical Γ = R(q)ᵀe₃, inverse moments (1/I₁, 1/I₂, 1/I₃) and mgl; each
    entry is a number, a polynomial or an array of many states.
    """

    l: Sequence[Any]  # noqa: E741
    vertical: Sequence[Any]
    inverse_inertia: Sequence[Any]
    mgl: Any

    def rates(self) -> tuple[Vector, Vector]:
        """Return l̇ = l × Ω + mgl (Γ₂, −Γ₁, 0) and Γ̇ = Γ × Ω, with Ω = J⁻¹ l."""
        omega = [j * x for j, x in zip(self.inverse_inertia, self.l, strict=True)]
        G1, G2, _ = self.vertical
        l_rate = cross(self.l, omega)
        # −mgl e₃ × Γ: the weight acts at the mass centre, on the body's third axis
        l_rate[0] += self.mgl * G2
        l_rate[1] -= self.mgl * G1
        return l_rate, cross(self.vertical, omega)


def conjugate(a: Sequence[Any]) -> Vector:
    """Return (a₀, −a₁, −a₂, −a₃)."""
    return [a[0], -a[1], -a[2], -a[3]]


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Return Σ aᵢ bᵢ; the sum starts at a₀b₀, for a ring need not add the integer 0 to its type."""
    return sum((x * y for x, y in zip(a[1:], b[1:], strict=True)), a[0] * b[0])


def over(value: Any, n: int) -> Any:
    """Return value/n for a number, an array or, exactly, an element of SymPy's ring over ℚ.

    Such an element has no ``/`` by an integer; ``quo_ground`` divides its coefficients.
    """
    ring = getattr(value, "ring", None)
    return value.quo_ground(ring.domain(n)) if ring is not None else value / n


def cross(a: Sequence[Any], b: Sequence[Any]) -> Vector:
    """Return a × b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


class _Taylor:
    """The coefficients a₀, a₁, … of a series, of which a product returns one term.

    ``a * b`` is the coefficient n of the product, Σ_k a_k b_(n−k): cross products and quaternion
    products then work on series as on numbers.
    """

    def __init__(self, terms: Vector, n: int) -> None:
        self.terms, self.n = terms, n

    def __mul__(self, other: _Taylor) -> Any:
        a, b = self.terms, other.terms
        return sum((a[k] * b[self.n - k] for k in range(1, self.n + 1)), a[0] * b[self.n])


def motion(top: BodyFrameTop, order: int) -> tuple[list[Vector], list[Vector]]:
    """Return the Taylor coefficients x₀..x_order and y₀..y_order, four components each.

        l̇ = l × Ω + mgl (G₂, −G₁, 0),   Ġ = G × Ω,   ẋ = ½ x ∘ Ω,   y = 2 x ∘ l

    with Ω = J⁻¹ l and the vertical G in body axes: coefficient n + 1 of each is coefficient n of
    its rate over n + 1. The motion starts at x = 1.
    """
    # numbers of a ring or arrays: the zero of the state makes every entry one of its type
    zero = 0 * top.l[0]
    l, G = [[c + zero] for c in top.l], [[c + zero] for c in top.vertical]  # noqa: E741
    x = [[1 + zero], [zero], [zero], [zero]]
    for n in range(order):
        omega = [[j * c for c in terms] for j, terms in zip(top.inverse_inertia, l, strict=True)]
        # products of these are the coefficients n of products of the series
        spin, momentum, vertical = (_at(n, vector) for vector in (omega, l, G))
        l_rate, G_rate = cross(momentum, spin), cross(vertical, spin)
        l_rate[0] += top.mgl * G[1][n]
        l_rate[1] -= top.mgl * G[0][n]
        x_rate = quaternion_product(_at(n, x), [_Taylor([zero] * (n + 1), n), *spin])
        # the factor 2 is the ½ of ẋ = ½ x∘Ω
        for vector, rate, factor in ((l, l_rate, 1), (G, G_rate, 1), (x, x_rate, 2)):
            for terms, coefficient in zip(vector, rate, strict=True):
                terms.append(over(coefficient, factor * (n + 1)))
    zero_series = [zero] * (order + 1)
    y = [quaternion_product(_at(n, x), _at(n, [zero_series, *l])) for n in range(order + 1)]
    return (
        [[terms[n] for terms in x] for n in range(order + 1)],
        [[2 * coefficient for coefficient in row] for row in y],
    )


def _at(n: int, vectors: list[Vector]) -> list[_Taylor]:
    """Return the components of a vector of series, whose products give the coefficient n."""
    return [_Taylor(terms, n) for terms in vectors]
