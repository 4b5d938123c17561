"""What a run needs to know of a model beside its stepper: numbers, no formulas."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .problems import Problem

__all__ = ["Start"]


@dataclass(frozen=True)
class Start:
    """Parameters and the state at t = 0, as JSON can hold them.

    Attributes
    ----------
    name, description : str
        Of the model.
    parameters : mapping of str to float
        All but those of ``bodies`` that are left to be chosen.
    q0, p0 : list of float
        State at t = 0.
    bodies : mapping of str to list
        Name of each inertia parameter (γ or α of a body) → the body's inertia: three principal
        moments, or a tensor in rows.
    dt, steps : float and int, or None
        Where the model names them.
    free : list of str
        Parameters that another value may be given for and nothing else changes.
    remarks : list of str
        What is to be said of the file that the model came from.
    """

    name: str
    description: str
    parameters: Mapping[str, float]
    q0: list[float]
    p0: list[float]
    bodies: Mapping[str, Any]
    dt: float | None
    steps: int | None
    free: list[str] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @classmethod
    def of_problem(cls, problem: Problem) -> Start:
        """Return the numbers of a built-in problem, one rigid body."""
        inertia = list(problem.inertia)
        return cls(problem.name, problem.description, problem.parameters, problem.q0.tolist(),
                   problem.p0.tolist(), {"gamma": inertia, "alpha": inertia}, None, None)

    @classmethod
    def of(cls, model: Any) -> Start:
        """Return the numbers of a model, a ``gyrospark.Model`` or what has its attributes."""
        return cls(
            model.name, model.description, dict(model.parameters),
            [float(x) for x in model.q0], [float(x) for x in model.p0],
            {name: np.array(inertia, dtype=float).tolist()
             for name, inertia in model.bodies.items()},
            model.dt, model.steps,
        )
