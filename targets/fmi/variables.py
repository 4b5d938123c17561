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
    """Yield time, dt, parameters, inputs, states, quantities and energy, in the order of C."""
    system = manifest.system
    numbers = system.numbers
    hamiltonian = system.hamiltonian
    quantities: Mapping[str, str] = system.quantities
    input_names = [n.name for n in numbers if n.role in ("parameter", "input")]
    time = system.time
    # of a Lagrangian the FMU has velocities in place of momenta
    motion_role = "velocity" if any(n.role == "velocity" for n in numbers) else "p"
    mechanical = any("kg" in base_units(n.unit) for n in numbers if n.unit)
    starts = {"q": options.q,
              motion_role: options.p if motion_role == "p" else _velocities(system, options)}
    yield Variable("time", "time", "time", "independent", unit="s")
    yield Variable("dt", "longest step of the integrator", "dt", "parameter", "fixed", "exact",
                   float(options.dt), "s", "positive")
    about = _meanings(system)
    default_texts = {"q": "coordinate", "p": "momentum", "velocity": "rate of a coordinate"}
    counts = dict.fromkeys(("q", "p", "velocity", "quantity"), 0)

    def depends(text: str) -> tuple[str, ...]:
        words = {*re.findall(r"[A-Za-z_]\w*", text)}
        return (*(["time"] if time in words else []),
                *(name for name in input_names if name in words))

    for number in numbers:
        name, role, unit, domain = number.name, number.role, number.unit, number.domain
        if role in counts:
            member = f"{'quantities' if role == 'quantity' else role}[{counts[role]}]"
            counts[role] += 1
        if role in ("parameter", "input"):
            start_value = float(options.parameters[name])
            yield Variable(name, role, f"parameters.{name}", role,
                           *(("continuous", "") if role == "input" else ("fixed", "exact")),
                           start_value, unit, domain)
        elif role in ("q", motion_role):
            start_value = float(starts[role][counts[role] - 1])
            yield Variable(name, about.get(name, default_texts[role]), member, "output",
                           initial="exact", start=start_value,
                           unit=unit, depends=() if role != "velocity" else depends(hamiltonian))
        elif role == "quantity":
            yield Variable(name, quantities[name], member, "output", initial="calculated",
                           unit=unit, depends=depends(quantities[name]))
    yield Variable("energy", "H(q, p)", "energy", "output", initial="calculated",
                   unit="J" if mechanical else None, depends=depends(hamiltonian))


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
    """Return the velocities of a start: 2 L(q) q' of a quaternion, else q', with q' = H_p.

    H_p is the complex step Im H(q, p + iε e_k)/ε, independent of the C.
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
    symbol_values = {**options.parameters, **dict(zip(system.coordinates, options.q, strict=True)),
                     **dict(zip(system.momenta, p, strict=True))}
    rates = evaluate([H], {names[name]: x for name, x in symbol_values.items()}).imag[0] / 1e-100
    index_of = {name: k for k, name in enumerate(system.coordinates)}
    velocities: list[float] = []
    used_indices: set[int] = set()
    for body in _bodies(system).values():
        turning, moving = [index_of[x] for x in body.q], [index_of[x] for x in body.x]
        if turning:
            velocities += (2
                           * left_matrix([options.q[k] for k in turning]) @ rates[turning]).tolist()
        velocities += rates[moving].tolist()
        used_indices |= {*turning, *moving}
    return [*velocities, *(float(rate) for k, rate in enumerate(rates) if k not in used_indices)]


def unit_of(variable: Variable) -> dict[str, str]:
    """Return the attribute ``unit`` where there is one."""
    return {} if variable.unit is None else {"unit": variable.unit}
