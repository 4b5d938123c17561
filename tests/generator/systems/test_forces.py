"""Forces without a potential: drag, forces of time, body torques, and their work.

    oscillator   n = 1, m = 0: q̈ = −k q − c q̇ + f cos(ω t), with its closed form
    pendulum     n = 2, m = 1: a bead on a circle with drag, a drive in time and a force of q and
                 p, against the reference in 62 digits
    body         a symmetric body in its α or γ form with torque −c Ω about its own axes
"""

from __future__ import annotations

from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from forced_systems import PARAMETERS, c, tau, u, v, x, y
from gyrospark.generator.multibody.rigid_body import free_body
from gyrospark.generator.schemes.fast_path import FastSystem
from gyrospark.generator.schemes.step_equations import hoist_constants
from gyrospark.generator.systems.repeated_structure import Structure
from python_newton import integrate, one_step
from reference import WORKING_DIGITS, Equations, Method, doubles, numbers
from strategies import EPS
from structured_systems import beads
from systems import case, start, stepper

# ---------------------------------------------------------------- closed forms


@pytest.mark.slow  # three stages
def test_driven_oscillator():
    """Order 2s − 2 of LIIIA-B, from errors above round-off; G-L and EMS are a law's."""
    step, end = stepper("driven_oscillator", "LIIIA-B", 3), 6.0
    entry, counts = case("driven_oscillator"), np.array([12, 24, 48])
    runs = [step.integrate(entry.q, entry.p, dt=end / n, steps=n, parameters=entry.parameters)
            for n in counts.tolist()]
    errors = [abs(run.q[-1, 0] - entry.exact(end)[0]) for run in runs]
    slope = np.polyfit(np.log(end / counts), np.log(errors), 1)[0]
    assert step.order == 4
    assert min(errors) > 1e-14
    assert abs(slope - step.order) < 0.35


def test_the_manifest_has_forces_and_time_where_there_is_one():
    for name, timed in (("pushed_pendulum", False), ("dragged_pendulum", True)):
        manifest = stepper(name).manifest.system
        assert manifest.forces == tuple(str(e) for e in case(name).system.forces)
        assert (manifest.time is not None) == timed


def body_with_drag(rep):
    """A symmetric body with torque τ = −c Ω: F = 2 L(q)ᵀ τ, since Ω = 2 L(q) q̇."""
    free = free_body(rep)
    q, p = sp.Matrix(free.q), sp.Matrix(free.p)
    L = sp.Matrix([[-q[1], q[0], q[3], -q[2]], [-q[2], -q[3], q[0], q[1]],
                   [-q[3], q[2], -q[1], q[0]]])
    inertia = [s for s in free.parameters if str(s).startswith("I")]
    rates = [w / (2 * moment) for w, moment in zip(L * p, inertia, strict=True)]
    torque = sp.Matrix([-c * w for w in rates])
    return gs.System(free.q, free.p, (*free.parameters, c), free.H, free.constraints,
                     forces=tuple(2 * L.T * torque), name="dragged_body", rigid_body=True,
                     quantities={f"Omega{i + 1}": w for i, w in enumerate(rates)})


@pytest.mark.slow  # a stepper of one system; drag of a pendulum is quick
def test_body_with_drag():
    """Ω₃ decays as exp(−ct/I₃); Ω₁ + iΩ₂ as exp(−ct/I₁), and turns by ∫(I₃/I₁ − 1) Ω₃ dt."""
    step, bound = gs.stepper("G-L", 2, system=body_with_drag("gamma")), 1e-8
    I1, I3, drag, Omega = 2.0, 0.8, 0.15, np.array([0.4, -0.2, 3.0])
    parameters = {"I1": I1, "I2": I1, "I3": I3, "c": drag, "gamma": 1.2}
    q = np.array([0.5, 0.5, -0.1, 0.7]) / np.linalg.norm([0.5, 0.5, -0.1, 0.7])
    p = gs.Start.of_body(q, Omega, (I1, I1, I3)).p
    run = step.integrate(q, p, dt=0.01, steps=300, parameters=parameters)
    t = run.t
    turned = (I3 / I1 - 1) * Omega[2] * I3 / drag * (1 - np.exp(-drag * t / I3))
    across = (Omega[0] + 1j * Omega[1]) * np.exp(-drag * t / I1 + 1j * turned)
    exact = np.column_stack([across.real, across.imag, Omega[2] * np.exp(-drag * t / I3)])
    assert np.abs(run.angular_velocity() - exact).max() <= bound
    found = np.column_stack([run.quantity(f"Omega{i}") for i in (1, 2, 3)])
    assert np.abs(found - run.angular_velocity()).max() <= 64 * EPS
    full = step.integrate(q, p, dt=0.01, steps=300, parameters=parameters, solver="newton")
    assert np.abs(run.q - full.q).max() <= 1024 * EPS
    assert run.report.newton_steps == 0
    kinetic = (exact**2 * [I1, I1, I3]).sum(axis=1) / 2
    assert np.abs(run.work - (kinetic - kinetic[0])).max() <= 20 * bound


# ---------------------------------------------------------------- routes


@pytest.mark.parametrize("rep", ["gamma", "alpha"])
def test_what_the_fast_path_proves_of_forces(rep):
    """The torque's L(q)p is evaluated once with H_p: no constraint force along q changes it."""
    system, _ = hoist_constants(body_with_drag(rep))
    fast = FastSystem(system)
    assert len(fast.shared_sums) == 3
    for shared in fast.shared_sums:
        slope = sum(sp.diff(shared, p) * q for q, p in zip(system.q, system.p, strict=True))
        assert sp.expand(slope) == 0
        assert any(force.has(shared) for force in system.forces)


def test_nothing_is_shared_across_places():
    """With H_pq = 0, sweeps evaluate H_q − F at newer places than H_p; nor is time shared."""
    swirl = x * v - y * u
    kinetic = (u**2 + v**2) / 2
    circle = (x**2 + y**2 - 1,)
    separable = gs.System((x, y), (u, v), (), kinetic, circle, forces=(-y * swirl, x * swirl))
    assert FastSystem(separable).is_separable
    assert FastSystem(separable).shared_sums == []
    timed = gs.System((x, y), (u, v), (), kinetic + swirl**2 * x, circle,
                      forces=(tau * y + swirl * (u - tau), 0), time=tau)
    assert all(tau not in u.free_symbols for u in FastSystem(timed).shared_sums)


def by_hand(number) -> Equations:
    """The pendulum, typed by hand."""
    k, c, f, omega = (number(value) for value in PARAMETERS.values())

    def F(q, p, t):
        cosine = mp.cos(omega * t) if number is mp.mpf else np.cos(omega * t)
        swirl = k * q[0] * (q[0] * p[1] - q[1] * p[0])
        return np.array([-c * p[0] + f * cosine, -c * p[1] - swirl])

    def G(q):
        return np.array([[2 * q[0], 2 * q[1]]])

    def mean_gradient(q0, p0, q1, p1):
        return np.array([0, number(9)]) + 0 * q0, (p0 + p1) / 2

    return Equations(
        H=lambda q, p: p @ p / 2 + 9 * q[1], H_q=lambda q, p: np.array([0, number(9)]) + 0 * q,
        H_p=lambda q, p: 1 * p, g=lambda q: np.array([q @ q - 1]), G=G,
        mean_gradient=mean_gradient, mean_constraint=lambda q0, q1: G((q0 + q1) / 2), F=F,
    )


@pytest.mark.parametrize(("scheme", "stages"), [
    ("EMS", None), ("G-L", 2)])
@pytest.mark.slow  # 50 digits; the same forces in their closed forms are quick
def test_against_the_reference(scheme, stages):
    """Residual, Jacobian and step at a time t, with the bounds of test_generic_system.py."""
    step, dt, t = stepper("dragged_pendulum", scheme, stages), 0.03125, 0.75
    q, p = start("dragged_pendulum", step)
    method = Method(by_hand, scheme, stages, q, p, dt, t)
    run: dict[str, Any] = {"dt": dt, "parameters": PARAMETERS}
    unknowns = step.guess(q, p, t=t, **run)
    unknowns += 0.05 * np.random.default_rng(42).standard_normal(step.unknowns)
    exact = method.jacobian(unknowns)
    error = np.abs(step.jacobian(unknowns, q, p, t=t, **run) - exact)
    assert np.all(error.max(axis=1) <= 1e-12 * np.abs(exact).max(axis=1))
    with mp.workdps(WORKING_DIGITS):
        r = doubles(step.residual(unknowns, q, p, t=t, **run)
                    - method.residual(mp.mpf)(numbers(unknowns, mp.mpf)))
    assert np.abs(r).max() <= 64 * EPS * (16 + np.abs(unknowns).max() + 0.1 / dt)
    end = method.step()
    rounding = 0.0 if stages else 8 * EPS / dt
    for solver in ("auto", "newton", "python"):
        q1, p1 = one_step(step, gs.Start(q, p, t=t), solver=solver, **run)
        assert np.abs(doubles(q1 - end.q)).max() <= 64 * EPS
        assert np.abs(doubles(p1 - end.p)).max() <= 64 * EPS + rounding


def test_cost_of_damping_grows_with_the_length():
    """Twice the chain has the same forms, and a band as wide."""
    short, long = (Structure(hoist_constants(beads(links))[0]) for links in (3, 6))
    assert len(short.force_templates) == len(long.force_templates)
    assert [len(form.expressions) for form in short.force_templates] == [
        len(form.expressions) for form in long.force_templates]


@pytest.mark.slow  # a stepper in float128; one with inputs is quick
def test_wide_numbers():
    """The same motion, and the work balance of EMS at the type's own round-off."""
    step, same = (stepper("dragged_pendulum", "EMS", None, real) for real in (
        "float128", "double"))
    begin, at = (gs.Start(*start("dragged_pendulum", each), t=0.5) for each in (step, same))
    how: dict[str, Any] = {"dt": 0.0625, "steps": 8, "parameters": PARAMETERS}
    run = step.integrate(begin, **how)
    double = same.integrate(at, **how)
    slow = integrate(step, begin, solver="python", **how)
    many = step.integrate_ensemble([begin] * 2, **how)
    epsilon = max(step.binding.epsilon, EPS)
    for other in (double, slow, many.members[1]):
        for part in ("q", "p", "work", "quantity_values"):
            difference = (getattr(run, part) - getattr(other, part)).astype(float)
            assert np.abs(difference).max() <= 2000 * epsilon
    assert run.report.energy_error_max <= 256 * step.binding.epsilon * 10


def test_time_at_a_failure():
    """A step that fails is reported at the run's own time, alone and among others."""
    step, known = stepper("breathing"), case("breathing").parameters
    small = known | {"l": 0.1}  # an ellipse that vanishes on the way
    starts = [step.project([0.9, 0.7], [0.5, 0.4], parameters=parameters, t=0.5)
              for parameters in (small, known)]
    with pytest.raises(gs.StepFailed) as caught:
        step.integrate(gs.Start(*starts[0], t=0.5), dt=0.25, steps=100, parameters=small)
    failure = caught.value
    assert failure.step > 1
    assert failure.t == 0.5 + (failure.step - 1) * 0.25
    many = step.integrate_ensemble(gs.Start(*map(np.array, zip(*starts, strict=True)), t=0.5),
                                   dt=0.25, steps=100, parameters=[small, known])
    assert list(many.failures) == [0]
    assert many.failures[0].t == 0.5 + (many.failures[0].step - 1) * 0.25
    assert np.isfinite(many.members[0].report.work)
    assert many.members[0].report.work == many.members[0].work[-1]


def test_no_steps_and_no_forces():
    step = stepper("dragged_pendulum")
    q, p = start("dragged_pendulum", step)
    run = step.integrate(gs.Start(q, p, t=3.0), dt=0.1, steps=0, parameters=PARAMETERS)
    assert run.t.tolist() == [3.0]
    assert run.work.tolist() == [0.0]
    many = step.integrate_ensemble([q], [p], dt=0.1, steps=0, parameters=PARAMETERS)
    assert many.members[0].work.tolist() == [0.0]
    with pytest.raises(gs.InputError, match="t = nan"):
        step.integrate(gs.Start(q, p, t=float("nan")), dt=0.1, steps=1, parameters=PARAMETERS)
