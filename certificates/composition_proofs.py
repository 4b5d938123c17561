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
        made = self.composition
        if made.base:
            found = lyndon_words(_LETTERS[made.base], made.order - 1)
        else:
            found = [word for word in lyndon_words("AB", max(made.orders) - 1)
                     if len(word) < made.orders[min(max(word.count("B"), 1), len(made.orders)) - 1]]
            found += made.also
        return [word for word in found if word not in ("1", "A", "B")]

    @cached_property
    def _parts(self) -> list[tuple[int, bool]]:
        """Size of each palindrome of numbers, and whether its sum is 1."""
        made = self.composition
        if made.base:
            return [(len(made.weights), True)]
        s = made.stages
        return [(s + 1, True), (s, True), *([(s, False)] if made.has_gradients else [])]

    @cached_property
    def unknowns(self) -> list[Fraction]:
        """x as stored."""
        made = self.composition
        numbers = [made.weights] if made.base else [made.drifts, made.kicks, made.gradients]
        return [value for (size, summed), values in zip(self._parts, numbers, strict=False)
                for value in values[: (size + 1) // 2 - summed]]

    @cached_property
    def solved(self) -> list[int]:
        """The unknowns that are not free."""
        return [i for i in range(len(self.unknowns)) if i not in self.composition.free]

    def _numbers(self) -> list[list[Affine]]:
        """Return each number of each palindrome as an affine function of the unknowns."""
        found, first = [], 0
        for size, summed in self._parts:
            half = (size + 1) // 2
            own = range(first, first + half - summed)
            terms = [(Fraction(0), {i: Fraction(1)}) for i in own]
            if summed:
                rest = Fraction(1, 1 if size % 2 else 2)  # shared by the middle ones
                terms.append((rest, dict.fromkeys(own, -2 * rest)))
            found.append([terms[min(i, size - 1 - i)] for i in range(size)])
            first = own.stop
        return found

    @cached_property
    def equal(self) -> list[float]:
        """The unknowns of equal steps without force gradients."""
        return [1 / size if summed else 0.0 for size, summed in self._parts
                for _ in range((size + 1) // 2 - summed)]

    def values(self, x: Sequence[Any], number: Callable[[Fraction], Any]) -> list[list[Any]]:
        """Return the numbers of each palindrome for these unknowns."""
        return [[_value(affine, x, number) for affine in part] for part in self._numbers()]

    def flows(self, words: Sequence[str] = ()) -> Iterator[tuple[Flow, list[Affine]]]:
        """Yield the flows of a step with their numbers, in order, up to the conditions' words.

        ``words`` are others, where they are needed.
        """
        words, numbers = words or self.words, self._numbers()
        most = max(map(grade, words), default=1)
        if self.composition.base:
            letters = "".join(x for x in _LETTERS[self.composition.base] if int(x) <= most)
            yield from ((composition_flow(letters, most), [number]) for number in numbers[0])
            return
        drifts, *kicks = numbers
        most_kicks = max((word.count("B") for word in words), default=1)
        drift = drift_flow(most)
        kick = kick_flow(min(most, most_kicks * 3 // 2), len(kicks) > 1)  # C is ABB and the like
        for i, number in enumerate(drifts):
            yield drift, [number]
            if i < len(drifts) - 1:
                yield kick, [part[i] for part in kicks]

    def evaluate(
        self, x: Sequence[Any], number: Callable[[Fraction], Any]
    ) -> tuple[list[Any], list[list[Any]]]:
        """Return F(x) and F′(x) in the arithmetic of x: a row per word, a column per unknown."""
        flows = list(self.flows())
        values = [[_value(affine, x, number) for affine in numbers] for _, numbers in flows]
        series = [evaluate_flow(flow, at, number)
                  for (flow, _), at in zip(flows, values, strict=True)]
        parts = factors_of([*self.words, *(word[::-1] for word in self.words)])
        zero = number(Fraction(0))
        left = multiply_flows(series, parts, number)
        right = [_reversed(one) for one in left]  # the composition is a palindrome
        residual = [left[-1].get(word, zero) - number(target(word)) for word in self.words]
        slopes = [[zero] * len(x) for _ in self.words]
        for i, (flow, numbers) in enumerate(flows):
            for by, (_, terms) in enumerate(numbers):
                slope = evaluate_flow(flow, values[i], number, by)
                for row, word in zip(slopes, self.words, strict=True):
                    change = differentiate(left[i], slope, right[-2 - i], word, zero)
                    for j, k in terms.items():
                        row[j] = row[j] + number(k) * change
        return residual, slopes

    def refine(self, x: Sequence[Any]) -> list[Any]:
        """Return the solution next to x by Newton's method in 90 digits; free unknowns stay."""
        with mp.workdps(DIGITS):
            found = [as_mpf(value) for value in x]
            for _ in range(12):
                residual, slopes = self.evaluate(found, as_mpf)
                if not residual or max(map(abs, residual)) < mp.mpf(10) ** (15 - DIGITS):
                    return found
                J = mp.matrix([[row[i] for i in self.solved] for row in slopes])
                for i, step in zip(self.solved, mp.lu_solve(J, -mp.matrix(residual)), strict=True):
                    found[i] += step
        raise ArithmeticError(f"Newton's method for {self.composition.name} did not converge; "
                              "start it closer to a solution.")

    def enclose(self) -> list[Any] | None:
        """Return intervals of 90 digits that hold the exact solution; None if none is proved.

        Krawczyk's operator is applied to the box of half width 1e-40 around the stored numbers.
        """
        x, solved = self.unknowns, self.solved
        if len(solved) != len(self.words):
            return None
        with intervals() as interval:
            at = [interval(value) for value in x]
            box = list(at)
            for i in solved:
                box[i] = at[i] + interval(RADIUS) * mp.iv.mpf([-1, 1])
            found = list(at)
            residual, _ = self.evaluate(at, interval)
            _, slopes = self.evaluate(box, interval)
            try:
                Y = mp.inverse(mp.matrix([[mp.mpf(row[i].mid) for i in solved] for row in slopes])
                               ) if solved else mp.matrix(0, 0)
            except ZeroDivisionError:  # singular: not an isolated solution
                return None
            for k, i in enumerate(solved):
                rows = [mp.iv.mpf(Y[k, b]) for b in range(len(solved))]
                image = at[i] - _dot(rows, residual)
                for m, j in enumerate(solved):
                    slope = _dot(rows, [row[j] for row in slopes])
                    image += ((k == m) - slope) * (box[j] - at[j])
                if not (box[i].a < image.a and image.b < box[i].b):
                    return None
                found[i] = image
        return found

    def residuals(self) -> list[Any]:
        """Return intervals that hold F of the stored numbers."""
        with intervals() as interval:
            return self.evaluate([interval(value) for value in self.unknowns], interval)[0]


def _value(affine: Affine, x: Sequence[Any], number: Callable[[Fraction], Any]) -> Any:
    constant, terms = affine
    return sum((number(k) * x[i] for i, k in terms.items()), start=number(constant))


def _dot(left: Sequence[Any], right: Sequence[Any]) -> Any:
    return sum((a * b for a, b in zip(left, right, strict=True)), start=mp.iv.mpf(0))


def _reversed(series: Series) -> Series:
    return {word[::-1]: value for word, value in series.items()}


@contextmanager
def intervals() -> Iterator[Callable[[Fraction], Any]]:
    """Set the digits of mpmath's intervals, and yield the enclosure of a rational number."""
    before = mp.iv.dps
    mp.iv.dps = DIGITS
    try:
        with mp.workdps(DIGITS):
            yield lambda value: mp.iv.mpf(value.numerator) / value.denominator
    finally:
        mp.iv.dps = before


def as_mpf(value: Any) -> Any:
    """Return an exact number in mpmath's working precision."""
    if isinstance(value, Fraction):
        return mp.mpf(value.numerator) / value.denominator
    return mp.mpf(value)
