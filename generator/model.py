"""A model: a system together with the numbers to run it with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InputError
from .system import System

__all__ = ["Model"]

Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class Model:
    """A system, its parameters and a state to start from.

    Attributes
    ----------
    system : System
        H, constraints, forces and quantities; its name is the model's.
    parameters : mapping of str to float
        The value of every parameter of the system, but for those in ``bodies``, which may be
        left to be chosen.
    q0, p0 : ndarray, shape (n,)
        State at t = 0, read-only.
    bodies : mapping of str to tuple of three floats
        Name of each inertia parameter (γ or α of a body) → the body's I₁, I₂, I₃ in kg m².
    dt, steps : float and int, or None
        A time step in s and a number of steps that suit the model, where it names them.
    description : str
        One sentence for people.
    """

    system: System
    parameters: Mapping[str, float]
    q0: Array
    p0: Array
    bodies: Mapping[str, tuple[float, float, float]] = field(default_factory=dict)
    dt: float | None = None
    steps: int | None = None
    description: str = ""

    def __post_init__(self) -> None:
        for name in ("q0", "p0"):
            object.__setattr__(self, name, self._state(name, getattr(self, name)))
        for name in ("parameters", "bodies"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        known = {str(symbol) for symbol in self.system.parameters}
        for name in (*self.parameters, *self.bodies):
            if name not in known:
                raise InputError(
                    f"Model {self.name!r} has a value for {name!r}, which is no parameter of its "
                    f"system; the parameters are {', '.join(sorted(known)) or 'none'}."
                )
        missing = sorted(known - {*self.parameters, *self.bodies})
        if missing:
            raise InputError(f"Model {self.name!r} has no value for its parameter {missing[0]!r}; "
                             "give one.")

    def __repr__(self) -> str:
        n, m = self.system.n, self.system.m
        steps = "" if self.steps is None else f", {self.steps:,} steps"
        run = "" if self.dt is None else f"; dt = {self.dt:g} s{steps}"
        return (f"<Model {self.name}: {n} coordinates, {m} constraints, {len(self.parameters)} "
                f"parameters, {len(self.bodies)} bodies{run}>")

    @property
    def name(self) -> str:
        """The system's name."""
        return self.system.name

    def _state(self, name: str, values: ArrayLike) -> Array:
        state = np.array(values, dtype=float)
        if state.shape != (self.system.n,) or not np.isfinite(state).all():
            raise InputError(f"{name} of model {self.name!r} is {values!r}; give {self.system.n} "
                             "finite numbers.")
        state.setflags(write=False)
        return state
