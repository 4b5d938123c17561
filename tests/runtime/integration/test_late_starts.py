"""Runs start at 1e9 s and 1e12 s, at which doubles are 1e-7 s and 1e-4 s apart."""

from __future__ import annotations

import re
import warnings
from itertools import product

import mpmath
import numpy as np
import pytest

import gyrospark as gs
import systems
from event_runs import pendulum, start
from gyrospark.runtime.integration.run_arguments import warn_of_late_start
from resumed_stores import check
from stores import small_blocks

LATE = [1e9, 1e12]
EVENTS = [gs.Event("side"), gs.Event("height", level=-1 + 1e-3),
          gs.Event("v", level=0.01, direction=1, terminal=True, name="stop")]


def run_from(t0: float, **options):
    return pendulum().integrate(gs.Start(*start(), t=t0), dt=0.05, steps=2000,
                                parameters={"g": 1.0}, **options)


@pytest.mark.parametrize("t0", LATE)
@pytest.mark.parametrize("events", [EVENTS[:2], EVENTS])
def test_an_autonomous_run_and_its_events_have_the_bits_of_one_from_0(t0, events) -> None:
    early, late = run_from(0.0, events=events), run_from(t0, events=events)
    assert np.array_equal(late.q, early.q)
    assert np.array_equal(late.elapsed, early.t)
    assert np.array_equal(late.t, t0 + early.t)
    assert late.report == early.report
    for name, crossings in early.events.items():
        late_crossings = late.events[name]
        assert len(crossings)
        assert np.array_equal(crossings.elapsed, crossings.t)
        for column in ("elapsed", "q", "p", "steps", "rising"):
            assert np.array_equal(
                getattr(late_crossings, column), getattr(crossings, column)), (name, column)


@pytest.mark.parametrize("t0", LATE)
def test_states_between_late_steps_are_those_of_early_ones(t0) -> None:
    """Times are doubles, multiples of 2⁻¹² s."""
    times = np.arange(1, 40) * 37 / 2**12
    early, late = (run_from(x).at(x + times) for x in (0.0, t0))
    assert np.array_equal(late.q, early.q)


@pytest.mark.parametrize(("name", "t0"), [
    pair if i == 3 else pytest.param(*pair, marks=pytest.mark.slow) for i, pair in enumerate(
        product(("driven_oscillator", "heavy_top"), LATE))])
def test_a_late_store_is_resumed_to_the_bit(name, t0, tmp_path, monkeypatch) -> None:
    case, step = systems.case(name), systems.stepper(name)
    small_blocks(monkeypatch, 8)
    q, p = systems.start(name, step)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gs.errors.InputWarning)  # t0 is late
        ends = check(step, tmp_path, (2, 1, 3), q=q, p=p, dt=case.dt, steps=40, t0=t0,
                     parameters=case.parameters)
    assert ends >= 2


@pytest.mark.parametrize(("t0", "steps", "is_warned"), [
    (1e9, 20, True), (1e3, 20, False), (0.0, 20, False), (1e6, 10**6, False), (1e9, 0, False)])
def test_a_late_start_of_a_driven_system_is_warned_of(
    t0: float, steps: int, is_warned: bool
) -> None:
    step, case = systems.stepper("driven_oscillator"), systems.case("driven_oscillator")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        warn_of_late_start(step.binding, t0, 0.01, steps)
        if steps < 10**6:
            step.integrate_ensemble(gs.Start([case.q] * 2, [case.p] * 2, t=t0), dt=0.01,
                                    steps=steps, parameters=case.parameters)
            step.integrate(gs.Start(case.q, case.p, t=t0), dt=0.01, steps=steps,
                           parameters=case.parameters)
        warn_of_late_start(step.binding, 1e9, 1e300, 10**9)  # longer than all numbers
    assert [bool(re.search(r"rounds times to 2e-05 of a step", str(warning.message)))
            for warning in caught] == [True] * 3 * is_warned


def test_the_latest_start_of_an_ensemble_is_named_with_its_sign() -> None:
    """The later of two starts has ten times the step, and rounds to a smaller part of it."""
    binding = systems.stepper("driven_oscillator").binding
    with pytest.warns(gs.errors.InputWarning, match=r"-1e\+09 s.*0\.0002"):
        warn_of_late_start(binding, np.array([-1e9, 2e9]), np.array([1e-3, 1e-2]), 20)


@pytest.mark.filterwarnings("ignore:t = .* rounds times")
@pytest.mark.parametrize("t0", [0.0, *LATE, 1e9 + 0.3])
@pytest.mark.parametrize(("stages", "dt", "steps", "bound"), [
    (2, 2**-10, 4000, 64),
    pytest.param(5, 0.05, 200, 16, marks=pytest.mark.slow)])  # a stepper of five stages
def test_a_driven_run_is_as_exact_from_a_late_start(
        t0: float, stages: int, dt: float, steps: int, bound: float) -> None:
    """x'' = −k x − c x' + f cos(ω(t0 + τ)) has a closed form, with the phase in 50 digits."""
    step, case = systems.stepper("driven_oscillator", stages=stages), systems.case(
        "driven_oscillator")
    run = step.integrate(gs.Start(case.q, case.p, t=t0), dt=dt, steps=steps, every=steps // 10,
                         parameters=case.parameters)
    with mpmath.workdps(50):
        k, c, f, omega = (mpmath.mpf(case.parameters[name]) for name in ("k", "c", "f", "omega"))
        answer = f / (k - omega**2 + 1j * c * omega) * mpmath.expj(omega * mpmath.mpf(t0))
        root = mpmath.sqrt(mpmath.mpc(c**2 / 4 - k))
        rates = -c / 2 + root, -c / 2 - root
        x0 = mpmath.mpf(case.q[0]) - answer.real
        u0 = mpmath.mpf(case.p[0]) - (1j * omega * answer).real
        second = (u0 - rates[0] * x0) / (rates[1] - rates[0])
        free = x0 - second, second
        exact = [float((sum(a * mpmath.exp(r * tau) for a, r in zip(free, rates, strict=True))
                        + answer * mpmath.expj(omega * tau)).real)
                 for tau in (mpmath.mpf(dt) * i for i in range(0, steps + 1, steps // 10))]
    assert np.abs(run.q[:, 0] - exact).max() < bound * np.finfo(float).eps
