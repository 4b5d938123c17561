"""Time in Lagrangians: M(q, t), b(q, t), V(q, t) and g(q, t), factors of M at the times of stages.

    swelling  a mass that grows, L = e^(2ct) (v² − k² q²)/2: the damped oscillator, in closed form
    wire      a bead on a wire that turns, in polar coordinates, φ = wt: r = r₀ cosh wt
    shaken    a pendulum whose pivot is shaken and whose length changes: M(t), b(q, t), V(q, t); of
              a constant length its Taylor series at 40 digits
    lifted    the bead of test_lagrangian in a frame that turns to and fro and is lifted, of a mass
              that grows, on a sphere that breathes, damped and driven: all at once

The other ways: H typed by hand, H with M⁻¹ in symbols (``legendre``), closed forms.
"""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest

import gyrospark as gs
import systems
from calls import refused
from gyrospark.generator.pipeline import generate
from gyrospark.generator.spec import Spec
from lagrangians import PARAMETERS, STARTS
from strategies import EPS
from time_lagrangians import c, k, lifted, one, shaken, start_of_lifted, swelling, t, wire

NUMBERS = {"w": 2.5, "a": 0.3, "b": 0.25, "g": 9.0}


@cache
def stepper(make, scheme="G-L", stages=2):
    return gs.stepper(scheme, stages, system=make())


# ---------------------------------------------------------------- closed forms, and order


@pytest.mark.parametrize(("scheme", "stages"), [
    ("G-L", 2), *(pytest.param(*pair, marks=pytest.mark.slow)
                  for pair in (("Radau-L", 2), ("IMS", None)))])
def test_mass_that_grows_is_the_damped_oscillator(scheme, stages):
    """q = e^(−ct) (cos Ωt + c/Ω sin Ωt) from rest, Ω² = k² − c²; at the order of the scheme."""
    step = stepper(swelling, scheme, stages)
    numbers, errors = {"c": 0.6, "k": 1.0}, []
    for steps in (20, 40, 80):
        run = step.integrate([1.0], [0.0], dt=2 / steps, steps=steps, parameters=numbers)
        decay, turned = np.exp(-0.6 * run.t), 0.8 * run.t
        x = decay * (np.cos(turned) + 0.75 * np.sin(turned))
        v = -decay * np.sin(turned) / 0.8
        errors.append(np.hypot(run.q[:, 0] - x, run.velocities[:, 0] - v).max())
        np.testing.assert_allclose(run.velocities[:, 0], run.p[:, 0] * np.exp(-1.2 * run.t),
                                   rtol=4 * EPS)
        np.testing.assert_allclose(run.energies, np.exp(1.2 * run.t) * (
            run.velocities[:, 0]**2 + run.q[:, 0]**2) / 2, rtol=8 * EPS)
    orders = [np.log2(coarse / fine) for coarse, fine in pairwise(errors)]
    assert abs(orders[-1] - step.manifest["scheme"]["order"]) < 0.15, orders


def test_bead_on_a_wire_that_turns():
    """r = r₀ cosh wt, pushed by the moment 2 m w r ṙ: a rheonomic constraint in M(q)."""
    step = stepper(wire, "G-L", 3)
    numbers = {"m": 1.5, "w": 2.0}
    p = step.momenta([0.5, 0.0], [0.0, 2.0], parameters=numbers)
    run = step.integrate([0.5, 0.0], p, dt=0.01, steps=100, parameters=numbers)
    r, speed = 0.5 * np.cosh(2 * run.t), np.sinh(2 * run.t)
    np.testing.assert_allclose(run.q, np.transpose([r, 2 * run.t]), rtol=0, atol=64 * EPS)
    np.testing.assert_allclose(run.velocities, np.transpose([speed, 2 + 0 * r]), atol=256 * EPS)
    moment = -2 * 1.5 * 2 * r[-1] * speed[-1]  # λ has the sign of g_q: ṗ = … − g_qᵀλ
    assert abs(run.multipliers[-1, -1] / moment - 1) < 1e-6  # of a lower order than the state
    np.testing.assert_allclose(run.work, run.energies - run.energies[0], rtol=0, atol=1e-12)


def taylor_of_shaken(numbers, t0, x0, v0, end, digits=40):
    """Return x and ẋ at the end by ẍ = −(g − a w² sin wt) sin x, series of degree 45."""
    with mp.workdps(digits):
        omega, size, gravity = (mp.mpf(numbers[name]) for name in ("w", "a", "g"))
        x, v, now, count, degree = mp.mpf(x0), mp.mpf(v0), mp.mpf(t0), 40, 45
        h = (mp.mpf(end) - now) / count
        for _ in range(count):
            load = [-size * omega**2 * mp.sin(omega * now + j * mp.pi / 2) * omega**j
                    / mp.factorial(j) for j in range(degree)]
            load[0] += gravity
            X, V, s, co = [x], [v], [mp.sin(x)], [mp.cos(x)]
            for i in range(degree):
                V.append(-mp.fdot(load[: i + 1], s[::-1]) / (i + 1))
                X.append(V[i] / (i + 1))
                rates = [(j + 1) * X[j + 1] for j in range(i + 1)]
                s.append(mp.fdot(rates, co[::-1]) / (i + 1))
                co.append(-mp.fdot(rates, s[i::-1]) / (i + 1))
            x, v = (mp.polyval(series[::-1], h) for series in (X, V))
            now += h
        return x, v


@pytest.mark.slow  # 1 CPU s; other cases run all its branches
def test_shaken_pivot_against_its_taylor_series():
    numbers = {"w": 2.5, "a": 0.3125, "b": 0.0, "g": 9.0}
    exact = taylor_of_shaken(numbers, 0.25, 0.5, 0.125, 2.25)
    rough = taylor_of_shaken(numbers, 0.25, 0.5, 0.125, 2.25, digits=34)
    assert max(abs(x - y) for x, y in zip(exact, rough, strict=True)) < 1e-32
    step, errors = systems.stepper("shaken"), []
    p = step.momenta([0.5], [0.125], parameters=numbers, t=0.25)
    for steps in (25, 50, 3200):
        run = step.integrate([0.5], p, dt=2 / steps, steps=steps, parameters=numbers, t0=0.25)
        errors.append(float(max(abs(run.q[-1, 0] - exact[0]),
                                abs(run.velocities[-1, 0] - exact[1]))))
    assert abs(np.log2(errors[0] / errors[1]) - 4) < 0.3
    assert errors[-1] < 1e-12


# ---------------------------------------------------------------- H by hand, H with M⁻¹


def test_motion_is_that_of_the_hamiltonian_typed_by_hand():
    step, other = systems.stepper("shaken"), gs.stepper("G-L", 2, system=shaken()[1])
    p = step.momenta([0.5], [0.1], parameters=NUMBERS, t=0.3)
    for solver in ("auto", "newton"):
        run, same = (each.integrate([0.5], p, dt=0.01, steps=100, parameters=NUMBERS, t0=0.3,
                                    solver=solver) for each in (step, other))
        for one_of, two in ((run.q, same.q), (run.p, same.p), (run.energies, same.energies),
                            (run.work, same.work)):
            np.testing.assert_allclose(one_of, two, rtol=0, atol=8 * EPS * (1 + np.abs(two).max()))


@pytest.mark.parametrize("scheme", [
    ("G-L", 2), pytest.param(("IMS", None), marks=pytest.mark.slow)])  # of the bead without time
def test_all_at_once_is_the_hamiltonian_written_out(scheme):
    """The momenta of IMS jump by rounding over Δt, as those of the bead at rest do."""
    step, other = stepper(lifted, *scheme), gs.stepper(*scheme, system=lifted().legendre())
    q, p = start_of_lifted(step)
    for solver in ("auto", "newton", "fixed-point"):
        run, same = (each.integrate(q, p, dt=0.01, steps=100, parameters=PARAMETERS["bead"],
                                    t0=0.3, solver=solver) for each in (step, other))
        size = np.abs(run.p).max()
        np.testing.assert_allclose(run.q, same.q, rtol=0, atol=100 * EPS)
        np.testing.assert_allclose(run.p, same.p, rtol=0, atol=5000 * EPS * size)
        np.testing.assert_allclose(run.energies, same.energies, rtol=0,
                                   atol=100 * EPS * np.abs(run.energies).max())
        np.testing.assert_allclose(run.work, same.work, rtol=0, atol=100 * EPS * size)
        assert run.report.constraint_max <= 4 * EPS
        if scheme[1]:
            assert run.f_errors.max() <= 64 * EPS
    x = step.guess(q, p, dt=0.02, parameters=PARAMETERS["bead"], t=0.3) + 0.01
    for what in ("residual", "jacobian"):
        values = [getattr(each, what)(x, q, p, dt=0.02, parameters=PARAMETERS["bead"], t=0.3)
                  for each in (step, other)]
        np.testing.assert_allclose(*values, rtol=0, atol=256 * EPS * np.abs(values[1]).max())


def test_energy_balances_with_the_work_of_forces_and_drives():
    """H_k − H_0 − W_k, of the order of the scheme."""
    step, errors = stepper(lifted), []
    q, p = start_of_lifted(step)
    for steps in (50, 100):
        run = step.integrate(q, p, dt=1 / steps, steps=steps, parameters=PARAMETERS["bead"],
                             t0=0.3)
        errors.append(run.report.energy_error_max)
    assert abs(np.log2(errors[0] / errors[1]) - 4) < 0.5
    assert np.abs(run.work).max() > 1e3 * errors[-1]


# ---------------------------------------------------------------- times of states


def test_each_state_has_a_time_of_its_own():
    step = stepper(lifted)
    q, v = map(np.array, STARTS["bead"])
    numbers, times = PARAMETERS["bead"], np.linspace(0, 2, 6).reshape(2, 3)
    places, speeds = (np.tile(x, (2, 3, 1)) for x in (q, v))
    p = step.momenta(places, speeds, parameters=numbers, t=times)
    each = [step.momenta(q, v, parameters=numbers, t=now) for now in times.ravel()]
    assert np.array_equal(p.reshape(6, 3), each)
    back = step.velocities(places, p, parameters=numbers, t=times)
    np.testing.assert_allclose(back, speeds, rtol=0, atol=64 * EPS)
    assert np.abs(p[0, 0] - p[1, 2]).max() > 0.1
    with refused(r"\(3, 2\).*\(2, 3\)"):
        step.momenta(places, speeds, parameters=numbers, t=times.T)


def test_velocities_of_a_run_are_those_of_its_times(tmp_path):
    step = stepper(lifted)
    q, p = start_of_lifted(step)
    numbers = PARAMETERS["bead"]
    run = step.integrate(q, p, dt=0.01, steps=20, parameters=numbers, t0=0.3)
    again = step.velocities(run.q, run.p, parameters=numbers, t=run.t)
    np.testing.assert_allclose(run.velocities, again, rtol=0, atol=16 * EPS)  # t0 + τ is rounded
    slopes = (run.q[2:] - run.q[:-2]) / 0.02
    np.testing.assert_allclose(run.velocities[1:-1], slopes, rtol=0, atol=0.01)
    loaded = gs.Trajectory.load(run.save(tmp_path / "run.npz"))
    assert np.array_equal(loaded.velocities, run.velocities)


def test_states_between_steps_and_crossings():
    """``at`` against half the step, an event where a coordinate passes its level."""
    step = systems.stepper("shaken")
    p = step.momenta([0.5], [0.1], parameters=NUMBERS)
    run, fine = (step.integrate([0.5], p, dt=0.02 / n, steps=100 * n, parameters=NUMBERS,
                                events=[gs.Event("x", level=0.2)]) for n in (1, 2))
    between = run.at(fine.t)
    np.testing.assert_allclose(between.q, fine.q, rtol=0, atol=1e-6)
    np.testing.assert_allclose(between.velocities, fine.velocities, rtol=0, atol=1e-5)
    found, same = run.events["x"], fine.events["x"]
    assert len(found.t) == len(same.t) >= 2
    np.testing.assert_allclose(found.t, same.t, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.q, 0.2, rtol=0, atol=8 * EPS)


# ---------------------------------------------------------------- what is refused


def test_what_cannot_have_it_says_so():
    for profile in ("control", "run"):
        with refused(f"{profile}.*Lagrangian"):
            generate(Spec.checked("G-L", 2).with_profile(profile), system=shaken()[0])
    x, v, _ = one("x")
    with refused("unknown.*'t'.*time"):
        gs.System.from_lagrangian(t * v**2, [x], [v], [])
    with refused("Constraint 0.*'t'.*holonomic"):
        gs.System.from_lagrangian(v**2 + c**2, [x, k], [v, c], [], [x - t])
    step = stepper(wire, "G-L", 3)
    numbers = {"m": 1.5, "w": 2.0}
    p = step.momenta([0.5, 0.0], [0.0, 2.0], parameters=numbers)
    with refused("constraint"):
        step.integrate([0.5, 0.0], p, dt=0.01, steps=1, parameters=numbers, t0=1.0)
