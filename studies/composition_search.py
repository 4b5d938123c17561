"""Search for compositions: ``python -m gyrospark.studies.composition_search KL6``.

Random starts, damped Gauss-Newton iterations on the order conditions (P. Deuflhard, Newton Methods
for Nonlinear Problems, 2004, chapter 4), sequential quadratic programming along the family of
solutions to the least objective

    s (Σ|w_i|^{p+1})^{1/(p+1)}   for weights (W. Kahan, R.-C. Li 1997),
    s ‖e‖^{1/p}                  for drifts and kicks, e the error's coefficients at p + 1 letters
    Σ|a_i| + Σ|b_i| + ‖c‖₂       where kicks are small (S. Blanes and others 2013),

then random steps from the best solution, kept where the objective falls. A run depends on its
arguments and its seed only, but for rounding. With ``--write`` the best solution is refined by
Newton's method and stored in compositions.json with the arguments. Needs SciPy.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from functools import cached_property
from itertools import product
from operator import itemgetter
from typing import NamedTuple

import mpmath as mp
import numpy as np
from numpy.typing import NDArray

from ..certificates.composition_proofs import DIGITS, STORED, Affine, OrderConditions
from ..certificates.lyndon_words import Flow, factors_of, target
from ..core.arrays import Floats
from ..generator.tableaux.compositions import COMPOSITIONS, PATH, composition_named

__all__ = ["FloatConditions", "main", "search", "store"]

#: A solution: length of the Gauss-Newton step (rounding of the conditions keeps it from zero) and
#: largest condition.
_NEAR, _SOLVED = 1e-6, 1e-14
#: A start is given up at this damping factor, or after so many iterations.
_SHORTEST, _ITERATIONS = 1e-4, 200
#: Singular values below this part of the largest count as zero.
_RANK = 1e-13
#: Decimals of free unknowns that are stored: the objective is flat at its least.
_FREE = 10
#: A solution after a random step is optimised if its objective is less than this times the best.
_WORTH_OPTIMISING = 1.2


class _Kind(NamedTuple):
    """All flows of one kind, e.g. the drifts, of a composition.

    The matrix of a flow is Σ_k (Π_v x_v^(monomials[k, v])) matrices[k], x the numbers of the flow.
    """

    monomials: NDArray[np.int_]  # exponents, shape (monomials, numbers of a flow)
    matrices: Floats  # shape (monomials, words, words)
    places: list[int]  # positions of the flows in the composition
    numbers: list[list[int]]  # for each flow the indices of its numbers among those of all flows


class _Linearised(NamedTuple):
    """Conditions F(x) at the words, and F′(x), shapes (words,) and (words, unknowns)."""

    F: Floats
    slopes: Floats


class _FlowTables(NamedTuple):
    """The flows of a composition, whose numbers are constants + slopes · x of the unknowns x."""

    factors: list[str]  # words, and the words that products of flows make on the way to them
    kinds: list[_Kind]
    constants: Floats  # shape (numbers,)
    slopes: Floats  # shape (numbers, unknowns)


@dataclass(frozen=True)
class FloatConditions:
    """F(x) and F′(x) of a composition in doubles, as products of matrices."""

    conditions: OrderConditions

    @cached_property
    def words(self) -> list[str]:
        """Words of the conditions, then words of the leading error where letters are A and B.

        The latter are all words of p + 1 letters, p the order of the composition.
        """
        method = self.conditions.composition
        error = [] if method.base else product("AB", repeat=method.order + 1)
        return [*self.conditions.words, *map("".join, error)]

    @cached_property
    def _tables(self) -> _FlowTables:
        """The flows of the composition: a palindrome and a prescribed sum determine the numbers
        of flows that are no unknowns."""
        factors = factors_of(self.words)
        flows = list(self.conditions.flows(self.words))
        kinds: dict[int, _Kind] = {}
        numbers: list[Affine] = []
        for i, (flow, flow_numbers) in enumerate(flows):
            # drifts and kicks are one object each: their matrices are computed once
            if id(flow) not in kinds:
                kinds[id(flow)] = _Kind(*_matrices(flow, factors), places=[], numbers=[])
            kinds[id(flow)].places.append(i)
            kinds[id(flow)].numbers.append(
                list(range(len(numbers), len(numbers) + len(flow_numbers))))
            numbers += flow_numbers
        slopes = np.zeros((len(numbers), len(self.conditions.unknowns)))
        for row, (_, terms) in zip(slopes, numbers, strict=True):
            for i, k in terms.items():
                row[i] = k
        return _FlowTables(factors, list(kinds.values()),
                           np.array([float(c) for c, _ in numbers]), slopes)

    def evaluate(self, x: Floats) -> _Linearised:
        """Return F(x), shape (words,), and F′(x), shape (words, unknowns).

        F is the coefficient of the composition at each word less the coefficient of the exact
        flow. A flow is a matrix that multiplies rows of coefficients, and the composition is the
        product F₁ F₂ …: its slope by a number of flow i is F₁ … F_(i−1) (dF_i) F_(i+1) ….
        """
        factors, kinds, constants, slopes = self._tables
        size, values = len(factors), constants + slopes @ x
        count = sum(len(kind.places) for kind in kinds)
        flows = np.empty((count, size, size))
        for kind in kinds:
            scale = np.prod(values[kind.numbers][:, None, :] ** kind.monomials, axis=2)
            flows[kind.places] = np.tensordot(scale, kind.matrices, axes=1)
        # left[i]: the row F₁ … F_i, of the empty word; right[i]: F_(i+1) F_(i+2) … at the words
        left, right = np.zeros((count + 1, size)), np.empty((count + 1, size, len(self.words)))
        left[0, 0] = 1
        right[-1] = np.eye(size)[:, [factors.index(word) for word in self.words]]
        for i in range(count):
            left[i + 1] = left[i] @ flows[i]
            right[-2 - i] = flows[-1 - i] @ right[-1 - i]
        by_number = np.empty((len(values), len(self.words)))
        for kind in kinds:
            left_times_matrices = np.tensordot(left[kind.places], kind.matrices, (1, 1))
            right_of_flows = right[np.array(kind.places) + 1]
            for variable, indices in enumerate(zip(*kind.numbers, strict=True)):
                # dxⁿ/dx = n xⁿ⁻¹ of each monomial; for n = 0 the factor n removes the term
                exponents = kind.monomials.copy()
                exponents[:, variable] = np.maximum(exponents[:, variable] - 1, 0)
                scale = kind.monomials[:, variable] * np.prod(
                    values[kind.numbers][:, None, :] ** exponents, axis=2)
                by_number[list(indices)] = (
                    scale[:, None] @ left_times_matrices @ right_of_flows)[:, 0]
        exact = np.array([float(target(word)) for word in self.words])
        return _Linearised(left[-1] @ right[-1] - exact, by_number.T @ slopes)

    def objective(self, x: Floats) -> float:
        """Return the objective of the search at x.

        s (Σ|w_i|^{p+1})^{1/(p+1)} for weights w; Σ|a_i| + Σ|b_i| + ‖c‖₂ for drifts a, kicks b and
        gradients c where kicks are small; s ‖e‖^{1/p} for other drifts and kicks, with the
        coefficients e of the error at p + 1 letters.
        """
        method, parts = self.conditions.composition, self.conditions.values(x.tolist(), float)
        p = method.order
        if method.base:
            return float(len(method.weights) * np.linalg.norm(parts[0], p + 1))
        if len(method.orders) > 1:
            drifts, kicks, *gradients = parts
            return float(np.abs(drifts).sum() + np.abs(kicks).sum() + np.linalg.norm(gradients))
        F, _ = self.evaluate(x)
        error = F[len(self.conditions.words):]
        return float(method.stages * np.linalg.norm(error) ** (1 / p))


def _matrices(flow: Flow, words: Sequence[str]) -> tuple[NDArray[np.int_], Floats]:
    """Return exponents of a flow's monomials and their matrices, (monomials, words, words).

    ``flow`` is word → {exponents: coefficient}, with an exponent for each number of the flow.
    A row of coefficients times the flow has at the word w = uv the sum over all cuts of
    row[u] · flow[v]: entry (u, uv) of a monomial's matrix is its coefficient at v.
    """
    monomials = sorted({exponents for terms in flow.values() for exponents in terms})
    word_index = {word: i for i, word in enumerate(words)}
    matrices = np.zeros((len(monomials), len(words), len(words)))
    for word in words:
        for i in range(len(word) + 1):
            for exponents, coefficient in flow.get(word[i:], {}).items():
                matrices[monomials.index(exponents), word_index[word[:i]],
                         word_index[word]] += float(coefficient)
    return np.array(monomials), matrices


class SearchResult(NamedTuple):
    """The best solution of a search."""

    x: Floats
    objective: float
    solution_count: int  # starts that led to a solution


def search(
    name: str, seed: int = 1, starts: int = 100, hops: int = 0, width: float = 0.5,
    middle: float = 1.0, largest_weight: float = 1.5,
) -> SearchResult:
    """Search a composition with the smallest objective from random starts.

    ``FloatConditions.objective`` measures the error of the method, or the size of its coefficients.

    Parameters
    ----------
    name : str
        A composition of ``COMPOSITIONS``: its form is searched, its numbers are not used.
    seed : int
        Of the random numbers.
    starts, hops : int
        Random starts, and random steps from the best solution.
    width : float
        Half the width of the box of the starts.
    middle : float
        Where the box is: 0 around zeros, 1 around equal steps.
    largest_weight : float
        Largest magnitude of an unknown.

    Raises
    ------
    MissingDependencyError
        Without SciPy.
    ArithmeticError
        If no start led to a solution.
    """
    conditions = OrderConditions(composition_named(name))
    floats, draw = FloatConditions(conditions), np.random.default_rng(seed)
    # ``equal``: the unknowns of a composition with equal steps
    centre = middle * np.array(conditions.equal)
    solutions: list[tuple[float, Floats]] = []
    for _ in range(starts):
        x = _solve(floats, centre + draw.uniform(-width, width, len(centre)), largest_weight)
        if x is not None:
            solutions.append((floats.objective(x), x))
    if not solutions:
        raise ArithmeticError(f"None of {starts} starts led to a composition like {name}; take "
                              "more, or another seed.")
    solution_count = len(solutions)
    by_objective = itemgetter(0)
    solutions.sort(key=by_objective)
    # the slide along a family of solutions takes long: for the best ten alone
    objective, x = min((_slide(floats, x, start_objective, largest_weight)
                        for start_objective, x in solutions[:10]), key=by_objective)
    for _ in range(hops):
        # short steps refine the solution, long ones lead to another family
        y = _solve(floats, x + draw.normal(0, 0.1 * draw.uniform(), len(x)), largest_weight)
        if y is not None and floats.objective(y) < _WORTH_OPTIMISING * objective:
            y_objective, y = _slide(floats, y, floats.objective(y), largest_weight)
            if y_objective < objective:
                objective, x = y_objective, y
    return SearchResult(x, objective, solution_count)


def _solve(floats: FloatConditions, x: Floats, largest_weight: float) -> Floats | None:
    """Return a solution of F(x) = 0 near a start; None if the iteration reaches none.

    Gauss-Newton steps Δ = −F′(x)⁺F(x) of least length, with a damping λ (``size``) that is halved
    until ‖F′(x)⁺F(x + λΔ)‖ ≤ (1 − λ/2)‖Δ‖. This test does not depend on the scaling of the
    conditions, which are nearly combinations of others in part.
    """
    k = len(floats.conditions.words)
    F, J = (block[:k] for block in floats.evaluate(x))
    size = 1.0
    for _ in range(_ITERATIONS):
        if not np.abs(x).max() < largest_weight:  # or not a number
            return None
        inverse = np.linalg.pinv(J, rcond=_RANK)
        step = -inverse @ F
        length = float(np.linalg.norm(step))
        if length < _NEAR and np.abs(F).max() < _SOLVED:
            return x + step
        # λ may grow by 4 from step to step; a step has at most the length 1
        size = min(1.0, 4 * size, 1 / max(length, _NEAR))
        while True:
            y = x + size * step
            F, J = (block[:k] for block in floats.evaluate(y))
            if np.linalg.norm(inverse @ F) <= (1 - size / 2) * length:
                break
            size /= 2
            if size < _SHORTEST:
                return None
        x = y
    return None


def _slide(
    floats: FloatConditions, x: Floats, objective: float, largest_weight: float
) -> tuple[float, Floats]:
    """Return the least objective along the family of solutions through x, and the solution there.

    ``objective`` belongs to x. Both are returned unchanged if x is isolated, or if sequential
    quadratic programming reaches nothing better.
    """
    if not floats.conditions.composition.free:
        return objective, x
    k = len(floats.conditions.words)
    from scipy import optimize  # takes 0.2 s

    optimum = optimize.minimize(
        floats.objective, x, method="SLSQP", options={"maxiter": 100, "ftol": 1e-12},
        constraints={"type": "eq", "fun": lambda y: floats.evaluate(y).F[:k],
                     "jac": lambda y: floats.evaluate(y).slopes[:k]}).x
    # the optimum meets the conditions to 1e-12 only
    y = _solve(floats, optimum, largest_weight)
    if y is None or floats.objective(y) >= objective:
        return objective, x
    return floats.objective(y), y


def store(name: str, x: Sequence[float], note: str) -> None:
    """Refine a solution in 90 digits, and write 60 of them to compositions.json.

    Free unknowns are rounded before; ``note`` says how the solution was found.
    """
    conditions = OrderConditions(composition_named(name))
    free_indices = conditions.composition.free
    start = [Fraction(f"{number:.{_FREE}f}" if i in free_indices else repr(float(number)))
             for i, number in enumerate(x)]
    with mp.workdps(DIGITS):
        digits = [mp.nstr(number, DIGITS - 10, min_fixed=-mp.inf, max_fixed=mp.inf)
                  for number in conditions.refine(start)]
    # rounded to ``STORED`` decimals: the digits behind them are the reserve of the refinement
    last_place, context = Decimal(1).scaleb(-STORED), Context(prec=DIGITS)
    texts = [f"{Decimal(text).quantize(last_place, context=context):f}" for text in digits]
    # free unknowns are short decimals
    texts = [text.rstrip("0") if i in free_indices else text for i, text in enumerate(texts)]
    stored = json.loads(PATH.read_text(encoding="utf-8"))
    for kind_of_numbers in ("weights", "drifts", "kicks", "gradients"):
        if kind_of_numbers in stored[name]:
            count = len(stored[name][kind_of_numbers])
            stored[name][kind_of_numbers], texts = texts[:count], texts[count:]
    stored[name]["found"] = note
    PATH.write_text(json.dumps(stored, indent=1) + "\n", encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> None:
    """Search for a composition, and store it where asked."""
    parser = argparse.ArgumentParser(description="Search for the numbers of a composition.")
    parser.add_argument("name", choices=[name for name, entry in COMPOSITIONS.items()
                                         if OrderConditions(entry).words])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--hops", type=int, default=0)
    parser.add_argument("--width", type=float, default=0.5)
    parser.add_argument("--middle", type=float, default=1.0)
    parser.add_argument("--write", action="store_true", help="Store the best solution.")
    choice = parser.parse_args(arguments)
    x, objective, solution_count = search(choice.name, choice.seed, choice.starts, choice.hops,
                                          choice.width, choice.middle)
    floats = FloatConditions(OrderConditions(composition_named(choice.name)))
    stored = floats.objective(np.array([float(v) for v in floats.conditions.unknowns]))
    print(f"{choice.name}: {solution_count} of {choice.starts} starts led to a solution; the best "
          f"has the objective {objective:.6f} (stored: {stored:.6f})")
    print(*(f"  {float(v)!r}" for v in x), sep="\n")
    if choice.write:
        store(choice.name, x.tolist(), f"seed {choice.seed}, starts {choice.starts}, "
              f"hops {choice.hops}, width {choice.width}, middle {choice.middle}")


if __name__ == "__main__":
    main()
