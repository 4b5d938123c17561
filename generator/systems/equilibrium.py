"""Static equilibria of constrained systems: H_q + g_qᵀλ = F and g = 0 at p = 0.

Pseudo-transient continuation (Kelley, Keyes, SIAM J. Numer. Anal. 35, 1998): implicit Euler steps
of q̇ = F − H_q − g_qᵀλ, g = 0, whose length τ grows as the residual falls, so that the last ones
are Newton steps. A step along which the potential would have a maximum is shortened: of several
equilibria a stable one is preferred.

L = H + λ·g is a sum over element templates, whose instances are evaluated together: the gradient
of L is the residual, its Hessian the matrix.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import sympy as sp

from ...core.arrays import Array
from ...core.errors import InputError
from ..symbolic.numeric_evaluation import evaluate
from .jacobians import jacobian
from .lagrangian import LagrangianSystem
from .repeated_structure import ElementSystem, ElementTemplate, Structure
from .system import System

__all__ = ["equilibrium"]

#: Iterations, and the largest relative change of one.
_ITERATIONS, _LARGEST_CHANGE = 500, 0.3
#: Changes below may stagnate at round-off.
_ROUNDING = 1e-9
#: τ of the first step times the largest entry of its matrix.
_FIRST_TAU = 1e3
_EPS, _TINY = float(np.finfo(float).eps), float(np.finfo(float).tiny)


class _Statics:
    """Gradient and Hessian of L = H + λ·g at p = 0, less the forces."""

    def __init__(self, system: System, parameters: Mapping[str, float], t: float) -> None:
        """Write H_q + Gᵀλ − F = 0 and g = 0 as sums over element templates, with their Jacobians.
        """
        # L(q, λ) = H(q, 0) + λ·g has L_q = H_q + Gᵀλ and L_λ = g: λ are further coordinates
        at_rest = dict.fromkeys(system.p, sp.Integer(0))
        multipliers = [sp.Dummy(f"lambda{k}", real=True) for k in range(system.m)]
        L = sp.Add(system.H.xreplace(at_rest),
                   *(x * g for x, g in zip(multipliers, system.constraints, strict=True)))
        q = (*system.q, *multipliers)
        forces = [F.xreplace(at_rest) for F in system.forces] + [sp.Integer(0)] * system.m
        structure = Structure(ElementSystem(
            q, (), system.parameters, L, forces=tuple(forces) if system.forces else (),
            time=system.time))
        self.time = {x: t for x in (system.time,) if x is not None}
        self.values = np.array([float(parameters[str(x)]) for x in system.parameters])
        self.parts = [(form, 1.0, [form.system.H_q], form.system.H_qq)
                      for form in structure.templates if form.q]
        self.parts += [(form, -1.0, [list(form.expressions)],
                        jacobian(list(form.expressions), form.q))
                       for form in structure.force_templates]
        # H_p at p = 0, which must vanish at an equilibrium
        self.velocities = [(form, form.system.H_p) for form in Structure(system).templates
                           if form.p]

    def moves(self, q: Array) -> bool:
        """Whether H_p is not 0 at p = 0."""
        return any(np.abs(self._evaluate(form, expressions, q)).max() > 0
                   for form, expressions in self.velocities)

    def __call__(self, x: Array) -> tuple[Array, tuple[Array, Array, Array]]:
        """Return the residual, and rows, columns and values of the matrix."""
        r, entries = np.zeros(len(x)), []
        for form, sign, (slopes,), matrix in self.parts:
            columns = np.array([i.q for i in form.instances], dtype=int)
            rows = np.array([i.rows for i in form.instances], dtype=int) if sign < 0 else columns
            np.add.at(r, rows.T, sign * self._evaluate(form, slopes, x))
            if not form.q:  # a constant force
                continue
            values = self._evaluate(form, [e for row in matrix for e in row], x)
            shape = (len(rows), rows.shape[1], columns.shape[1])
            entries.append((np.broadcast_to(rows[:, :, None], shape).ravel(),
                            np.broadcast_to(columns[:, None], shape).ravel(),
                            sign * values.T.ravel()))
        rows, columns, values = (np.concatenate(arrays) for arrays in zip(*entries, strict=True))
        return r, (rows, columns, values)

    def _evaluate(self, form: ElementTemplate, expressions: list[sp.Expr], x: Array) -> Array:
        """Return expressions of all instances, shape (expressions, instances)."""
        def of(index: Any, numbers: Array) -> Array:
            rows: Array = numbers[np.array([index(i) for i in form.instances], dtype=int)]
            return rows.T

        # at rest: momenta are 0; each symbol has a column of the values of all instances
        substitution: dict[sp.Symbol, Any] = dict.fromkeys(form.p, 0.0) | self.time
        substitution |= dict(zip(form.q, of(lambda i: i.q, x), strict=True))
        substitution |= dict(zip(form.constants, of(lambda i: i.constants, self.values),
                                 strict=True))
        values = evaluate(expressions, substitution)
        return np.broadcast_to(values.reshape(len(expressions), -1),
                               (len(expressions), len(form.instances)))


def equilibrium(
    system: System, parameters: Mapping[str, float], q0: Array, t: float = 0.0
) -> tuple[Array, Array]:
    """Return coordinates and multipliers of the equilibrium that the continuation reaches from q0.

    With x = (q, λ), residual r and matrix J of its derivatives, each step solves

        (J + diag(1/τ, 0)) (δq, −λ_new) = r − g_qᵀ λ,   q ← q − δq.

    It is repeated with a smaller τ if it is long, or if δqᵀ (J + 1/τ) δq < 0.

    Raises
    ------
    InputError
        For a system from a Lagrangian, with velocity constraints or constraints of t, for one that
        moves where p = 0, and where no equilibrium is reached.
    """
    if isinstance(system, LagrangianSystem) or system.velocity_count or any(
            g.has(system.time) for g in system.constraints if system.time is not None):
        raise InputError(f"System {system.name!r} has a Lagrangian, velocity constraints or "
                         "constraints of time; static equilibria are found of systems with H(q, p) "
                         "and g(q).")
    statics, n = _Statics(system, parameters, t), system.n
    x = np.concatenate([np.asarray(q0, dtype=float), np.zeros(system.m)])
    if statics.moves(x):
        raise InputError(f"System {system.name!r} moves where its momenta are 0, as in a turning "
                         "frame; it has no static equilibrium.")
    r, J = statics(x)
    size, change, shifts = float(np.linalg.norm(r)), np.inf, np.arange(n)
    tau = _FIRST_TAU / max(float(np.abs(J[2][J[0] < n]).max(initial=0.0)), _TINY)
    for _ in range(_ITERATIONS):
        # J has rows, columns and values; 1/τ is added to the diagonal of the rows of q
        rows, columns, values = (np.concatenate(arrays) for arrays in zip(
            J, (shifts, shifts, np.full(n, 1 / tau)), strict=True))
        forces = (J[0] < n) & (J[1] >= n)  # entries of g_qᵀ
        right_side = r - np.bincount(J[0][forces], J[2][forces] * x[J[1][forces]], len(x))
        step = _solve(rows, columns, values, right_side)
        last, change = change, float(np.abs(step[:n]).max()) / float(np.abs(x[:n]).max())
        if not np.isfinite(change):
            break
        inner = (rows < n) & (columns < n)
        curvature = np.sum(values[inner] * step[rows[inner]] * step[columns[inner]])
        if change > _LARGEST_CHANGE or (curvature < 0 and change > _ROUNDING):
            tau *= min(max(_LARGEST_CHANGE / (2 * change), 1e-3), 0.3)
            continue
        x = np.concatenate([x[:n] - step[:n], -step[n:]])
        r, J = statics(x)
        old, size = size, float(np.linalg.norm(r))
        # converged: the change is round-off, which it is if it no longer falls by half
        if change <= _EPS or (change < _ROUNDING and change > last / 2 and size <= 2 * old):
            return x[:n], x[n:]
        tau *= min(max(old / max(size, _TINY), 0.5), 10.0)
    raise InputError(f"No equilibrium of system {system.name!r} was reached from its start: after "
                     f"{_ITERATIONS} iterations |H_q + g_qᵀλ − F| = {size:.3g}; fix or hinge what "
                     "moves freely, or begin nearer.")


def _solve(rows: Array, columns: Array, values: Array, right: Array) -> Array:
    """Return the solution of a sparse system; NaN of a singular one."""
    from scipy.sparse import csc_array  # takes 0.1 s
    from scipy.sparse.linalg import splu

    size = len(right)
    try:
        return np.asarray(splu(csc_array((values, (rows, columns)), (size, size))).solve(right))
    except RuntimeError:  # singular
        return np.full(size, np.nan)
