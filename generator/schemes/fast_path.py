"""Identities of a system for the fixed-point iteration, derived by algebra.

The fast path solves T1 by fixed-point iteration on scaled unknowns

    L_j = h b_j k_j,   L̂_j = h b̂_j k̂_j,   ι_j = h b̃_j Λ_j,   Y_j = −G(Q̃_j)ᵀ ι_j
    Q_i = q + Σ μ_ij L_j,   Q̃_l = q + Σ ν_lj L_j,   P_i = p + Σ μ̂_ij L̂_j + Σ ν̃_ij Y_j

with the multipliers corrected in every iteration through the Schur complement of the constraints,
δι_j = (b̃_j/h) W_j⁻¹ Σ_l (M⁻¹)_jl g(Q̃_l), M = Ā Ã, W = G H_pp Gᵀ. It uses identities that hold
where g = 0; each is proved here by reduction modulo g:

- W is constant (1/γ for the quaternion): it is inverted once a run, not at each node and step;
- H_pp Gᵀ = c Gᵀ: the correction of k is c times the correction of P, without evaluating H_p again;
- subexpressions u of H_q that a constraint force does not change, (∂u/∂p) Gᵀ = 0 (as L(q)q = 0),
  are evaluated once an iteration and shared by H_p and H_q.

With forces F(q, p, t), H_q − F replaces H_q. Without a proof of an identity the general form is
emitted, which is slower and equally correct.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property

import sympy as sp

from ...core.records import dataclass
from ..kernels.statements import Kernel
from ..symbolic.bounded_algebra import expand_if_short, is_small
from ..symbolic.switching_functions import depends_by_steps, switches_of
from ..systems.jacobians import jacobian, shortest
from ..systems.lagrangian import LagrangianSystem
from ..systems.system import System
from .lagrangian_kernels import motion_kernels
from .lagrangian_midpoint import LagrangianIMS
from .step_equations import MeanScheme, common_kernels, constraint_rate_kernels, energy_rate_kernels
from .system_differences import time_input, vector

__all__ = ["FastLagrangian", "FastSystem", "fast_system"]

#: A constant matrix W is inverted in symbols up to this size.
_LARGEST_INVERSE = 3


@dataclass(frozen=True)
class FastSystem:
    """The identities of a system that its fixed-point iteration uses."""

    system: System

    def reduce_modulo_g(self, e: sp.Expr) -> sp.Expr:
        """Return the remainder of e modulo g, or e expanded if e or g is no polynomial in q.

        The result equals e on the constraint manifold g = 0.
        """
        polynomial = expand_if_short(e)
        # a division by g costs time that grows fast with the number of terms
        if not polynomial.free_symbols & set(self.system.q) or not is_small(e):
            return polynomial
        if not all(x.is_polynomial(*self.system.q) for x in (polynomial, *self.system.constraints)):
            return polynomial
        # SymPy would simplify each coefficient that has p and a root of p, for seconds: in a
        # division by q roots are symbols
        polynomials = [polynomial, *self.system.constraints]
        roots = {power for x in polynomials for power in x.atoms(sp.Pow)
                 if not power.exp.is_Integer and power.free_symbols
                 and power.free_symbols.isdisjoint(self.system.q)}
        symbols = {root: sp.Dummy(f"root{i}")
                   for i, root in enumerate(sorted(roots, key=sp.default_sort_key))}
        dividend, *divisors = (x.xreplace(symbols) for x in polynomials)
        remainder = sp.reduced(dividend, divisors, *self.system.q)[1]
        return sp.expand(remainder.xreplace({symbol: root for root, symbol in symbols.items()}))

    def _is_constant(self, e: sp.Expr) -> bool:
        """Whether e depends on parameters alone."""
        return bool(e.free_symbols.isdisjoint(
            {*self.system.q, *self.system.p, self.system.clock}))

    @cached_property
    def forces(self) -> list[list[sp.Expr]]:
        """H_pp Gᵀ, n × m: the velocity changes by H_pp Gᵀ λ if the momentum changes by Gᵀ λ."""
        system = self.system
        return [
            [shortest(sum((a * b for a, b in zip(row, g, strict=True)), sp.Integer(0)))
             for g in system.G]
            for row in system.H_pp
        ]

    @cached_property
    def schur(self) -> list[list[sp.Expr]]:
        """W = G H_pp Gᵀ, m × m, reduced modulo g entry by entry."""
        columns = list(zip(*self.forces, strict=True))
        return [
            [self.reduce_modulo_g(sum((a * b for a, b in zip(g, column, strict=True)),
                                      sp.Integer(0)))
             for column in columns]
            for g in self.system.G
        ]

    @cached_property
    def schur_inverse(self) -> list[list[sp.Expr]] | None:
        """W⁻¹ if W is proved constant on g = 0, else None."""
        # a product in the loop in place of a factorisation: for three constraints and fewer
        if self.system.m > _LARGEST_INVERSE or not all(
                self._is_constant(e) for row in self.schur for e in row):
            return None
        W = sp.Matrix(self.schur)
        return None if sp.expand(W.det()) == 0 else W.inv().tolist()

    @cached_property
    def correction(self) -> sp.Expr | None:
        """The c of H_pp Gᵀ = c Gᵀ on g = 0; None if there is no such number."""
        if not self.system.m or self.schur_inverse is None:
            return None
        g = self.system.G[0]
        square = self.reduce_modulo_g(sum((a * a for a in g), sp.Integer(0)))
        # c = W₀₀/(G₀·G₀) is a constant only if both are
        if square == 0 or not self._is_constant(square):
            return None
        c = sp.cancel(self.schur[0][0] / square)  # from one entry; all others are checked
        differences = [
            force - c * row[a]
            for a, forces_on_a in enumerate(self.forces)
            for force, row in zip(forces_on_a, self.system.G, strict=True)
        ]
        return c if all(self.reduce_modulo_g(e) == 0 for e in differences) else None

    @cached_property
    def shared_sums(self) -> list[sp.Expr]:
        """Sums u in H_q − F that no constraint force changes: (∂u/∂p) Gᵀ = 0 identically.

        The kernel of H_p computes them for the kernel of H_q, which is called after a
        correction of P.
        """
        if self.system.m and self.correction is None:
            return []  # the kernel of H_q evaluates H_p again, and these sums with it
        if self.is_separable:
            return []  # Gauss-Seidel ordering: H_q − F and H_p are evaluated at different states
        # the kernel of H_p computes the shared sums, and has no time among its inputs
        sums = {u for e in self.system.minus_p_rate for u in e.atoms(sp.Add)
                if self.system.time not in u.free_symbols}
        candidates = sorted((u for u in sums if u.has(*self.system.p) and self._is_unaffected(u)),
                            key=sp.default_sort_key)
        # a sum inside another shared one is no output of its own
        return [u for u in candidates if not self._is_inside(u, candidates)]

    def _is_inside(self, u: sp.Expr, sums: list[sp.Expr]) -> bool:
        """Whether a sum occurs only inside other sums, as u₃ in a u₃ − ω/2."""
        enclosing = {v: sp.Dummy() for v in sums if v != u and v.has(u)}
        return bool(enclosing) and not any(
            e.xreplace(enclosing).has(u) for e in self.system.minus_p_rate)

    def _is_unaffected(self, u: sp.Expr) -> bool:
        """Whether u, and its switches, have the derivative 0 along all constraint forces."""
        return all(
            expand_if_short(sum((a * b for a, b in zip(by_p, g, strict=True)), sp.Integer(0))) == 0
            for by_p in jacobian([u, *switches_of([u])], self.system.p)
            for g in self.system.G
        )

    @cached_property
    def is_affine(self) -> bool:
        """Whether the hidden constraint f(q, p) is affine in p: one linear solve projects p."""
        p = self.system.p
        return not depends_by_steps(self.system.hidden, p) and not any(
            e.has(*p) for row in jacobian(self.system.hidden, p) for e in row)

    @property
    def is_separable(self) -> bool:
        """Whether H_pq = 0: Gauss-Seidel ordering then squares the contraction."""
        return not depends_by_steps(self.system.H_p, self.system.q) and all(
            expand_if_short(e) == 0 for row in self.system.H_pq for e in row)

    @cached_property
    def folds(self) -> Folds:
        """Products number × constant as new constants: 2 mgl is not computed in a loop."""
        return Folds({*self.system.parameters} - {*self.system.inputs})

    @cached_property
    def gradients(self) -> tuple[list[sp.Expr], list[sp.Expr], list[sp.Expr]]:
        """H_p, then H_q − F in terms of w, then w_j = a_j u_j of the shared sums u_j.

        a_j (``factor``) is the constant that u_j is multiplied by wherever it occurs: one product
        less.
        """
        H_p, H_q = ([self.folds(e) for e in gradient]
                    for gradient in (self.system.H_p, self.system.minus_p_rate))
        w = []
        for index, u in enumerate(map(self.folds, self.shared_sums)):
            factor = self._common_constant(u, H_p + H_q)
            symbol = sp.Symbol(f"_w{index}", real=True)
            w.append(factor * u)
            # H_p computes w, and keeps u: its common subexpressions are extracted later
            H_q = [e.xreplace({u: symbol / factor}) for e in H_q]
        return H_p, H_q, w

    def _common_constant(self, u: sp.Expr, expressions: list[sp.Expr]) -> sp.Expr:
        """Return the constant factor of u if it is the same wherever u occurs, else 1."""
        factors = set()
        for e in expressions:
            products = [product for product in e.atoms(sp.Mul) if u in product.args]
            # e.count(u) would match patterns, which takes seconds; equality is enough
            occurrences = sum(node == u for node in sp.preorder_traversal(e))
            if occurrences != len(products):  # u also occurs without a factor
                return sp.Integer(1)
            for product in products:
                factors.add(sp.Mul(*(a for a in product.args if a in self.folds.constants)))
        return factors.pop() if len(factors) == 1 else sp.Integer(1)

    def spark_kernels(self, *, separate: bool = False) -> list[Kernel]:
        """Return the kernels of the fixed-point iteration of SPARK methods, on lanes.

        After a correction of P by constraint forces, the kernel of H_q evaluates H_p again, unless
        H_pp Gᵀ = c Gᵀ gives its change; with ``separate``, the kernel of H_p is called instead.
        """
        system = self.system
        state = {"q": list(system.q), "p": list(system.p)}
        H_p, H_q, common_parts = self.gradients
        w = vector("w", len(common_parts))
        velocity: dict[str, list[sp.Expr]] = {"H_p": H_p}
        force: dict[str, list[sp.Expr]] = {"H_q": H_q}
        velocity_doc, force_doc = "H_p", "H_q = dH/dq - F" if system.forces else "H_q"
        force_inputs = state | time_input(system)
        if w:
            velocity["w"] = common_parts
            velocity_doc += ", and w: what H_q shares with it"
            force_inputs["w"] = w
            force_doc += " from the same w"
        # the velocity changes with P, by H_pp Gᵀ δλ, and no number c gives this change
        if system.m and self.correction is None and not separate:
            force = {"H_p": H_p, "H_q": H_q}
            force_doc += ", H_p"
        return [
            *self._common_kernels(projected=True),
            Kernel("velocity", velocity_doc, state, velocity),
            Kernel("force", force_doc, force_inputs, force),
            *energy_rate_kernels(system),
            *constraint_rate_kernels(system),
            *self._multiplier_kernels(),
        ]

    def mean_kernels(self, scheme: MeanScheme) -> list[Kernel]:
        """Return the kernels of the fixed-point iteration of IMS or EMS, on lanes."""
        inputs = {"qm": scheme.means.q, "pm": scheme.means.p,
                  "dq": scheme.differences.q, "dp": scheme.differences.p}
        D_q, D_p = ([self.folds(e) for e in side] for side in scheme.mean_rates)
        minus_forces = " - F(qm, pm, t)" if self.system.forces else ""
        kernels = [
            *self._common_kernels(projected=False),
            Kernel("mean_velocity", "D_p", inputs, {"D_p": D_p}),
            Kernel("mean_force", f"D_q{minus_forces}", inputs | time_input(self.system),
                   {"D_q": D_q}),
        ]
        return [*kernels, *self._mean_constraint_kernels(scheme), *scheme.energy_rate_kernels(),
                *scheme.constraint_rate_kernels(), *self._multiplier_kernels()]

    def _mean_constraint_kernels(self, scheme: MeanScheme) -> list[Kernel]:
        """Return the kernel of Ḡ, if there are constraints."""
        if not self.system.m:
            return []
        return [Kernel("mean_constraint", "G between q0 and q1",
                       {"qm": scheme.means.q, "dq": scheme.differences.q},
                       {"G": scheme.mean_constraint})]

    def _multiplier_kernels(self) -> list[Kernel]:
        """Return the kernel of W; if W is constant, the kernels of W⁻¹ and of c."""
        if not self.system.m:
            return []
        if self.schur_inverse is None:
            state = {"q": list(self.system.q), "p": list(self.system.p)}
            return [Kernel("schur", "W = G H_pp G^T", state, {"W": self.schur})]
        kernels = [Kernel("schur_inverse", "W^-1, with W = G H_pp G^T constant where g = 0",
                          inputs={}, outputs={"W_inverse": self.schur_inverse})]
        if self.correction is not None:
            kernels.append(Kernel("correction", "c, with H_pp G^T = c G^T where g = 0",
                                  inputs={}, outputs={"c_correction": self.correction}))
        return kernels

    def _common_kernels(self, *, projected: bool) -> list[Kernel]:
        """Return H, g and f on lanes: f in twice the working precision, its matrix reduced.

        The matrix is needed only if momenta are projected onto f = 0 (SPARK methods).
        """
        kernels = []
        for kernel in common_kernels(self.system):
            if kernel.name == "hidden_matrix" and not projected:
                continue
            # f cancels to round-off on the constraints: double-word sums keep its digits
            if kernel.name == "hidden_constraint":
                kernels.append(replace(kernel, compensated=True))
            elif kernel.name == "hidden_matrix":
                W = [[self.reduce_modulo_g(e) for e in row] for row in self.system.hidden_matrix]
                kernels.append(Kernel(kernel.name, kernel.doc, kernel.inputs, {"W": W}))
            else:
                kernels.append(kernel)
        return kernels


class Folds:
    """Replaces the product of a number and a constant by a new constant."""

    def __init__(self, constants: set[sp.Symbol]) -> None:
        self.constants = set(constants)
        self.definitions: dict[sp.Expr, sp.Symbol] = {}
        self._folded: dict[sp.Expr, sp.Expr] = {}

    def __call__(self, e: sp.Expr) -> sp.Expr:
        """Return e with its numbers folded into its constants."""
        if e not in self._folded:
            self._folded[e] = e if e.is_Atom else self._fold(e.func(*map(self, e.args)))
        return self._folded[e]

    def _fold(self, e: sp.Expr) -> sp.Expr:
        """Return a product whose number is folded into its first constant."""
        if not e.is_Mul:
            return e
        number, product = e.as_coeff_Mul()
        factors = sp.Mul.make_args(product)
        # 2 c and −2 c have one constant
        sign, number = (-1, -number) if number < 0 else (1, number)
        constant = next((a for a in factors if a in self.constants), None)
        # only powers of two: the product is exact, so that the C has the same bits with or without
        # it
        if number == 1 or constant is None or not is_power_of_two(number):
            return e
        folded = number * constant
        if folded not in self.definitions:
            symbol = sp.Symbol(f"_f{len(self.definitions)}", real=True, nonzero=True)
            self.definitions[folded] = symbol
            self.constants.add(symbol)
        return sp.Mul(sign, self.definitions[folded], *(a for a in factors if a is not constant))


def is_power_of_two(x: sp.Expr) -> bool:
    """Whether a product with the number is exact in binary."""
    if not x.is_Rational:
        return False
    return all(n & (n - 1) == 0 for n in (int(x.p), int(x.q)))


@dataclass(frozen=True)
class FastLagrangian(FastSystem):
    """A system from its Lagrangian: no identities are used, M is factorised at every stage."""

    system: LagrangianSystem
    schur_inverse = None
    correction = None
    is_affine = True
    is_separable = False

    @property
    def shared_sums(self) -> list[sp.Expr]:
        """Empty: the engine shares the factors of M between H_p and H_q."""
        return []

    def spark_kernels(self, *, separate: bool = False) -> list[Kernel]:
        """Return M, b, V, L_q + F and the constraints on lanes: the engine computes the rates."""
        return [*common_kernels(self.system), *motion_kernels(self.system)]

    def mean_kernels(self, scheme: MeanScheme) -> list[Kernel]:
        """Return M, b, V, the generalised force between the ends, and G and g_t there."""
        assert isinstance(scheme, LagrangianIMS)
        return [*common_kernels(self.system), *scheme.motion_kernels(),
                *self._mean_constraint_kernels(scheme), *scheme.constraint_rate_kernels()]


def fast_system(system: System) -> FastSystem:
    """Return the structure for the fixed-point iteration of a system of either kind."""
    return FastLagrangian(system) if isinstance(system, LagrangianSystem) else FastSystem(system)
