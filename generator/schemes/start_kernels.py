"""Momenta of velocities and back, H, and the constraint defects of a start.

    q' = B(q) u,   u = (Omega of each body, x' of each body, q' of the other coordinates)
    p = C(q) y,    C = 2 L(q)^T for a quaternion, else 1,   so that u = C^T q' and B = C/4 or 1
    u = C^T H_p(q, C y) = D y + a,   y = D^-1 (u - a)

D = C^T H_pp C and a are derived, D modulo |q| = 1: for bodies it is diag(1/I) or J^-1, for any
alpha or gamma, and a is 0 without rheonomic joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import sympy as sp

from ..kernels.statements import Kernel
from ..multibody.rigid_body import left_matrix
from ..splitting.quotient import Quotient, unit_quaternions
from ..systems.elimination_order import connected_components
from ..systems.system import System

__all__ = ["StartKernels", "energy_kernel"]

#: Largest number of rows of a block of D that is inverted in symbols.
_LARGEST_BLOCK = 3


def energy_kernel(system: System) -> Kernel:
    """Return the kernel of H in the parameters themselves."""
    time = {"t": [system.time]} if system.is_time_dependent else {}
    return Kernel("energy_of", "H", {**time, "q": list(system.q), "p": list(system.p)},
                  {"H": system.H})


class StartKernels:
    """The velocities u of a system, and the maps between velocities and momenta.

    Parameters
    ----------
    system : System
        The system in the user's parameters.

    Attributes
    ----------
    names : list of str
        Names of the velocities, in their order, distinct from all other names of the system.
    """

    def __init__(self, system: System) -> None:
        """Collect the columns of C in p = C y: 2 L(q)ᵀ of quaternions, 1 of other coordinates."""
        self.system = system
        self.bodies = [body for body in system.bodies if body.q]
        self._quotient = Quotient(unit_quaternions([body.q for body in self.bodies]))
        #: Columns of C, one for each velocity: index of a coordinate → entry.
        self._columns: list[dict[int, sp.Expr]] = []
        self.names: list[str] = []
        #: For each velocity, the coordinate whose rate it is; None for an angular velocity.
        self.rate_of: list[sp.Symbol | None] = []
        index_of = {x: i for i, x in enumerate(system.q)}
        for body in system.bodies:
            # the column of Ω_k is row k of 2 L(q), as Ω = 2 L(q) q̇
            for axis, row in enumerate(left_matrix(body.q).tolist() if body.q else []):
                self._add(f"{body.name}_omega_{'xyz'[axis]}",
                          {index_of[x]: 2 * e for x, e in zip(body.q, row, strict=True)})
            for axis, x in enumerate(body.x):
                self._add(f"{body.name}_v_{'xyz'[axis]}", {index_of[x]: sp.Integer(1)})
        covered = {i for column in self._columns for i in column}
        for i, x in enumerate(system.q):
            if i not in covered:
                self._add(f"{x}_dot", {i: sp.Integer(1)})

    def _add(self, name: str, column: dict[int, sp.Expr]) -> None:
        """Add a velocity with its column, under a name that is not taken."""
        system = self.system
        reserved = {*map(str, (*system.parameters, *system.q, *system.p, system.time)),
                    *system.quantities, *self.names}
        while name in reserved:
            name += "_"
        self.names.append(name)
        self._columns.append(column)
        self.rate_of.append(system.q[next(iter(column))] if len(column) == 1 else None)

    @cached_property
    def symbols(self) -> list[sp.Symbol]:
        """The symbols of the velocities."""
        return [sp.Dummy(name, real=True) for name in self.names]

    @property
    def exists(self) -> bool:
        """Whether H is quadratic in p and the blocks of D are inverted in symbols."""
        return self._inverse_D is not None

    @cached_property
    def _velocity_map(self) -> tuple[sp.Matrix, list[sp.Expr]]:
        """D = Cᵀ H_pp C, symmetric, and a = Cᵀ H_p(q, 0) of u = D y + a, both modulo |q| = 1.

        An entry whose reduction takes too long stays as it is.
        """
        H_pp = self.system.H_pp
        D = sp.zeros(len(self._columns))
        for i, column_i in enumerate(self._columns):
            for j, column_j in enumerate(self._columns[: i + 1]):
                terms = [x * y * H_pp[m][n]
                         for m, x in column_i.items() for n, y in column_j.items()]
                D[i, j] = D[j, i] = self._quotient.expression_if_short(sp.Add(*terms))
        at_rest = dict.fromkeys(self.system.p, sp.Integer(0))
        velocity_at_rest = [e.xreplace(at_rest) for e in self.system.H_p]
        a: list[sp.Expr] = []
        for column in self._columns:
            terms = [e * velocity_at_rest[m] for m, e in column.items()]
            a.append(self._quotient.expression_if_short(sp.Add(*terms)))
        return D, a

    @cached_property
    def _inverse_D(self) -> sp.Matrix | None:
        """D^-1, block by block; None if H is not quadratic in p or a block is too large."""
        if any(e.has(*self.system.p) for row in self.system.H_pp for e in row):
            return None
        D, _ = self._velocity_map
        count = len(self.names)
        blocks = connected_components([frozenset({i, j}) for i in range(count) for j in range(count)
                                       if i == j or D[i, j] != 0])
        inverse = sp.zeros(count)
        for block in map(sorted, blocks):
            # inverses in symbols grow like the factorial of the size: of the tensor of a body at
            # most
            D_block = D.extract(block, block)
            if len(block) > _LARGEST_BLOCK or sp.expand(D_block.det()) == 0:
                return None
            block_inverse = D_block.inv()
            for i, m in enumerate(block):
                for j, n in enumerate(block):
                    inverse[m, n] = sp.cancel(block_inverse[i, j])
        return inverse

    def momenta(self, velocities: Sequence[sp.Expr]) -> list[sp.Expr]:
        """Return p = C D⁻¹ (u − a); only if ``exists``."""
        assert self._inverse_D is not None
        _, a = self._velocity_map
        y = self._inverse_D * sp.Matrix([u - e for u, e in zip(velocities, a, strict=True)])
        return self._times_columns(list(y))

    def rates(self, velocities: Sequence[sp.Expr]) -> list[sp.Expr]:
        """Return q' = B u."""
        return self._times_columns(velocities, factor=sp.Rational(1, 4))

    def _times_columns(
        self, vector: Sequence[sp.Expr], factor: sp.Expr | int = 1
    ) -> list[sp.Expr]:
        """Return C times a vector; columns of quaternions, with 4 entries, are times ``factor``."""
        product: list[sp.Expr] = [sp.Integer(0)] * self.system.n
        for column, x in zip(self._columns, vector, strict=True):
            for m, e in column.items():
                product[m] += (factor if len(column) > 1 else 1) * e * x
        return product

    @cached_property
    def velocities(self) -> list[sp.Expr]:
        """u = D y + a as functions of q and p, if f(q, p) = 0."""
        D, a = self._velocity_map
        p = self.system.p
        # y = Cᵀ p/4 of a quaternion, as Cᵀ C = 4 for C = 2 L(q)ᵀ, and p itself else
        y = [sp.Add(*(e * p[m] for m, e in column.items())) / (4 if len(column) > 1 else 1)
             for column in self._columns]
        return [sp.Add(offset, *(d * e for d, e in zip(D.row(i), y, strict=True)))
                for i, offset in enumerate(a)]

    def kernels(self) -> list[Kernel]:
        """Return the kernels p(q, u) and u(q, p), and of the constraint defects of a start."""
        system = self.system
        q, p, u = list(system.q), list(system.p), self.symbols
        kernels = [Kernel("momenta_of", "Momenta of velocities", {"q": q, "v": u},
                          {"p": self.momenta(u)}),
                   Kernel("velocities_of", "Velocities of momenta", {"q": q, "p": p},
                          {"v": self.velocities})]
        if self.conditions:
            # |g|/|g_q| is a distance from the constraint, in units of q, and |g_q q̇|/|g_q| a rate
            G = [system.G[i] for i in self.conditions]
            rates = self.rates(u)
            outputs = {
                "rate": rates,
                "g": [system.constraints[i] for i in self.conditions],
                "f": [sp.Add(*(a * b for a, b in zip(row, rates, strict=True))) for row in G],
                "square": [sp.Add(*(a**2 for a in row)) for row in G]}
            kernels.append(Kernel(
                "start_defects", "q', and g, g_q q' and |g_q|^2 but of unit quaternions",
                {"q": q, "v": u}, outputs))
        return kernels

    @cached_property
    def conditions(self) -> list[int]:
        """Indices of the constraints other than |q|^2 = 1 of quaternions."""
        return [i for i, g in enumerate(self.system.constraints)
                if not self._quotient.vanishes(g)]
