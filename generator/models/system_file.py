"""The model file of any Hamiltonian system with constraints: [system], [start] q and p."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import NamedTuple

import sympy as sp

from ...core.arguments import count_text
from ..multibody.model import Model, exact_array
from ..parsing.grammar import UNITS
from ..systems.system import System
from .common_tables import Formulas, run_length
from .toml_tables import TomlTable

__all__ = ["read_system"]

#: H is one expression here, without the element templates of a multibody: its n² second
#: derivatives are expressions, too.
MAX_COORDINATES = 64


class _Formulas(NamedTuple):
    """The formulas of a file with [system], and the symbol of the time if one may contain it."""

    H: sp.Expr
    constraints: list[sp.Expr]
    velocity_constraints: list[sp.Expr]
    forces: list[sp.Expr]  # one for each coordinate, or none
    quantities: dict[str, sp.Expr]
    time_scales: list[sp.Expr]  # one, or none
    time: sp.Symbol | None


def read_system(content: TomlTable, name: str, formulas: Formulas, rep: str | None) -> Model:
    """Return the model of a file with [system]; ``formulas`` knows its parameters.

    ``rep`` must be None: there is no inertia representation. Raises InputError with file, key and
    cure.
    """
    content.allow("name", "description", "frame", "system", "parameters", "inputs", "start",
                  "run", "quantities", "events", "units")
    table, start = content.table("system"), content.table("start")
    if rep is not None:
        raise content.file_error(f"it is a system with its own hamiltonian, and rep {rep!r} "
                                 "belongs to models with [body]; leave it out.")
    table.allow("coordinates", "momenta", "hamiltonian", "constraints", "constraint_names",
                "forces", "time", "time_scale", "velocities", "velocity_constraints",
                "velocity_constraint_names")
    table.require("coordinates", "momenta", "hamiltonian")
    q, p = _coordinates_and_momenta(table)
    v = _symbols(table, "velocities") if "velocities" in table else {}
    # scales: the time scale σ, or nothing
    H, constraints, velocity_constraints, forces, quantities, scales, time = _read_formulas(
        content, formulas, q, p, v)
    # symbols of parameters that a formula divides by are replaced by symbols that are not 0
    system_symbols, values = formulas.in_use(
        [H, *constraints, *velocity_constraints, *forces, *quantities.values(), *scales])
    start.allow("q", "p")
    start.require("q", "p")

    def in_system(expressions: Iterable[sp.Expr]) -> tuple[sp.Expr, ...]:
        """Return expressions with the system's symbols of parameters."""
        return tuple(e.xreplace(system_symbols) for e in expressions)

    system = System(
        tuple(q.values()), tuple(p.values()), tuple(system_symbols.values()),
        in_system([H])[0],
        in_system(constraints), name=name,
        constraint_names=tuple(table.strings("constraint_names")),
        velocities=tuple(v.values()), velocity_constraints=in_system(velocity_constraints),
        velocity_constraint_names=tuple(table.strings("velocity_constraint_names")),
        forces=in_system(forces), time=time,
        quantities=dict(zip(quantities, in_system(quantities.values()), strict=True)),
        time_scale=next(iter(in_system(scales)), None),
    )
    q0, p0 = (exact_array(start.vector(key, len(q), UNITS)) for key in ("q", "p"))
    return Model(system, values, q0, p0, **run_length(content))


def _read_formulas(
    content: TomlTable, formulas: Formulas, q: dict[str, sp.Symbol], p: dict[str, sp.Symbol],
    v: dict[str, sp.Symbol],
) -> _Formulas:
    """Return the formulas of a file in coordinates q, momenta p, velocities v, time, parameters.

    q, p and v are name → symbol. Raises InputError with file, key and cure.
    """
    table, state = content.table("system"), q | p
    # name → symbol: the time that forces and quantities may contain, and H and constraints
    time, time_in_H = _time(table, {*state, *v, *formulas.parameters})
    H = formulas.read(table, "hamiltonian", table.formula("hamiltonian"), state | time_in_H)
    constraints = formulas.read_all(table, "constraints", q | time_in_H)
    velocity_constraints = formulas.read_all(table, "velocity_constraints", q | v | time_in_H)
    scales = [formulas.read(table, "time_scale", table.formula("time_scale"), state | time_in_H)
              ] if "time_scale" in table else []
    uses_time = "forces" in table or "quantities" in content or "time" in table or any(
        e.has(*time.values()) for e in (H, *constraints, *velocity_constraints, *scales))
    # only a file with a time is refused for a coordinate called t
    for name in time if uses_time else ():
        if name in state:
            raise table.error("time", f"is {name!r}, which is a coordinate or momentum; choose "
                                      "another name.")
    forces = formulas.read_all(table, "forces", state | time, count=len(q)) if (
        "forces" in table) else []
    quantities = formulas.quantities(state | time)
    return _Formulas(H, constraints, velocity_constraints, forces, quantities, scales,
                     next(iter(time.values())) if uses_time else None)


def _coordinates_and_momenta(table: TomlTable) -> tuple[dict[str, sp.Symbol], dict[str, sp.Symbol]]:
    """Return name → symbol of the coordinates and of the momenta, one for each coordinate."""
    q, p = (_symbols(table, key) for key in ("coordinates", "momenta"))
    if len(q) != len(p):
        raise table.error("momenta", f"has {count_text(len(p), 'name')} for "
                                     f"{count_text(len(q), 'coordinate')}; write one for "
                                     "each.")
    for symbol in q.keys() & p.keys():
        raise table.error("momenta", f"has the name {symbol!r}, which is a coordinate too; names "
                                     "must differ.")
    return q, p


def _time(
    table: TomlTable, names: Collection[str]
) -> tuple[dict[str, sp.Symbol], dict[str, sp.Symbol]]:
    """Return name → symbol of the time in forces and quantities, and in H and constraints.

    If the file declares no time, t may be one of the ``names`` of coordinates and parameters: then
    H and constraints have no time.
    """
    if "time" in table:
        name = table.symbol("time", table.text("time"))
        time = {name: sp.Symbol(name, real=True)}
        return time, time
    time = {"t": sp.Symbol("t", real=True)}
    return time, {} if "t" in names else time


def _symbols(table: TomlTable, key: str) -> dict[str, sp.Symbol]:
    """Return name → symbol of the names under a key, which must differ."""
    names = table.names(key)
    if not 1 <= len(names) <= MAX_COORDINATES:
        raise table.error(key, f"has {count_text(len(names), 'name')}; write 1 to "
                               f"{MAX_COORDINATES}.")
    for i, name in enumerate(names):
        if name in names[:i]:
            raise table.error(key, f"has the name {name!r} twice; names must differ.")
    return {name: sp.Symbol(name, real=True) for name in names}
