"""Integrable velocity constraints: rates of functions of position, which replace them.

A combination ω = Σ c_k (A_k dq + a_k dt) of the rows is integrable only if dω vanishes on the
velocities that all rows and all constraints allow (Frobenius). Constant c_k with this property are
the null vectors of Σ c_k dω_k(X_i, X_j) = 0 at random points of g = 0. What is found is proved by
differentiation: φ has dφ = ω, or ω divided by one of its coefficients.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

import numpy as np
import sympy as sp

from ...core.arrays import Array
from ...core.records import dataclass
from ...core.warnings import warn
from ..parsing.tokens import shorten
from ..symbolic.bounded_algebra import is_small
from ..symbolic.derivatives import derivative
from ..symbolic.identities import compare
from ..symbolic.numeric_evaluation import evaluate
from .redundant_constraints import random_point
from .system import System

__all__ = ["RowIntegral", "curls_of", "row_integrals", "warn_of_row_integrals",
           "with_row_integrals"]

#: Step of complex differences, which cancel nothing: their error, its square, is below round-off.
_TINY = 1e-100
#: What counts as 0 in a reduced echelon form, beside entries of size 1 and their round-off.
_SMALL = 1e-9
#: Random points at which the curl must vanish.
_POINTS = 3
#: Largest denominator of a coefficient c_k.
_DENOMINATOR = 64
#: t of a system that declares no time.
_CLOCK = sp.Symbol("_clock", real=True)


@dataclass(frozen=True)
class RowIntegral:
    """A function of q and t that velocity constraints keep constant.

    Attributes
    ----------
    rows : dict of str to Rational
        Names of the rows that it is a combination of → their coefficients.
    expression : Expr
        φ(q, t).
    """

    rows: dict[str, sp.Rational]
    expression: sp.Expr


def row_integrals(system: System) -> list[RowIntegral]:
    """Return the integrals φ(q, t) of constant combinations Σ c_k (A_k dq + a_k dt) = dφ.

    Only coefficients that are polynomials of q, t and their sines and cosines are integrated.
    """
    if not system.velocity_count:
        return []
    # rows of one-forms in (q, t)
    x = [*system.q, system.time or _CLOCK]
    rows = [[*row, rate] for row, rate in zip(system.A, system.a, strict=True)]
    integrals = []
    for c in _candidates(system, x, rows):
        omega = [sp.Add(*(k * row[i] for k, row in zip(c, rows, strict=True)))
                 for i in range(len(x))]
        phi = _potential(omega, x)
        if phi is not None:
            names = zip(system.velocity_constraint_names, c, strict=True)
            integrals.append(RowIntegral({name: k for name, k in names if k}, phi))
    return integrals


def with_row_integrals(system: System) -> System:
    """Return the system with a constraint φ(q, t) − φ₀ = 0 in place of a row for each integral.

    φ₀ is a new parameter, named after the row that the constraint replaces: NAME_0. A system
    without row integrals is returned as it is.
    """
    remaining = dict(zip(system.velocity_constraint_names, system.velocity_constraints,
                         strict=True))
    g, names, start_values = [], [], []
    for integral in row_integrals(system):
        # φ = φ₀ replaces the first of its rows, which follows from it and from the other ones; no
        # other integral has this row, as their coefficients are in reduced echelon form
        name = next(iter(integral.rows))
        phi_0 = sp.Symbol(re.sub(r"\W+", "_", f"{name}_0"), real=True)
        del remaining[name]
        g.append(integral.expression - phi_0)
        names.append(name)
        start_values.append(phi_0)
    if not g:
        return system
    extended: System = replace(
        system, parameters=(*system.parameters, *start_values),
        constraints=(*system.constraints, *g),
        constraint_names=(*system.constraint_names, *names),
        velocity_constraints=tuple(remaining.values()), velocity_constraint_names=tuple(remaining))
    return extended


def warn_of_row_integrals(system: System) -> None:
    """Warn of velocity constraints that are rates of a function of position, with the function."""
    for integral in row_integrals(system):
        names = ", ".join(map(repr, integral.rows))
        warn(f"Of the velocity constraints of {system.name!r}, {names} keep "
             f"{shorten(str(integral.expression), 60)} constant: as velocities to the order of the "
             "method only. system.with_row_integrals() holds it to round-off.")


def _candidates(
    system: System, x: Sequence[sp.Symbol], rows: Sequence[Sequence[sp.Expr]]
) -> Iterator[list[sp.Rational]]:
    """Yield coefficients c_k with which Frobenius' condition dω(X, Y) = 0 holds at random points.

    X and Y are tangents of g = 0 with ω = 0; x are the coordinates, then t, ``rows`` the one-forms
    (A_k, a_k). At first all rows define the tangents; of the combinations ω that satisfy the
    condition, those remain that satisfy it with the tangents of these combinations alone, and so
    on, until none is lost.
    """
    constraint_rows = [e for row, rate in zip(system.G, system.g_t, strict=True)
                       for e in (*row, rate)]
    points = []
    for seed in range(_POINTS):
        q, values = random_point(system, {x[-1]}, seed)
        point = np.array([*q, values[x[-1]]])
        # W: the one-forms as rows; curls: the matrix of dω of each; G: rows (g_q, g_t)
        W, curls = curls_of(rows, x, point, values)
        G = evaluate(constraint_rows,
                     values | dict(zip(x, point, strict=True))).reshape(-1, len(x))
        # a pole at the point: nothing is known of the rows
        if not all(np.isfinite(array).all() for array in (W, curls, G)):
            return
        points.append((G, W, curls))
    basis = np.eye(len(rows))
    while len(basis):
        conditions = []
        for G, W, curls in points:
            # columns X: tangents of g = 0 on which all combinations, the rows of ``basis``, vanish
            tangents = _null_space(np.vstack([G, basis @ W]))
            # dω(X_i, X_j) of each of these ω
            d_omega = tangents.T @ np.tensordot(basis, curls, 1) @ tangents
            conditions.append(d_omega.reshape(len(basis), -1).T)
        smaller = _null_space(np.vstack(conditions)).T @ basis
        if len(smaller) == len(basis):
            yield from _rational(basis)
            return
        basis = smaller


def curls_of(
    rows: Sequence[Sequence[sp.Expr]], x: Sequence[sp.Symbol], point: Array,
    values: Mapping[sp.Symbol, float],
) -> tuple[Array, Array]:
    """Return one-forms ω at a point, shape (rows, n), and ∂ω_i/∂x_j − ∂ω_j/∂x_i, (rows, n, n).

    Derivatives are Im ω(x + iε e_j)/ε, exact to round-off. ``values`` has the parameters' numbers.
    """
    complex_points = point[:, None] + 1j * _TINY * np.eye(len(x))  # column j: along x_j
    numbers = evaluate([e for row in rows for e in row],
                       {**values, **dict(zip(x, complex_points, strict=True))})
    by_x = (numbers.imag / _TINY).reshape(len(rows), len(x), len(x))
    return numbers.real[:, 0].reshape(len(rows), len(x)), by_x - by_x.transpose(0, 2, 1)


def _null_space(A: Array) -> Array:
    """Return an orthonormal basis of the null space of A, as columns; shape (n, n − rank)."""
    _, sizes, directions = np.linalg.svd(A)
    # relative to the largest singular value, or to 1 where all entries are small
    rank = int(np.sum(sizes > _SMALL * max(sizes.max(initial=0.0), 1.0)))
    return directions[rank:].T


def _rational(rows: Array) -> Iterator[list[sp.Rational]]:
    """Yield the rows of the reduced echelon form that have simple rational entries.

    Elimination by Gauss and Jordan; an entry is rational if its denominator is at most 64.
    """
    rows, pivot = rows.copy(), 0
    for column in range(rows.shape[1]):
        if pivot == len(rows):
            break
        # partial pivoting: the largest entry of the column
        pivot_row = pivot + int(np.argmax(np.abs(rows[pivot:, column])))
        if abs(rows[pivot_row, column]) <= _SMALL * np.abs(rows).max():
            continue
        rows[[pivot, pivot_row]] = rows[[pivot_row, pivot]]
        rows[pivot] /= rows[pivot, column]
        other_rows = [i for i in range(len(rows)) if i != pivot]
        rows[other_rows] -= rows[other_rows, column, None] * rows[pivot]
        pivot += 1
    for row in rows[:pivot]:
        fractions = [Fraction(e).limit_denominator(_DENOMINATOR) for e in row]
        if all(abs(e - float(k)) <= _SMALL for e, k in zip(row, fractions, strict=True)):
            yield [sp.Rational(k.numerator, k.denominator) for k in fractions]


def _potential(omega: Sequence[sp.Expr], x: Sequence[sp.Symbol]) -> sp.Expr | None:
    """Return φ with dφ = ω, or dφ = ω/ω_i for an entry ω_i; None if neither is integrated.

    ``omega`` has the entries ω_k of ω = Σ ω_k dx_k. φ is integrated entry by entry:
    ∫ (ω_k − ∂φ/∂x_k) dx_k is added for each k, and dφ compared.
    """
    # an integrating factor 1/ω_i finds the potentials of rows that were multiplied by a function
    variable_entries = [e for e in dict.fromkeys(omega) if e.free_symbols & {*x}]
    for factor in (sp.Integer(1), *variable_entries):
        ratios = [e / factor if e != factor else sp.Integer(1) for e in omega]
        if not all(map(is_small, ratios)):
            continue
        scaled = [sp.cancel(e) for e in ratios]
        # other integrands could take SymPy minutes
        if not all(_is_simple(e, x) for e in scaled):
            continue
        phi = sp.Integer(0)
        for e, s in zip(scaled, x, strict=True):
            remainder = sp.expand(e - derivative(phi, s))
            phi += sp.Add(*(sp.integrate(term, s) for term in sp.Add.make_args(remainder)))
        if not phi.has(sp.Integral) and compare(
                [derivative(phi, s) for s in x], scaled).holds:
            return phi
    return None


def _is_simple(e: sp.Expr, x: Sequence[sp.Symbol]) -> bool:
    """Whether e is a polynomial of x and of sines and cosines of linear functions of x."""
    waves = {w for w in e.atoms(sp.sin, sp.cos) if w.args[0].free_symbols & {*x}}
    if not all(w.args[0].is_polynomial(*x) and sp.Poly(w.args[0], *x).is_linear for w in waves):
        return False
    symbol_of_wave = {w: sp.Dummy() for w in waves}
    return bool(e.xreplace(symbol_of_wave).is_polynomial(*x, *symbol_of_wave.values()))
