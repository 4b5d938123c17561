"""Truncated series Σ a_ng hⁿ γᵍ: powers of the step, and of γ of either sign.

The coefficients may come from any ring: rational numbers, or polynomials in the state.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["PowerSeries"]


class PowerSeries:
    """A polynomial in h, γ and 1/γ without the powers of h above ``order``.

    ``terms``: (n, g) → a_ng of a_ng hⁿ γᵍ. Sums, differences and products with series and with
    coefficients have the lower of the two orders.
    """

    __slots__ = ("order", "terms")

    def __init__(self, terms: Mapping[tuple[int, int], Any], order: int) -> None:
        self.order = order
        self.terms = {key: a for key, a in terms.items() if a != 0 and key[0] <= order}

    @classmethod
    def constant(cls, value: Any, order: int) -> PowerSeries:
        """Return a series without h and γ."""
        return cls({(0, 0): value}, order)

    def __add__(self, other: Any) -> PowerSeries:
        terms = dict(self.terms)
        for key, a in self._terms_of(other).items():
            terms[key] = terms[key] + a if key in terms else a
        return PowerSeries(terms, self._order_with(other))

    __radd__ = __add__

    def __neg__(self) -> PowerSeries:
        return PowerSeries({key: -a for key, a in self.terms.items()}, self.order)

    def __sub__(self, other: Any) -> PowerSeries:
        result: PowerSeries = self + (-other)
        return result

    def __mul__(self, other: Any) -> PowerSeries:
        # powers of h beyond the order of a factor are not known
        terms: dict[tuple[int, int], Any] = {}
        order = self._order_with(other)
        factors = self._terms_of(other).items()
        for (n, g), a in self.terms.items():
            for (m, f), b in factors:
                if n + m <= order:
                    key = (n + m, g + f)
                    terms[key] = terms[key] + a * b if key in terms else a * b
        return PowerSeries(terms, order)

    __rmul__ = __mul__

    def shift(self, h: int = 0, gamma: int = 0) -> PowerSeries:
        """Return the series times h^h γ^gamma, with powers ``h`` and ``gamma`` of either sign.

        Raises
        ------
        ValueError
            If a negative power of h would remain: the series lacks the factor h^(−h).
        """
        terms = {(n + h, g + gamma): a for (n, g), a in self.terms.items()}
        if any(n < 0 for n, _ in terms):
            raise ValueError(f"The series has terms below h^{-h}.")
        return PowerSeries(terms, self.order)

    def coefficient(self, h: int, gamma: int = 0) -> Any:
        """Return a_ng; 0 where there is none."""
        return self.terms.get((h, gamma), 0)

    def truncate(self, order: int) -> PowerSeries:
        """Return the series with another order; a higher one adds no terms."""
        return PowerSeries(self.terms, order)

    def _order_with(self, other: Any) -> int:
        """Return the order of a result: the lower one of two series; a coefficient has none."""
        return min(self.order, other.order) if isinstance(other, PowerSeries) else self.order

    def _terms_of(self, other: Any) -> dict[tuple[int, int], Any]:
        """Return the terms of a series, or a coefficient as the term h⁰ γ⁰."""
        if isinstance(other, PowerSeries):
            return other.terms
        return {(0, 0): other}
