"""The variables of an FMU, from the manifest of a stepper and the numbers of a start."""

from __future__ import annotations

import math
import re
import sys
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...core.errors import InputError
from ...core.manifest import BodyManifest, Manifest, SystemManifest
from ...core.units import base_units
from ..artefact import Options

__all__ = ["Variable", "unit_of", "variables_of"]

#: The smallest normal number above 0: the attribute ``min`` of positive variables.
LEAST = sys.float_info.min


@dataclass(frozen=True)
class Variable:
    """A number of an FMU; its value reference is its index among them.

    Attributes
    ----------
    name, about : str
    member : str
        Member of the struct ``model_t`` of core.h.
    causality, variability, initial : str
        As FMI has them; ``initial`` is empty for inputs and for time.
    start : float or None
        None where it follows from others.
    unit : str or None
        In FMI's spelling.
    domain : str
        ``real``, ``nonzero`` or ``positive``.
    of_start : bool
        Whether the state at the start, or whether it is on the constraints, depends on it.
    depends : tuple of str or None
        Inputs, parameters and time that an output depends on at a fixed state.
    """

    name: str
    about: str
    member: str
    causality: str
    variability: str = "continuous"
    initial: str = ""
    start: float | None = None
    unit: str | None = None
    domain: str = "real"
    of_start: bool = False
    depends: tuple[str, ...] | None = None

    @property
    def settable(self) -> str:
        """When it can be set, as core.h names it."""
        if self.causality == "input":
            return "AT_ANY_TIME"
        if self.initial != "exact":
            return "NEVER"
        return "START_STATE" if self.of_start else "BEFORE_THE_START"


def variables_of(manifest: Manifest, options: Options) -> list[Variable]:
    """Return the variables in the order of their value references: time is the first.

    Parameters are fixed, inputs are constant over a communication step, coordinates and velocities
    (momenta, where no velocities are known) are outputs that can be set before the start, and
    quantities and the energy are outputs that follow. Raises InputError for two numbers of one
    name, a number without a start, an unknown unit.
    """
    variables = [*_variables(manifest, options)]
    names: set[str] = set()
    for variable in variables:
        if variable.name in names:
            raise InputError(
                f"An FMU of {manifest.name} would have two variables {variable.name!r}: time, "
                "dt and energy are its own; rename that number of the model.")
        names.add(variable.name)
        if variable.start is not None and not math.isfinite(variable.start):
            raise InputError(f"The start of {variable.name} is {variable.start}; an FMU needs a "
                             "finite number.")
    return variables


def _variables(manifest: Manifest, options: Options) -> Iterator[Variable]:
    """Yield time, dt, the numbers of the system in the manifest's order, and the energy."""
    system = manifest.system
    yield Variable("time", "time", "time", "independent", unit="s")
    yield Variable("dt", "longest step of the integrator", "dt", "parameter", "fixed", "exact",
                   start=float(options.dt), unit="s", domain="positive")
    energy_inputs = _dependencies(system, system.hamiltonian)
    yield from _numbers(system, options, energy_inputs)
    is_mechanical = any("kg" in base_units(number.unit) for number in system.numbers if number.unit)
    yield Variable("energy", "H(q, p)", "energy", "output", initial="calculated",
                   unit="J" if is_mechanical else None, depends=energy_inputs)


def _numbers(
    system: SystemManifest, options: Options, energy_inputs: tuple[str, ...]
) -> Iterator[Variable]:
    """Yield the parameters, inputs, states and quantities; the time is no variable of its own.

    Of a Lagrangian the FMU has velocities in place of momenta.
    """
    has_velocities = any(number.role == "velocity" for number in system.numbers)
    starts = {"q": options.q}
    if has_velocities:
        starts["velocity"] = tuple(_velocities(system, options))
    else:
        starts["p"] = options.p
    meanings = _meanings(system)
    default_meanings = {"q": "coordinate", "p": "momentum", "velocity": "rate of a coordinate"}
    index_of_role = Counter[str]()
    for number in system.numbers:
        name, role = number.name, number.role
        index = index_of_role[role]
        index_of_role[role] += 1
        if role in ("parameter", "input"):
            variability, initial = ("continuous", "") if role == "input" else ("fixed", "exact")
            yield Variable(name, role, f"parameters.{name}", role, variability, initial,
                           float(options.parameters[name]), number.unit, number.domain,
                           of_start=has_velocities or name in system.start_parameters)
        elif role in starts:
            yield Variable(name, meanings.get(name, default_meanings[role]), f"{role}[{index}]",
                           "output", initial="exact", start=float(starts[role][index]),
                           unit=number.unit, of_start=True,
                           depends=energy_inputs if role == "velocity" else ())
        elif role == "quantity":
            formula = system.quantities[name]
            yield Variable(name, formula, f"quantities[{index}]", "output", initial="calculated",
                           unit=number.unit, depends=_dependencies(system, formula))


def _dependencies(system: SystemManifest, formula: str) -> tuple[str, ...]:
    """Return the names of time, parameters and inputs in a formula, of variables of the FMU."""
    words = {*re.findall(r"[A-Za-z_]\w*", formula)}
    time = ["time"] if system.time in words else []
    return (*time, *(number.name for number in system.numbers
                     if number.role in ("parameter", "input") and number.name in words))


def _bodies(system: SystemManifest) -> Mapping[str, BodyManifest]:
    """Return the coordinates of each body by its name."""
    if system.rigid_body and not system.bodies:
        return {"body": BodyManifest(q=system.coordinates)}
    return system.bodies


def _meanings(system: SystemManifest) -> dict[str, str]:
    """Return descriptions of the coordinates and velocities of bodies, by name."""
    texts: dict[str, str] = {}
    for name, body in _bodies(system).items():
        texts |= dict.fromkeys(body.q, f"attitude of {name}, a unit quaternion")
        texts |= dict.fromkeys(body.x, f"position of {name} in space")
        texts |= {f"{name}_omega_{a}": f"angular velocity of {name} in its axes" for a in "xyz"}
        texts |= {f"{name}_v_{a}": f"velocity of {name} in space" for a in "xyz"}
    return texts


def _velocities(system: SystemManifest, options: Options) -> list[float]:
    """Return the velocities of a start: 2 L(q) q' of a quaternion, else q'."""
    from ...runtime.rigid_body.quaternion import left_matrix

    rates = np.array(options.rates)
    index_of = {name: k for k, name in enumerate(system.coordinates)}
    velocities: list[float] = []
    used_indices: set[int] = set()
    for body in _bodies(system).values():
        turning, moving = [index_of[x] for x in body.q], [index_of[x] for x in body.x]
        if turning:
            attitude = [options.q[k] for k in turning]
            velocities += (2 * left_matrix(attitude) @ rates[turning]).tolist()
        velocities += rates[moving].tolist()
        used_indices |= {*turning, *moving}
    return [*velocities, *(float(rate) for k, rate in enumerate(rates) if k not in used_indices)]


def unit_of(variable: Variable) -> dict[str, str]:
    """Return the attribute ``unit`` where there is one."""
    return {} if variable.unit is None else {"unit": variable.unit}
