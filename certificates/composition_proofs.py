"""Certificates of compositions: their order conditions, solved and proved in interval arithmetic.

The unknowns x of a composition are its independent numbers: the first half of the weights, or of
drifts, kicks and gradients. Symmetry and Σ = 1 determine the others. Krawczyk's operator

    K(X) = x − Y F(x) + (1 − Y F′(X)) (X − x),   Y ≈ F′(x)⁻¹,

proves that F has exactly one zero in the box X if K(X) lies in its interior, and the zero lies in
K(X) (R. Krawczyk, Computing 4, 1969, 187-201). Free unknowns are held at their decimals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, TypeAlias

import mpmath as mp

from ..generator.tableaux.compositions import Composition
from .lyndon_words import (
    Flow,
    Series,
    composition_flow,
    differentiate,
    drift_flow,
    evaluate_flow,
    factors_of,
    grade,
    kick_flow,
    lyndon_words,
    multiply_flows,
    target,
)

__all__ = ["DIGITS", "RADIUS", "STORED", "Affine", "OrderConditions", "as_mpf", "intervals"]

#: Working digits of Newton's method and of intervals, and the digits that are stored.
DIGITS, STORED = 90, 60
#: Half the width of the box in which the exact solution is proved to be the only one.
RADIUS = Fraction(1, 10**40)
#: Grades of the symmetric bases: Y₁ + Y₃ + …, and a map of order 4 has no Y₃.
_LETTERS = {"Strang": "13579", "G4": "1579"}

#: A number of a composition: its constant, and its slopes by unknowns.
Affine: TypeAlias = tuple[Fraction, dict[int, Fraction]]


@dataclass(frozen=True)
class OrderConditions:
    """The conditions of a composition as equations F(x) = 0 of its unknowns."""

    composition: Composition

    @cached_property
    def words(self) -> list[str]:
        """The Lyndon words of the conditions; those of one letter of grade 1 hold by Σ = 1."""
        composition = self.composition
        if composition.base:
            words = lyndon_words(_LETTERS[composition.base], composition.order - 1)
        else:
            # orders = (r₁, r₂, …): words with k kicks B count below order r_k, the last r for all
            # further kicks; a word without kicks counts with those of one
            orders = composition.orders
            words = [word for word in lyndon_words("AB", max(orders) - 1)
                     if len(word) < orders[min(max(word.count("B"), 1), len(orders)) - 1]]
            words += composition.also
        return [word for word in words if word not in ("1", "A", "B")]

    @cached_property
    def _palindromes(self) -> list[tuple[int, bool]]:
        """Size of each palindrome of numbers, and whether its sum is 1."""
        composition = self.composition
        if composition.base:
            return [(len(composition.weights), True)]
        s = composition.stages
        return [(s + 1, True), (s, True), *([(s, False)] if composition.has_gradients else [])]

    @cached_property
    def unknowns(self) -> list[Fraction]:
        """x as stored: of each palindrome the numbers that neither symmetry nor a sum fixes."""
        composition = self.composition
        palindromes = [composition.weights] if composition.base else [
            composition.drifts, composition.kicks, composition.gradients]
        # the first half of each list; the one in the middle of a list with a given sum follows
        return [x for (size, summed), palindrome in zip(self._palindromes, palindromes,
                                                        strict=False)
                for x in palindrome[: (size + 1) // 2 - summed]]

    @cached_property
    def solved_unknowns(self) -> list[int]:
        """Indices of the unknowns that are solved for; the free ones keep their decimals."""
        return [i for i in range(len(self.unknowns)) if i not in self.composition.free]

    def _numbers(self) -> list[list[Affine]]:
        """Return each number of each palindrome as (constant, {index of an unknown: factor}).

        A palindrome of ``size`` numbers is fixed by its first half. Where the sum is 1, the middle
        number is 1 − 2 Σ of the numbers before, or one half of it each for two middle numbers: it
        is no unknown.
        """
        palindromes, first = [], 0  # ``first``: index of the palindrome's first unknown
        for size, summed in self._palindromes:
            half = (size + 1) // 2
            indices = range(first, first + half - summed)
            terms = [(Fraction(0), {i: Fraction(1)}) for i in indices]
            if summed:
                middle = Fraction(1, 1 if size % 2 else 2)  # shared by the middle ones
                terms.append((middle, dict.fromkeys(indices, -2 * middle)))
            # entry i is equal to its mirror image, entry size − 1 − i
            palindromes.append([terms[min(i, size - 1 - i)] for i in range(size)])
            first = indices.stop
        return palindromes

    @cached_property
    def equal(self) -> list[float]:
        """x of a composition with equal steps, without force gradients: where a search begins."""
        return [1 / size if summed else 0.0 for size, summed in self._palindromes
                for _ in range((size + 1) // 2 - summed)]

    def values(self, x: Sequence[Any], as_number: Callable[[Fraction], Any]) -> list[list[Any]]:
        """Return the numbers of each palindrome for the unknowns x, converted by ``as_number``."""
        return [[_value(affine, x, as_number) for affine in palindrome]
                for palindrome in self._numbers()]

    def flows(self, words: Sequence[str] = ()) -> Iterator[tuple[Flow, list[Affine]]]:
        """Yield the flows of a step in their order, each with the affine functions of its numbers.

        A flow has the words up to the largest grade of the conditions' words, or of ``words`` if
        these are given. A weight w has one number, a drift a, a kick b and perhaps c.
        """
        words, palindromes = words or self.words, self._numbers()
        largest_grade = max(map(grade, words), default=1)
        if self.composition.base:
            letters = "".join(x for x in _LETTERS[self.composition.base] if int(x) <= largest_grade)
            yield from ((composition_flow(letters, largest_grade), [affine])
                        for affine in palindromes[0])
            return
        drifts, *kicks = palindromes
        most_kicks = max((word.count("B") for word in words), default=1)
        drift = drift_flow(largest_grade)
        # a word of k letters B has at most 3k/2 letters in a kick: C has two B among its three
        kick = kick_flow(min(largest_grade, most_kicks * 3 // 2), gradients=len(kicks) > 1)
        for i, affine in enumerate(drifts):
            yield drift, [affine]
            if i < len(drifts) - 1:
                yield kick, [kick_numbers[i] for kick_numbers in kicks]

    def evaluate(
        self, x: Sequence[Any], as_number: Callable[[Fraction], Any]
    ) -> tuple[list[Any], list[list[Any]]]:
        """Return F(x) and F′(x) in the arithmetic of x: a row per word, a column per unknown.

        F has the coefficient of the product of all flows at each word, less its target; F′ the sum
        of (flows before i) · (derivative of flow i) · (flows after i).
        """
        flows = list(self.flows())
        flow_values = [[_value(affine, x, as_number) for affine in affine_numbers]
                       for _, affine_numbers in flows]
        series = [evaluate_flow(flow, arguments, as_number)
                  for (flow, _), arguments in zip(flows, flow_values, strict=True)]
        # reversed words, too: products of the last flows are taken from products of the first
        parts = factors_of([*self.words, *(word[::-1] for word in self.words)])
        zero = as_number(Fraction(0))
        left_products = multiply_flows(series, parts, as_number)
        right_products = [_reverse(series_product)
                          for series_product in left_products]  # the composition is a palindrome
        residual = [left_products[-1].get(word, zero) - as_number(target(word))
                    for word in self.words]
        slopes = [[zero] * len(x) for _ in self.words]
        for i, (flow, affine_numbers) in enumerate(flows):
            for index, (_, terms) in enumerate(affine_numbers):
                slope = evaluate_flow(flow, flow_values[i], as_number, index)
                for row, word in zip(slopes, self.words, strict=True):
                    # i flows stand left of flow i, and len(flows) − 1 − i right of it
                    change = differentiate(left_products[i], slope, right_products[-2 - i], word,
                                           zero)
                    for j, k in terms.items():  # the chain rule: number = constant + Σ k x_j
                        row[j] = row[j] + as_number(k) * change
        return residual, slopes

    def refine(self, x: Sequence[Any]) -> list[Any]:
        """Return the solution near x by Newton's method in 90 digits; free unknowns are fixed."""
        with mp.workdps(DIGITS):
            solution = [as_mpf(number) for number in x]
            # from the 16 digits of a search 90 take three steps
            for _ in range(12):
                residual, slopes = self.evaluate(solution, as_mpf)
                if not residual or max(map(abs, residual)) < mp.mpf(10) ** (15 - DIGITS):
                    return solution
                J = mp.matrix([[row[i] for i in self.solved_unknowns] for row in slopes])
                for i, step in zip(self.solved_unknowns, mp.lu_solve(J, -mp.matrix(residual)),
                                   strict=True):
                    solution[i] += step
        raise ArithmeticError(f"Newton's method for {self.composition.name} did not converge; "
                              "start it closer to a solution.")

    def enclose(self) -> list[Any] | None:
        """Return intervals of 90 digits that contain the exact solution; None without a proof.

        Let X be the box of half width 1e-40 around the stored numbers x. If Krawczyk's operator

            K(X) = x − Y F(x) + (1 − Y F′(X)) (X − x),   Y ≈ F′(x)⁻¹,

        maps X into its interior, X contains one and only one solution, and it is in K(X).
        """
        x, indices = self.unknowns, self.solved_unknowns
        if len(indices) != len(self.words):  # as many equations as unknowns are needed
            return None
        with intervals() as interval:
            centre = [interval(number) for number in x]
            box = list(centre)
            for i in indices:
                box[i] = centre[i] + interval(RADIUS) * mp.iv.mpf([-1, 1])
            enclosure = list(centre)
            residual, _ = self.evaluate(centre, interval)
            _, slopes = self.evaluate(box, interval)
            # Y need not be exact: any matrix is allowed, a good one makes K(X) small
            try:
                Y = mp.inverse(mp.matrix([[mp.mpf(row[i].mid) for i in indices] for row in slopes])
                               ) if indices else mp.matrix(0, 0)
            except ZeroDivisionError:  # singular: not an isolated solution
                return None
            for k, i in enumerate(indices):
                inverse_row = [mp.iv.mpf(Y[k, b]) for b in range(len(indices))]
                image = centre[i] - _dot(inverse_row, residual)  # entry k of K(X)
                for m, j in enumerate(indices):
                    slope = _dot(inverse_row, [row[j] for row in slopes])
                    image += ((k == m) - slope) * (box[j] - centre[j])
                if not (box[i].a < image.a and image.b < box[i].b):  # not in the interior
                    return None
                enclosure[i] = image
        return enclosure

    def residuals(self) -> list[Any]:
        """Return interval enclosures of F at the stored numbers."""
        with intervals() as interval:
            F, _ = self.evaluate([interval(value) for value in self.unknowns], interval)
            return F


def _value(affine: Affine, x: Sequence[Any], as_number: Callable[[Fraction], Any]) -> Any:
    """Return an affine function, constant + Σ k_i x_i, at the unknowns x."""
    constant, terms = affine
    return sum((as_number(k) * x[i] for i, k in terms.items()), start=as_number(constant))


def _dot(u: Sequence[Any], v: Sequence[Any]) -> Any:
    """Return u·v of intervals; 0 for empty ones."""
    return sum((a * b for a, b in zip(u, v, strict=True)), start=mp.iv.mpf(0))


def _reverse(series: Series) -> Series:
    """Return the series of a product with its factors in reverse order: every word is reversed."""
    return {word[::-1]: value for word, value in series.items()}


@contextmanager
def intervals() -> Iterator[Callable[[Fraction], Any]]:
    """Set the digits of mpmath's intervals, and yield the enclosure of a rational number."""
    previous_digits = mp.iv.dps
    mp.iv.dps = DIGITS
    try:
        with mp.workdps(DIGITS):
            yield lambda value: mp.iv.mpf(value.numerator) / value.denominator
    finally:
        mp.iv.dps = previous_digits


def as_mpf(value: Any) -> Any:
    """Return an exact number in mpmath's working precision."""
    if isinstance(value, Fraction):
        return mp.mpf(value.numerator) / value.denominator
    return mp.mpf(value)
