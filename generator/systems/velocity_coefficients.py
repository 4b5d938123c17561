"""Velocity constraints A(q, t) q̇ + a(q, t) = 0: their coefficients, extracted exactly."""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from ...core.errors import InputError
from ..parsing.tokens import shorten
from ..symbolic.identities import compare
from ..symbolic.shared_subexpressions import substitute, symbols_of
from .jacobians import jacobian

__all__ = ["coefficients_of", "refuse_unless_linear"]


def coefficients_of(
    rows: Sequence[sp.Expr], velocities: Sequence[sp.Symbol]
) -> tuple[list[list[sp.Expr]], list[sp.Expr]]:
    """Return A, m' × n, and a, m' entries, of rows A v + a: A is the slope, a the row at v = 0."""
    at_rest = dict.fromkeys(velocities, sp.Integer(0))
    return ([substitute(row, at_rest) for row in jacobian(rows, velocities)],
            substitute(rows, at_rest))


def refuse_unless_linear(
    system: str, rows: Sequence[sp.Expr], velocities: Sequence[sp.Symbol], names: Sequence[str]
) -> None:
    """Refuse rows whose slope along a velocity depends on velocities, and rows without velocities.

    Raises InputError with the row, the velocity and the slope.
    """
    slopes, (constants, _) = jacobian(rows, velocities), coefficients_of(rows, velocities)
    for name, row, constant in zip(names, slopes, constants, strict=True):
        for v, e, at_rest in zip(velocities, row, constant, strict=True):
            # velocities may stand in a slope and cancel: it is compared with its value at rest
            if not symbols_of([e]).isdisjoint(velocities) and (
                    at_rest.has(sp.nan, sp.zoo) or not compare([e], [at_rest]).holds):
                raise InputError(
                    f"The velocity constraint {name!r} of system {system!r} is not linear in "
                    f"the velocities: its slope along {v}, {shorten(str(e), 60)}, depends on them; "
                    "write A(q, t) v + a(q, t), or an equation equivalent to it.")
        if not any(constant):
            raise InputError(
                f"The velocity constraint {name!r} of system {system!r} contains no "
                "velocity; give it as one of constraints, or leave it out.")
