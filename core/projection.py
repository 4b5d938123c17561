"""Projection onto the constraints: a state is moved to g(q) = 0 and g_q H_p(q, p) = 0.

    q ← q − Gᵀ(GGᵀ)⁻¹ g          the shortest way, with G = g_q; halved while |g| would grow
    p ← p − Gᵀ W⁻¹ G H_p         W = G H_pp Gᵀ: the smallest change of kinetic energy

Rows A of velocity constraints A q̇ + a = 0 join those of G in the second, and only there.

The generator projects the starts of models that are not compiled yet, ``gs.consistent`` the states
of any system. Nothing here knows SymPy or compiled code.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from .arguments import count_text, quote
from .arrays import Array
from .calls import explain_arguments
from .errors import InputError
from .html import card, table
from .records import dataclass

if TYPE_CHECKING:
    from scipy.sparse import csr_array

__all__ = ["Constrained", "Projection", "as_dense", "dependent_rows", "project", "solve_sparse"]

EPS = float(np.finfo(float).eps)

#: Singular values of G (rows of length one) below this, relative to the largest, count as zero.
RANK_TOLERANCE = 1e-9
#: A row is left out only with at least this share of the largest part in a dependency.
SHARE = 0.1


class Constrained(Protocol):
    """The functions of a system that a projection evaluates."""

    @property
    def constraint_names(self) -> Sequence[str]:
        """Names of the constraints in messages."""
        ...

    @property
    def velocity_constraint_names(self) -> Sequence[str]:
        """Names of the velocity constraints in messages."""
        ...

    @property
    def coordinates(self) -> Sequence[str]:
        """Names of q."""
        ...

    @property
    def momenta(self) -> Sequence[str]:
        """Names of p."""
        ...

    def g(self, q: Array) -> Array:
        """Return g(q), shape (m,)."""
        ...

    def G(self, q: Array) -> Array | csr_array:
        """Return g_q, shape (m, n)."""
        ...

    def rows(self, q: Array) -> Array | csr_array:
        """Return g_q and below it A, shape (m + m', n)."""
        ...

    def f(self, q: Array, p: Array) -> Array:
        """Return g_q H_p, or what vanishes with it, then A H_p + a, shape (m + m',)."""
        ...

    def W(self, q: Array, p: Array, rows: Any) -> Array | csr_array:
        """Return (∂f/∂p) rowsᵀ, shape (m + m', m + m')."""
        ...


@explain_arguments
@dataclass(frozen=True)
class Projection:
    """A consistent state, and the report of its projection.

    Attributes
    ----------
    q, p : ndarray, shape (n,)
        The state with g(q) = 0 and g_q H_p = 0.
    q_moved, p_moved : float
        Largest |Δq| and |Δp| of all coordinates and momenta.
    q_name, p_name : str
        The coordinate and the momentum that moved furthest; empty when none did.
    before, after : dict of str to float
        |g| of each constraint by name.
    hidden_before, hidden_after : dict of str to float
        |g_q H_p| of each constraint by name, |A H_p + a| of each velocity constraint: of the given
        momenta at the projected q.
    """

    q: Array
    p: Array
    q_moved: float
    p_moved: float
    q_name: str
    p_name: str
    before: dict[str, float]
    after: dict[str, float]
    hidden_before: dict[str, float]
    hidden_after: dict[str, float]

    def __repr__(self) -> str:
        return (f"<Projection of {count_text(len(self.q), 'coordinate')} onto "
                f"{count_text(len(self.before), 'constraint')}: "
                f"{_move_of('q', self.q_moved, self.q_name)}, "
                f"{_move_of('p', self.p_moved, self.p_name)}>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the moves, and each constraint before and after."""
        rows = [(name, *(f"{column[name]:.1e}" if name in column else "" for column in (
            self.before, self.after, self.hidden_before, self.hidden_after)))
            for name in self.hidden_before]
        moves = [[_move_of("q", self.q_moved, self.q_name)],
                 [_move_of("p", self.p_moved, self.p_name)]]
        return card("Projection", table(moves), table(
            rows, ("constraint", "|g| before", "after", "|g_q H_p| before", "after")))

    def __str__(self) -> str:
        """Return the largest moves, and a line for each constraint before and after."""
        lines = [_move_of("q", self.q_moved, self.q_name), _move_of("p", self.p_moved, self.p_name)]
        width = max(map(len, self.hidden_before), default=0)
        lines += [
            f"  {name:{width}s}  |g| {self.before[name]:.1e} -> {self.after[name]:.1e}   "
            f"|g_q H_p| {self.hidden_before[name]:.1e} -> {self.hidden_after[name]:.1e}"
            for name in self.before
        ]
        lines += [f"  {name:{width}s}  |A H_p + a| {size:.1e} -> {self.hidden_after[name]:.1e}"
                  for name, size in self.hidden_before.items() if name not in self.before]
        return "\n".join(lines)


def project(system: Constrained, q: Array, p: Array) -> Projection:
    """Return the consistent state near (q, p): q by ``project_coordinates``, then p.

    Raises
    ------
    InputError
        Naming the constraints that depend on each other, or that cannot be met from here.
    """
    with np.errstate(all="ignore"):  # what is not finite ends in a refusal
        q_new = project_coordinates(system, q)
        p_new = project_momenta(system, q_new, p)
        return report(
            system, (q, p), (q_new, p_new), (system.g(q), system.g(q_new)),
            (system.f(q_new, p), system.f(q_new, p_new)),
        )


def report(
    system: Any, start: tuple[Array, Array], projected: tuple[Array, Array], g: tuple[Array, Array],
    f: tuple[Array, Array],
) -> Projection:
    """Return the report of a projection of (q, p) from ``start`` to ``projected``.

    ``g`` and ``f`` are the constraints and the conditions on momenta before and after; ``system``
    has the names.
    """
    names = _names(system)
    q_moved, q_name = _furthest(projected[0] - start[0], system.coordinates)
    p_moved, p_name = _furthest(projected[1] - start[1], system.momenta)
    return Projection(
        projected[0], projected[1], q_moved, p_moved, q_name, p_name,
        *({name: abs(float(x)) for name, x in zip(names[: len(defects)], defects, strict=True)}
          for defects in (*g, *f)),
    )


def project_coordinates(system: Constrained, q: Array) -> Array:
    """Return a q with g(q) = 0 near the given one, by Newton's method with damping.

    q ← q − θ Gᵀ(GGᵀ)⁻¹ g, where θ (``fraction``) is halved until |g| falls or is round-off.
    """
    g = system.g(q)
    closest_q = q  # the last step may raise |g| within round-off
    for _ in range(100):  # damped steps, each of which lowers |g|, may be many
        G = system.G(q)
        step = _newton_step(system, G, G @ G.T, g)
        q_new, g_new, fraction = q - step, system.g(q - step), 1.0
        # not <: |g| may be NaN
        while not _norm(g_new) < max(_norm(g), _round_off_of_g(G, q)) and fraction > 1e-6:
            fraction /= 2
            q_new = q - fraction * step
            g_new = system.g(q_new)
        is_round_off = np.abs(step).max(initial=0.0) <= 4 * EPS * max(_norm(q), EPS)
        if _norm(g_new) <= _norm(g):
            closest_q = q_new
        # a step below the round-off of q: g cannot become smaller, unless G is infinite near q
        if is_round_off and _largest(system.G(q_new) - G) <= _largest(G) / 2:
            return closest_q
        # the slope of |g|² along the step is −2 |g|²: where 20 halvings find no descent, G is
        # nearly singular and the step far too long
        if fraction <= 1e-6:
            break
        q, g = q_new, g_new
    if _norm(g) <= _round_off_of_g(system.G(q), q):
        return closest_q
    worst = int(np.argmax(np.abs(g)))
    raise InputError("No state near the given one meets all constraints: "
                     f"{system.constraint_names[worst]!r} stays at |g| = {abs(g[worst]):.3e}; "
                     "check its points and lengths, or give a nearer start.")


def project_momenta(system: Constrained, q: Array, p: Array) -> Array:
    """Return the p with g_q H_p = 0 and A H_p + a = 0 near the given one, by Newton's method.

    p ← p − rowsᵀ W⁻¹ f with rows = (g_q, A), W = f_p rowsᵀ; one step if H is quadratic in p.
    """
    rows = system.rows(q)
    for _ in range(50):
        f = system.f(q, p)
        step = _newton_step(system, rows, system.W(q, p, rows), f)
        p = p - step
        # the step is round-off
        if np.abs(step).max(initial=0.0) <= 4 * EPS * max(_norm(p), EPS):
            return p
        if not np.isfinite(p).all():
            break
    worst = int(np.argmax(np.abs(f)))
    raise InputError(f"No momenta near the given ones satisfy {_names(system)[worst]!r}: "
                     f"its rate stays at {abs(f[worst]):.3e}; give a nearer start.")


class DependentRows(NamedTuple):
    """Indices of rows of a matrix: all that depend on others, and a smallest set to leave out."""

    involved: list[int]
    left_out: list[int]


def dependent_rows(G: Array | csr_array) -> DependentRows:
    """Return the rows of G that depend on others, and a smallest set of rows to leave out.

    Rows are taken at length one. Of dependent rows the later ones are left out, which belong
    to the joints that were added last, but only rows with a large coefficient in the dependency.
    Example: if the normal of a planar loop is nearly y, row y is left out and not z, because z
    becomes independent as soon as the normal changes.
    """
    if not isinstance(G, np.ndarray):
        if G.shape[0] <= G.shape[1] and _has_independent_rows(G):
            return DependentRows([], [])
        G = G.toarray()
    largest = np.abs(G).max(axis=1, initial=0.0)  # first, for its square may be beyond 1e308
    rows = G / np.where(largest > 0, largest, 1.0)[:, None]
    sizes = np.linalg.norm(rows, axis=1)
    rows /= np.where(sizes > 0, sizes, 1.0)[:, None]
    if len(G) <= G.shape[1] and _is_well_conditioned(rows):
        return DependentRows([], [])
    U, singular_values, _ = np.linalg.svd(rows)
    # the second RANK_TOLERANCE is for a G that is 0
    rank = int(np.sum(singular_values > RANK_TOLERANCE * max(singular_values.max(initial=0.0),
                                                             RANK_TOLERANCE)))
    null = U[:, rank:]  # nullᵀ rows = 0: a column for each dependency
    # coefficients of rows that take no part in it are round-off over the gap of singular values
    involved = [i for i in range(len(G)) if np.linalg.norm(null[i]) > np.sqrt(RANK_TOLERANCE)]
    left_out: list[int] = []
    null_rows = null[involved]  # coefficients of the involved rows in each dependency
    for _ in range(null.shape[1]):
        coefficients = np.linalg.norm(null_rows, axis=1)
        # the last row with a large coefficient
        pivot = np.flatnonzero(coefficients > SHARE * coefficients.max())[-1]
        left_out.append(involved[pivot])
        # one dependency is resolved by leaving out the pivot; go on with those without it
        direction = null_rows[pivot] / coefficients[pivot]
        null_rows = null_rows - np.outer(null_rows @ direction, direction)
    return DependentRows(involved, sorted(left_out))


def _is_well_conditioned(rows: Array) -> bool:
    """Return whether RRᵀ − 1e-10 |RRᵀ|₁ has a Cholesky factor: then no row depends on others.

    R are ``rows``, of length one. |RRᵀ|₁ ≥ σ_max², so that σ_min > 1e-5 σ_max: far above
    ``RANK_TOLERANCE``, and the shift above the round-off of RRᵀ, m eps. It is quicker than singular
    values, which decide where it fails.
    """
    if not len(rows):
        return True
    square = rows @ rows.T
    try:
        np.linalg.cholesky(square - 1e-10 * np.linalg.norm(square, 1) * np.eye(len(square)))
    except np.linalg.LinAlgError:
        return False
    return True


def _has_independent_rows(G: csr_array) -> bool:
    """Return whether D G Gᵀ D has a Cholesky factor after a shift of 1e-10, D = diag |row|⁻¹.

    ``_is_well_conditioned`` has the same bound for dense matrices: 1e-5 of G's singular values.
    """
    square = G @ G.T
    sizes = np.sqrt(square.diagonal())
    if not np.isfinite(sizes).all() or not sizes.all():
        return False
    square = _scale(square, 1 / sizes)
    try:
        _factor(square, 1e-10 * _norm_1(square))
    except np.linalg.LinAlgError:
        return False
    return True


def solve_sparse(W: csr_array, defect: Array) -> Array:
    """Return W⁻¹ defect; raise ``LinAlgError`` if W is not positive definite or nearly singular.

    Constraints of a chain are numbered body by body, so that W = G H_pp Gᵀ has a narrow band: its
    Cholesky factor takes O(m b²) operations for m rows and a band of b.
    """
    from scipy.linalg import cho_solve_banded

    scale = 1 / np.sqrt(np.maximum(np.abs(W.diagonal()), np.finfo(float).tiny))
    scaled = _scale(W, scale)
    # positive definite by more than its round-off, or it raises; the factor itself is not used
    _factor(scaled, EPS * _norm_1(scaled))
    x: Array = cho_solve_banded((_factor(scaled), True), scale * defect)  # True: a lower factor
    x *= scale
    return x


def _scale(A: csr_array, scale: Array) -> csr_array:
    """Return D A D with D = diag(scale): rows and columns of A scaled alike."""
    from scipy.sparse import diags_array

    D = diags_array(scale)
    return D @ A @ D


def _norm_1(A: csr_array) -> float:
    """Return the largest sum of absolute values of a column."""
    return float(abs(A).sum(axis=0).max())


def _factor(A: csr_array, shift: float = 0.0) -> Array:
    """Return the Cholesky factor of A − shift, lower, in the band storage of LAPACK.

    It raises ``LinAlgError`` unless A − shift is positive definite.
    """
    from scipy.linalg import cholesky_banded

    # row k of the band has the k-th diagonal below the main one
    diagonals = A.todia()
    lower = diagonals.offsets <= 0
    band = np.zeros((1 - int(diagonals.offsets.min(initial=0)), A.shape[0]))
    band[-diagonals.offsets[lower], : diagonals.data.shape[1]] = diagonals.data[lower]
    band[0] -= shift
    if not np.isfinite(band).all():
        raise np.linalg.LinAlgError("entries are not finite")
    factor: Array = cholesky_banded(band, lower=True, check_finite=False)
    return factor


def as_dense(matrix: Array | csr_array) -> Array:
    """Return a matrix as an array."""
    dense: Array = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
    return dense


def _newton_step(
    system: Constrained, G: Array | csr_array, W: Array | csr_array, defect: Array
) -> Array:
    """Return Gᵀ W⁻¹ d, shape (n,), of a ``defect`` d = g or f, shape (m,).

    G has the shape (m, n), and W = G Gᵀ or f_p Gᵀ the shape (m, m). Raises an error that names the
    constraints that make W singular. With S = diag(|W_ii|^−½): Gᵀ S (S W S)⁻¹ S d, so that the
    condition of S W S, which is checked, does not depend on the units of the constraints.
    """
    if not len(defect):
        return np.zeros(G.shape[1])
    if not isinstance(W, np.ndarray):
        try:
            correction: Array = G.T @ solve_sparse(W, defect)
            return correction
        except np.linalg.LinAlgError:  # the dense matrix decides
            G, W = as_dense(G), W.toarray()
    scale = 1 / np.sqrt(np.maximum(np.abs(np.diag(W)), np.finfo(float).tiny))
    scaled = W * scale[:, None] * scale
    try:
        inverse = np.linalg.inv(scaled)
        condition = float(np.linalg.norm(scaled, 1) * np.linalg.norm(inverse, 1))
    except np.linalg.LinAlgError:
        condition = math.inf
    if not condition < 1 / EPS:
        raise InputError(f"The state cannot be projected. {_why_singular(system, as_dense(G))}")
    change: Array = G.T @ (scale * (inverse @ (scale * defect)))
    return change


def _why_singular(system: Constrained, G: Array) -> str:
    """Return which constraints leave the multipliers undetermined, as a sentence."""
    names = _names(system)[: len(G)]
    if not np.isfinite(G).all():
        return "The constraints have no finite gradient here; start elsewhere."
    flat = [name for name, row in zip(names, G, strict=True) if not row.any()]
    if flat:
        return f"The gradient of {quote(flat)} vanishes here; start elsewhere."
    involved, left_out = dependent_rows(G)
    if not involved:
        return ("G H_pp Gᵀ is singular: momenta cannot meet the constraints; H needs all of p, and "
                "lengths a unit in which they are near 1.")
    return (f"The constraints depend on each other here: {quote(names[i] for i in involved)}; "
            f"leave out {quote(names[i] for i in left_out)} if others say the same, or start "
            "elsewhere: where parts lie in a line, turn one of them a little. Lengths far from 1 "
            "need another unit.")


def _names(system: Any) -> list[str]:
    """Return the names of the constraints, then of the velocity constraints, as f has them."""
    return [*system.constraint_names, *system.velocity_constraint_names]


def _round_off_of_g(G: Array | csr_array, q: Array) -> float:
    """Return the round-off level of |g|, 16 ε | |G| |q| |: a constraint is a sum of few products.

    |G| |q| bounds the largest of them, which cancel in g.
    """
    return 16 * EPS * float(np.linalg.norm(abs(G) @ np.abs(q))) if G.size else 0.0


def _largest(G: Array | csr_array) -> float:
    """Return the largest |G_ij|; 0 without rows."""
    return float(abs(G).max()) if G.shape[0] else 0.0


def _norm(x: Array) -> float:
    """Return the Euclidean norm as a float."""
    return float(np.linalg.norm(x))


def _furthest(change: Array, names: Sequence[str]) -> tuple[float, str]:
    """Return the largest |change| and its coordinate's name; (0, "") if nothing changes."""
    sizes = np.abs(np.asarray(change, dtype=float))
    if not sizes.any():
        return 0.0, ""
    index = int(np.argmax(sizes))
    return float(sizes[index]), names[index]


def _move_of(letter: str, size: float, name: str) -> str:
    """Return how far q or p was moved, as a clause; ``name`` is the entry that moved most, ""
    for none."""
    return f"{letter} moved by up to {size:.3e} ({name})" if name else f"{letter} not moved"
