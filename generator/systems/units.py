"""Units of the numbers of a system: those that are given, and those that follow from them.

All terms of a sum have one unit, arguments of functions have none; H is an energy and F_i the rate
of p_i. A product with one unknown factor then determines it. Decimals such as 9.81 may have units
of their own, and determine nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

import sympy as sp

from ...core.units import DIMENSIONLESS, Dimensions, base_units, combined, unit_name
from ..symbolic.switching_functions import Switch
from .system import System

__all__ = ["units_of"]

class _Solver:
    """Dimensions of symbols, completed by equations."""

    def __init__(self, known: Mapping[sp.Symbol, Dimensions]) -> None:
        self.known = dict(known)

    def of(self, e: sp.Expr) -> Dimensions | None:
        """Return the dimensions of an expression; None if they are unknown."""
        if e.is_Symbol:
            return self.known.get(e)
        if e.is_number:
            pure = (e.is_Rational and e.q & (e.q - 1) == 0) or not e.is_Rational
            return DIMENSIONLESS if pure else None
        if e.is_Add or isinstance(e, (sp.Abs, Switch)):
            found = (self.of(a) for a in _alike(e))
            return next((one for one in found if one is not None), None)
        if e.is_Mul:
            parts = [self.of(a) for a in e.args]
            known = [one for one in parts if one is not None]
            return combined(*((one, 1) for one in known)) if len(known) == len(parts) else None
        if e.is_Pow and e.exp.is_Rational:
            base = self.of(e.base)
            return None if base is None else combined((base, Fraction(int(e.exp.p), int(e.exp.q))))
        return DIMENSIONLESS

    def assign(self, e: sp.Expr, dimensions: Dimensions | None) -> None:
        """Find unknowns of an expression of these dimensions."""
        if e.is_Symbol:
            if dimensions is not None:
                self.known.setdefault(e, dimensions)
        elif e.is_Add or isinstance(e, (sp.Abs, Switch)):
            own = dimensions if dimensions is not None else self.of(e)
            for a in _alike(e):
                self.assign(a, own)
            compared = [a for a in e.args if isinstance(e, Switch) and a not in _alike(e)]
            self.assign(sp.Add(*compared, evaluate=False), None)
        elif e.is_Mul:
            parts = {a: self.of(a) for a in e.args}
            unknown = [a for a, found in parts.items() if found is None]
            rest = combined(*((found, 1) for found in parts.values() if found is not None))
            for a in e.args:
                single = dimensions is not None and unknown == [a]
                self.assign(a, combined((dimensions or {}, 1), (rest, -1)) if single else parts[a])
        elif e.is_Pow and e.exp.is_Rational:
            power = Fraction(int(e.exp.q), int(e.exp.p))
            self.assign(e.base, None if dimensions is None else combined((dimensions, power)))
        else:
            free = isinstance(e, (sp.sign, sp.Heaviside, sp.atan2))
            for a in e.args:
                self.assign(a, None if free else DIMENSIONLESS)


def _alike(e: sp.Expr) -> list[sp.Expr]:
    """Return the parts of a sum or of a choice that have its unit."""
    own = [e.args[i] for i in e.branches] if isinstance(e, Switch) else e.args
    return [a for a in own if a != 0]


def units_of(system: System, given: Mapping[str, str]) -> dict[str, str | None]:
    """Return the unit of each parameter, coordinate, momentum and quantity; None where unknown.

    Parameters
    ----------
    system : System
        Bodies say that quaternions have no unit, positions are in m, inertias in kg.m2.
    given : mapping of str to str
        Units that are known by name.
    """
    symbols = {str(x): x for x in (*system.q, *system.p, *system.parameters)}
    known: dict[sp.Symbol, Dimensions] = {}
    if system.time is not None:
        known[system.time] = base_units("s")
    for body in system.bodies:
        inertia = base_units("kg.m2" if len(body.inertia) == 3 else "1/kg/m2")
        known |= dict.fromkeys(body.q, DIMENSIONLESS) | dict.fromkeys(body.x, base_units("m"))
        known |= dict.fromkeys(body.inertia, inertia)
        if isinstance(body.mass, sp.Symbol):
            known[body.mass] = base_units("kg")
    known |= {symbols[name]: _without_angles(base_units(unit)) for name, unit in given.items()
              if name in symbols}
    solver = _Solver(known)
    if known.keys() - {system.time}:
        _solve(solver, system)
    torques = {x for f in system.forces for x in f.free_symbols} - system.H.free_symbols
    made: dict[str, str | None] = {}
    for name, x in (*symbols.items(), *system.quantities.items()):
        found = solver.of(x)
        unit = None if found is None else unit_name(found)
        if unit == "J" and x in torques:
            unit = "N.m"
        elif unit == "1/s" and system.bodies:
            unit = "rad/s"
        made[name] = given.get(name, unit)
    return made


def _solve(solver: _Solver, system: System) -> None:
    """Go through the equations until nothing new is found."""
    energy, count = base_units("J"), -1
    while len(solver.known) > count:
        count = len(solver.known)
        solver.assign(system.H, energy)
        for x, p in zip(system.q, system.p, strict=True):
            for one, other in ((x, p), (p, x)):  # the product of both is an action
                if (own := solver.known.get(one)) is not None:
                    solver.assign(other, combined((base_units("J.s"), 1), (own, -1)))
        for x, force in zip(system.q, system.forces, strict=False):
            own = solver.known.get(x)
            solver.assign(force, None if own is None else combined((energy, 1), (own, -1)))
        for e in (*system.constraints, *system.quantities.values()):
            solver.assign(e, solver.of(e))


def _without_angles(dimensions: Dimensions) -> Dimensions:
    """Return dimensions where an angle is a pure number."""
    return {unit: e for unit, e in dimensions.items() if unit != "rad"}
