"""Bodies, states, steps and steppers from which the numerical tests draw.

Each ingredient is written once as a function of plain numbers and offered twice: to hypothesis as a
strategy, and to tests that must not change from run to run as ``random_case(rng)``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st

import gyrospark as gs
from gyrospark.generator.spec import PAPER_SPECS, Spec

EPS = float(np.finfo(float).eps)

#: Beyond the paper: stages enough for a wrong eleventh digit of a coefficient to show.
HIGH_SPECS = tuple(
    Spec(scheme, stages, rep)
    for scheme, counts in (("G-L", (6, 8)), ("LIIIA-B", (7, 8)))
    for stages in counts
    for rep in ("alpha", "gamma")
)
SPARK_SPECS = tuple(spec for spec in PAPER_SPECS if spec.stages)
MEAN_SPECS = tuple(spec for spec in PAPER_SPECS if not spec.stages)


def few(specs: Iterable[Spec]) -> list[Any]:
    """Return specs to run a test with: each scheme once, in both parametrisations; else slow."""
    return [pytest.param(spec, marks=[pytest.mark.slow] * (spec not in _FEW)) for spec in specs]


#: Each scheme once, of few stages; checked in or in the catalogue.
_FEW = (Spec("IMS"), Spec("EMS"), Spec("G-L", 2, "alpha"), Spec("LIIIA-B", 3))


def identify(value: Any) -> str:
    """Return the test id of a spec."""
    return f"{value.method}-{value.rep}" if isinstance(value, Spec) else str(value)


def stepper_of(spec: Spec) -> gs.Stepper:
    """Return the compiled heavy-top stepper of a spec."""
    return gs.stepper(spec.scheme, spec.stages, spec.rep)


@cache
def tableau_of(scheme: str, stages: int, digits: int = 60) -> Any:
    """Return the numeric tableau with that many digits."""
    return gs.tableau(scheme, stages=stages).numeric(digits)


@dataclass(frozen=True)
class Case:
    """One step to be taken: a body, a consistent state, a time step."""

    parameters: dict[str, float]
    q: np.ndarray
    p: np.ndarray
    dt: float
    omega: np.ndarray

    @property
    def inertia(self) -> tuple[float, float, float]:
        return tuple(self.parameters[name] for name in ("I1", "I2", "I3"))

    @property
    def run(self) -> dict[str, Any]:
        """The keyword arguments that every method of a stepper accepts."""
        return {"dt": self.dt, "parameters": self.parameters}

    @property
    def weight(self) -> float:
        """The value of gamma or alpha."""
        return self.parameters.get("gamma", self.parameters.get("alpha", 1.0))


def left(q: Any) -> np.ndarray:
    """Return L(q) of (8), in whatever numbers q has."""
    q0, q1, q2, q3 = q
    return np.array([[-q1, q0, q3, -q2], [-q2, -q3, q0, q1], [-q3, q2, -q1, q0]])


def make_case(
    rep: str, moments: Any, gravity: float, weight: float, attitude: Any, omega: Any, turn: float
) -> Case:
    """Return a case from free numbers.

    ``gravity`` is mgl in units of γ_m |Ω|², ``weight`` is gamma or alpha in units of γ_m, ``turn``
    is Δt |Ω| in radians. The state is consistent to round-off: q is divided by |q|, and
    p = 2L(q)ᵀJΩ freed of its part along q twice.
    """
    moments, attitude, omega = (np.asarray(x, dtype=float) for x in (moments, attitude, omega))
    q = attitude / np.linalg.norm(attitude)
    q /= np.sqrt(q @ q)
    p = 2 * left(q).T @ (moments * omega)
    for _ in range(2):
        p = p - (q @ p) / (q @ q) * q
    mean, speed = moments.mean(), float(np.linalg.norm(omega))
    parameters = dict(zip(("I1", "I2", "I3"), moments.tolist(), strict=True))
    parameters |= {"mgl": float(gravity * mean * speed**2), rep: float(weight * mean)}
    return Case(parameters, q, p, float(turn / speed), omega)


def distinct(moments: Any) -> bool:
    """Whether no two of the moments are within 5 %, nor one the sum of the others."""
    a, b, c = sorted(moments)
    return b > 1.05 * a and c > 1.05 * b and abs(a + b - c) > 0.05 * c


def random_case(
    rng: np.random.Generator, rep: str, turn: tuple[float, float] = (0.01, 0.3)
) -> Case:
    """Return a case drawn from a seeded generator: the same in every run."""
    moments = (1.0, 1.0, 1.0)
    while not distinct(moments):
        moments = 10 ** rng.uniform(-0.5, 0.5, 3)
    return make_case(
        rep,
        moments * 10 ** rng.uniform(-3, 1),
        rng.uniform(-0.5, 0.5),
        10 ** rng.uniform(np.log10(0.3), np.log10(3)),
        rng.standard_normal(4),
        rng.standard_normal(3) * 10 ** rng.uniform(-1, 2),
        10 ** rng.uniform(*np.log10(turn)),
    )


# ---------------------------------------------------------------- hypothesis


def powers_of_ten(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda e: 10.0**e)


@st.composite
def bodies(draw: Any) -> tuple[float, float, float]:
    """Draw three different moments, of ratio up to 10, in any order and of any size."""
    moments = tuple(draw(powers_of_ten(-0.5, 0.5)) for _ in range(3))
    assume(distinct(moments))
    size = draw(powers_of_ten(-3, 1))
    return tuple(size * moment for moment in moments)


@st.composite
def unit_quaternions(draw: Any) -> np.ndarray:
    x = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 4)))
    size = np.linalg.norm(x)
    assume(size > 0.1)
    return x / size


@st.composite
def angular_velocities(draw: Any) -> np.ndarray:
    x = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 3)))
    assume(np.linalg.norm(x) > 0.1)
    return x * draw(powers_of_ten(-1, 2))


def weights() -> st.SearchStrategy[float]:
    """Draw gamma or alpha in units of γ_m."""
    return powers_of_ten(np.log10(0.3), np.log10(3))


def turns(low: float = 0.01, high: float = 0.3) -> st.SearchStrategy[float]:
    """Draw Δt |Ω|, in radians."""
    return powers_of_ten(np.log10(low), np.log10(high))


def cases(rep: str, turn: st.SearchStrategy[float] | None = None) -> st.SearchStrategy[Case]:
    """Draw cases whose every ingredient shrinks."""
    return st.builds(
        make_case, st.just(rep), bodies(), st.floats(-0.5, 0.5), weights(), unit_quaternions(),
        angular_velocities(), turns() if turn is None else turn,
    )
