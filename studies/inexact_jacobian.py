"""The inexact Jacobian that the paper's iteration counts point to (erratum 21); inferred.

With w = L(q)p the kinetic energy gives, for D = J⁻¹ (α) or J⁻¹ − γ⁻¹I (γ) and u = ∂H/∂w = D w/4,

    H_p = L(q)ᵀ u + …      H_pq = d(L(q)ᵀ)/dq · u + L(q)ᵀ ∂u/∂q + …

The option drops the term d(L(q)ᵀ)·u from H_pq, and with it from H_qp = H_pqᵀ. The residual is
untouched, so a converged step is the same step; Newton only converges linearly instead of
quadratically. It is an option of these studies: no stepper of the product has it.
"""

from __future__ import annotations

from functools import cache, cached_property

import sympy as sp

from ..core.real_types import REALS
from ..generator.codegen.emit import emit
from ..generator.codegen.program import Derived
from ..generator.multibody.rigid_body import double_momentum, heavy_top
from ..generator.pipeline import tableau_of
from ..generator.schemes.step_equations import SparkScheme, hoist_constants
from ..generator.spec import Spec
from ..generator.systems.system import System
from ..runtime.steppers.stepper import Stepper

__all__ = ["InexactTop", "dropped_term", "inexact_stepper"]

_NAME = "heavy_top_inexact"


def dropped_term(system: System) -> sp.Matrix:
    """Return d(L(q)ᵀ)·u = Σ_i u_i ∂²w_i/∂p∂q with u = ∂H/∂w, w = L(q)p; 4 × 4."""
    w = double_momentum(system.q, system.p)
    # H is differentiated by w as a symbol: each w_i stands in H as one expression
    symbols = sp.symbols(f"_w0:{len(w)}", real=True)
    H = system.H.xreplace(dict(zip(w, symbols, strict=True)))
    back = dict(zip(symbols, w, strict=True))
    total = sp.zeros(system.n, system.n)
    for symbol, component in zip(symbols, w, strict=True):
        u = sp.diff(H, symbol).xreplace(back)
        total += u * sp.Matrix(
            system.n, system.n,
            lambda a, b, c=component: sp.diff(c, system.p[a], system.q[b]),
        )
    return total


class InexactTop(System):
    """A top whose H_pq lacks d(L(q)ᵀ)·u; every other derivative is exact."""

    @cached_property
    def H_pq(self) -> list[list[sp.Expr]]:
        """∂H_p/∂q without d(L(q)ᵀ)·u."""
        exact = System(self.q, self.p, self.parameters, self.H, self.constraints).H_pq
        rows: list[list[sp.Expr]] = (sp.Matrix(exact) - dropped_term(self)).tolist()
        return rows


@cache
def inexact_stepper(scheme: str, stages: int, rep: str) -> Stepper:
    """Return the compiled SPARK stepper of the top with the inexact Jacobian.

    Its residual is the product's, so that a converged step is the same step. ``rep`` is "gamma"
    or "alpha".
    """
    spec = Spec.from_arguments(scheme, stages, rep)
    tableau = tableau_of(spec)
    assert tableau is not None, "the option is for SPARK methods"
    model = heavy_top("gamma" if rep == "gamma" else "alpha")
    # as the product does: subexpressions of parameters alone become constants before the loop
    reduced, constants = hoist_constants(model)
    top = InexactTop(reduced.q, reduced.p, reduced.parameters, reduced.H,
                     reduced.constraints, name=_NAME, rigid_body=True)
    source = emit(Derived(
        f"{_NAME}_{spec.method}_{rep}", f"{stages}-{scheme}, inexact Jacobian,",
        SparkScheme(top, tableau), model, constants, REALS["double"]))
    return Stepper(source.name, source.files())
