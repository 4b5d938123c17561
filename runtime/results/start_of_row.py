"""The start of another run from a state of a run."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ...core.event import Impact
from ...core.start import GAMMA_M, Start
from ..rigid_body.gamma_rules import gamma_by_rule, has_inertia

__all__ = ["start_of_row"]


def start_of_row(
    q: Any, p: Any, t: Any, parameters: Mapping[str, Any], inputs: Mapping[str, Any],
    excess: Any = 0.0, impacts: tuple[Impact, ...] = (),
) -> Start:
    """Return the start from a state q, p, shapes (n,), at time t of a run.

    γ and α that are equal to the mean γ_m of their moments are left out: ``integrate`` computes
    them from the moments, also from other ones. ``excess`` is H + e in scaled time, ``impacts`` are
    those of the run.
    """
    start_parameters = {}
    for name, number in parameters.items():
        if name in inputs or number != number:  # an input that changes has NaN for its number
            continue
        # a mean of the moments, which the new start may replace
        if has_inertia(name, parameters) and number == gamma_by_rule(name, GAMMA_M, parameters):
            continue
        start_parameters[name] = number
    start = Start(q, p, start_parameters, t, inputs)
    start._excess, start._events = excess, impacts
    return start
