"""Eccentric orbits and Arenstorf's orbit: steps in scaled time and constant ones, heyoka, SciPy.

σ is r^(3/2), and (r1⁻³ + μ/(1 − μ) r2⁻³ + 1/100)^(−1/2) near two masses. The end of Kepler's
orbits, after a number of periods that is no integer, has a closed form; the reference for
Arenstorf's orbit is heyoka at a tolerance of 1e-18. SciPy's right-hand side is compiled by numba.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import mpmath
import numpy as np
import sympy as sp
from numpy.typing import NDArray

import gyrospark as gs

from .peers.first_order import FirstOrder, heyoka_run, scipy_run
from .rows import Choice, Entry, Prepared, Row, accuracies, contest
from .timing import Sample

__all__ = ["adaptive", "kepler", "levels"]

Array = NDArray[Any]

_X, _Y, _U, _V = sp.symbols("x y u v", real=True)
#: Arenstorf's orbit: the mass of the Moon; x and y' of the start, and the period.
_MU = 0.012277471
_ARENSTORF = (0.994, -2.00158510637908252240537862224, 17.0652165601579625588917206249)
_ECCENTRICITIES = (0.3, 0.6, 0.9, 0.99)
#: Periods of Kepler's orbits: 2π each.
_PERIODS = 100.37


@dataclass(frozen=True)
class Orbit:
    """A planar motion of unit mass.

    Attributes
    ----------
    name : str
    system : System
        With its time scale.
    q, p : tuple of float
        The start.
    t_end, tau_end : float
        t and τ of the end; τ = 0 where a run has to compute it.
    periods : float
        ``t_end`` in periods.
    position : callable
        (x, y) at a time.
    constant, scaled : sequence
        (stages, number of steps a period) in constant steps and in scaled time.
    """

    name: str
    system: gs.System
    q: tuple[float, float]
    p: tuple[float, float]
    t_end: float
    tau_end: float
    periods: float
    position: Callable[[float], Array]
    constant: Sequence[tuple[int, float]]
    scaled: Sequence[tuple[int, float]]


def adaptive(choice: Choice) -> list[Row]:
    """Return the rows of each orbit."""
    periods = 2.37 if choice.quick else _PERIODS
    orbits = [*(kepler(e, periods) for e in _ECCENTRICITIES), _arenstorf(choice.quick)]
    return [row for orbit in orbits if choice.only in orbit.name
            for row in contest(orbit.name, list(_entries(orbit)), choice)]


def levels(rows: Sequence[Row]) -> list[Row]:
    """Return the cheapest of scaled steps, of constant ones and of each program for an error."""
    return accuracies(rows, "CPU µs/period", "error", (1e-6, 1e-10, 1e-13), "",
                      lambda row: row.program + " constant" * ("constant" in row.setting),
                      ("error", "iterations/period"))


# ---------------------------------------------------------------- orbits


def kepler(e: float, periods: float) -> Orbit:
    """Return an orbit of unit mass and semi-major axis that starts at its pericentre."""
    r = sp.sqrt(_X**2 + _Y**2)
    system = gs.System((_X, _Y), (_U, _V), (), (_U**2 + _V**2) / 2 - 1 / r, name="orbit",
                       time_scale=gs.scales.distance((_X, _Y), (0, 0)))
    # τ of a period: ∫ dt / r^(3/2) = ∫ (1 − e cos E)^(−1/2) dE
    tau = float(np.mean((1 - e * np.cos(np.linspace(0, 2 * np.pi, 4096, endpoint=False))) ** -0.5)
                * 2 * np.pi)
    # Constant steps as long as the shortest of 4, 8, … scaled ones.
    constant = [(s, round(n * 2 * np.pi / (1 - e) ** 1.5 / tau, 2))
                for s, n in ((6, 4), (6, 8), (6, 16), (8, 12), (8, 24))]
    return Orbit(f"Kepler, e = {e}", system, (1 - e, 0.0), (0.0, float(np.sqrt((1 + e) / (1 - e)))),
                 periods * 2 * np.pi, periods * tau, periods, partial(_on_ellipse, e),
                 constant,
                 [(6, n) for n in (8.37, 10.37, 12.37, 14.37, 16.37, 20.37, 24.37)]
                 + [(8, n) for n in (8.3, 10.3, 12.3, 14.3, 18.3, 24.3)]
                 + [(4, n) for n in (8.37, 12.37, 16.37, 24.37)])


def _on_ellipse(e: float, t: float) -> Array:
    """Return r = (cos E − e, √(1 − e²) sin E) with E − e sin E = t."""
    with mpmath.workdps(30):
        M = mpmath.fmod(mpmath.mpf(t), 2 * mpmath.pi)
        E = mpmath.findroot(lambda E: E - e * mpmath.sin(E) - M, (M - e, M + e), solver="anderson",
                            tol=1e-25)
        return np.array([float(mpmath.cos(E) - e),
                         float(mpmath.sqrt(1 - mpmath.mpf(e) ** 2) * mpmath.sin(E))])


def _arenstorf(quick: bool) -> Orbit:
    mu = sp.Float(str(_MU), 20)
    r1, r2 = sp.sqrt((_X + mu) ** 2 + _Y**2), sp.sqrt((_X - 1 + mu) ** 2 + _Y**2)
    H = (_U**2 + _V**2) / 2 + _Y * _U - _X * _V - (1 - mu) / r1 - mu / r2
    scale = gs.scales.rates(r1 ** sp.Rational(-3, 2), sp.sqrt(mu / (1 - mu)) * r2 **
                            sp.Rational(-3, 2), sp.Rational(1, 10))
    system = gs.System((_X, _Y), (_U, _V), (), H, name="arenstorf", time_scale=scale)
    x, v, period = _ARENSTORF
    return Orbit("Arenstorf", system, (x, 0.0), (0.0, v + x), period, 0.0, 1.0, _on_arenstorf,
                 [(6, n) for n in (2000.0, 4000.0, 8000.0, 16000.0)],
                 [(6, n) for n in (40.0, 60.0, 80.0, 120.0, 160.0, 240.0)]
                 + [(8, n) for n in (60.0, 80.0, 120.0, 160.0)])


def _on_arenstorf(t: float) -> Array:
    orbit = _arenstorf(quick=True)
    return heyoka_run(replace(_first_order(orbit), t_end=t), tol=1e-18)()[:2]


# ---------------------------------------------------------------- entries


def _entries(orbit: Orbit) -> list[Entry]:
    rows = [Entry("gyrospark", f"{s}-G-L scaled, {n:g} steps", partial(_scaled, orbit, s, n),
                  quick=s == 6 and i < 2) for i, (s, n) in enumerate(orbit.scaled)]
    rows += [Entry("gyrospark", f"{s}-G-L constant, {n:g} steps", partial(_constant, orbit, s, n),
                   quick=i < 1) for i, (s, n) in enumerate(orbit.constant)]
    rows += [Entry("heyoka", f"tol {tol}" if tol else "default", partial(_heyoka, orbit, tol),
                   quick=not tol) for tol in ("", "1e-12", "1e-9", "1e-6")]
    rows += [Entry("scipy", f"DOP853 numba, tol {tol}", partial(_dop853, orbit, float(tol)),
                   quick=False) for tol in ("1e-8", "1e-11", "1e-13")]
    return rows


def _costs(orbit: Orbit) -> Callable[[Mapping[str, Sample]], Mapping[str, float]]:
    return lambda times: {"CPU µs/period": times["run"].median / orbit.periods * 1e6}


def _scaled(orbit: Orbit, stages: int, steps: float) -> Prepared:
    step = gs.stepper("G-L", stages, system=orbit.system)
    start = gs.Start(orbit.q, orbit.p)
    tau = orbit.tau_end
    if not tau:
        tau = float(step.integrate(start, dtau=0.01, t_end=orbit.t_end).tau[-1])
    dtau = tau / orbit.periods / steps
    count = round(tau / dtau)
    return _measured(orbit, lambda: step.integrate(start, dtau=dtau, steps=count, every=count))


def _constant(orbit: Orbit, stages: int, steps: float) -> Prepared:
    step = gs.stepper("G-L", stages, system=orbit.system.with_time_scale(None))
    start, count = gs.Start(orbit.q, orbit.p), round(orbit.periods * steps)
    dt = orbit.t_end / count
    return _measured(orbit, lambda: step.integrate(start, dt=dt, steps=count, every=count))


def _measured(orbit: Orbit, run: Callable[[], gs.Trajectory]) -> Prepared:
    end = run()
    iterations = end.report.iterations / orbit.periods
    return Prepared({"error": _error(orbit, end.q[-1], float(end.t[-1])),
                     "iterations/period": iterations}, {"run": run}, _costs(orbit))


def _error(orbit: Orbit, position: Array, t: float) -> float:
    return float(np.abs(position - orbit.position(t)).max())


def _heyoka(orbit: Orbit, tol: str) -> Prepared:
    return _arrived(orbit, heyoka_run(_first_order(orbit), **({"tol": float(tol)} if tol else {})))


def _dop853(orbit: Orbit, tol: float) -> Prepared:
    return _arrived(orbit, scipy_run(_first_order(orbit), tol))


def _first_order(orbit: Orbit) -> FirstOrder:
    system = orbit.system.with_time_scale(None)
    return FirstOrder((_X, _Y, _U, _V), (*system.H_p, *(-rate for rate in system.H_q)),
                      (*orbit.q, *orbit.p), orbit.t_end)


def _arrived(orbit: Orbit, run: Callable[[], Array]) -> Prepared:
    return Prepared({"error": _error(orbit, run()[:2], orbit.t_end)}, {"run": run}, _costs(orbit))
