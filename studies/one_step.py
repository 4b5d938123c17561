"""One step of LIIIA-B as a power series in h, exactly, with γ as a symbol.

The α-form is taken (it is the γ-form, ``equivalence``): with w = q̄∘p, ι = (1/γ, J⁻¹),

    H = ⅛ Σᵢ ιᵢ wᵢ² + V,   H_p = ¼ q∘(ιw),   H_q = ¼ p∘conj(ιw) + V_q,   V_q = −2mgl Γ∘q∘e₃
    P_i = p₀ + h Σ_j â_ij F_j,   Q_i = q₀ + h Σ_j a_ij H_p(Q_j, P_j),   F = −H_q − 2QΛ

A multiplier moves the constraints of the later stages by δg = −(h²/γ) A Â δΛ + …, so that

    Λ ← Λ + (γ/h²) (A Â)⁻¹ g(Q)

brings more correct powers of h in every sweep through P, H_p, Q and Λ. The sweeps end when one of
them changes nothing: then the equations of the step hold to the order kept, term by term.
"""

from __future__ import annotations

from typing import Any

import sympy as sp
from sympy import QQ

from ..core.inertia import quaternion_product
from ..generator.tableaux.tableau import Tableau
from .body_frame import BodyFrameTop, conjugate, dot, over
from .power_series import PowerSeries

__all__ = ["energy_error"]

Vector = list[Any]


def energy_error(tableau: Tableau, top: BodyFrameTop, order: int) -> PowerSeries:
    """Return H(q₁, p₁) − H(q₀, p₀) of one step, with the powers of h up to ``order``.

    The tableau must have rational entries: LIIIA-B with 2 or 3 stages.
    """
    return _Step(tableau, top, order).solved().energy_change()


class _Step:
    """The stages Q_i, P_i and multipliers Λ_i of one step, as series in h that iterations improve.

    Vectors have four components, each a ``PowerSeries``.
    """

    def __init__(self, tableau: Tableau, top: BodyFrameTop, order: int) -> None:
        """Begin with constant stages, Q_i = q₀ and P_i = p₀, and Λ = 0."""
        self.top, self.order = top, order + 1  # Λ loses two powers and P gains one
        self.s = tableau.s
        self.A, self.A_hat = _rational(tableau.A), _rational(tableau.A_hat)
        self.b = _rational([tableau.b])[0]
        # A Â without the first stage, at which g holds, and the last multiplier, without effect
        product = sp.Matrix(tableau.A)[1:, :] * sp.Matrix(tableau.A_hat)[:, :-1]
        self.inverse_product = _rational(product.inv().tolist())
        self.q0 = [self.constant(v) for v in (1, 0, 0, 0)]
        self.p0 = [self.constant(v) for v in (0, *(2 * x for x in top.l))]
        self.Q, self.P = [self.q0] * self.s, [self.p0] * self.s
        self.Lambda = [self.constant(0)] * (self.s - 1)

    def constant(self, value: Any) -> PowerSeries:
        """Return a number as a series whose coefficients have the type of the state."""
        return PowerSeries.constant(value + 0 * self.top.l[0], self.order)

    def solved(self) -> _Step:
        """Iterate until no term changes; each sweep makes at least one more power of h right.

        Raises
        ------
        ArithmeticError
            If the terms still change after four sweeps for each power.
        """
        # few terms while the high ones are still wrong
        for order in range(2, self.order):
            self.sweep(order)
        for _ in range(4 * self.order):
            previous = self.terms()
            self.sweep(self.order)
            if self.terms() == previous:
                return self
        raise ArithmeticError(f"The expansion of the step to h^{self.order} does not settle.")

    def sweep(self, order: int) -> None:
        """Go once through P, H_p, Q and Λ with the powers of h up to ``order``."""
        self.Lambda = [x.truncate(order) for x in self.Lambda]
        self.P = [[x.truncate(order) for x in p] for p in self.P]
        self.Q = [[x.truncate(order) for x in q] for q in self.Q]
        forces = self.forces()
        self.P = [self.stage(self.p0, row, forces) for row in self.A_hat]
        rates = [self.velocity(q, p) for q, p in zip(self.Q, self.P, strict=True)]
        self.Q = [self.stage(self.q0, row, rates) for row in self.A]
        self.correct()

    def terms(self) -> list[Any]:
        """Return all coefficients of the stages and multipliers."""
        return [x.terms for x in self.Lambda] + [x.terms for v in self.P + self.Q for x in v]

    def correct(self) -> None:
        """Add (γ/h²) (A Â)⁻¹ g(Q) to Λ, with g_i = |Q_i|² − 1 at the stages after the first."""
        g = [dot(q, q) - self.constant(1) for q in self.Q[1:]]
        for i, row in enumerate(self.inverse_product):
            change = sum((defect * a for defect, a in zip(g, row, strict=True)), self.constant(0))
            self.Lambda[i] += change.shift(h=-2, gamma=1)

    def stage(self, start: Vector, row: Vector, rates: list[Vector]) -> Vector:
        """Return start + h Σ_j a_j rate_j, where ``row`` has the coefficients a_j."""
        stage = list(start)
        for a, rate in zip(row, rates, strict=True):
            if a != 0:
                stage = [x + (v * a).shift(h=1) for x, v in zip(stage, rate, strict=True)]
        return stage

    def relative(self, q: Vector, p: Vector) -> Vector:
        """Return ιw/4 with w = q̄∘p and ι = (1/γ, 1/I₁, 1/I₂, 1/I₃)."""
        radial, *vector = quaternion_product(conjugate(q), p)
        inner = [x * over(j, 4) for x, j in zip(vector, self.top.inverse_inertia, strict=True)]
        return [(radial * QQ(1, 4)).shift(gamma=-1), *inner]

    def velocity(self, q: Vector, p: Vector) -> Vector:
        """Return H_p = ¼ q∘(ιw)."""
        return quaternion_product(q, self.relative(q, p))

    def forces(self) -> list[Vector]:
        """Return the forces F_j = −T_q − V_q − 2 Q Λ of all stages, T_q = ¼ p ∘ conj(ι w).

        ``relative`` returns ¼ ι w, w the vector part of q̄ ∘ p and ι = J⁻¹. The last multiplier is
        set to 0: it has no influence on the stages, since â_is = 0.
        """
        multipliers = [*self.Lambda, self.constant(0)]
        forces = []
        for q, p, multiplier in zip(self.Q, self.P, multipliers, strict=True):
            T_q = quaternion_product(p, conjugate(self.relative(q, p)))
            V_q = self.gravity(q)
            forces.append([-a - b - 2 * c * multiplier
                           for a, b, c in zip(T_q, V_q, q, strict=True)])
        return forces

    def gravity(self, q: Vector) -> Vector:
        """Return V_q = −2 mgl Γ∘q∘e₃."""
        G = [self.constant(v) for v in (0, *self.top.vertical)]
        a, b, c, d = quaternion_product(G, q)
        return [x * (-2 * self.top.mgl) for x in (-d, c, -b, a)]

    def energy_change(self) -> PowerSeries:
        """Return H(q₁, p₁) − H(q₀, p₀), to the order asked.

        The last multiplier, which the forces lack, makes q₁ᵀp₁ = 0: it changes the radial part of
        p₁ alone, and ``energy`` does not read that part.
        """
        rates = [self.velocity(q, p) for q, p in zip(self.Q, self.P, strict=True)]
        q1 = self.stage(self.q0, self.b, rates)
        p1 = self.stage(self.p0, self.b, self.forces())
        change = self.energy(q1, p1) - self.energy(self.q0, self.p0)
        # the power that __init__ added is not complete
        return PowerSeries(change.terms, self.order - 1)

    def energy(self, q: Vector, p: Vector) -> PowerSeries:
        """Return ⅛ Σᵢ wᵢ²/Iᵢ + V with w = q̄∘p, i = 1..3; V = ½ qᵀV_q, as V is quadratic in q."""
        w = quaternion_product(conjugate(q), p)[1:]
        energy: PowerSeries = dot(q, self.gravity(q)) * QQ(1, 2)
        for x, j in zip(w, self.top.inverse_inertia, strict=True):
            energy = energy + x * x * over(j, 8)
        return energy


def _rational(rows: Any) -> list[Vector]:
    """Return rows of SymPy's rational numbers as rows of elements of ``QQ``."""
    return [[QQ.from_sympy(entry) for entry in row] for row in rows]
