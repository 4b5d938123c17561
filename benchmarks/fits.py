"""How often estimates of ``gs.fit`` are within two standard deviations, from many seeds of noise.

    python -m benchmarks.fits [SEEDS]

damped top      three moments, a damping and the start from 60 noisy attitudes in 1.2 s
double body     a body of unknown mass, centre of mass and inertia, ten numbers, on a known one:
                these, the damping of both and the start from 100 noisy attitudes of both in 1 s

The noise of attitudes is a rotation vector of 2 mrad in each component. First guesses are wrong by
20 to 75 %. Of a normal distribution 95.4 % are within two standard deviations.
"""

from __future__ import annotations

import statistics
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import gyrospark as gs

from .attitudes import Array, left_matrix

__all__ = ["FitCase", "Recovery", "damped_top", "double_body", "recover"]

#: Standard deviation of each component of the rotation vector of the noise, in rad.
NOISE = 2e-3


@dataclass(frozen=True)
class FitCase:
    """A fit whose answer is known.

    Attributes
    ----------
    step, dt : gs.Stepper and float
        The stepper and the time step of the fit.
    t, attitudes : array
        Times of the samples and exact quaternions, four columns for each body.
    q, p, guess : array and mapping
        First guesses of start and parameters.
    true : mapping
        The parameters.
    free : list of str
        Names that are fitted, beside the start.
    """

    step: gs.Stepper
    dt: float
    t: Array
    attitudes: Array
    q: Array
    p: Array
    guess: Mapping[str, float]
    true: Mapping[str, float]
    free: list[str]

    def data(self, seed: int, noise: float = NOISE) -> Array:
        """Return the attitudes with noise."""
        draw = np.random.default_rng(seed)
        noisy = self.attitudes.copy()
        for k in range(0, noisy.shape[1], 4):
            angles = noise * draw.normal(size=(len(noisy), 3))
            noisy[:, k : k + 4] = turned(noisy[:, k : k + 4], angles)
        return noisy

    def fit(self, data: Array, **options: Any) -> Any:
        """Return the fit to data."""
        return gs.fit(self.step, gs.Start(self.q, self.p, self.guess), self.t, data, **{
            "dt": self.dt, "free": [*self.free, "start"], **options})


def turned(q: Array, angles: Array) -> Array:
    """Return attitudes turned by small rotation vectors e in body axes, q + L(q)ᵀe/2 normalised."""
    moved = q + np.einsum("...ij,...i->...j", left_matrix(q), angles) / 2
    unit: Array = moved / np.linalg.norm(moved, axis=-1, keepdims=True)
    return unit


def damped_top() -> FitCase:
    """Return the top of examples/damped_top.toml, m g l known, its first guess far off."""
    model = gs.load_model(Path(__file__).parents[1] / "examples" / "damped_top.toml")
    step = gs.stepper("G-L", 2, system=model)
    run = step.integrate(model.q0, model.p0, dt=6.25e-4, steps=1920, every=32,
                         parameters=model.parameters)
    true = {name: float(x) for name, x in run.parameters.items()}
    guess = true | {"I1": 2.7e-3, "I2": 1e-3, "I3": 1.1e-3, "c": 1e-4, "gamma": 1.4e-3}
    q = turned(run.q[0], np.array([0.04, -0.06, 0.04]))
    return FitCase(step, 5e-3, run.t[1:], run.q[1:], q, 1.15 * run.p[0], guess, true,
                   ["I1", "I2", "I3", "c"])


def double_body() -> FitCase:
    """Return an unknown body on a ball joint at the end of a known one with a fixed point."""
    build = gs.Multibody("damped_double_body")
    c = build.parameter("c", 2e-3)
    lower = build.body("lower", mass=1.0, inertia=(4e-3, 4e-3, 2e-3),
                       quaternion=(np.cos(0.2), np.sin(0.2), 0, 0), angular_velocity=(1, 0.5, 8))
    axes, _ = np.linalg.qr([[1, 0.1, -0.05], [-0.1, 1, 0.08], [0.05, -0.08, 1]])
    upper = build.body("upper", mass=0.4, inertia=axes @ np.diag([1.2e-3, 1e-3, 6e-4]) @ axes.T,
                       quaternion=(np.cos(0.9), 0, np.sin(0.9), 0), angular_velocity=(6, -3, 10))
    build.fixed_point("foot", lower, on_body=(0, 0, -0.06), at=(0, 0, 0))
    build.ball("hip", lower, upper, on_a=(0, 0, 0.06), on_b=(0.01, -0.008, -0.05))
    for body in (lower, upper):
        build.torque(body, [-c * omega for omega in body.angular_velocity])
    model = build.model()
    step = gs.stepper("G-L", 2, system=model)
    run = step.integrate(model, dt=2.5e-3, steps=400, every=4)
    true = {name: float(x) for name, x in run.parameters.items()}
    entries = [f"upper_K{i}" for i in (11, 12, 13, 22, 23, 33)]
    factors = {"upper_m": 1.3, "hip_upper_x": 0.6, "hip_upper_y": 1.5, "hip_upper_z": 1.2, "c": 2}
    guess = true | {name: factor * true[name] for name, factor in factors.items()}
    inverse = np.diag(1 / np.array([1.4e-3, 1.2e-3, 8e-4]))  # not along the principal axes
    guess |= dict(zip(entries, inverse[np.triu_indices(3)].tolist(), strict=True))
    columns = [i for i, name in enumerate(run.manifest.system.coordinates) if "_q" in name]
    return FitCase(step, 1e-2, run.t[1:], run.q[1:, columns], run.q[0], run.p[0], guess, true,
                   [*factors, *entries])


@dataclass(frozen=True)
class Recovery:
    """Errors of estimates over their standard deviations, and the cost of the fits.

    Attributes
    ----------
    names : list of str
    errors : array, shape (seeds, names)
        (estimate − truth)/σ.
    seconds : list of float
        CPU seconds of each fit.
    failures : list of int
        Seeds whose fit has not converged, or with undetermined combinations.
    """

    names: list[str]
    errors: Array
    seconds: list[float]
    failures: list[int]

    def within(self, deviations: float = 2.0) -> dict[str, int]:
        """Return, by name, how many seeds are within ``deviations`` standard deviations."""
        counts = (np.abs(self.errors) < deviations).sum(axis=0).tolist()
        return dict(zip(self.names, counts, strict=True))


def recover(case: FitCase, seeds: range) -> Recovery:
    """Fit a case to data with noise of each seed; return errors, times and failures."""
    errors, seconds, failures = [], [], []
    case.fit(case.data(seeds[0]))  # compiles the stepper, outside the timed calls
    for seed in seeds:
        data = case.data(seed)
        begin = time.process_time()
        fit = case.fit(data)
        seconds.append(time.process_time() - begin)
        errors.append([(fit.parameters[name] - case.true[name]) / fit.sigma[name]
                       for name in case.free])
        if not fit.converged or fit.undetermined:
            failures.append(seed)
    return Recovery(case.free, np.array(errors), seconds, failures)


def main() -> None:
    """Print a table for each case."""
    seeds = range(int(sys.argv[1]) if len(sys.argv) > 1 else 100)
    for name, case in (("damped top", damped_top()), ("double body", double_body())):
        recovery = recover(case, seeds)
        print(f"{name}: {len(seeds)} seeds, {len(recovery.failures)} failures, CPU s: median "
              f"{statistics.median(recovery.seconds):.2f}, largest {max(recovery.seconds):.2f}")
        spread = np.sqrt((recovery.errors**2).mean(axis=0))
        for parameter, deviation in zip(recovery.names, spread, strict=True):
            print(f"  {parameter:12} {recovery.within()[parameter]:4d} within 2 σ, "
                  f"rms error {deviation:.2f} σ")


if __name__ == "__main__":
    main()
