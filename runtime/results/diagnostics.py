"""Diagnostics over every step of a run."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

from ...core.arguments import count_text
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.html import card, table
from ...core.records import dataclass, replace_fields

if TYPE_CHECKING:
    from ..bindings.binding import Binding

__all__ = ["Report", "known_fields"]


@explain_arguments
@dataclass(frozen=True)
class Report:
    """Diagnostics over *every* step of an integration, stored or not.

    Energy errors are |H_k − H_0| with the scheme's own H (α or γ term included), |H_k − H_0 − W_k|
    where forces do the work W_k (``work`` at the end of the run); constraint
    errors |g(q_k)| and momentum-constraint errors |qᵀp| (for other systems the derived
    constraint on the momenta, and |A H_p + a| of velocity constraints, whichever is larger); means
    run over k = 0..N as in (87)-(91). ``iterations`` counts fixed-point and Newton iterations
    together, ``iterations_max`` those of one step; a step with impacts has those of all its parts.
    ``newton_steps`` counts the steps of solver ``auto`` whose fixed-point iteration, or simplified
    Newton iteration, did not converge. ``energy_waits`` counts steps of a stepper with exact energy
    that leave the error of the energy to later steps. Of splittings, errors are those of the first
    16 steps and of every 32nd, since a state at the end of a step costs extra.

    In scaled time W is what H has changed by as the steps have it, so that the energy error is
    |H + e|; ``time_step_min`` and ``time_step_max`` are the smallest and the largest Δt.
    ``impacts`` counts the jumps of the momenta.

    A last part of a step, to a t_end between two steps or to an event that ends the run, is in
    ``work`` and in the largest errors, not in ``steps``, iterations and means; ``q`` and ``p`` are
    the state at that end then.
    """

    steps: int
    iterations: int
    iterations_max: int
    newton_steps: int
    energy_start: float
    energy_error_max: float
    energy_error_mean: float
    constraint_max: float
    constraint_mean: float
    momentum_constraint_max: float
    momentum_constraint_mean: float
    q: tuple[float, ...]
    p: tuple[float, ...]
    work: float = 0.0
    energy_waits: int = 0
    time_step_min: float = 0.0
    time_step_max: float = 0.0
    impacts: int = 0

    def __repr__(self) -> str:
        """Return the steps and iterations, and the largest and mean errors, on three lines."""
        scaled = (f", from {self.time_step_min:.3g} to {self.time_step_max:.3g} s long"
                  if self.time_step_max else "")
        return (f"<Report of {count_text(self.steps, 'step')}, {self.iterations_mean:.1f} "
                "iterations each"
                f"{scaled}\n"
                f"  largest errors: energy {self.energy_error_max:.2e}, constraint "
                f"{self.constraint_max:.2e}, momentum constraint "
                f"{self.momentum_constraint_max:.2e}\n"
                f"  mean errors: energy {self.energy_error_mean:.2e}, constraint "
                f"{self.constraint_mean:.2e}, momentum constraint "
                f"{self.momentum_constraint_mean:.2e}>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: iterations, and the largest and mean error of each kind."""
        errors = [(name, f"{largest:.2e}", f"{mean:.2e}") for name, largest, mean in (
            ("energy", self.energy_error_max, self.energy_error_mean),
            ("constraint", self.constraint_max, self.constraint_mean),
            ("momentum constraint", self.momentum_constraint_max,
             self.momentum_constraint_mean))]
        iterations = ("iterations a step", self.iterations_max, f"{self.iterations_mean:.1f}")
        return card(f"Report of {count_text(self.steps, 'step')}",
                    table([iterations, *errors], ("", "largest", "mean")))

    @classmethod
    def read(cls, record: Any, q: Array, p: Array, binding: Binding) -> Report:
        """Return the report of a compiled running record and the final state.

        Impacts, which the record does not have, are left at 0.
        """
        # H is compared at every state, or at some if the record says at how many; 1 avoids 0/0
        states = int(getattr(record, "recorded", record.steps + 1)) or 1
        energy_error_mean = float(record.energy_error_sum) / states
        return replace_fields(  # faster than the constructor of a frozen dataclass
            object.__new__(cls),
            steps=int(record.steps),
            iterations=int(record.iterations),
            iterations_max=int(record.iterations_max),
            newton_steps=int(record.newton_steps),
            energy_start=float(record.energy_start),
            # the maximum of the C leaves out NaN, as of log(q) at q < 0; the sum contains it
            energy_error_max=math.nan if math.isnan(energy_error_mean)
            else float(record.energy_error_max),
            energy_error_mean=energy_error_mean,
            constraint_max=float(record.constraint_max),
            constraint_mean=float(record.constraint_sum) / states,
            momentum_constraint_max=float(record.hidden_max),
            momentum_constraint_mean=float(record.hidden_sum) / states,
            q=tuple(map(float, q[: binding.shown].tolist())),
            p=tuple(map(float, p[: binding.shown].tolist())),
            work=float(binding.work_done(record)),
            energy_waits=int(getattr(record, "energy_waits", 0)),
            time_step_min=float(record.time_step_min) if binding.clocked else 0.0,
            time_step_max=float(record.time_step_max) if binding.clocked else 0.0,
        )

    @property
    def iterations_mean(self) -> float:
        """Iterations (fixed-point, Newton) a step; 0 without steps."""
        return self.iterations / self.steps if self.steps else 0.0


def known_fields(kind: type, entries: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries for a dataclass's fields: a later version may have written more."""
    return {field.name: entries[field.name] for field in fields(kind) if field.name in entries}
