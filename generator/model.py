"""A model: a system together with the numbers to run it with."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import as_mapping, as_text
from ..body_values import Inertia, as_moments_or_tensor, real_array
from ..errors import InputError
from ..naming import shown, whole
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
    bodies : mapping of str to tuple
        Name of each inertia parameter (γ or α of a body) → the body's I₁, I₂, I₃ in kg m², or its
        tensor, 3 × 3.
    dt, steps : float and int, or None
        A time step in s and a number of steps that suit the model, where it names them.
    description : str
        One sentence for people.
    """

    system: System
    parameters: Mapping[str, float]
    q0: Array
    p0: Array
    bodies: Mapping[str, Inertia] = field(default_factory=dict)
    dt: float | None = None
    steps: int | None = None
    description: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.system, System):
            raise InputError(f"system = {shown(self.system)} is no gyrospark.System.")
        as_text("description", self.description)
        for name in ("q0", "p0"):
            object.__setattr__(self, name, self._state(name, getattr(self, name)))
        values = {name: self._number(f"parameter {name!r}", value) for name, value in as_mapping(
            "parameters", self.parameters, "{'m': 1.0}").items()}
        bodies = {name: as_moments_or_tensor(inertia) for name, inertia in as_mapping(
            "bodies", self.bodies, "{'gamma': (I1, I2, I3)}").items()}
        object.__setattr__(self, "parameters", MappingProxyType(values))
        object.__setattr__(self, "bodies", MappingProxyType(bodies))
        if self.dt is not None:
            object.__setattr__(self, "dt", self._number("dt", self.dt))
        if self.steps is not None:
            object.__setattr__(self, "steps", self._count(self.steps))
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

    @property
    def name(self) -> str:
        """The system's name."""
        return self.system.name

    def _state(self, name: str, values: ArrayLike) -> Array:
        state = real_array(values)
        if state is None or state.shape != (self.system.n,) or not np.isfinite(state).all():
            raise InputError(f"{name} of model {self.name!r} is {shown(values)}; give "
                             f"{self.system.n} finite numbers.")
        state.setflags(write=False)
        return state

    def _number(self, name: str, value: Any) -> float:
        number = real_array(value)
        if number is None or number.ndim or not np.isfinite(number):
            raise InputError(f"{name} of model {self.name!r} is {shown(value)}; give a finite "
                             "number.")
        return float(number)

    def _count(self, value: Any) -> int:
        count = whole(value)
        if count is None or count < 0:
            raise InputError(f"steps of model {self.name!r} is {shown(value)}; give a whole number "
                             "from 0 on.")
        return count
