"""Motions, methods and the runs by which a chosen γ is judged.

A motion is judged path by path (``runtime.tuning.motion_distance``): the root mean square distance
of each of the body's axes, in space, from 6-stage Gauss-Lobatto with half the step, order 12.
Distances with the chosen γ are told in units of those with a recommendation; where the latter is
off by more than 0.3 rad both runs have lost the motion, and the ratio says nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from ..api import stepper
from ..core.arrays import Array
from ..core.registry import MEANS, Aim
from ..generator.schemes.named_schemes import SchemeName
from ..runtime.results.trajectory import Trajectory
from ..runtime.rigid_body.gamma_rules import mean_inertia
from ..runtime.rigid_body.problems import Problem, fast_top, free_body, regular_precession
from ..runtime.rigid_body.quaternion import euler_quaternion, momentum
from ..runtime.tuning.motion_distance import MotionError, root_mean_squares
from ..runtime.tuning.tune import Tuned, tune

__all__ = [
    "ASYMMETRIC_TOPS",
    "BODIES",
    "ENERGY_BODIES",
    "FREE_BODY",
    "METHODS",
    "TIMES",
    "Trial",
    "TrialBody",
    "asymmetric_top",
]

METHODS = (("IMS", None), ("EMS", None), ("G-L", 1), ("G-L", 2), ("G-L", 3), ("LIIIA-B", 2),
           ("LIIIA-B", 3), ("LIIIA-B", 4))
#: When motions are compared, in s.
TIMES = (1.0, 10.0, 100.0)
#: From this error on the motion is lost, in rad: errors grow like t no more, and their ratios say
#: nothing about a method.
_LOST = 0.3
#: States kept of a run that motions are compared on.
_KEPT = 10


def asymmetric_top(
    inertia: tuple[float, float, float], mgl: float, theta: float, omega: list[float]
) -> Problem:
    """Return a heavy top with any moments in kg m²; there is no closed form of its motion.

    ``mgl`` in J; ``theta`` the tilt in rad, with φ = 0.3 and ψ = 0.2 rad so that nothing is
    special; ``omega`` the angular velocity in body axes, rad/s.
    """
    q0 = euler_quaternion(0.3, theta, 0.2)
    parameters = dict(zip(("I1", "I2", "I3"), inertia, strict=True)) | {"mgl": mgl}
    return Problem("asymmetric-top", parameters, q0, momentum(q0, omega, inertia), inertia)


@dataclass(frozen=True)
class TrialBody:
    """A problem with Δt and the number of steps of its pilot runs for the energy."""

    name: str
    make: Callable[[], Problem]
    dt: float
    steps: int

    @cached_property
    def problem(self) -> Problem:
        """The problem, made once: the motion of a free body is computed to forty digits."""
        return self.make()

    @property
    def symmetric(self) -> bool:
        """Whether I₁ = I₂."""
        return self.problem.inertia[0] == self.problem.inertia[1]


def _top(inertia: tuple[float, float, float], mgl: float, theta: float, *omega: float
         ) -> Callable[[], Problem]:
    """Return the function that makes the top with these arguments, for a ``TrialBody``."""
    return lambda: asymmetric_top(inertia, mgl, theta, list(omega))


FREE_BODY = TrialBody("free body", free_body, 0.001, 500)
ASYMMETRIC_TOPS = (
    TrialBody("fast asymmetric top", _top((0.002, 0.0013, 0.0008), 0.3924, math.pi / 6, 0, 0, 126),
              0.001, 500),
    TrialBody("heavy asymmetric top", _top((3, 2, 1), 10, 0.5, 0, 0.5, 20), 0.005, 500),
)
#: Motions of Tables 4, 6 and 7 with their Δt and N_t, and some without gravity or symmetry.
ENERGY_BODIES = (
    TrialBody("fast top", fast_top, 0.001, 320),
    TrialBody("precession, r = h/2", regular_precession, 0.005, 80),
    TrialBody("precession, r = 3h/2", lambda: regular_precession(1.5), 0.01, 80),
    FREE_BODY,
    *ASYMMETRIC_TOPS,
)
BODIES = (
    *ENERGY_BODIES,
    TrialBody("Lagrange's top", _top((0.004, 0.004, 0.001), 0.3924, 0.6, 0, 0, 60), 0.002, 500),
    TrialBody("slow top", _top((0.002, 0.002, 0.0008), 0.3924, 1, 1, 2, 20), 0.001, 500),
    TrialBody("sleeping top", _top((0.002, 0.002, 0.0008), 0.3924, 0.05, 0.5, 0, 150), 0.001, 500),
    TrialBody("flat top", _top((0.001, 0.001, 0.0018), 0.3924, 0.7, 2, -3, 60), 0.001, 500),
    TrialBody("free symmetric body", lambda: free_body((0.002, 0.002, 0.0008)), 0.001, 500),
)


@dataclass(frozen=True)
class Trial:
    """One body and one method, with the γ chosen for it."""

    body: TrialBody
    scheme: SchemeName
    stages: int | None

    @property
    def method(self) -> str:
        """As the paper writes it."""
        return self.scheme if self.stages is None else f"{self.stages}-{self.scheme}"

    @cached_property
    def for_motion(self) -> Tuned:
        """The choice by default."""
        return self._tune("motion", options={})

    @cached_property
    def for_energy(self) -> Tuned:
        """The choice for the energy by pilot runs as long as the paper's tables."""
        return self._tune("energy", options={"pilot_steps": self.body.steps})

    def _tune(self, aim: Aim, options: dict[str, Any]) -> Tuned:
        """Return the γ that ``gs.tune`` with ``options`` chooses for the body with this method."""
        return tune(stepper(self.scheme, self.stages), self.body.problem, dt=self.body.dt,
                    gamma="auto", aim=aim, **options)

    def gamma(self, aim: Aim = "motion") -> float:
        """Return γ chosen for the motion or for the energy."""
        tuned = self.for_motion if aim == "motion" else self.for_energy
        return tuned.parameters["gamma"]

    def rule(self, name: str) -> float:
        """Return a recommendation, "γ_m" for example, for this body."""
        rule = next(rule for rule, symbol in MEANS.items() if symbol == name)
        return mean_inertia(self.body.problem.inertia, rule)

    def run(self, gamma: float, steps: int, every: int = 1) -> Trajectory:
        """Return the run with this γ in kg m²; every ``every``-th state is stored."""
        problem = self.body.problem
        return stepper(self.scheme, self.stages).integrate(
            problem.q0, problem.p0, dt=self.body.dt, steps=steps, every=every,
            parameters=problem.parameters | {"gamma": gamma})

    # ------------------------------------------------------------ the motion

    def distances(self, gamma: float, times: tuple[float, ...] = TIMES) -> Array:
        """Return the distance of each axis up to each time, shape (times, 3), in rad."""
        return _distances(self, gamma, times)

    def ratios(self, rule: str = "γ_m", times: tuple[float, ...] = TIMES) -> Array:
        """Return the distances with the γ chosen for the motion over those with a rule.

        Shape (times, 3); NaN where the rule has lost the motion.
        """
        return self._over(self.gamma(), rule, times)

    def price(self, times: tuple[float, ...] = TIMES) -> Array:
        """Return the distances with the γ chosen for the energy over those with γ_m.

        Shape (times, 3); NaN where γ_m has lost the motion.
        """
        return self._over(self.gamma("energy"), "γ_m", times)

    def gain(self, rule: str = "γ_m", times: tuple[float, ...] = TIMES) -> float:
        """Return the largest distance of an axis with a rule over the one with the chosen γ.

        Distances up to the last of ``times``; NaN where the rule has lost the motion.
        """
        with_rule = self.distances(self.rule(rule), times)[-1].max()
        if with_rule > _LOST:
            return math.nan
        return float(with_rule / self.distances(self.gamma(), times)[-1].max())

    def _over(self, gamma: float, rule: str, times: tuple[float, ...]) -> Array:
        """Return the distances with ``gamma`` over those with a rule, shape (times, 3).

        NaN at times where any axis is off by more than 0.3 rad with the rule.
        """
        gamma_of_rule = self.rule(rule)
        # exactly 1, and no runs of up to 100 s
        if gamma == gamma_of_rule:
            return np.ones((len(times), 3))
        with_rule = self.distances(gamma_of_rule, times)
        lost = with_rule.max(axis=1, keepdims=True) > _LOST
        return np.where(lost, np.nan, self.distances(gamma, times) / with_rule)

    # ------------------------------------------------------------ the energy

    def energy_error(self, gamma: float, times: int = 1) -> float:
        """Return the mean of |H_k − H_0| in J; the run is ``times`` as long as the pilot runs."""
        return _energy_error(self, gamma, times)

    def energy_gain(self, rule: str | None = None, times: int = 1) -> float:
        """Return the energy error with a rule over the one with the γ chosen for the energy.

        Without ``rule``, the best of the four recommendations is taken.
        """
        names = list(MEANS.values()) if rule is None else [rule]
        least_error = min(self.energy_error(self.rule(name), times) for name in names)
        return least_error / self.energy_error(self.gamma("energy"), times)

    def at_round_off(self, times: int = 1) -> bool:
        """Whether the energy error with some rule is round-off, so that ratios mean nothing.

        The bound is 4 ε √N |H₀|: N random roundings of relative size ε = 2⁻⁵² grow like √N.
        """
        size = abs(float(self.run(self.rule("γ_m"), steps=1).energies[0]))
        epsilon = 2.0**-52 * float(np.sqrt(times * self.body.steps))
        errors = [self.energy_error(self.rule(name), times) for name in MEANS.values()]
        return min(errors) < 4 * epsilon * size


def _steps(body: TrialBody, times: tuple[float, ...]) -> list[int]:
    """Return the numbers of steps that lead to ``times`` in s."""
    return [round(t / body.dt) for t in times]


@cache  # several claims ask for the same run
def _distances(trial: Trial, gamma: float, times: tuple[float, ...]) -> Array:
    """Return the root mean square distance of each axis up to each time, shape (times, 3), rad."""
    steps = _steps(trial.body, times)
    exact, every = _exact(trial.body, steps[-1])
    # without the start, where all runs are equal
    errors = exact(trial.run(gamma, steps[-1], every).q)[1:]
    return np.array([root_mean_squares(errors[: count // every], exact.paths)
                     for count in steps])


@cache
def _energy_error(trial: Trial, gamma: float, times: int) -> float:
    """Return mean |H_k − H_0| in J over ``times`` the steps of the pilot runs."""
    return trial.run(gamma, times * trial.body.steps).report.energy_error_mean


@cache
def _exact(body: TrialBody, steps: int) -> tuple[MotionError, int]:
    """Return the distance function from the reference motion, and the steps between its rows.

    The reference is 6-stage Gauss-Lobatto, order 12, with half the step of the body.
    """
    problem = body.problem
    # of long runs every tenth state is compared: enough for a mean, with a tenth of the memory
    every = _KEPT if steps > 2000 else 1
    run = stepper("G-L", 6).integrate(
        problem.q0, problem.p0, dt=body.dt / 2, steps=2 * steps, every=2 * every,
        parameters=problem.parameters | {"gamma": mean_inertia(problem.inertia)})
    return MotionError(run.q, run.q), every
