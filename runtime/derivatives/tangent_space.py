"""Directions of a start: the tangent space of the constraints, and what each column is.

The states of a constrained system are T*M = {g(q) = 0, f(q, p) = 0}; directions are tangent to it,
G dq = 0 and f_q dq + f_p dp = 0. A parameter or a start time that moves g or f moves the start
too, by the derivative of the projection (``consistent``) at a consistent state,

    dq ← dq − Gᵀ(GGᵀ)⁻¹ (G dq + g_θ dθ),   dp ← dp − GᵀW⁻¹ (f_q dq + f_p dp + f_θ dθ),  W = f_p Gᵀ

IMS and EMS do not keep f = 0: there dp stays as it is.

In scaled time the rows of q and p have t and its momentum e = −H as well: the projection keeps t,
and de = −dH(dq, dp, dθ, dt) at the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...core.arguments import as_flag, as_items, as_text, shown, unknown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.records import dataclass
from ..bindings.array_checks import as_numbers
from ..bindings.run_memory import ParameterStruct

if TYPE_CHECKING:
    from .binding import DerivativeBinding

__all__ = ["Start", "TangentSpace", "Tangents", "null_space"]

#: |G dq| beyond this share of |G| |dq| is no round-off.
_OFF = 1e-10
#: Round-off of G dq: 64 ε of each entry, as in the test of starts.
_ROUNDING = 64 * float(np.finfo(float).eps)


@dataclass(frozen=True)
class Tangents:
    """The directions along which ``integrate`` computes tangents.

    Attributes
    ----------
    start : {"all"} or array_like, shape (2 n, k), or None
        Directions of (q, p) at the start, in columns; "all" is an orthonormal basis of the tangent
        space of the constraints, 2 (n − m) columns.
    parameters : sequence of str
        Names of parameters and inputs; ``project`` does not concern them.
    dt, t0 : bool
        Whether the time step, in scaled time Δτ, and the start time are directions.
    project : bool
        Project given directions onto the tangent space, which else are refused where they leave
        it.
    multipliers : bool
        Whether the multipliers of the stored steps are differentiated too.
    """

    start: Any = "all"
    parameters: Sequence[str] = ()
    dt: bool = False
    t0: bool = False
    project: bool = False
    multipliers: bool = False

    def __post_init__(self) -> None:
        """Check the flags and the names.

        Raises
        ------
        InputError
            Naming the value and the allowed ones.
        """
        for name in ("dt", "t0", "project", "multipliers"):
            as_flag(name, getattr(self, name))
        names = tuple(as_text("a parameter's name", name)
                      for name in as_items("parameters", self.parameters, "names"))
        object.__setattr__(self, "parameters", names)
        if isinstance(self.start, str) and self.start != "all":
            raise InputError(f"start = {shown(self.start)} is unknown; give 'all', an array with "
                             "a row for each coordinate and momentum, or None.")
        if self.start is not None and not isinstance(self.start, str):
            as_numbers("start", self.start)


class TangentSpace:
    """Directions at a consistent state (q, p), in rows q, p, parameters, dt, start time."""

    def __init__(
        self, binding: DerivativeBinding, parameters: ParameterStruct, q: Array, p: Array,
        constraint_names: Sequence[str],
    ) -> None:
        """Compute ∂g and ∂f, (m, rows), at the state (q, p): the tangent space is their kernel.

        ``constraint_names`` are for errors of directions that leave a constraint.
        """
        self.binding, self.n = binding, binding.n
        self._names = constraint_names
        q_size, p_size = (float(np.linalg.norm(x.astype(float))) for x in (q, p))
        # |q|/|p|, by which a change of p compares with one of q; 1 at rest
        self._q_per_p = q_size / (p_size or q_size or 1.0)
        self.g, self.f = binding.constraint_derivatives(parameters, q, p)
        n, n_shown = self.n, binding.module.shown
        #: The rows of q and p that users see.
        self.places = np.r_[:n_shown, n : n + n_shown]
        self._G, self._f_p = self.g[:, :n].copy(), self.f[:, n : 2 * n]
        # in scaled time q has t as its last entry: the projection moves q and keeps t
        self._G[:, n_shown:] = 0
        self._energy = (binding.energy_derivatives(parameters, q, p) if binding.module.clocked
                        else None)

    def project(self, dz: Array) -> Array:
        """Return directions whose rows q and p are moved along Gᵀ until they keep the constraints.

            dq ← dq − Gᵀ (G Gᵀ)⁻¹ dg,   dp ← dp − Gᵀ (f_p Gᵀ)⁻¹ df

        dg and df are the derivatives of g and f along all rows of ``dz``, shape (rows, k); in
        scaled time then de ← −dH.
        """
        n, G, directions = self.n, self._G, dz.copy()
        if len(G):
            directions[:n] -= G.T @ solve(G @ G.T, self.g @ directions)
        # f depends on the projected dq too: the rows of q come first
        if len(G) and self.binding.keeps_momentum:
            directions[n : 2 * n] -= G.T @ solve(self._f_p @ G.T, self.f @ directions)
        if self._energy is not None:
            # e = −H: de = −dH of the projected direction, so that H + e stays 0
            directions[2 * n - 1] = -(self._energy @ directions)
        return directions

    def pulled_back(self, z_bar: Array) -> Array:
        """Return the transpose of ``project`` applied to cotangents, shape (rows,) or (rows, k).

            z̄ ← z̄ − f_zᵀ (f_p Gᵀ)⁻ᵀ G p̄,   then   z̄ ← z̄ − g_zᵀ (G Gᵀ)⁻¹ G q̄
        """
        n, G, cotangent = self.n, self._G, z_bar.copy()
        # the transposes in the reverse order: e, then p, then q
        if self._energy is not None:
            # a copy, of one number too: indexing one of float128 has no method of arrays
            of_energy, cotangent[2 * n - 1] = np.array(cotangent[2 * n - 1]), 0
            cotangent -= np.multiply.outer(self._energy, of_energy)
        if len(G) and self.binding.keeps_momentum:
            cotangent -= self.f.T @ solve((self._f_p @ G.T).T, G @ cotangent[n : 2 * n])
        if len(G):
            cotangent -= self.g.T @ solve(G @ G.T, G @ cotangent[:n])
        return cotangent

    @property
    def normals(self) -> Array:
        """The derivatives of g and f by (q, p), shape (2 m, 2 n)."""
        rows: Array = np.concatenate([self.g, self.f])[:, self.places]
        return rows

    def basis(self) -> Array:
        """Return an orthonormal basis of the tangent space, shape (2 n, 2 (n − m))."""
        return null_space(self.normals)

    def refuse_off(self, directions: Array) -> None:
        """Refuse directions of (q, p), (2 n, k), that leave g = 0: |G_μ dq| > bound for a row μ.

        The bound is |G_μ| (1e-10 |dq| + 64 ε |dp| |q|/|p|): round-off of dq and of a change of p.
        """
        n = len(self.places) // 2
        dq, dp = (block.astype(float) for block in (directions[:n],
                                                    directions[n : 2 * n]))
        G = self._G[:, :n].astype(float)
        # a direction along momenta alone has a dq of round-off
        round_off = _ROUNDING * self._q_per_p * np.linalg.norm(dp, axis=0)
        for mu, row in enumerate(G):
            rates = np.abs(row @ dq)
            bounds = np.linalg.norm(row) * (_OFF * np.linalg.norm(dq, axis=0) + round_off)
            k = int(np.argmax(rates - bounds)) if rates.size else 0
            if rates.size and rates[k] > bounds[k]:
                raise InputError(
                    f"Direction {k} leaves the constraint {self._names[mu]!r}: its rate is "
                    f"{row @ dq[:, k]:.3g}. Give a direction with G dq = 0, or project=True.")


def solve(A: Array, b: Array) -> Array:
    """Return A⁻¹ b in the type of the arrays; A has the shape (n, n), b (n,) or (n, k).

    LAPACK takes float and double; long double and float128 are eliminated here, with row pivots.
    """
    if A.dtype in (np.float32, np.float64):
        solution: Array = np.linalg.solve(A, b)
        return solution
    A, x = A.copy(), b.copy()
    # Gauss: eliminate below the pivots, then substitute from the last row on
    for k in range(len(A)):
        pivot = k + int(np.argmax(np.abs(A[k:, k])))
        A[[k, pivot]], x[[k, pivot]] = A[[pivot, k]], x[[pivot, k]]
        for i in range(k + 1, len(A)):
            factor = A[i, k] / A[k, k]
            A[i, k:] -= factor * A[k, k:]
            x[i] -= factor * x[k]
    for k in range(len(A) - 1, -1, -1):
        x[k] = (x[k] - A[k, k + 1 :] @ x[k + 1 :]) / A[k, k]
    return x


def null_space(rows: Array) -> Array:
    """Return an orthonormal basis of {x: rows x = 0}, shape (n, n − rank), for ``rows``, (m, n).

    Gram-Schmidt, done twice, on the rows; then on unit vectors, each time on the one that is
    farthest from the span so far. Any floating-point type will do, which LAPACK does not take.
    """
    size, basis = rows.shape[1], list[Array]()
    units = [*np.eye(size, dtype=int).astype(rows.dtype)]
    spanned: list[Array] = []
    for row in rows:
        vector = _orthogonal(row, spanned)
        if vector is not None:
            spanned.append(vector)
    rank = len(spanned)
    # |e_i − its projection|² of each unit vector: the largest loses no digits
    squared_distances = 1.0 - sum((v.astype(float) ** 2 for v in spanned), np.zeros(size))
    while len(basis) < size - rank:
        vector = _orthogonal(units[int(np.argmax(squared_distances))], spanned)
        if vector is None:
            break
        squared_distances -= vector.astype(float) ** 2
        spanned.append(vector)
        basis.append(vector)
    return np.array(basis).T.reshape(size, len(basis)).copy()


def _orthogonal(x: Array, basis: Sequence[Array]) -> Array | None:
    """Return the unit vector along x − Σ v (v·x), v in the orthonormal ``basis``; shapes (n,).

    None if x is in the span of the basis: the remainder is below 1e-10 |x|.
    """
    squared_norm = x @ x
    # twice is enough (Kahan, Parlett): once leaves parts of the size of round-off over |remainder|
    for _ in range(2):
        for v in basis:
            x = x - v * (v @ x)
    squared_remainder = x @ x
    if not squared_remainder > 1e-20 * squared_norm:
        return None
    # x/x/2 is ½ in the type of x: a float ½ would round an exponent of float128
    unit: Array = x / squared_remainder ** (squared_norm / squared_norm / 2)
    return unit


class Start:
    """Start directions of tangents: ``directions``, (rows, k), and ``names`` of its columns."""

    def __init__(self, space: TangentSpace, tangents: Tangents) -> None:
        """Collect the columns of q and p, then of parameters, dt and t0, and project them.

        Raises InputError for unknown names, for directions off the constraints, and for none.
        """
        binding = space.binding
        derivative_module, n = binding.module, binding.n
        names = derivative_module.parameter_names
        columns: list[Array] = []
        self.names: list[str] = []
        if tangents.start is not None:
            directions = _state_directions(space, tangents)
            for k in range(directions.shape[1]):
                column = derivative_module.new(binding.rows)
                column[space.places] = directions[:, k]
                columns.append(column)
                self.names.append(f"start[{k}]")
        for name in tangents.parameters:
            if name not in names:
                raise unknown("parameter", name, names)
            columns.append(_unit(binding, 2 * n + names.index(name)))
            self.names.append(name)
        # the last two rows are dt and t0; in scaled time the start's time is a coordinate
        time_row = n - 1 if derivative_module.clocked else binding.rows - 1
        for flag, name, index in ((tangents.dt, "dt", binding.rows - 2),
                                  (tangents.t0, "t0", time_row)):
            if flag:
                columns.append(_unit(binding, index))
                self.names.append(name)
        if not columns:
            raise InputError("No direction is asked for; give start, parameters, dt or t0.")
        self.directions = space.project(np.ascontiguousarray(np.array(columns).T))


def _state_directions(space: TangentSpace, tangents: Tangents) -> Array:
    """Return the directions of q and p, shape (2 n, k): the basis for "all", or the user's array.

    The user's directions are checked to be tangent to the constraints, unless they are projected.
    """
    if isinstance(tangents.start, str):
        return space.basis()
    binding, start = space.binding.module, as_numbers("start", tangents.start)
    if start.ndim == 1:
        start = start[:, None]
    # in scaled time a user's state is without t and −H
    n = binding.shown
    if start.ndim != 2 or len(start) != 2 * n:
        raise InputError(f"start has the shape {start.shape}; a direction has {2 * n} rows, those "
                         "of q and of p.")
    directions: Array = binding.array("start", start, start.shape)
    if not tangents.project:
        space.refuse_off(directions)
    return directions


def _unit(binding: DerivativeBinding, index: int) -> Array:
    """Return a direction, (rows,), of one parameter or time alone."""
    column: Array = binding.module.new(binding.rows)
    column[index] = 1
    return column
