"""Roles, units, domains and starting values of the numbers of a stepper, for its manifest."""

from __future__ import annotations

from typing import Any

import sympy as sp

from ...core.exact_numbers import exact
from ...core.manifest import Domain, NumberManifest
from ...core.registry import MEANS, function_of
from ...core.units import base_units, product_dimensions, unit_name
from ..multibody.model import Model
from ..systems.units import units_of
from .program import Derived, StateFunctions

__all__ = ["domain_of", "numbers_of"]


def domain_of(parameter: sp.Symbol) -> Domain:
    """Return the domain of a parameter, from the assumptions of its symbol."""
    if parameter.is_positive:
        return "positive"
    return "nonzero" if parameter.is_nonzero else "real"


def numbers_of(derived: Derived, states: StateFunctions | None) -> list[NumberManifest]:
    """Return name, role, domain, unit and starting value of each number.

    Within a role, the order is the order in the C. Names are distinct C identifiers.
    """
    system, model = derived.system, derived.model
    units = units_of(system, model.units if model else {})
    start = _starting_values(derived, model, states) if model else {}
    if system.time is not None:
        units[str(system.time)] = "s"
    velocities = states.velocities if states else []
    if states and velocities:
        # components of Ω, or the rate of a coordinate x, with the unit of x per second
        units |= {name: "rad/s" if x is None else _unit_of_rate(units[str(x)])
                  for name, x in zip(velocities, states.own.rate_of, strict=True)}
    # role, number and domain; within a role in the order of the members of the C structs
    rows: list[tuple[Any, Any, Domain]] = [
        ("input" if x in system.inputs else "parameter", x, domain_of(x))
        for x in system.parameters]
    if system.is_nonautonomous:
        rows.append(("time", system.time, "real"))
    rows += [(role, x, "real") for role, numbers in (
        ("q", system.q), ("p", system.p), ("velocity", velocities),
        ("quantity", system.quantities)) for x in numbers]
    return [NumberManifest(name=str(x), role=role, domain=domain, unit=units.get(str(x)),
                           start=start.get(str(x))) for role, x, domain in rows]


def _unit_of_rate(unit: str | None) -> str | None:
    """Return the unit per second, such as "m/s" of "m"; None for None."""
    if unit is None:
        return None
    return unit_name(product_dimensions((base_units(unit), 1), (base_units("s"), -1)))


def _starting_values(
    derived: Derived, model: Model, states: StateFunctions | None
) -> dict[str, float]:
    """Return the starting values of the numbers of a model by name, exact until rounded once.

    γ or α of a body is the mean of its moments by the model's rule; velocities are computed from q
    and p with 30 digits.
    """
    system = derived.system
    start: dict[str, Any] = {name: exact(x) for name, x in model.parameters.items()}
    # γ by name: the generator does not import the runtime
    mean_inertia = function_of("runtime.rigid_body.gamma_rules", "mean_inertia")
    for name, inertia in model.bodies.items():
        if name not in start:
            rule = model.rules.get(name, "m")
            # a rule that tunes γ in a run starts from the arithmetic mean
            start[name] = exact(mean_inertia(inertia, rule if rule in MEANS else "m"))
    if system.is_nonautonomous:
        start[str(system.time)] = exact(0.0)
    for symbols, numbers in ((model.system.q, model.q0), (model.system.p, model.p0)):
        start |= {str(x): exact(number) for x, number in zip(symbols, numbers, strict=True)}
    # in exact numbers, so that a velocity of 0 is 0
    if states and states.velocities:
        substitutions = {x: sp.Rational(start[str(x)]) for x in (*system.q, *system.p,
                                                                 *system.parameters)}
        for name, e in zip(states.velocities, states.own.velocities, strict=True):
            start[name] = e.evalf(30, subs=substitutions)
    return {name: float(x) for name, x in start.items()}
