"""Units of the numbers of a system: units that the user gives, and units that follow from them.

All terms of a sum have one unit, arguments of functions have none; H is an energy and F_i the rate
of p_i. A product with one unknown factor then determines it. Decimals such as 9.81 may have units
of their own, and determine nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

import sympy as sp

from ...core.units import DIMENSIONLESS, Dimensions, base_units, product_dimensions, unit_name
from ..symbolic.switching_functions import Switch
from .system import System

__all__ = ["units_of"]


class _Solver:
    """Dimensions of symbols, completed by equations."""

    def __init__(self, dimensions: Mapping[sp.Symbol, Dimensions]) -> None:
        """Begin with the dimensions of some symbols."""
        self.known = dict(dimensions)

    def of(self, e: sp.Expr) -> Dimensions | None:
        """Return the dimensions of an expression; None if they are unknown.

        A fraction such as 981/100 may have dimensions; 3, ½ and other binary numbers have none.
        """
        if e.is_Symbol:
            return self.known.get(e)
        if e.is_number:
            # a power of two in the denominator; π and √2 are pure numbers, too
            pure = (e.is_Rational and e.q & (e.q - 1) == 0) or not e.is_Rational
            return DIMENSIONLESS if pure else None
        if e.is_Add or isinstance(e, (sp.Abs, Switch)):
            # all terms have the same dimensions: the first known ones count
            candidates = (self.of(a) for a in _alike(e))
            return next((term for term in candidates if term is not None), None)
        if e.is_Mul:
            known_factors = [factor for a in e.args if (factor := self.of(a)) is not None]
            if len(known_factors) < len(e.args):
                return None
            return product_dimensions(*((factor, 1) for factor in known_factors))
        if e.is_Pow and e.exp.is_Rational:
            base = self.of(e.base)
            return None if base is None else product_dimensions((base, Fraction(int(e.exp.p),
                                                                                int(e.exp.q))))
        # sines, exponentials and the like
        return DIMENSIONLESS

    def assign(self, e: sp.Expr, dimensions: Dimensions | None) -> None:
        """Derive dimensions of symbols in e from its own ``dimensions``, None if they are unknown.

        Terms of a sum have the dimensions of the sum; a single unknown factor of a product has the
        quotient of the product and the known factors; arguments of functions have none.
        """
        if e.is_Symbol:
            if dimensions is not None:
                self.known.setdefault(e, dimensions)
        elif e.is_Add or isinstance(e, (sp.Abs, Switch)):
            dimensions_of_e = dimensions if dimensions is not None else self.of(e)
            for a in _alike(e):
                self.assign(a, dimensions_of_e)
            # the two sides of a switch's comparison have equal dimensions, other ones than e: they
            # are treated as the terms of a sum
            compared = [a for a in e.args if isinstance(e, Switch) and a not in _alike(e)]
            self.assign(sp.Add(*compared, evaluate=False), dimensions=None)
        elif e.is_Mul:
            dimensions_of = {a: self.of(a) for a in e.args}
            unknown = [a for a, factor in dimensions_of.items() if factor is None]
            known_product = product_dimensions(*((factor, 1) for factor in dimensions_of.values()
                                                 if factor is not None))
            for a in e.args:
                if dimensions is not None and unknown == [a]:
                    self.assign(a, product_dimensions((dimensions, 1), (known_product, -1)))
                else:
                    # symbols inside of a known factor may be unknown
                    self.assign(a, dimensions_of[a])
        elif e.is_Pow and e.exp.is_Rational:
            inverse_exponent = Fraction(int(e.exp.q), int(e.exp.p))
            self.assign(e.base, None if dimensions is None
                        else product_dimensions((dimensions, inverse_exponent)))
        else:
            # signs and angles of vectors take arguments of any dimensions, exp and sin of none
            takes_any = isinstance(e, (sp.sign, sp.Heaviside, sp.atan2))
            for a in e.args:
                self.assign(a, None if takes_any else DIMENSIONLESS)


def _alike(e: sp.Expr) -> list[sp.Expr]:
    """Return the nonzero terms of a sum, or branches of a switch: they have its unit."""
    terms = [e.args[i] for i in e.branches] if isinstance(e, Switch) else e.args
    return [a for a in terms if a != 0]


def units_of(system: System, given_units: Mapping[str, str]) -> dict[str, str | None]:
    """Return the unit of each parameter, coordinate, momentum and quantity; None where unknown.

    Parameters
    ----------
    system : System
        Bodies say that quaternions have no unit, positions are in m, inertias in kg.m2.
    given_units : mapping of str to str
        Units by names of parameters, coordinates, momenta and quantities.
    """
    symbols = {str(x): x for x in (*system.q, *system.p, *system.parameters)}
    dimensions: dict[sp.Symbol, Dimensions] = {}
    if system.time is not None:
        dimensions[system.time] = base_units("s")
    for body in system.bodies:
        # three principal moments, or the six entries of J⁻¹
        inertia = base_units("kg.m2" if len(body.inertia) == 3 else "1/kg/m2")
        dimensions |= dict.fromkeys(body.q, DIMENSIONLESS) | dict.fromkeys(body.x, base_units("m"))
        dimensions |= dict.fromkeys(body.inertia, inertia)
        if isinstance(body.mass, sp.Symbol):
            dimensions[body.mass] = base_units("kg")
    dimensions |= {symbols[name]: _without_angles(base_units(unit))
                   for name, unit in given_units.items() if name in symbols}
    solver = _Solver(dimensions)
    # without any unit but that of the time, no unit follows
    if dimensions.keys() - {system.time}:
        _solve(solver, system)
    # J and N m are one dimension: a parameter of forces alone is a torque
    torques = {x for f in system.forces for x in f.free_symbols} - system.H.free_symbols
    units: dict[str, str | None] = {}
    for name, x in (*symbols.items(), *system.quantities.items()):
        dimension = solver.of(x)
        unit = None if dimension is None else unit_name(dimension)
        if unit == "J" and x in torques:
            unit = "N.m"
        # rates of bodies are mostly angular ones, whose angle has no dimension here
        elif unit == "1/s" and system.bodies:
            unit = "rad/s"
        units[name] = given_units.get(name, unit)
    return units


def _solve(solver: _Solver, system: System) -> None:
    """Derive dimensions from the equations of a system until a pass adds none.

    H is an energy, q p an action, F q an energy; the terms of a sum have one dimension.
    """
    energy, count = base_units("J"), -1
    while len(solver.known) > count:
        count = len(solver.known)
        solver.assign(system.H, energy)
        for x, p in zip(system.q, system.p, strict=True):
            for variable, conjugate in ((x, p), (p, x)):  # the product of both is an action
                if (known_unit := solver.known.get(variable)) is not None:
                    solver.assign(conjugate,
                                  product_dimensions((base_units("J.s"), 1), (known_unit, -1)))
        for x, force in zip(system.q, system.forces, strict=False):  # there may be no forces
            known_unit = solver.known.get(x)
            solver.assign(force, None if known_unit is None
                          else product_dimensions((energy, 1), (known_unit, -1)))
        for e in (*system.constraints, *system.quantities.values()):
            solver.assign(e, solver.of(e))


def _without_angles(dimensions: Dimensions) -> Dimensions:
    """Return dimensions without rad: in equations an angle is a pure number."""
    return {unit: e for unit, e in dimensions.items() if unit != "rad"}
