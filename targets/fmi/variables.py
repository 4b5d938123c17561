"""The variables of an FMU, from the manifest of a stepper and the numbers of a start."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...core.errors import InputError
from ...core.manifest import BodyManifest, Manifest, SystemManifest
from ...core.units import base_units
from ..artefact import Options

__all__ = ["Variable", "unit_of", "variables_of"]

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


def variables_of(manifest: Manifest, options: Options) -> list[Variable]:
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
                f"An FMU of {manifest.name} would have two variables {variable.name!r}: time, "
                "dt and energy are its own; rename that number of the model.")
        names.add(variable.name)
        if variable.start is not None and not math.isfinite(variable.start):
            raise InputError(f"The start of {variable.name} is {variable.start}; an FMU needs a "
                             "finite number.")
    return found


def _variables(manifest: Manifest, options: Options) -> Iterator[Variable]:
    system = manifest.system
    numbers = system.numbers
    hamiltonian = system.hamiltonian
    quantities: Mapping[str, str] = system.quantities
    known = [n.name for n in numbers if n.role in ("parameter", "input")]
    time = system.time
    first = "velocity" if any(n.role == "velocity" for n in numbers) else "p"
    mechanical = any("kg" in base_units(n.unit) for n in numbers if n.unit)
    starts = {"q": options.q, first: options.p if first == "p" else _velocities(system, options)}
    yield Variable("time", "time", "time", "independent", unit="s")
    yield Variable("dt", "longest step of the integrator", "dt", "parameter", "fixed", "exact",
                   float(options.dt), "s", "positive")
    about = _meanings(system)
    first_of = {"q": "coordinate", "p": "momentum", "velocity": "rate of a coordinate"}
    counts = dict.fromkeys(("q", "p", "velocity", "quantity"), 0)

    def depends(text: str) -> tuple[str, ...]:
        words = {*re.findall(r"[A-Za-z_]\w*", text)}
        return (*(["time"] if time in words else []), *(name for name in known if name in words))

    for number in numbers:
        name, role, unit, domain = number.name, number.role, number.unit, number.domain
        if role in counts:
            place = f"{'quantities' if role == 'quantity' else role}[{counts[role]}]"
            counts[role] += 1
        if role in ("parameter", "input"):
            value = float(options.parameters[name])
            yield Variable(name, role, f"parameters.{name}", role,
                           *(("continuous", "") if role == "input" else ("fixed", "exact")),
                           value, unit, domain)
        elif role in ("q", first):
            value = float(starts[role][counts[role] - 1])
            yield Variable(name, about.get(name, first_of[role]), place, "output",
                           initial="exact", start=value,
                           unit=unit, depends=() if role != "velocity" else depends(hamiltonian))
        elif role == "quantity":
            yield Variable(name, quantities[name], place, "output", initial="calculated", unit=unit,
                           depends=depends(quantities[name]))
    yield Variable("energy", "H(q, p)", "energy", "output", initial="calculated",
                   unit="J" if mechanical else None, depends=depends(hamiltonian))


def _bodies(system: SystemManifest) -> Mapping[str, BodyManifest]:
    """Return the coordinates of each body by its name."""
    if system.rigid_body and not system.bodies:
        return {"body": BodyManifest(q=system.coordinates)}
    return system.bodies


def _meanings(system: SystemManifest) -> dict[str, str]:
    """Return what coordinates and velocities of bodies are."""
    found: dict[str, str] = {}
    for name, body in _bodies(system).items():
        found |= dict.fromkeys(body.q, f"attitude of {name}, a unit quaternion")
        found |= dict.fromkeys(body.x, f"position of {name} in space")
        found |= {f"{name}_omega_{a}": f"angular velocity of {name} in its axes" for a in "xyz"}
        found |= {f"{name}_v_{a}": f"velocity of {name} in space" for a in "xyz"}
    return found


def _velocities(system: SystemManifest, options: Options) -> list[float]:
    """Return the velocities of a start: 2 L(q) q' of a quaternion, else q', with q' = H_p.

    H_p is Im H(q, p + iε e_k)/ε, a way that shares nothing with the C.
    """
    import sympy as sp

    from ...generator.models.formulas import parse_formula
    from ...generator.symbolic.numeric_evaluation import evaluate
    from ...runtime.rigid_body.quaternion import left_matrix

    names = {name: sp.Symbol(name) for name in (
        *system.coordinates, *system.momenta, *options.parameters)}
    text = system.hamiltonian.replace("Abs(", "abs(")  # SymPy's name, and that of formulas
    H = parse_formula(text, names, frozenset(names.values()))
    p = np.array(options.p)[:, None] + 1e-100j * np.eye(len(options.p))
    values = {**options.parameters, **dict(zip(system.coordinates, options.q, strict=True)),
              **dict(zip(system.momenta, p, strict=True))}
    rates = evaluate([H], {names[name]: x for name, x in values.items()}).imag[0] / 1e-100
    at = {name: k for k, name in enumerate(system.coordinates)}
    found: list[float] = []
    seen: set[int] = set()
    for body in _bodies(system).values():
        turning, moving = [at[x] for x in body.q], [at[x] for x in body.x]
        if turning:
            found += (2 * left_matrix([options.q[k] for k in turning]) @ rates[turning]).tolist()
        found += rates[moving].tolist()
        seen |= {*turning, *moving}
    return [*found, *(float(rate) for k, rate in enumerate(rates) if k not in seen)]


def unit_of(variable: Variable) -> dict[str, str]:
    """Return the attribute ``unit`` where there is one."""
    return {} if variable.unit is None else {"unit": variable.unit}
