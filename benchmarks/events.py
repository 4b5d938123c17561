"""Events and states between steps, beside heyoka and SciPy: cost and error of each.

    pendulum    let go at 1 rad, g = l = 1: through the bottom at odd multiples of a quarter of its
                period 4 K(sin² ½), at the angle 2 asin(k cd(t, k²)) in between
    fast top    falls through the middle of its range of heights; the reference of these times and
                of its mass centres is G-L of 8 stages in long double

A run alone, with the event, and with states at random times: CPU time, contestants in turn,
medians. Every program has its own state at these times, heyoka its dense output.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import mpmath
import numpy as np
import sympy as sp

import gyrospark as gs

from .attitudes import Array
from .peers import heyoka_taylor, scipy_dop853
from .peers.optional import need
from .rows import Choice, Entry, Prepared, Row, contest
from .tops import LEVER, axis, parameters, state_of, tops

__all__ = ["FastTop", "Pendulum", "events"]

#: Seed of the times between steps, and how many they are.
_SEED, _TIMES = 20250101, 1000
#: Bits of mpmath's numbers.
_BITS = 120


@dataclass(frozen=True)
class EventJob:
    """A run of one program: alone, for the times of its event, for positions at some times."""

    alone: Callable[[], object]
    events: Callable[[], Array]
    dense: Callable[[], Array]


class Pendulum:
    """A pendulum with g = l = 1, let go at rest at 1 rad."""

    name = "pendulum"
    angle = 1.0

    def __init__(self, passages: int) -> None:
        self.passages = passages
        with mpmath.workprec(_BITS):
            self._m = mpmath.sin(mpmath.mpf(self.angle) / 2) ** 2
            self._quarter = mpmath.ellipk(self._m)
        self.t_end = float(self._quarter * 2 * passages)
        self.times = np.sort(np.random.default_rng(_SEED).uniform(0, self.t_end, _TIMES))

    @cached_property
    def crossings(self) -> Array:
        """Times at which it goes through the bottom."""
        with mpmath.workprec(_BITS):
            return np.array([float(self._quarter * (2 * k + 1)) for k in range(self.passages)])

    @cached_property
    def positions(self) -> Array:
        """Angles at ``times``."""
        with mpmath.workprec(_BITS):
            k = mpmath.sqrt(self._m)
            return np.array([float(2 * mpmath.asin(k * mpmath.ellipfun("cd", mpmath.mpf(t),
                                                                       m=self._m)))
                             for t in self.times.tolist()])

    def errors(self, times: Array, positions: Array) -> tuple[float, float]:
        """Return the largest relative error of times, and the largest error of angles."""
        return _worst(times, self.crossings), float(abs(positions - self.positions).max())

    def ours(self) -> dict[str, Callable[[], EventJob]]:
        """Return our settings: the point on its circle in the plane."""
        return {f"G-L s={stages} Δt={dt:g}": partial(self._our_job, stages, dt)
                for stages, dt in ((5, 0.05), (8, 0.2))}

    def _our_job(self, stages: int, dt: float) -> EventJob:
        x, y, u, v, g = sp.symbols("x y u v g")
        step = gs.stepper("G-L", stages, system=gs.System(
            (x, y), (u, v), (g,), (u**2 + v**2) / 2 + g * y, (x**2 + y**2 - 1,), name="pendulum"))
        q, p = [np.sin(self.angle), -np.cos(self.angle)], [0.0, 0.0]
        return _our_job(step, q, p, dt, self.t_end, {"g": 1.0}, gs.Event("x"), self.times,
                        lambda q: np.arctan2(q[:, 0], -q[:, 1]))

    def heyoka(self) -> EventJob:
        """Return the run of heyoka: θ' = ω, ω' = −sin θ."""
        heyoka = need("heyoka")
        angle, rate = heyoka.make_vars("angle", "rate")
        return _heyoka_job([(angle, rate), (rate, -heyoka.sin(angle))], [self.angle, 0.0], angle, 0,
                           self.t_end, self.times, lambda x: x[:, 0])

    def scipy(self) -> EventJob:
        """Return the run of SciPy, of the same equations."""
        return _scipy_job(lambda t, x: (x[1], -np.sin(x[0])), [self.angle, 0.0],
                          lambda t, x: x[0], 0, self.t_end, self.times, lambda x: x[0])


class FastTop:
    """The paper's top (80): its mass centre falls through the middle of its range of heights."""

    name = "fast top"

    def __init__(self, t_end: float) -> None:
        self.t_end = t_end
        self.times = np.sort(np.random.default_rng(_SEED).uniform(0, t_end, _TIMES))

    @cached_property
    def _reference(self) -> tuple[float, Array, Array]:
        step = self._stepper(8, "long-double")
        top = tops()[0]
        q, p = step.project(top.q, top.p, parameters=parameters())
        run: dict[str, Any] = {"dt": 1e-2, "steps": round(self.t_end / 1e-2),
                               "parameters": parameters()}
        heights = step.integrate(q, p, **run).quantity("height").astype(float)
        level = float((heights.min() + heights.max()) / 2)
        trajectory = step.integrate(q, p, **run, events=gs.Event("height", level, -1))
        between = trajectory.at(self.times)
        return (level, trajectory.events["height"].t.astype(float),
                LEVER * axis(between.q).astype(float))

    @staticmethod
    def _stepper(stages: int, real: Any = "double") -> Any:
        mgl, R33 = sp.Symbol("mgl", positive=True), gs.symbols.R[2, 2]
        return gs.stepper("G-L", stages, real=real, system=gs.body_system(
            "watched_top", "gamma", mgl * R33, (mgl,), quantities={"height": LEVER * R33}))

    def errors(self, times: Array, positions: Array) -> tuple[float, float]:
        """Return the largest relative error of times, and how far mass centres are off."""
        _, crossings, centres = self._reference
        distances = np.linalg.norm(LEVER * axis(positions) - centres, axis=1)
        return _worst(times, crossings), float(distances.max())

    def ours(self) -> dict[str, Callable[[], EventJob]]:
        """Return our settings."""
        return {f"G-L s={stages} Δt={dt:g}": partial(self._our_job, stages, dt)
                for stages, dt in ((4, 5e-3), (8, 2e-2))}

    def _our_job(self, stages: int, dt: float) -> EventJob:
        top = tops()[0]
        return _our_job(self._stepper(stages), top.q, top.p, dt, self.t_end, parameters(),
                        gs.Event("height", self._reference[0], -1), self.times, lambda q: q)

    def heyoka(self) -> EventJob:
        """Return the run of heyoka, by Euler's equations."""
        equations = heyoka_taylor.equations()
        q0, q1, q2, q3 = (variable for variable, _ in equations[:4])
        height = LEVER * (q0 * q0 - q1 * q1 - q2 * q2 + q3 * q3) - self._reference[0]
        return _heyoka_job(equations, self._start, height, -1, self.t_end, self.times,
                           lambda x: x[:, :4])

    def scipy(self) -> EventJob:
        """Return the run of SciPy, by the same equations."""
        level = self._reference[0]
        right = scipy_dop853.right_hand_side()

        def height(t: float, x: Array) -> Any:
            return LEVER * axis(x[:4])[2] - level

        return _scipy_job(right, self._start, height, -1, self.t_end, self.times,
                          lambda x: x[:4].T)

    @property
    def _start(self) -> Array:
        start = state_of(tops()[0])
        return np.concatenate([start.q, start.omega])


def _worst(times: Array, exact: Array) -> float:
    """Return the largest relative error; infinite where some are missing or too many."""
    return float(abs(times / exact - 1).max()) if len(times) == len(exact) else float("inf")


def _our_job(
    step: Any, q: Any, p: Any, dt: float, t_end: float, values: dict[str, float], event: gs.Event,
    times: Array, position: Callable[[Array], Array],
) -> EventJob:
    steps = int(np.ceil(t_end / dt))
    run: dict[str, Any] = {"dt": dt, "steps": steps, "parameters": values}

    def events() -> Array:
        trajectory: gs.Trajectory = step.integrate(q, p, **run, every=steps, events=event)
        t: Array = trajectory.events[event.name].t
        return t[t <= t_end]

    return EventJob(lambda: step.integrate(q, p, **run, every=steps), events,
                    lambda: position(step.integrate(q, p, **run, t_eval=times).q))


def _heyoka_job(
    equations: Any, start: Any, value: Any, direction: int, t_end: float, times: Array,
    position: Callable[[Array], Array],
) -> EventJob:
    heyoka = need("heyoka")
    event_times: list[float] = []
    event_direction = {0: heyoka.event_direction.any,
                       -1: heyoka.event_direction.negative}[direction]
    plain = heyoka.taylor_adaptive(equations, list(start))
    watched = heyoka.taylor_adaptive(equations, list(start), nt_events=[heyoka.nt_event(
        value, lambda motion, t, sign: event_times.append(t), direction=event_direction)])

    def run(motion: Any, **options: Any) -> Any:
        motion.time = 0.0
        motion.state[:] = start
        return motion.propagate_until(t_end, **options)

    def events() -> Array:
        event_times.clear()
        run(watched)
        return np.array(event_times)

    def dense() -> Array:
        output = next(result for result in run(plain, c_output=True) if callable(result))
        return position(output(times))

    return EventJob(lambda: run(plain), events, dense)


def _scipy_job(
    right: Any, start: Any, value: Callable[[float, Array], Any], direction: int, t_end: float,
    times: Array, position: Callable[[Array], Array],
) -> EventJob:
    solve = need("scipy.integrate", "scipy").solve_ivp

    def run(**options: Any) -> Any:
        return solve(right, (0.0, t_end), start, method="DOP853", rtol=1e-12, atol=1e-12,
                     **options)

    def event(t: float, x: Array) -> Any:
        return value(t, x)

    event.direction = direction  # type: ignore[attr-defined]  # SciPy's way to say so
    return EventJob(run, lambda: run(events=event).t_events[0],
                    lambda: position(run(t_eval=times).y))


def events(choice: Choice) -> list[Row]:
    """Return a row for each case, program and setting."""
    rows = []
    for case in (Pendulum(20 if choice.quick else 1000),
                 FastTop(choice.t_end or (1.0 if choice.quick else 10.0))):
        if choice.only in case.name:
            rows += contest(case.name, [
                *(Entry("gyrospark", name, partial(_prepared, case, make))
                  for name, make in case.ours().items()),
                Entry("heyoka", "default", partial(_prepared, case, case.heyoka)),
                Entry("scipy", "DOP853 tol 1e-12", partial(_prepared, case, case.scipy))], choice)
    return rows


def _prepared(case: Pendulum | FastTop, make: Callable[[], EventJob]) -> Prepared:
    job = make()
    times = job.events()
    time_error, dense_error = case.errors(times, job.dense())
    return Prepared(
        {"events": float(len(times)), "error of times": time_error,
         "error of states": dense_error},
        {"alone": job.alone, "events": job.events, "dense": job.dense},
        lambda seconds: {"run (ms)": seconds["alone"].median * 1e3,
                         "with event (ms)": seconds["events"].median * 1e3,
                         "with states (ms)": seconds["dense"].median * 1e3})
