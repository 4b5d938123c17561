"""Verification of a stepper, for ``gyrospark verify``: symbols, measurement, compiled numbers.

The one place besides ``api`` where generator and runtime meet: it reads the coefficients back
out of the *compiled* module and compares them with the exact ones to the last bit.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from ..core.arguments import count_text
from ..core.real_types import REALS, RealName
from ..generator.pipeline import Generated, generate
from ..generator.schemes.fast_tableau import FastTableau
from ..generator.schemes.splitting_scheme import SplittingScheme
from ..generator.spec import Spec
from ..generator.splitting.parts import Splitting
from ..generator.tableaux.compositions import Composition
from ..generator.tableaux.conditions import (
    Condition,
    check_tableau,
    energy_conditions,
    velocity_conditions,
)
from ..generator.tableaux.tableau import FIELDS, Tableau
from ..generator.tableaux.velocity_rows import refusal_of_velocity_rows, velocity_matrix
from ..runtime.steppers.stepper import Stepper
from .composition_checks import check_composition
from .midpoint_conditions import check_mean_scheme
from .observed_order import HiddenOrderError, observed_order
from .splitting_proofs import prove_flows, prove_splitting

__all__ = ["Verification", "verify_composition", "verify_stepper"]


@dataclass(frozen=True)
class Verification:
    """All checked conditions of one stepper."""

    name: str
    title: str
    order: int
    conditions: list[Condition]

    def __repr__(self) -> str:
        satisfied = sum(line.holds for line in self.conditions)
        return (f"<Verification of {self.name}: order {self.order}, {satisfied} of "
                f"{count_text(len(self.conditions), 'condition')} hold>")

    @property
    def holds(self) -> bool:
        """Whether every condition holds."""
        return all(line.holds for line in self.conditions)

    def as_dict(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {"name": self.name, "order": self.order, "holds": self.holds,
                "conditions": [asdict(line) for line in self.conditions]}


def verify_stepper(spec: Spec) -> Verification:
    """Check the stepper of a spec; a tableau that violates conditions is checked all the same."""
    generated = generate(spec, allow_invalid=True)
    if isinstance(generated.scheme, SplittingScheme):
        conditions = [*_splitting_proofs(generated.scheme.symmetric), *(
            line for composition in generated.scheme.compositions
            for line in check_composition(composition))]
    elif generated.tableau is None:
        conditions = check_mean_scheme(generated.scheme)  # type: ignore[arg-type]
    else:
        # what algebra says of the tableau first, then what is measured and what was compiled
        conditions = [
            *check_tableau(generated.tableau),
            *([] if refusal_of_velocity_rows(generated.tableau) else
              velocity_conditions(generated.tableau, velocity_matrix(generated.tableau))),
            *(energy_conditions(generated.tableau) if spec.energy else []),
            _check_order(generated.tableau),
            _check_coefficients(generated, generated.tableau, spec.real),
            *_scaled_coefficients(generated.tableau, spec.real),
        ]
    return Verification(generated.source.name,
                        f"{generated.source.name}, order {generated.scheme.order}",
                        generated.scheme.order, conditions)


def _splitting_proofs(splitting: Splitting) -> list[Condition]:
    """Return the proofs about the parts of H as conditions."""
    return [Condition(proof.name, proof.equation, "proved" if proof.holds else "not proved",
                      holds=proof.holds, residual="0" if proof.holds else "-", required=True)
            for proof in (*prove_splitting(splitting), *prove_flows())]


def verify_composition(composition: Composition) -> Verification:
    """Check the order conditions of a composition of flows, its symmetry and symplecticity."""
    return Verification(composition.name, f"{composition.name}, order {composition.order}, "
                        f"{composition.stages} stages", composition.order,
                        check_composition(composition))


def _check_order(tableau: Tableau) -> Condition:
    """Return the condition that the order measured on a constrained test problem is at least the
    proved one, and within 0.2 of a whole number."""
    name, equation = "order, measured", "log2 of the local error's ratio for h, h/2, less 1"
    try:
        slope = observed_order(tableau)
    except HiddenOrderError as error:  # no measurement, which is no evidence against the tableau
        return Condition(name, equation, str(error), holds=True, residual="not measured")
    except ArithmeticError as error:  # conditions above say why there is no step
        return Condition(name, equation, str(error), holds=False, residual="no step",
                         required=True)
    return Condition(
        name,
        equation,
        f"{slope:.3f}{', more than is proved' if round(slope) > tableau.order else ''}",
        holds=round(slope) >= tableau.order and abs(slope - round(slope)) < 0.2,
        residual=f"{slope - tableau.order:.1e}",
        required=True,
    )


def _check_coefficients(generated: Generated, tableau: Tableau, real_name: RealName) -> Condition:
    """Return the condition that each coefficient in the compiled module is the exact one, correctly
    rounded to the stepper's type."""
    stepper = Stepper(generated.source.name, generated.source.files())
    real = REALS[real_name]
    exact = tableau.map_enclosures(real.round)
    # in the order of the module: field by field, matrices row by row
    exact_coefficients = [e for field in FIELDS for row in exact[field]
                          for e in (row if isinstance(row, list) else [row])]
    total, compiled = len(exact_coefficients), stepper.binding.coefficients()
    different = sum(a != b for a, b in zip(compiled, exact_coefficients, strict=True))
    return Condition(
        "compiled coefficients",
        f"equal to the exact ones, correctly rounded to {real.c_type}",
        f"{total - different} of {total} to the last bit",
        holds=different == 0,
        residual="0" if different == 0 else f"{different} differ",
        required=True,
    )


def _scaled_coefficients(tableau: Tableau, real_name: RealName) -> list[Condition]:
    """Return the condition on the coefficients of the fixed-point iteration, μ_ij = a_ij/b_j.

    μ̂_ij + μ_ji = 1 and ν̃_ij + ν_ji = 1 of the tables of constraints must hold exactly after
    rounding: pairs x and 1 − x. No condition for a tableau that the iteration refuses, or whose
    family or file says that it is not symplectic.
    """
    fast, real = FastTableau(tableau), REALS[real_name]
    if fast.refusal is not None:
        return []
    # 0: there are no pairs to be kept; without a claim it is not known, and they are examined
    if tableau.claims.get("symplectic") == 0:
        return []
    errors = fast.rounding_errors(real)
    # in units of 2^-bits, the rounding of numbers near 1
    largest_error = max(abs(e) for e in errors) * 2**real.bits
    return [Condition(
        "scaled coefficients of the fixed-point iteration",
        "mu^_ij + mu_ji = 1 and nu~_ij + nu_ji = 1 after rounding, in rational arithmetic",
        f"{len(errors)} within {float(largest_error):.2f} of 2^-{real.bits}",
        holds=fast.is_symplectic(real),
        residual="0" if fast.is_symplectic(real) else "not symplectic after rounding",
        required=False,  # of the rounded tables, and no property of the method
    )]
