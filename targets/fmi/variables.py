"""The variables of an FMU, from the manifest of a stepper and the numbers of a start."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from ...core.arguments import shown
from ...core.errors import InputError
from ..artefact import Options

__all__ = ["Variable", "exponents", "unit_of", "variables_of"]

_KG_M2_S_2 = {"kg": 1, "m": 2, "s": -2}
#: Units that FMI's exponents of kg, m, s, A, K, mol, cd and rad can say, with factors of 1.
_UNITS: dict[str, dict[str, int]] = {
    **{base: {base: 1} for base in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")},
    "1": {}, "J": _KG_M2_S_2, "N": {"kg": 1, "m": 1, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3}, "Pa": {"kg": 1, "m": -1, "s": -2}, "Hz": {"s": -1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1}, "T": {"kg": 1, "s": -2, "A": -1},
    "C": {"A": 1, "s": 1},
}
_FACTOR = re.compile(r"([A-Za-z]+|1)(-?\d+)?")

#: The least number above 0 that is not subnormal: what ``min`` says of a positive number.
LEAST = sys.float_info.min


@dataclass(frozen=True)
class Variable:
    """A number of an FMU; its value reference is its place among them.

    Attributes
    ----------
    name, about : str
    place : str
        In the struct ``model_t`` of core.h.
    causality, variability, initial : str
        As FMI has them; ``initial`` is empty for inputs and for time.
    start : float or None
        None where it follows from others.
    unit : str or None
        In FMI's spelling.
    domain : str
        ``real``, ``nonzero`` or ``positive``.
    depends : tuple of str or None
        Inputs, parameters and time that an output depends on at a fixed state.
    """

    name: str
    about: str
    place: str
    causality: str
    variability: str = "continuous"
    initial: str = ""
    start: float | None = None
    unit: str | None = None
    domain: str = "real"
    depends: tuple[str, ...] | None = None

    @property
    def settable(self) -> str:
        """When it can be set, as core.h names it."""
        if self.causality == "input":
            return "AT_ANY_TIME"
        return "BEFORE_THE_START" if self.initial == "exact" else "NEVER"


def variables_of(manifest: Mapping[str, Any], options: Options) -> list[Variable]:
    """Return the variables in the order of their value references: time is the first.

    Parameters are fixed, inputs are constant over a communication step, coordinates and velocities
    (momenta, where no velocities are known) are outputs that can be set before the start, and
    quantities and the energy are outputs that follow.

    Raises
    ------
    InputError
        For two numbers of one name, a number without a start, an unknown unit.
    """
    found = [*_variables(manifest, options)]
    names: set[str] = set()
    for variable in found:
        if variable.name in names:
            raise InputError(
                f"An FMU of {manifest['name']} would have two variables {variable.name!r}: time, "
                "dt and energy are its own; rename that number of the model.")
        names.add(variable.name)
        if variable.start is not None and not math.isfinite(variable.start):
            raise InputError(f"The start of {variable.name} is {variable.start}; an FMU needs a "
                             "finite number.")
    return found


def _variables(manifest: Mapping[str, Any], options: Options) -> Iterator[Variable]:
    system = manifest["system"]
    numbers = system["numbers"]
    hamiltonian = system["hamiltonian"]
    quantities: Mapping[str, str] = system.get("quantities", {})
    known = [n["name"] for n in numbers if n["role"] in ("parameter", "input")]
    time = system.get("time")
    first = "velocity" if any(n["role"] == "velocity" for n in numbers) else "p"
    mechanical = any("kg" in exponents(n["unit"]) for n in numbers if n["unit"])
    starts = {"q": options.q, "p": options.p}
    yield Variable("time", "time", "time", "independent", unit="s")
    yield Variable("dt", "longest step of the integrator", "dt", "parameter", "fixed", "exact",
                   float(options.dt), "s", "positive")
    counts = dict.fromkeys(("q", "p", "velocity", "quantity"), 0)

    def depends(text: str) -> tuple[str, ...]:
        words = {*re.findall(r"[A-Za-z_]\w*", text)}
        return (*(["time"] if time in words else []), *(name for name in known if name in words))

    for number in numbers:
        name, role, unit, domain = (number[key] for key in ("name", "role", "unit", "domain"))
        if role in counts:
            place = f"{'quantities' if role == 'quantity' else role}[{counts[role]}]"
            counts[role] += 1
        if role in ("parameter", "input"):
            value = float(options.parameters[name])
            yield Variable(name, role, f"parameters.{name}", role,
                           *(("continuous", "") if role == "input" else ("fixed", "exact")),
                           value, unit, domain)
        elif role in ("q", first):
            values = starts.get(role)
            value = number["start"] if values is None else values[counts[role] - 1]
            if value is None:
                raise InputError(f"{name} has no start; give start= or put it into the model.")
            about = {"q": "coordinate", "p": "momentum", "velocity": "velocity"}[role]
            yield Variable(name, about, place, "output", initial="exact", start=float(value),
                           unit=unit, depends=() if role != "velocity" else depends(hamiltonian))
        elif role == "quantity":
            yield Variable(name, quantities[name], place, "output", initial="calculated", unit=unit,
                           depends=depends(quantities[name]))
    yield Variable("energy", "H(q, p)", "energy", "output", initial="calculated",
                   unit="J" if mechanical else None, depends=depends(hamiltonian))


def exponents(unit: str) -> dict[str, int]:
    """Return the exponents of SI's base units in a unit such as ``kg.m2/s2``.

    Raises
    ------
    InputError
        For a unit that is no product of powers of those known here.
    """
    total: dict[str, int] = {}
    above, *below = unit.split("/")
    for sign, part in [(1, above), *((-1, text) for text in below)]:
        for factor in part.strip("()").split("."):
            match = _FACTOR.fullmatch(factor)
            if match is None or match[1] not in _UNITS:
                raise InputError(f"Unit {shown(unit)}: {shown(factor)} is none that an FMU can "
                                 f"state; write it with {', '.join(_UNITS)}.")
            for base, power in _UNITS[match[1]].items():
                total[base] = total.get(base, 0) + sign * power * int(match[2] or 1)
    return {base: power for base, power in total.items() if power}


def unit_of(variable: Variable) -> dict[str, str]:
    """Return the attribute ``unit`` where there is one."""
    return {} if variable.unit is None else {"unit": variable.unit}
