"""Cases of the catalogue whose steps are differentiated, and differences to compare with."""

from __future__ import annotations

from typing import Any

import numpy as np

import gyrospark as gs
import systems
from calls import identify

#: Steps of each kind: Gauss-Lobatto, Lobatto IIIA-B, Radau-L, implicit midpoint, energy-momentum.
SCHEMES = [("G-L", 2), ("G-L", 3), ("LIIIA-B", 3), ("Radau-L", 2), ("IMS", None), ("EMS", None)]
NAMES = ("free_body", "heavy_top", "heavy_top_alpha", "heavy_top_in_frame", "driven_pendulum",
         "ellipse", "breathing", "lagrangian", "heavy_bob")

case_of, start_of = systems.case, systems.start


def directions(name: str) -> list[dict[str, float]]:
    """Return directions of parameters, dt and, where there is time, t0: relative changes.

    A frame needs I1 = I2, which change together.
    """
    case = case_of(name)
    timed = getattr(case.system, "time", None) is not None
    groups = [(key,) for key in case.parameters]
    if "frame" in case.options:
        groups = [("I1", "I2"), *groups[2:]]
    return [*({key: case.parameters[key] for key in keys} for keys in groups), {"dt": case.dt},
            *([{"t0": case.dt}] if timed else [])]


def product() -> list[Any]:
    """Return every name of a case with every scheme."""
    return [(name, scheme) for name in NAMES for scheme in SCHEMES]


def label(parameter: Any) -> str:
    """Return a test's id."""
    return parameter if isinstance(parameter, str) else identify(parameter)


def stepper_for(name: str, scheme: tuple[str, int | None], real: str = "double") -> gs.Stepper:
    """Return the stepper of a case, its derivatives compiled."""
    return systems.differentiable(name, *scheme, real)


def moved_step(
    name: str, step: gs.Stepper, direction: dict[str, float], shift: Any, dz: Any = None
) -> np.ndarray:
    """Return q, p and multipliers of a step whose consistent start, parameters, times are moved."""
    case, (q, p) = case_of(name), start_of(name, step)
    if dz is not None:
        q, p = q + shift * dz[: step.n], p + shift * dz[step.n :]
    unit = q[0] - q[0] + 1  # of the stepper's numbers
    values = {k: unit * value + shift * direction.get(k, 0.0) for k, value in
              case.parameters.items()}
    t0 = unit * case.t0 + shift * direction.get("t0", 0.0)
    if step.m:
        state = step.consistent(q, p, parameters=values, t=t0)
        q, p = state.q, state.p if step.manifest.scheme.keeps_momentum_constraint else p
    dt = unit * case.dt + shift * direction.get("dt", 0.0)
    run = step.integrate(gs.Start(q, p, t=t0), dt=dt, steps=1, parameters=values)
    return np.concatenate([run.q[-1], run.p[-1], run.multipliers[-1].ravel()])


def difference(function: Any, size: float = 2.0**-36) -> np.ndarray:
    """Return the derivative at 0 by central differences of order 4."""
    change, wide_change = (function(e) - function(-e) for e in (size, 2 * size))
    return (8 * change - wide_change) / (12 * size)


def tangents_of_step(
    name: str, step: gs.Stepper, **wanted: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Return directions of the start and their tangents at the end of one step, in columns."""
    case, (q, p) = case_of(name), start_of(name, step)
    run = step.integrate(gs.Start(q, p, t=case.t0), dt=case.dt, steps=1,
                         parameters=case.parameters, tangents=gs.Tangents(**wanted))
    return run.tangents.start, np.concatenate([run.tangents.q[-1], run.tangents.p[-1]])


def transposition_defect(step: gs.Stepper, begin: gs.Start, dt: float, count: int = 3) -> float:
    """Return |⟨w, Φ'v⟩ − ⟨Φ'ᵀw, v⟩| in parts of its terms, along start, parameters, dt and t0."""
    draw, worst = np.random.default_rng(3), 0.0
    _, _, pullback = step.vjp(begin, dt=dt)
    for _ in range(count):
        w = draw.normal(size=(2, step.n))
        gradient = pullback(*w)
        y = draw.normal(size=gradient.basis.shape[1])
        v = gradient.basis @ y
        d = {name: draw.normal() for name in (*begin.parameters, "dt", "t0")}
        *_, dq, dp = step.jvp(begin, v[: step.n], v[step.n :], d=d, dt=dt)
        terms = [*(w[0] * dq), *(w[1] * dp)]
        pulled = [*(gradient.start * y), *(gradient[k] * x for k, x in d.items())]
        size = np.abs(terms).sum() + np.abs(pulled).sum()
        worst = max(worst, abs(sum(terms) - sum(pulled)) / size)
    return worst
