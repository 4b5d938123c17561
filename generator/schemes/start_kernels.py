"""Momenta of velocities and back, H, and how far a start is off the constraints.

    q' = B(q) u,   u = (Omega of each body, x' of each body, q' of the other coordinates)
    p = C(q) y,    C = 2 L(q)^T for a quaternion, else 1,   so that u = C^T q' and B = C/4 or 1
    u = C^T H_p(q, C y) = D y + a,   y = D^-1 (u - a)

D = C^T H_pp C and a are derived, D modulo |q| = 1: for bodies it comes out as diag(1/I) or J^-1,
whatever alpha or gamma is, and a is 0 or the motion of what is driven.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import sympy as sp

from ..kernels.statements import Kernel
from ..multibody.rigid_body import left_matrix
from ..splitting.quotient import Quotient, unit_quaternions
from ..systems.elimination_order import connected
from ..systems.system import System

__all__ = ["StartKernels", "energy_kernel"]

#: Rows of a block of D that is inverted in symbols.
_LARGEST_BLOCK = 3


def energy_kernel(system: System) -> Kernel:
    """Return the kernel of H in the parameters themselves."""
    time = {"t": [system.time]} if system.is_time_dependent else {}
    return Kernel("energy_of", "H", {**time, "q": list(system.q), "p": list(system.p)},
                  {"H": system.H})


class StartKernels:
    """The velocities u of a system, and what leads from them to momenta and back.

    Parameters
    ----------
    system : System
        In its own parameters.

    Attributes
    ----------
    names : list of str
        Of the velocities, in their order; no other number of the system has one of them.
    """

    def __init__(self, system: System) -> None:
        self.system = system
        self.bodies = [body for body in system.bodies if body.q]
        self._quotient = Quotient(unit_quaternions([body.q for body in self.bodies]))
        #: Columns of C with the names of their velocities: for each coordinate its entry.
        self._columns: list[dict[int, sp.Expr]] = []
        self.names: list[str] = []
        #: Of each velocity the coordinate that it is the rate of; None of an angular velocity.
        self.rate_of: list[sp.Symbol | None] = []
        place = {x: i for i, x in enumerate(system.q)}
        for body in system.bodies:
            for axis, row in enumerate(left_matrix(body.q).tolist() if body.q else []):
                self._add(f"{body.name}_omega_{'xyz'[axis]}",
                          {place[x]: 2 * e for x, e in zip(body.q, row, strict=True)})
            for axis, x in enumerate(body.x):
                self._add(f"{body.name}_v_{'xyz'[axis]}", {place[x]: sp.Integer(1)})
        seen = {i for column in self._columns for i in column}
        for i, x in enumerate(system.q):
            if i not in seen:
                self._add(f"{x}_dot", {i: sp.Integer(1)})

    def _add(self, name: str, column: dict[int, sp.Expr]) -> None:
        system = self.system
        taken = {*map(str, (*system.parameters, *system.q, *system.p, system.time)),
                 *system.quantities, *self.names}
        while name in taken:
            name += "_"
        self.names.append(name)
        self._columns.append(column)
        self.rate_of.append(system.q[next(iter(column))] if len(column) == 1 else None)

    @cached_property
    def symbols(self) -> list[sp.Symbol]:
        """The velocities as symbols of their own."""
        return [sp.Dummy(name, real=True) for name in self.names]

    @property
    def exists(self) -> bool:
        """Whether H is quadratic in p and D has an inverse, in symbols, block by block."""
        return self._solution is not None

    @cached_property
    def _mass(self) -> tuple[sp.Matrix, list[sp.Expr]]:
        """D and a."""
        H_pp, H_p = self.system.H_pp, self.system.H_p
        rest = {x: sp.Integer(0) for x in self.system.p}
        D = sp.zeros(len(self._columns))
        for i, one in enumerate(self._columns):
            for j, other in enumerate(self._columns[: i + 1]):
                D[i, j] = D[j, i] = self._quotient.expression(sp.Add(
                    *(a * b * H_pp[m][n] for m, a in one.items() for n, b in other.items())))
        a = [self._quotient.expression(sp.Add(
            *(e * H_p[m].xreplace(rest) for m, e in column.items()))) for column in self._columns]
        return D, a

    @cached_property
    def _solution(self) -> sp.Matrix | None:
        """D^-1."""
        if any(e.has(*self.system.p) for row in self.system.H_pp for e in row):
            return None
        D, _ = self._mass
        count = len(self.names)
        blocks = connected([frozenset({i, j}) for i in range(count) for j in range(count)
                            if i == j or D[i, j] != 0])
        inverse = sp.zeros(count)
        for block in map(sorted, blocks):
            part = D.extract(block, block)
            if len(block) > _LARGEST_BLOCK or sp.expand(part.det()) == 0:
                return None
            solved = part.inv()
            for i, m in enumerate(block):
                for j, n in enumerate(block):
                    inverse[m, n] = sp.cancel(solved[i, j])
        return inverse

    def momenta(self, velocities: Sequence[sp.Expr]) -> list[sp.Expr]:
        """Return p = C D^-1 (u - a)."""
        assert self._solution is not None
        _, a = self._mass
        y = self._solution * sp.Matrix([u - e for u, e in zip(velocities, a, strict=True)])
        return self._spread(list(y), 1)

    def rates(self, velocities: Sequence[sp.Expr]) -> list[sp.Expr]:
        """Return q' = B u."""
        return self._spread(velocities, sp.Rational(1, 4))

    def _spread(self, values: Sequence[sp.Expr], factor: sp.Expr | int) -> list[sp.Expr]:
        """Return the product of C with a vector; columns of quaternions times a factor."""
        made: list[sp.Expr] = [sp.Integer(0)] * self.system.n
        for column, value in zip(self._columns, values, strict=True):
            for m, e in column.items():
                made[m] += (factor if len(column) > 1 else 1) * e * value
        return made

    @cached_property
    def velocities(self) -> list[sp.Expr]:
        """u = D y + a of q and p, where f(q, p) = 0."""
        D, a = self._mass
        p = self.system.p
        y = [sp.Add(*(e * p[m] for m, e in column.items())) / (4 if len(column) > 1 else 1)
             for column in self._columns]
        return [sp.Add(rest, *(d * e for d, e in zip(D.row(i), y, strict=True)))
                for i, rest in enumerate(a)]

    def kernels(self) -> list[Kernel]:
        """Return momenta of velocities, velocities of momenta, and what constraints say of both."""
        system = self.system
        q, p, u = list(system.q), list(system.p), self.symbols
        made = [Kernel("momenta_of", "Momenta of velocities", {"q": q, "v": u},
                       {"p": self.momenta(u)}),
                Kernel("velocities_of", "Velocities of momenta", {"q": q, "p": p},
                       {"v": self.velocities})]
        held = self.conditions
        if held:
            G = [system.G[i] for i in held]
            rates = self.rates(u)
            made.append(Kernel(
                "start_defects", "q', and g, g_q q' and |g_q|^2 but of unit quaternions",
                {"q": q, "v": u},
                {"rate": rates, "g": [system.constraints[i] for i in held],
                 "f": [sp.Add(*(a * b for a, b in zip(row, rates, strict=True))) for row in G],
                 "square": [sp.Add(*(a**2 for a in row)) for row in G]}))
        return made

    @cached_property
    def conditions(self) -> list[int]:
        """Constraints that a normalised quaternion does not imply."""
        return [i for i, g in enumerate(self.system.constraints)
                if not self._quotient.vanishes(g)]
