"""Detect redundant constraints, which follow from others: refuse them by name, or drop them.

Where g_q, with the rows A of velocity constraints A q̇ + a = 0 below it, lacks full rank on g = 0,
multipliers are not unique. A model is checked at its start; a system without numbers is checked at
random parameters, at points of g = 0 that Gauss-Newton steps reach.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from ...core.arguments import quote
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.projection import as_dense, dependent_rows, solve_sparse
from ...core.records import dataclass
from ..parsing.tokens import shorten
from ..symbolic.numeric_evaluation import evaluate
from ..symbolic.rounding_errors import rounding
from ..symbolic.shared_subexpressions import name_of, symbols_of
from .numeric_system import NumericConstraints
from .system import System

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["Redundancy", "find_redundant", "random_point", "refuse_redundant_anywhere"]

EPS = float(np.finfo(float).eps)

#: Entries of g_q; a system with more is not examined at random points, which would take seconds.
_LARGEST_SEARCH = 20_000
#: Arms beyond this, or below one over it, are not of the size of 1 in their unit.
_USUAL_ARM = 1e4
#: Points of g = 0 that are examined, and random starts at most.
_POINTS, _TRIES = 3, 12
#: Relative singular values of g_q that count as zero in a projection onto g = 0.
_RANK = 1e-10


@dataclass(frozen=True)
class Redundancy:
    """The constraints of a model that others imply; its text is a sentence.

    Attributes
    ----------
    model : str
        Name of the model.
    constraints : tuple of str
        All of its constraints.
    involved : tuple of str
        The constraints that depend on each other.
    left_out : tuple of str
        A smallest set of them without which the others are independent.
    """

    model: str
    constraints: tuple[str, ...]
    involved: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, model: str, names: Sequence[str], involved: Sequence[int], left_out: Sequence[int]
    ) -> Redundancy:
        """Return the redundancy of constraints, given by their row numbers, with their names."""
        return cls(model, tuple(names), *(tuple(names[i] for i in rows)
                                          for rows in (involved, left_out)))

    def __str__(self) -> str:
        if not self.left_out:
            return f"The {len(self.constraints)} constraints of {self.model!r} are independent."
        verb = "is" if len(self.left_out) == 1 else "are"
        return (f"{len(self.left_out)} of the {len(self.constraints)} constraints of "
                f"{self.model!r} {verb} redundant: the others imply {quote(self.left_out)}. "
                f"These depend on each other: {quote(self.involved)}.")

    def refuse(self, cure: str = "") -> None:
        """Refuse redundant constraints; ``cure`` tells a caller how to drop them.

        Raises InputError with the names of all that take part, and of a smallest set to leave out.
        """
        if self.left_out:
            raise InputError(f"{self} Leave out {quote(self.left_out)}; the motion stays the "
                             f"same{cure}.")


def find_redundant(
    owner: str, constraints: NumericConstraints, q: Array, lengths: Array
) -> Redundancy:
    """Return the constraints that others imply; refuse a singular position.

    Parameters
    ----------
    owner : str
        Name of the model.
    q : ndarray, shape (n,)
        The start; it need not be on g = 0 exactly.
    lengths : ndarray of bool, shape (n,)
        Which coordinates are lengths, beside numbers such as quaternions.

    Raises
    ------
    InputError
        For constraints that contradict each other, and in a position where more of them depend
        on each other than elsewhere.
    """
    refuse_constant(owner, constraints.expressions, constraints.constraint_names)
    names = constraints.names
    if not names:
        return Redundancy(owner, constraints=())
    # The rank is taken where g = 0: rows dependent there may be independent elsewhere.
    point = nearest_point(constraints, q)
    G = constraints.rows(q if point is None else point)
    if not _is_finite(G):
        G = as_dense(G)
        infinite = [i for i, row in enumerate(G) if not np.isfinite(row).all()]
        raise InputError(f"The constraints {_names_of(names, infinite)} of {owner!r} have no "
                         "finite gradient at the start; start elsewhere, or in other units.")
    units = _units_of_columns(G, lengths)
    involved, left_out = dependent_rows(_scale_columns(G, units))
    if not involved:
        return Redundancy(owner, tuple(names))
    if point is None or _are_contradictory(constraints, point, left_out):
        raise InputError(f"The constraints {_names_of(names, involved)} of {owner!r} contradict "
                         "each other near the start: no state near it meets them all. Check their "
                         "points, axes and lengths, turn parts that lie in a line a little, or "
                         f"leave out {_names_of(names, left_out)}.")
    # dependent here and independent nearby: a dead centre, not a superfluous constraint
    if _is_singular(constraints, point, len(left_out), units):
        raise InputError(f"{owner!r} starts in a singular position, where its constraints "
                         f"{_names_of(names, involved)} depend on each other although they do not "
                         "elsewhere; start in another position.")
    return Redundancy.of(owner, names, involved, left_out)


def refuse_redundant_anywhere(system: System) -> None:
    """Refuse constraints of a system that depend on each other at every examined point of g = 0.

    Parameters and coordinates are random. A large system passes, and so does one that cannot be
    evaluated, or whose constraints are independent where no point of g = 0 is reached.

    Raises
    ------
    InputError
        With the names of all dependent constraints; also for constraints without q.
    """
    names = [*system.constraint_names, *system.velocity_constraint_names]
    refuse_constant(system.name, system.constraints, system.constraint_names)
    for name, g in zip(system.constraint_names, system.constraints, strict=True):
        if g.free_symbols.isdisjoint(system.q):
            raise InputError(f"The constraint {name!r} of {system.name!r}, {shorten(str(g))} = 0, "
                             "contains no coordinate and restricts no motion; leave it out.")
    if not names or len(names) * system.n > _LARGEST_SEARCH:
        return
    dependencies = _dependencies(system)
    if dependencies is None:
        return
    on_manifold, off_manifold = dependencies
    # rows are dependent at every examined point: any point shows which
    if on_manifold:
        Redundancy.of(system.name, names, *on_manifold[-1]).refuse()
    if all(involved for involved, _ in off_manifold):
        raise InputError(
            f"The constraints {_names_of(names, off_manifold[-1][0])} of {system.name!r} depend on "
            "each other everywhere, and no state was found that meets them all: they contradict "
            "each other.")


#: Row numbers of constraints that depend on each other, and of a smallest set to leave out.
_Dependency = tuple[list[int], list[int]]


def _dependencies(system: System) -> tuple[list[_Dependency], list[_Dependency]] | None:
    """Return dependent rows at random points of g = 0, and at points where none was reached.

    None if one point of g = 0 has independent rows, or if the rows cannot be evaluated.
    """
    # seeded, so that the result for a system does not change from call to call
    rng = np.random.default_rng(20)
    on_manifold: list[_Dependency] = []
    off_manifold: list[_Dependency] = []
    try:
        while len(on_manifold) < _POINTS and len(off_manifold) < _TRIES:
            constraints = NumericConstraints(
                system.q, system.constraints, system.constraint_names, _random_values(system, rng),
                system.A, system.a, system.velocity_constraint_names, system.g_t)
            q = rng.standard_normal(system.n)
            point = nearest_point(constraints, q)
            G = constraints.rows(q if point is None else point)
            if not _is_finite(G):
                return None
            involved, left_out = dependent_rows(G)
            # one regular point proves independence: rank falls on a set of measure zero only
            if point is not None and not involved:
                return None
            # velocities that no q̇ satisfies: there is no state at this point either
            if point is not None and _are_contradictory(constraints, point, left_out):
                point = None
            (off_manifold if point is None else on_manifold).append((involved, left_out))
    except (InputError, TypeError, ArithmeticError, np.linalg.LinAlgError):
        return None  # a function that NumPy does not know, or not off the real axis
    return on_manifold, off_manifold


def refuse_constant(owner: str, constraints: Sequence[sp.Expr], names: Sequence[str]) -> None:
    """Refuse constraints without coordinates or parameters that matter: they hold always or never.

    ``owner`` is the model's name, ``names`` has a name for each constraint.
    """
    for name, g, varies in zip(names, constraints, _vary(constraints), strict=True):
        # a long sum takes too long to expand: it is accepted, constant or not
        if not g.free_symbols or (len(g.args) < 64 and not varies and sp.expand(g).is_number):
            constant = sp.expand(g)
            fault = "always holds; leave it out" if constant == 0 else f"reads {constant} = 0"
            raise InputError(f"The constraint {name!r} of {owner!r} contains no coordinate and "
                             f"{fault}.")


def _vary(constraints: Sequence[sp.Expr]) -> Sequence[bool]:
    """Return for each expression whether its values at four random points differ.

    One whose values differ is no constant, and need not be expanded: a product of twelve sums has
    thousands of terms. False where the difference may be round-off.
    """
    rng = np.random.default_rng(21)
    point = {x: rng.uniform(0.5, 1.5, 4)
             for x in sorted(symbols_of(constraints), key=name_of)}
    if not point:
        return [False] * len(constraints)
    try:
        values = evaluate(constraints, point)
        round_off = EPS * rounding(constraints, point, errors={})
    except (InputError, TypeError, ArithmeticError):
        # one expression that cannot be evaluated does not hide the others
        return [False] if len(constraints) == 1 else [_vary([g])[0] for g in constraints]
    # by a factor of 1e6 more than round-off: an expansion decides about the others
    varies: Sequence[bool] = (np.isfinite(values).all(axis=1)
                              & (np.ptp(values, axis=1) > 1e6 * round_off.max(axis=1))).tolist()
    return varies


def nearest_point(constraints: NumericConstraints, q: Array) -> Array | None:
    """Return a q with g(q) = 0 to round-off, shape (n,), by Gauss-Newton steps from q.

    q ← q − f G⁺ g with the pseudoinverse G⁺ and f, ``fraction``, halved until |g| falls. None if
    sixty steps do not reach g = 0, or |g| has a minimum there that is not 0.
    """
    if not constraints.expressions:
        return q
    with np.errstate(all="ignore"):
        g = constraints.g(q)
        for _ in range(60):
            G = constraints.G(q)
            if not (_is_finite(G) and np.isfinite(g).all()):
                return None
            # round-off of g at q: each entry of G times its coordinate
            floor = 64 * EPS * (abs(G) @ np.abs(q) + EPS).max()
            if np.abs(g).max() <= floor:
                return q
            step = _least_squares(G, g)
            fraction = 1.0
            # halve the step, down to 2^−13, until |g| falls: far away a full one may not reduce it
            while fraction > 1e-4:
                q_new, g_new = q - fraction * step, constraints.g(q - fraction * step)
                if np.linalg.norm(g_new) < np.linalg.norm(g):
                    break
                fraction /= 2
            else:
                return None
            q, g = q_new, g_new
    return None


def _is_finite(matrix: Array | csr_array) -> bool:
    """Whether all entries of a dense or sparse matrix are finite."""
    return bool(np.isfinite(matrix if isinstance(matrix, np.ndarray) else matrix.data).all())


def _least_squares(G: Array | csr_array, g: Array) -> Array:
    """Return G⁺g, shape (n,), G of shape (m, n): the shortest x with the least |G x − g|."""
    if not isinstance(G, np.ndarray):
        # x = Gᵀ (G Gᵀ)⁻¹ g for independent rows
        try:
            x: Array = G.T @ solve_sparse(G @ G.T, g)
            return x
        except np.linalg.LinAlgError:
            G = G.toarray()
    shortest: Array = np.linalg.lstsq(G, g, rcond=_RANK)[0]
    return shortest


def random_point(
    system: System, symbols_besides: Iterable[sp.Symbol] = (), seed: int = 23
) -> tuple[Array, dict[sp.Symbol, float]]:
    """Return random coordinates on g = 0, shape (n,), and values of all other symbols.

    These are parameters, the time, and ``symbols_besides``; all are positive. The coordinates are
    off g = 0 if no start of ``_TRIES`` leads there.
    """
    rng = np.random.default_rng(seed)
    time = {*filter(None, (system.time,))}
    symbols = sorted({*system.parameters} | time | ({*symbols_besides} - {*system.q}), key=str)
    for _ in range(_TRIES):
        # numbers of size 1 that are not special: no sum or product of them is 0 or 1
        values = {s: float(rng.uniform(0.5, 2.0)) for s in symbols}
        q = rng.standard_normal(system.n)
        if not system.m:
            return q, values
        numbers = NumericConstraints(system.q, system.constraints, system.constraint_names,
                                     {str(s): x for s, x in values.items()})
        point = nearest_point(numbers, q)
        if point is not None:
            return point, values
    return q, values


def _are_contradictory(constraints: NumericConstraints, q: Array, left_out: Sequence[int]) -> bool:
    """Whether the dependent rows A q̇ + a = 0 at q have no common solution q̇.

    A q̇ = −a has a solution if and only if (A, a) has the rank of A, that is if as many rows of
    (A, a) as of A, ``left_out``, depend on the others.
    """
    rows = np.column_stack([as_dense(constraints.rows(q)), constraints.drift(q)])
    return len(dependent_rows(rows).left_out) < len(left_out)


def _units_of_columns(G: Array | csr_array, lengths: Array) -> Array:
    """Return units of the coordinates, (n,), in which lengths and numbers have entries of one size.

    ``lengths``, (n,), says which coordinates are in m; the others are numbers. In a row of both,
    the largest entry of numbers over the largest entry of lengths is an arm. Units are 1 but for
    arms of molecules or planets: there one part of a row would be round-off of the other.
    """
    sizes = [abs(G[:, columns]).max(axis=1) if columns.any() else np.zeros(G.shape[0])
             for columns in (~lengths, lengths)]
    numbers_of_rows, lengths_of_rows = (
        x if isinstance(x, np.ndarray) else x.toarray().ravel() for x in sizes)
    has_both = (numbers_of_rows > 0) & (lengths_of_rows > 0)
    arm = (numbers_of_rows[has_both] / lengths_of_rows[has_both]).max(initial=0.0)
    is_usual = 1 / _USUAL_ARM < arm < _USUAL_ARM or arm == 0
    return np.where(lengths, 1.0 if is_usual else arm, 1.0)


def _scale_columns(G: Array | csr_array, units: Array) -> Array | csr_array:
    """Return G with its columns multiplied by units."""
    if isinstance(G, np.ndarray):
        return G * units
    from scipy.sparse import diags_array

    scaled: csr_array = (G @ diags_array(units)).tocsr()
    return scaled


def _is_singular(
    constraints: NumericConstraints, q: Array, dependent_count: int, units: Array
) -> bool:
    """Whether fewer rows than at q, ``dependent_count``, depend on others at a point nearby.

    At such a q the rank of G drops: a singular configuration, such as a stretched parallelogram.
    The point is at a tenth of the size of q along a random tangent, projected onto g = 0; ``units``
    are those of the columns of G.
    """
    rng = np.random.default_rng(21)
    # the largest entry is taken out of the root of squares, which may be beyond 1e308
    largest = np.abs(q).max() or 1.0
    mean_size = largest * np.linalg.norm(q / largest) / np.sqrt(len(q))
    G = as_dense(constraints.G(q))
    for _ in range(3):
        direction = rng.standard_normal(len(q))
        # tangent to g = 0: d ← d − G⁺ G d
        direction -= np.linalg.lstsq(G, G @ direction, rcond=_RANK)[0]
        direction *= 0.1 * mean_size * np.sqrt(len(q)) / max(np.linalg.norm(direction), EPS)
        neighbour = nearest_point(constraints, q + direction)
        if neighbour is not None:
            G = _scale_columns(constraints.rows(neighbour), units)
            return len(dependent_rows(G).left_out) < dependent_count
    return False


def _random_values(system: System, rng: np.random.Generator) -> Mapping[str, float]:
    """Return random values for all parameters and the time, by name.

    Sizes are between 0.5 and 2; half of those that need not be positive are negative.
    """
    values = {}
    for symbol in (*system.parameters, *filter(None, (system.time,))):
        size = float(rng.uniform(0.5, 2.0))
        values[str(symbol)] = size if symbol.is_positive or rng.random() < 0.5 else -size
    return values


def _names_of(names: Sequence[str], rows: Sequence[int]) -> str:
    """Return the names of constraints, given by their row numbers, as text."""
    return quote([names[i] for i in rows])
