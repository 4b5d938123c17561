"""Forces without a potential: drag, forces of time, body torques, and their work.

    oscillator   n = 1, m = 0: q̈ = −k q − c q̇ + f cos(ω t), with its closed form
    pendulum     n = 2, m = 1: a bead on a circle with drag, a drive in time and a force of q and
                 p, against the reference in 62 digits
    runner       n = 2, m = 1: H neither separable nor quadratic
    body         a symmetric body in its α or γ form with torque −c Ω about its own axes
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from forced_systems import PARAMETERS, SYSTEMS, c, f, k, omega, start, stepper_for, tau, u, v, x, y
from gyrospark.generator.multibody.rigid_body import free_body
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.fast_path import FastSystem
from gyrospark.generator.schemes.step_equations import hoisted
from gyrospark.generator.spec import Spec
from gyrospark.generator.systems.repeated_structure import Structure
from gyrospark.runtime.steppers.stepper import Stepper
from reference import WORKING_DIGITS, Equations, Method, doubles, numbers
from strategies import EPS

MEAN = [("IMS", None), ("EMS", None)]
SOME = [*MEAN, ("G-L", 2), ("LIIIA-B", 3)]
SLOW = [pytest.param(*scheme, marks=pytest.mark.slow)
        for scheme in (("G-L", 1), ("G-L", 4), ("LIIIA-B", 2))]
every_scheme = pytest.mark.parametrize(("scheme", "stages"), [*SOME, ("G-L", 3), *SLOW])
some_schemes = pytest.mark.parametrize(("scheme", "stages"), SOME)
#: The runner, whose H takes long to derive, with one scheme of either kind.
systems_and_schemes = pytest.mark.parametrize(("name", "scheme", "stages"), [
    pytest.param(name, *scheme, marks=[pytest.mark.slow] * (
        name == "runner" and scheme not in (("EMS", None), ("G-L", 2))))
    for name in SYSTEMS for scheme in SOME])


def closed_form(t, q0=0.5, p0=0.3):
    """q(t) of q̈ + c q̇ + k q = f cos(ω t): the decaying free motion and the steady one."""
    k, c, f, omega = PARAMETERS.values()
    steady = f / (k - omega**2 + 1j * c * omega)
    damped = np.sqrt(k - c**2 / 4)
    a = q0 - steady.real
    b = (p0 - (1j * omega * steady).real + c / 2 * a) / damped
    free = np.exp(-c / 2 * t) * (a * np.cos(damped * t) + b * np.sin(damped * t))
    return free + (steady * np.exp(1j * omega * t)).real


# ---------------------------------------------------------------- closed forms


@every_scheme
def test_driven_oscillator(scheme, stages):
    """Order 2s of G-L, 2s − 2 of LIIIA-B and 2 of IMS and EMS, from errors above round-off."""
    step, end = stepper_for("oscillator", scheme, stages), 6.0
    counts = np.array([12, 24, 48])
    runs = [step.integrate([0.5], [0.3], dt=end / n, steps=n, parameters=PARAMETERS)
            for n in counts.tolist()]
    errors = [abs(run.q[-1, 0] - closed_form(end)) for run in runs]
    slope = np.polyfit(np.log(end / counts), np.log(errors), 1)[0]
    assert step.order == {None: 2, "G-L": 2 * (stages or 0), "LIIIA-B": 2 * (stages or 0) - 2}[
        scheme if stages else None]
    assert min(errors) > 1e-14
    assert abs(slope - step.order) < 0.35


def test_undriven_damping_is_exponential():
    """Without a spring: p = p₀ exp(−c t), by 8-th order to round-off of 100 steps."""
    system = gs.System((x,), (u,), (c,), u**2 / 2, forces=(-c * u,), name="coasting")
    step = gs.stepper("G-L", 4, system=system)
    run = step.integrate([0.0], [2.0], dt=0.05, steps=100, parameters={"c": 0.3})
    assert np.abs(run.p[:, 0] - 2 * np.exp(-0.3 * run.t)).max() <= 16 * EPS
    assert "time" not in step.manifest["system"]
    assert step.manifest["system"]["forces"] == ["-c*u"]


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


BOUNDS = {("EMS", None): 1e-4, ("G-L", 2): 1e-8, ("G-L", 4): 1e-13}


@pytest.mark.parametrize(("rep", "scheme", "stages"), [
    ("alpha", "EMS", None), ("gamma", "G-L", 4),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("alpha", "G-L", 2), ("gamma", "EMS", None), ("gamma", "G-L", 2), ("alpha", "G-L", 4)))])
def test_body_with_drag(rep, scheme, stages):
    """Ω₃ decays as exp(−ct/I₃); Ω₁ + iΩ₂ as exp(−ct/I₁), and turns by ∫(I₃/I₁ − 1) Ω₃ dt."""
    step, bound = gs.stepper(scheme, stages, system=body_with_drag(rep)), BOUNDS[scheme, stages]
    I1, I3, drag, Omega = 2.0, 0.8, 0.15, np.array([0.4, -0.2, 3.0])
    parameters = {"I1": I1, "I2": I1, "I3": I3, "c": drag, rep: 1.2}
    q = np.array([0.5, 0.5, -0.1, 0.7]) / np.linalg.norm([0.5, 0.5, -0.1, 0.7])
    p = gs.momentum(q, Omega, (I1, I1, I3))
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


# ---------------------------------------------------------------- work


@systems_and_schemes
@pytest.mark.parametrize("solver", ["auto", "newton"])
def test_work_balances_energy(name, scheme, stages, solver):
    """|H − H₀ − W|: round-off for EMS over 2000 steps, of the order of the method else."""
    step = stepper_for(name, scheme, stages)
    q, p = start(name, step)
    run = step.integrate(q, p, dt=0.02, steps=2000, parameters=PARAMETERS, solver=solver)
    assert np.abs(run.energy_error()).max() == pytest.approx(run.report.energy_error_max)
    assert run.work[0] == 0
    assert run.report.work == run.work[-1]
    assert abs(run.work[-1]) > 0.1
    if scheme == "EMS":
        # Each step closes to ε of energies up to 20 and of λ g; signs are random.
        assert run.report.energy_error_max <= 64 * EPS * 20
        return
    errors = [step.integrate(q, p, dt=2 / n, steps=n, parameters=PARAMETERS, solver=solver)
              .report.energy_error_max for n in (16, 32, 64)]
    if min(errors) < 1e-13:
        return  # where H and g are quadratic, IMS is EMS
    slope = np.polyfit(np.log([1 / 16, 1 / 32, 1 / 64]), np.log(errors), 1)[0]
    assert slope > step.order - 0.5


# ---------------------------------------------------------------- routes


@pytest.mark.parametrize("rep", ["gamma", "alpha"])
def test_what_the_fast_path_proves_of_forces(rep):
    """The torque's L(q)p is evaluated once with H_p: no constraint force along q changes it."""
    system, _ = hoisted(body_with_drag(rep))
    fast = FastSystem(system)
    assert len(fast.shared) == 3
    for shared in fast.shared:
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
    assert FastSystem(separable).shared == []
    timed = gs.System((x, y), (u, v), (), kinetic + swirl**2 * x, circle,
                      forces=(tau * y + swirl * (u - tau), 0), time=tau)
    assert all(tau not in u.free_symbols for u in FastSystem(timed).shared)


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


@some_schemes
def test_against_the_reference(scheme, stages):
    """Residual, Jacobian and step at a time t, with the bounds of test_generic_system.py."""
    step, dt, t = stepper_for("pendulum", scheme, stages), 0.03125, 0.75
    q, p = start("pendulum", step)
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
        q1, p1 = step.step(q, p, t0=t, solver=solver, **run)
        assert np.abs(doubles(q1 - end.q)).max() <= 64 * EPS
        assert np.abs(doubles(p1 - end.p)).max() <= 64 * EPS + rounding


@systems_and_schemes
def test_solvers_and_ensembles_agree(name, scheme, stages):
    """All routes give one motion: round-off of 40 steps, and of g/Δt in p by IMS and EMS."""
    step = stepper_for(name, scheme, stages)
    q, p = start(name, step)
    how: dict[str, Any] = {"dt": 0.05, "steps": 40, "parameters": PARAMETERS, "every": 3}
    run = step.integrate(q, p, t0=0.4, **how)
    assert run.t[0] == 0.4
    assert run.t[-1] == 0.4 + 40 * 0.05
    assert run.report.newton_steps == 0
    others = [step.integrate(q, p, t0=0.4, solver=solver, **how)
              for solver in ("newton", "python", "fixed-point")]
    many = step.integrate_ensemble([q] * 3, [p] * 3, t0=[0.4, 1.9, 0.4], **how)
    assert np.array_equal(many.q[0], many.q[2])
    alone = step.integrate(q, p, t0=1.9, **how)
    assert np.abs(alone.q - many.q[1]).max() <= 64 * EPS
    if step.manifest["system"].get("time"):
        assert np.abs(many.q[0] - many.q[1]).max() > 1e-3
    for other in [*others, many.members[0]]:
        assert np.array_equal(other.t, run.t)
        for part, bound in (("q", 64), ("p", 640), ("work", 640), ("quantity_values", 64)):
            first, second = getattr(other, part), getattr(run, part)
            assert np.abs(first - second).max(initial=0) <= bound * EPS


@systems_and_schemes
def test_there_and_back(name, scheme, stages):
    """Negative steps from the end's time lead back; so does going on where a run ended."""
    step = stepper_for(name, scheme, stages)
    q, p = start(name, step)
    how: dict[str, Any] = {"parameters": PARAMETERS}
    run = step.integrate(q, p, dt=0.05, steps=40, t0=0.4, **how)
    back = step.integrate(run.q[-1], run.p[-1], dt=-0.05, steps=40, t0=run.t[-1], **how)
    assert np.abs(back.q[-1] - q).max() <= 256 * EPS
    assert np.abs(back.p[-1] - p).max() <= 1024 * EPS
    assert back.t[-1] == pytest.approx(0.4)
    assert back.work[-1] == pytest.approx(-run.work[-1], rel=1e-9)
    half = step.integrate(q, p, dt=0.05, steps=20, t0=0.4, **how)
    rest = step.integrate(half.q[-1], half.p[-1], dt=0.05, steps=20, t0=half.t[-1], **how)
    assert np.abs(rest.q[-1] - run.q[-1]).max() <= 256 * EPS
    assert half.work[-1] + rest.work[-1] == pytest.approx(run.work[-1], abs=1e-12)


def chain(links):
    """Beads on rods with a mass that depends on place, dampers between them, a drive at the end."""
    q = sp.symbols(f"x0:{2 * links}", real=True)
    p = sp.symbols(f"y0:{2 * links}", real=True)
    points = [(0, 0), *zip(q[::2], q[1::2], strict=True)]
    rods = [(b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 - 1
            for a, b in pairwise(points)]
    H = sum(a**2 for a in p) / 2 + 9 * sum(q[1::2])
    H += sum(x**2 * v**2 for x, v in zip(q[::2], p[1::2], strict=True)) / 8
    forces = [-k * a for a in p]
    for i in range(2 * links - 2):
        pull = c * (p[i + 2] - p[i]) * (1 + q[i] * q[i + 2] / 5)
        forces[i], forces[i + 2] = forces[i] + pull, forces[i + 2] - pull
    forces[-2] += f * sp.sin(omega * tau) * q[-1]
    return gs.System(q, p, (k, c, f, omega), H, rods, forces=forces, time=tau, name="damped")


@pytest.mark.parametrize(("scheme", "stages"), [
    ("EMS", None), *(pytest.param(*scheme, marks=pytest.mark.slow)
                     for scheme in (("IMS", None), ("G-L", 2), ("LIIIA-B", 3)))])
def test_forces_of_large_systems(scheme, stages):
    """With one kernel a form: what is solved, its band and its motion are those of dense C."""
    spec, steppers = Spec.checked(scheme, stages), []
    for structured in (False, True):
        source = generate(spec, system=replace(chain(3), name=f"damped{int(structured)}"),
                          structured=structured).source
        steppers.append(Stepper(source.name, source.files()))
    start = np.array([0.6, -0.8, 1.4, -1.4, 1.4, -2.4]), np.array([0.8, 0.6] * 3)
    q, p = steppers[0].project(*start, parameters=PARAMETERS)
    at: dict[str, Any] = {"dt": 0.02, "parameters": PARAMETERS}
    x = steppers[0].guess(q, p, t=0.3, **at)
    x += 0.05 * np.random.default_rng(1).standard_normal(len(x))
    r, other_r = (step.residual(x, q, p, t=0.3, **at) for step in steppers)
    assert np.abs(r - other_r).max() <= 64 * EPS * (16 + np.abs(x).max() + 0.1 / 0.02)
    J, other_J = (step.jacobian(x, q, p, t=0.3, **at) for step in steppers)
    assert np.abs(J - other_J).max() <= 64 * EPS * np.abs(J).max()
    run = steppers[0].integrate(q, p, steps=50, t0=0.3, **at)
    others = [steppers[1].integrate(q, p, steps=50, t0=0.3, solver=solver, **at)
              for solver in ("auto", "newton", "python")]
    others += steppers[1].integrate_ensemble([q], [p], steps=50, t0=0.3, **at).members
    for other in others:
        assert other.report.newton_steps == 0
        assert np.abs(other.q - run.q).max() <= 64 * EPS
        # IMS and EMS: what rounding g, of terms up to 6, costs in p by Δt.
        assert np.abs(other.p - run.p).max() <= (64 if stages else 64 / 0.02) * EPS
        assert np.abs(other.work - run.work).max() <= 256 * EPS


def test_cost_of_damping_grows_with_the_length():
    """Twice the chain has the same forms, and a band as wide."""
    short, long = (Structure(hoisted(chain(links))[0]) for links in (6, 12))
    assert len(short.force_templates) == len(long.force_templates)
    assert [len(form.expressions) for form in short.force_templates] == [
        len(form.expressions) for form in long.force_templates]


@pytest.mark.parametrize(("real", "scheme", "stages"), [
    ("float", "G-L", 2), ("long-double", "EMS", None), ("float128", "EMS", None),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("float", "EMS", None), ("long-double", "G-L", 2), ("float128", "G-L", 2)))])
def test_every_real(real, scheme, stages):
    """The same motion, and the work balance of EMS at the type's own round-off."""
    step, same = (stepper_for("pendulum", scheme, stages, r) for r in (real, "double"))
    q, p = start("pendulum", step)
    how: dict[str, Any] = {"dt": 0.0625, "steps": 8, "parameters": PARAMETERS, "t0": 0.5}
    run = step.integrate(q, p, **how)
    double = same.integrate(*start("pendulum", same), **how)
    slow = step.integrate(q, p, solver="python", **how)
    many = step.integrate_ensemble(np.array([q] * 2), np.array([p] * 2), **how)
    epsilon = max(step.binding.epsilon, EPS)
    for other in (double, slow, many.members[1]):
        for part in ("q", "p", "work", "quantity_values"):
            difference = (getattr(run, part) - getattr(other, part)).astype(float)
            assert np.abs(difference).max() <= 2000 * epsilon
    if scheme == "EMS":
        assert run.report.energy_error_max <= 256 * step.binding.epsilon * 10


def test_time_at_a_failure():
    """A step that fails is reported at the run's own time, alone and among others."""
    H = u**2 / 2
    system = gs.System((x,), (u,), (k,), H, forces=(u**2 * tau * k,), time=tau, name="runaway")
    step = gs.stepper("G-L", 2, system=system)
    with pytest.raises(gs.StepFailed) as caught:
        step.integrate([0.0], [1.0], dt=0.25, steps=100, t0=2.0, parameters={"k": 1.0})
    failure = caught.value
    assert failure.t == 2.0 + (failure.step - 1) * 0.25
    many = step.integrate_ensemble([[0.0]] * 2, [[1.0], [0.0]], dt=0.25, steps=100, t0=[2.0, 1.0],
                                   parameters={"k": 1.0})
    assert list(many.failures) == [0]
    assert many.failures[0].t == 2.0 + (many.failures[0].step - 1) * 0.25
    assert np.isfinite(many.members[0].report.work)
    assert many.members[0].report.work == many.members[0].work[-1]


def test_no_steps_and_no_forces():
    step = stepper_for("pendulum", "G-L", 2)
    q, p = start("pendulum", step)
    run = step.integrate(q, p, dt=0.1, steps=0, t0=3.0, parameters=PARAMETERS)
    assert run.t.tolist() == [3.0]
    assert run.work.tolist() == [0.0]
    many = step.integrate_ensemble([q], [p], dt=0.1, steps=0, parameters=PARAMETERS)
    assert many.members[0].work.tolist() == [0.0]
    with pytest.raises(gs.InputError, match="t0"):
        step.integrate(q, p, dt=0.1, steps=1, t0=float("nan"), parameters=PARAMETERS)
