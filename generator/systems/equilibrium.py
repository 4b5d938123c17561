"""Static equilibria of constrained systems: H_q + g_qᵀλ = F and g = 0 at p = 0.

Pseudo-transient continuation (Kelley, Keyes, SIAM J. Numer. Anal. 35, 1998): implicit Euler steps
of q̇ = F − H_q − g_qᵀλ, g = 0, whose length τ grows as the residual falls, so that the last ones
are Newton steps. A step along which the potential would have a maximum is shortened: of several
equilibria a stable one is preferred.

L = H + λ·g is a sum over element templates, whose instances are evaluated together: the gradient
of L is the residual, its Hessian the matrix.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import sympy as sp

from ...core.arrays import Array
from ...core.errors import InputError
from ...core.warnings import warn
from ..symbolic.numeric_evaluation import evaluate
from .jacobians import jacobian
from .lagrangian import LagrangianSystem
from .repeated_structure import ElementSystem, ElementTemplate, Structure
from .system import System

__all__ = ["equilibrium"]

#: Iterations, and the largest relative change of one.
_ITERATIONS, _LARGEST_CHANGE = 300, 0.3
#: A coordinate beyond this many units of the start runs away. The forces of a system that is so far
#: off are lost in the round-off of their terms.
_RUNAWAY = 1e9
#: Changes below may stagnate at round-off.
_ROUNDING = 1e-9
#: Residuals below this part of their terms are round-off.
_ROUND_OFF = 8 * float(np.finfo(float).eps)
#: Coordinates below, in units of the start, are 0 with rounding.
_NOTHING = 1e-14
#: τ of the first step times the largest entry of its matrix.
_FIRST_TAU = 1e3
#: τ times that entry below which the matrix of a step is nearly 1/τ alone.
_SMALL_TAU = 0.1
#: Most coordinates of a system whose stability is examined, by dense matrices.
_LARGEST = 300
_EPS, _TINY = float(np.finfo(float).eps), float(np.finfo(float).tiny)


class _Sparse(NamedTuple):
    """The entries of a matrix of expressions that are not 0, with their rows and columns."""

    rows: list[int]
    columns: list[int]
    entries: list[sp.Expr]

    @classmethod
    def of(cls, matrix: Sequence[Sequence[sp.Expr]]) -> _Sparse:
        """Return the entries of a matrix, row by row."""
        places = [(i, k) for i, row in enumerate(matrix) for k, e in enumerate(row) if e != 0]
        return cls([i for i, _ in places], [k for _, k in places],
                   [matrix[i][k] for i, k in places])


class _Triplets(NamedTuple):
    """A sparse matrix: values at rows and columns, arrays of one length; equal places are added."""

    rows: Array
    columns: Array
    values: Array


class _Part(NamedTuple):
    """Elements of equal form: the gradient of an energy, or forces, and its share in r_x."""

    template: ElementTemplate
    sign: int  # of the share in the residual: 1 for a gradient, −1 for forces
    rows: Array  # rows of the residual, shape (instances, rows of an instance)
    columns: Array  # entries of q, shape (instances, coordinates of an instance)
    entries: list[sp.Expr]  # the share of an instance, row by row
    derivatives: _Sparse  # of these by the template's q


class _Statics:
    """Residual and matrix of the equilibrium: gradient and Hessian of L = H + λ·g, less the forces.

    All is evaluated at p = 0 and at one time; x = (q, λ) has n + m entries. x is in units of its
    own, ``units``, and so are r and r_x: results do not depend on the units of the system.
    """

    def __init__(self, system: System, parameters: Mapping[str, float], q0: Array, t: float
                 ) -> None:
        """Write H_q + Gᵀλ − F = 0 and g = 0 as sums over element templates, with their Jacobians.

        The units of x are those of the start q0.
        """
        # L(q, λ) = H(q, 0) + λ·g has L_q = H_q + Gᵀλ and L_λ = g: λ are further coordinates
        at_rest = dict.fromkeys(system.p, sp.Integer(0))
        multipliers = [sp.Dummy(f"lambda{k}", real=True) for k in range(system.m)]
        L = sp.Add(system.H.xreplace(at_rest),
                   *(x * g for x, g in zip(multipliers, system.constraints, strict=True)))
        q = (*system.q, *multipliers)
        forces = [F.xreplace(at_rest) for F in system.forces] + [sp.Integer(0)] * system.m
        structure = Structure(ElementSystem(
            q, p=(), parameters=system.parameters, H=L,
            forces=tuple(forces) if system.forces else (), time=system.time))
        self.time = {x: t for x in (system.time,) if x is not None}
        self.values = np.array([float(parameters[str(x)]) for x in system.parameters])
        # a gradient has a row for each coordinate, forces act on rows of their own
        self.parts = [_Part(template, sign=1, rows=_columns(template), columns=_columns(template),
                            entries=template.system.H_q,
                            derivatives=_Sparse.of(template.system.H_qq))
                      for template in structure.templates if template.q]
        self.parts += [_Part(template, sign=-1,
                             rows=np.array([i.rows for i in template.instances], dtype=int),
                             columns=_columns(template), entries=list(template.expressions),
                             derivatives=_Sparse.of(jacobian(list(template.expressions),
                                                             template.q)))
                       for template in structure.force_templates]
        # H_p at p = 0, which must vanish at an equilibrium
        self.velocities = [(template, template.system.H_p)
                           for template in Structure(system).templates if template.p]
        # units are derived from r and r_x at the start, which are evaluated with units of 1
        self.units, self.residual_units = np.ones(len(q)), np.ones(len(q))
        self.units, self.residual_units = self._natural_units(system, q0)

    def _natural_units(self, system: System, q0: Array) -> tuple[Array, Array]:
        """Return the units of x = (q, λ) and of r = (H_q + Gᵀλ − F, g), shape (n + m,) each.

        Quaternions are numbers, other coordinates have the largest of the start as a unit, or the
        largest |H_q − F|/|H_qq| beside which all are round-off. The unit of energy is the largest
        of H_qq, or of H_q, in these; those of g are the largest of G.
        """
        n, quaternions = system.n, {symbol for body in system.bodies for symbol in body.q}
        is_length = np.array([symbol not in quaternions for symbol in system.q])
        r, (rows, columns, values) = self(np.concatenate([q0, np.zeros(system.m)]))

        def largest_of_rows(of_q: Array) -> Array:
            """Return the largest of each row of r_q, for coordinates in these units."""
            in_q, sizes = columns < n, np.zeros(len(self.units))
            np.maximum.at(sizes, rows[in_q], np.abs(values[in_q]) * of_q[columns[in_q]])
            return sizes

        stiffness = largest_of_rows(np.ones(n))[:n]
        reach = np.divide(np.abs(r[:n]), stiffness, out=np.zeros(n), where=stiffness > 0)
        length, reach = (x[is_length].max(initial=0.0) for x in (np.abs(q0), reach))
        length = length if length > _NOTHING * reach else reach
        of_q = np.where(is_length, length or 1.0, 1.0)
        sizes = largest_of_rows(of_q)
        of_g = np.where(sizes[n:] > 0, sizes[n:], 1.0)
        energy = float((sizes[:n] * of_q).max() or np.abs(r[:n] * of_q).max() or 1.0)
        return np.concatenate([of_q, energy / of_g]), np.concatenate([energy / of_q, of_g])

    def moves(self, q: Array) -> bool:
        """Whether H_p is not 0 at p = 0: then q changes at rest, as in a turning frame."""
        return any(np.abs(self._evaluate(template, expressions, q)).max() > 0
                   for template, expressions in self.velocities)

    def __call__(self, x: Array) -> tuple[Array, _Triplets]:
        """Return the residual r = (H_q + Gᵀλ − F, g) at x = (q, λ), shape (n + m,), and r_x.

        x, r and r_x are in the units of this object.
        """
        no_index = np.zeros(0, dtype=int)
        x = self.units * x
        r, triplets = np.zeros(len(x)), [_Triplets(no_index, no_index, np.zeros(0))]
        for part in self.parts:
            np.add.at(r, part.rows.T, part.sign * self._evaluate(part.template, part.entries, x))
            r_q = part.derivatives
            if not r_q.entries:  # forces that are constant
                continue
            triplets.append(_Triplets(
                part.rows[:, r_q.rows].ravel(), part.columns[:, r_q.columns].ravel(),
                part.sign * self._evaluate(part.template, r_q.entries, x).T.ravel()))
        rows, columns, values = map(np.concatenate, zip(*triplets, strict=True))
        return r / self.residual_units, _Triplets(
            rows, columns, values * self.units[columns] / self.residual_units[rows])

    def _evaluate(self, template: ElementTemplate, expressions: list[sp.Expr], x: Array) -> Array:
        """Return expressions of a template for all instances, shape (expressions, instances)."""
        q = x[_columns(template)]
        constants = self.values[np.array([i.constants for i in template.instances], dtype=int)]
        # at rest: momenta are 0; each symbol has a column of the values of all instances
        substitution: dict[sp.Symbol, Any] = dict.fromkeys(template.p, 0.0) | self.time
        substitution |= dict(zip(template.q, q.T, strict=True))
        substitution |= dict(zip(template.constants, constants.T, strict=True))
        values = evaluate(expressions, substitution)
        return np.broadcast_to(values.reshape(len(expressions), -1),
                               (len(expressions), len(template.instances)))


def _columns(template: ElementTemplate) -> Array:
    """Return the indices in x of the coordinates of each instance."""
    return np.array([i.q for i in template.instances], dtype=int)


def equilibrium(
    system: System, parameters: Mapping[str, float], q0: Array, t: float = 0.0
) -> tuple[Array, Array]:
    """Return coordinates and multipliers of the equilibrium that the continuation reaches from q0.

    With x = (q, λ), residual r and matrix J of its derivatives, each step solves

        (J + diag(1/τ, 0)) (δq, −λ_new) = r − g_qᵀ λ,   q ← q − δq.

    It is repeated with a smaller τ if it is long, or if δqᵀ (J + 1/τ) δq < 0. Shapes are (n,) and
    (m,); ``q0`` need not satisfy g = 0, and all is taken at the time ``t``.

    Raises
    ------
    InputError
        For a system from a Lagrangian, with velocity constraints or constraints of t, for one that
        moves where p = 0, and where no equilibrium is reached.
    """
    _refuse_without_statics(system)
    q0, n = np.asarray(q0, dtype=float), system.n
    statics = _Statics(system, parameters, q0, t)
    x = np.concatenate([q0, np.zeros(system.m)]) / statics.units
    if statics.moves(q0):
        raise InputError(f"System {system.name!r} moves where its momenta are 0, as in a turning "
                         "frame; it has no static equilibrium.")
    x, J = _continue_to_equilibrium(statics, x, n, system.name)
    if n <= _LARGEST and not system.forces and _is_unstable(J, n, system.m):
        warn(f"System {system.name!r} is in an unstable equilibrium: it stays there as "
             "long as nothing moves it. Begin beside it for a stable one.")
    x *= statics.units
    return x[:n], x[n:]


def _continue_to_equilibrium(
    statics: _Statics, x: Array, n: int, name: str
) -> tuple[Array, _Triplets]:
    """Return x = (q, λ) and J at the equilibrium of the system ``name``; q has n entries.

    Steps of length τ are as of ``equilibrium``; x, r and J are in the units of ``statics``. Raises
    InputError if no equilibrium is reached.
    """
    r, J = statics(x)
    size = float(np.linalg.norm(r))
    # change: of q in the last step; rejected_change: in the last one if that was rejected, else ∞
    change, rejected_change = np.inf, np.inf
    # changes are relative to the largest coordinate up to there, as equilibria may have q = 0
    extent = float(np.abs(x[:n]).max())
    stiffness = float(np.abs(J.values[J.rows < n]).max(initial=0.0))
    tau = _FIRST_TAU / (stiffness or size or 1.0)  # no stiffness: a body falls, its rope is slack
    farthest, iterations = _RUNAWAY * max(extent, 1.0), 0
    while iterations < _ITERATIONS and extent <= farthest:
        iterations += 1
        step, curvature = _implicit_step(x, r, J, tau, n)
        previous_change = change
        change = float(np.abs(step[:n]).max()) / (extent if extent > _NOTHING else 1.0)
        if not np.isfinite(change):
            break
        # A long step is repeated with a smaller τ, which aims at half the largest change. No τ
        # shortens the way to g = 0, however: where 1/τ is above the stiffness, a step that a
        # smaller τ left as long is taken. With a negative curvature the potential has a maximum
        # along the step.
        is_long = change > _LARGEST_CHANGE and (
            change < 0.9 * rejected_change or tau * stiffness > _SMALL_TAU)
        if is_long or (curvature < 0 and change > _ROUNDING):
            rejected_change = change
            tau *= min(max(_LARGEST_CHANGE / (2 * change), 1e-3), 0.3)
            continue
        rejected_change = np.inf
        x = np.concatenate([x[:n] - step[:n], -step[n:]])  # the step is (δq, −λ_new)
        extent = max(extent, float(np.abs(x[:n]).max()))
        r, J = statics(x)
        previous_size, size = size, float(np.linalg.norm(r))
        # converged: the residual is round-off of its terms, or the change is
        stagnates = change > previous_change / 2 and size <= 2 * previous_size
        if (stagnates and (np.abs(r) <= _ROUND_OFF * _sizes_of_terms(J, x)).all()) or (
                _is_round_off(change, previous_change, stagnates)):
            return x, J
        tau *= _growth_of_tau(previous_size / max(size, _TINY), change)
    raise InputError(f"No equilibrium of system {name!r} was reached from its start: after "
                     f"{iterations} iterations |H_q + g_qᵀλ − F| = {size:.3g}, and the largest "
                     f"coordinate was {extent:.3g}, in units of the start; fix or hinge what moves "
                     "freely, or begin nearer.")


def _is_round_off(change: float, previous_change: float, stagnates: bool) -> bool:
    """Whether the change of q in a step is round-off, by which the iteration has converged.

    It is if it no longer falls by half (``stagnates``), nor grows as τ does; where bodies move
    freely, the round-off of the change grows with τ.
    """
    return change <= 2 * previous_change and (change <= _EPS or (stagnates and change < _ROUNDING))


def _is_unstable(J: _Triplets, n: int, m: int) -> bool:
    """Whether L_qq has a negative eigenvalue on the tangent space of the m constraints.

    ``J`` has L_qq in its rows and columns of q, n of them, and g_q in the rows behind them.
    """
    matrix = np.zeros((n + m, n + m))
    np.add.at(matrix, (J.rows, J.columns), J.values)
    stiffness = matrix[:n, :n]
    basis = np.linalg.qr(matrix[n:, :n].T, mode="complete")[0][:, m:] if m else np.eye(n)
    lowest = np.linalg.eigvalsh(basis.T @ stiffness @ basis).min(initial=0.0)
    # where bodies move freely it is 0 up to the error of the multipliers
    return bool(lowest < -_ROUNDING * np.abs(stiffness).max(initial=0.0))


def _growth_of_tau(residual_ratio: float, change: float) -> float:
    """Return the factor of τ after a step that divided the residual by ``residual_ratio``.

    τ grows as the residual falls, so that the last steps are Newton steps. It grows, too, if the
    residual stays: soft springs hardly move at the τ of stiff ones. It grows no further than to a
    step of the largest change.
    """
    if residual_ratio >= 1:
        factor = min(max(residual_ratio, 4.0), 10.0)
    else:
        factor = 1.0 if residual_ratio > 0.5 else 0.5
    return min(factor, max(_LARGEST_CHANGE / max(change, _TINY), 1.0))


def _sizes_of_terms(J: _Triplets, x: Array) -> Array:
    """Return the sizes of the terms of the residual, shape (n + m,).

    Each is the largest of |J| |x| among the entries that share its coordinates.
    """
    rows, columns, values = J
    terms = np.bincount(rows, np.abs(values * x[columns]), len(x))
    sizes = np.zeros(len(x))
    np.maximum.at(sizes, rows, np.where(values == 0, 0.0, terms[columns]))
    return sizes


def _refuse_without_statics(system: System) -> None:
    """Refuse a system whose equilibria are not those of an H(q, p) on g(q) = 0."""
    has_moving_constraint = any(
        g.has(system.time) for g in system.constraints if system.time is not None)
    if isinstance(system, LagrangianSystem) or system.velocity_count or has_moving_constraint:
        raise InputError(f"System {system.name!r} has a Lagrangian, velocity constraints or "
                         "constraints of time; static equilibria are found of systems with H(q, p) "
                         "and g(q).")


def _implicit_step(x: Array, r: Array, J: _Triplets, tau: float, n: int) -> tuple[Array, float]:
    """Return (δq, −λ_new), shape (n + m,), of an implicit Euler step, and δqᵀ (J + 1/τ) δq.

    r and ``J`` are the residual and its matrix at x = (q, λ), n entries of which are q; ``tau`` is
    the length τ of the step.
    """
    # 1/τ is added to the diagonal of the rows of q
    diagonal = _Triplets(np.arange(n), np.arange(n), np.full(n, 1 / tau))
    matrix = _Triplets(*map(np.concatenate, zip(J, diagonal, strict=True)))
    # r without g_qᵀλ: the step is solved for the new λ, not for its change
    in_forces = (J.rows < n) & (J.columns >= n)
    right_side = r - np.bincount(
        J.rows[in_forces], J.values[in_forces] * x[J.columns[in_forces]], len(x))
    step = _solve(matrix, right_side)
    rows, columns, values = (
        entries[(matrix.rows < n) & (matrix.columns < n)] for entries in matrix)
    with np.errstate(invalid="ignore"):  # an infinite step, at which the iteration ends
        curvature = np.sum(values * step[rows] * step[columns])
    return step, float(curvature)


def _solve(A: _Triplets, right: Array) -> Array:
    """Return x of A x = ``right``, NaN if A is singular."""
    from scipy.sparse import csc_array  # takes 0.1 s
    from scipy.sparse.linalg import splu

    size = len(right)
    try:
        matrix = csc_array((A.values, (A.rows, A.columns)), (size, size))
        return np.asarray(splu(matrix).solve(right))
    except RuntimeError:  # singular
        return np.full(size, np.nan)
