"""Order conditions of compositions: coefficients of products of exponentials at Lyndon words.

A composition of flows is, as an operator on functions, a product of exponentials of elements of a
free Lie algebra over graded letters. Such a product is group-like: its coefficient is a character
of the shuffle algebra, which is a polynomial algebra over the Lyndon words (Radford 1979). Two
group-like series agree up to a grade if and only if their coefficients at the Lyndon words up to
this grade agree. The flow of A + B (or of Y₁) has the coefficient 1/n! at every word of n letters
of grade 1, and zero at the others.

A symmetric composition, Ψ(−h) = Ψ(h)⁻¹, has a logarithm odd in h, so conditions of even grade
follow from those below (Hairer, Lubich, Wanner, Geometric Numerical Integration, III.3 and V.3).
Letters are characters:

    A, B         Lie derivatives of drift T and kick V, of grade 1
    C            [B, [A, B]] = 2 BAB − BBA − ABB, written in A and B
    1, 3, 5, …   S(h) = exp(h Y₁ + h³ Y₃ + h⁵ Y₅ + …) of a symmetric map, of their own grade

Reference: S. Blanes, F. Casas, A. Murua, Splitting and composition methods in the numerical
integration of differential equations, Bol. Soc. Esp. Mat. Apl. 45 (2008) 89-145.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cache
from itertools import chain, product
from math import factorial, prod
from typing import Any, TypeAlias

__all__ = ["Flow", "Series", "composition_flow", "differentiate", "drift_flow", "evaluate_flow",
           "exponential", "factors_of", "grade", "is_lyndon", "kick_flow", "lyndon_words",
           "multiply_flows", "target", "words_up_to"]

#: Coefficients at words, and such coefficients as polynomials: exponents of the flow's numbers.
Series: TypeAlias = dict[str, Any]
Flow: TypeAlias = dict[str, dict[tuple[int, ...], Fraction]]


def grade(word: str) -> int:
    """Return the power of h that belongs to a word."""
    return sum(int(letter) if letter.isdigit() else 1 for letter in word)


def words_up_to(letters: str, largest_grade: int) -> list[str]:
    """Return all words of at most ``largest_grade``, the empty one included, by rising grade."""
    by_grade = [[""]]
    for n in range(1, largest_grade + 1):
        # a word of grade n is a letter before a word of what the letter leaves of the grade
        by_grade.append(sorted(letter + word for letter in letters if grade(letter) <= n
                               for word in by_grade[n - grade(letter)]))
    return list(chain.from_iterable(by_grade))


def is_lyndon(word: str) -> bool:
    """Whether a word is smaller than each of its proper suffixes."""
    return bool(word) and all(word < word[i:] for i in range(1, len(word)))


def lyndon_words(letters: str, largest_grade: int) -> list[str]:
    """Return the Lyndon words of odd grade up to this one: the conditions that symmetry leaves."""
    return [word for word in words_up_to(letters, largest_grade) if is_lyndon(word)
            and grade(word) % 2]


def factors_of(words: Iterable[str]) -> list[str]:
    """Return all factors (contiguous subwords) of some words, by grade and alphabet."""
    factors = {word[i:j] for word in words for i in range(len(word) + 1)
               for j in range(i, len(word) + 1)}
    return sorted(factors, key=lambda word: (grade(word), word))


def target(word: str) -> Fraction:
    """Return the coefficient of the exact flow, exp(A + B) or exp(Y₁)."""
    return Fraction(1, factorial(len(word))) if grade(word) == len(word) else Fraction(0)


# ---------------------------------------------------------------- flows


@cache
def drift_flow(largest_grade: int) -> Flow:
    """Return exp(aA), a flow of the number a."""
    return exponential({"A": {(1,): Fraction(1)}}, largest_grade)


@cache
def kick_flow(largest_grade: int, gradients: bool) -> Flow:
    """Return exp(bB), or exp(bB + cC) of the numbers b and c with C = 2 BAB − BBA − ABB."""
    if not gradients:
        return exponential({"B": {(1,): Fraction(1)}}, largest_grade)
    element: Flow = {"B": {(1, 0): Fraction(1)}}
    element |= {word: {(0, 1): Fraction(n)} for word, n in (("BAB", 2), ("BBA", -1), ("ABB", -1))}
    return exponential(element, largest_grade)


@cache
def composition_flow(letters: str, largest_grade: int) -> Flow:
    """Return exp(wY₁ + w³Y₃ + …) with these letters, a flow of the weight w."""
    return exponential({letter: {(int(letter),): Fraction(1)} for letter in letters}, largest_grade)


def exponential(element: Flow, largest_grade: int) -> Flow:
    """Return the exponential Σ elementⁿ/n! of an element of the free algebra, up to a grade."""
    first_terms = next(iter(element.values()))
    number_count = len(next(iter(first_terms)))  # numbers of the flow: an exponent for each
    power: Flow = {"": {(0,) * number_count: Fraction(1)}}  # elementⁿ/n!, begun at n = 0 with 1
    series: Flow = {word: dict(terms) for word, terms in power.items()}
    n = 0
    while power:  # letters have grades ≥ 1: the grade of every word of a power is at least n
        n += 1
        power = _times(power, element, Fraction(1, n), largest_grade)
        for word, terms in power.items():
            _add(series.setdefault(word, {}), terms)
    return series


def _times(f: Flow, g: Flow, factor: Fraction, largest_grade: int) -> Flow:
    """Return factor · f g up to a grade; words are concatenated and their polynomials multiplied.
    """
    products: Flow = {}
    for (left_word, left_terms), (right_word, right_terms) in product(f.items(), g.items()):
        word = left_word + right_word
        if grade(word) > largest_grade:
            continue
        for (d, x), (e, y) in product(left_terms.items(), right_terms.items()):
            exponents = tuple(i + j for i, j in zip(d, e, strict=True))
            _add(products.setdefault(word, {}), {exponents: x * y * factor})
    return products


def _add(terms: dict[tuple[int, ...], Fraction],
         summands: Mapping[tuple[int, ...], Fraction]) -> None:
    """Add a polynomial, a mapping of exponents to coefficients, to ``terms`` in place."""
    for exponents, value in summands.items():
        terms[exponents] = terms.get(exponents, Fraction(0)) + value


def evaluate_flow(
    flow: Flow, arguments: Sequence[Any], as_number: Callable[[Fraction], Any],
    derivative_index: int | None = None,
) -> Series:
    """Return the coefficients of a flow for its numbers, or their derivatives by one of them.

    The coefficient of a word is Σ x Π v_i^(e_i), from exponents e to x, with the numbers v.
    ``as_number`` converts an exact constant to the type of the arguments: interval, mpmath, float.
    """
    zero, one = as_number(Fraction(0)), as_number(Fraction(1))
    series: Series = {}
    for word, terms in flow.items():
        if derivative_index is not None:
            terms = _derivative(terms, derivative_index)
        if not terms:  # the derivative of a constant
            continue
        value = zero
        for exponents, coefficient in terms.items():
            # powers 0 are left out: a factor 1 would cost an operation
            powers = (v**n for v, n in zip(arguments, exponents, strict=True) if n)
            value = value + as_number(coefficient) * prod(powers, start=one)
        series[word] = value
    return series


def _derivative(
    terms: Mapping[tuple[int, ...], Fraction], index: int
) -> dict[tuple[int, ...], Fraction]:
    """Return the derivative of a polynomial by its number ``index``: x vᵉ becomes x e vᵉ⁻¹."""
    slopes: dict[tuple[int, ...], Fraction] = {}
    for exponents, coefficient in terms.items():
        power = exponents[index]
        if power:
            lowered = (*exponents[:index], power - 1, *exponents[index + 1 :])
            slopes[lowered] = coefficient * power
    return slopes


# ---------------------------------------------------------------- products


def multiply_flows(
    series: Sequence[Series], words: Sequence[str], as_number: Callable[[Fraction], Any]
) -> list[Series]:
    """Return the products of the first 0, 1, 2, … flows, as coefficients at words.

    The coefficient of a product at a word is Σ (left factor at u) (right factor at v), word = u v.
    ``words`` must contain all factors of each of its words.
    """
    zero, splits = as_number(Fraction(0)), {}
    products: list[Series] = [{"": as_number(Fraction(1))}]
    for flow in series:
        left, flow_words = products[-1], frozenset(flow)
        # flows of one kind have the same words: their factorisations are found once
        if flow_words not in splits:
            splits[flow_words] = [(word, [(word[:i], word[i:]) for i in range(len(word) + 1)
                                          if word[i:] in flow_words]) for word in words]
        products.append({word: sum((left[u] * flow[v] for u, v in factors if u in left),
                                   start=zero)
                         for word, factors in splits[flow_words]})
    return products


def differentiate(left_product: Series, flow: Series, right_product: Series, word: str,
                  zero: Any) -> Any:
    """Return the coefficient at a word of left · flow · right.

    It is Σ left(u) flow(v) right(w) over all cuts word = u v w; with ``flow`` the derivative of one
    flow by its number, it is the derivative of the product of all flows. ``zero`` is the 0 of the
    coefficients' type.
    """
    coefficient = zero
    for i in range(len(word) + 1):
        if word[:i] not in left_product:
            continue
        for j in range(i, len(word) + 1):
            if word[i:j] in flow and word[j:] in right_product:
                coefficient = coefficient + (left_product[word[:i]] * flow[word[i:j]]
                                             * right_product[word[j:]])
    return coefficient
