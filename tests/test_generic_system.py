"""Systems that are no quaternion: two constraints, a quartic one, none, redundant ones.

    pendulum   n = 4, m = 2: a planar double pendulum in Cartesian coordinates
    runner     n = 3, m = 1: H = √(M² + p²)(1 + x²/4) + k/(2 + z), not separable and not quadratic
               in p, on x⁴ + y⁴ + z² = 1
    Hénon      n = 2, m = 0: the Hénon-Heiles oscillator

Each is written twice: in SymPy for ``gyrospark.System``, and by hand for the reference, with the
discrete gradients that follow from Δ(uv) = ūΔv + v̄Δu, Δ√u = Δu/(√u₁ + √u₀), Δ(1/u) = −Δu/(u₀u₁).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.systems.system import System
from gyrospark.runtime.bindings.binding import REASONS
from reference import WORKING_DIGITS, Equations, Method, doubles, numbers
from strategies import EPS

METHODS = [("IMS", None), ("EMS", None), ("G-L", 2), ("LIIIA-B", 3)]


@dataclass(frozen=True)
class Example:
    """A system twice, and a region to start in."""

    symbolic: System
    by_hand: Any  # number → Equations
    parameters: dict[str, float]
    q: tuple[float, ...]
    p: tuple[float, ...]


def pendulum() -> Example:
    x1, y1, x2, y2, u1, v1, u2, v2 = q_p = sp.symbols("x1 y1 x2 y2 u1 v1 u2 v2", real=True)
    m1, m2, l1, l2 = sp.symbols("m1 m2 l1 l2", positive=True)
    w = sp.Symbol("w", real=True)
    H = (u1**2 + v1**2) / (2 * m1) + (u2**2 + v2**2) / (2 * m2) + w * (m1 * y1 + m2 * y2)
    g = (x1**2 + y1**2 - l1**2, (x2 - x1) ** 2 + (y2 - y1) ** 2 - l2**2)
    parameters = {"m1": 1.5, "m2": 0.7, "l1": 1.25, "l2": 0.8, "w": 9.81}

    def by_hand(number):
        m1, m2, l1, l2, w = (number(parameters[name]) for name in ("m1", "m2", "l1", "l2", "w"))
        mass, weight = np.array([m1, m1, m2, m2]), w * np.array([0 * m1, m1, 0 * m1, m2])

        def G(q):
            x, y = q[2] - q[0], q[3] - q[1]
            return 2 * np.array([[q[0], q[1], 0 * x, 0 * x], [-x, -y, x, y]])

        def mean_gradient(q0, p0, q1, p1):  # H and g are quadratic: at the mean
            return weight + 0 * q0, (p0 + p1) / 2 / mass

        return Equations(
            H=lambda q, p: p @ (p / mass) / 2 + weight @ q,
            H_q=lambda q, p: weight + 0 * q,
            H_p=lambda q, p: p / mass,
            g=lambda q: np.array([q[0] ** 2 + q[1] ** 2 - l1**2,
                                  (q[2] - q[0]) ** 2 + (q[3] - q[1]) ** 2 - l2**2]),
            G=G, mean_gradient=mean_gradient, mean_constraint=lambda q0, q1: G((q0 + q1) / 2),
        )

    return Example(System(q_p[:4], q_p[4:], (m1, m2, l1, l2, w), H, g, name="pendulum"), by_hand,
                   parameters, (0.9, -0.6, 1.5, -1.1), (1.0, 0.4, -0.6, 0.9))


def runner() -> Example:
    x, y, z, a, b, c = q_p = sp.symbols("x y z a b c", real=True)
    M = sp.Symbol("M", positive=True)
    k = sp.Symbol("k", real=True)
    H = sp.sqrt(M**2 + a**2 + b**2 + c**2) * (1 + x**2 / 4) + k / (2 + z)
    parameters = {"M": 0.8, "k": 1.7}

    def by_hand(number):
        M, k = (number(parameters[name]) for name in ("M", "k"))

        def root(p):
            return (M**2 + p @ p) ** 0.5

        def stretch(q):
            return 1 + q[0] ** 2 / 4

        def mean_gradient(q0, p0, q1, p1):
            roots, q = root(p0) + root(p1), (q0 + q1) / 2
            D_p = (stretch(q0) + stretch(q1)) / 2 * (p0 + p1) / roots
            return np.array([roots * q[0] / 4, 0 * q[0], -k / ((2 + q0[2]) * (2 + q1[2]))]), D_p

        def mean_constraint(q0, q1):
            row = (q0 + q1) * (q0**2 + q1**2)
            row[2] = q0[2] + q1[2]
            return np.array([row])

        return Equations(
            H=lambda q, p: root(p) * stretch(q) + k / (2 + q[2]),
            H_q=lambda q, p: np.array([root(p) * q[0] / 2, 0 * q[0], -k / (2 + q[2]) ** 2]),
            H_p=lambda q, p: p / root(p) * stretch(q),
            g=lambda q: np.array([q[0] ** 4 + q[1] ** 4 + q[2] ** 2 - 1]),
            G=lambda q: np.array([[4 * q[0] ** 3, 4 * q[1] ** 3, 2 * q[2]]]),
            mean_gradient=mean_gradient, mean_constraint=mean_constraint,
        )

    return Example(System(q_p[:3], q_p[3:], (M, k), H, (x**4 + y**4 + z**2 - 1,), name="runner"),
                   by_hand, parameters, (0.7, -0.6, 0.5), (0.6, 0.9, -0.4))


def oscillator() -> Example:
    x, y, a, b = q_p = sp.symbols("x y a b", real=True)
    H = (a**2 + b**2 + x**2 + y**2) / 2 + x**2 * y - y**3 / 3

    def by_hand(number):
        third = 1 / number(3)

        def mean_gradient(q0, p0, q1, p1):
            q, y0, y1 = (q0 + q1) / 2, q0[1], q1[1]
            square = (q0[0] ** 2 + q1[0] ** 2) / 2
            D_q = np.array([q[0] + 2 * q[0] * q[1],
                            q[1] + square - third * (y0**2 + y0 * y1 + y1**2)])
            return D_q, (p0 + p1) / 2

        return Equations(
            H=lambda q, p: (p @ p + q @ q) / 2 + q[0] ** 2 * q[1] - third * q[1] ** 3,
            H_q=lambda q, p: np.array([q[0] + 2 * q[0] * q[1], q[1] + q[0] ** 2 - q[1] ** 2]),
            H_p=lambda q, p: 1 * p,
            g=lambda q: np.zeros(0), G=lambda q: np.zeros((0, 2)),
            mean_gradient=mean_gradient, mean_constraint=lambda q0, q1: np.zeros((0, 2)),
        )

    return Example(System(q_p[:2], q_p[2:], (), H, name="henon_heiles"), by_hand, {}, (0.3, -0.2),
                   (0.25, 0.35))


EXAMPLES = {make.__name__: make() for make in (pendulum, runner, oscillator)}
CONSTRAINED = ["pendulum", "runner"]


@cache
def stepper_for(name, scheme, stages):
    return gs.stepper(scheme, stages, system=EXAMPLES[name].symbolic)


def states(name, count, step):
    """Return consistent states near the example's, made so by ``project``."""
    example, rng = EXAMPLES[name], np.random.default_rng(41)
    for _ in range(count):
        q, p = (np.array(x) * (1 + 0.1 * rng.standard_normal(len(x)))
                for x in (example.q, example.p))
        yield step.project(q, p, parameters=example.parameters)


def method_for(name, scheme, stages, q, p, dt):
    return Method(EXAMPLES[name].by_hand, scheme, stages, q, p, dt)


def largest(x):
    return float(np.abs(x).max(initial=0.0))


every_method = pytest.mark.parametrize(("scheme", "stages"), METHODS)
every_system = pytest.mark.parametrize("name", EXAMPLES)
constrained = pytest.mark.parametrize("name", CONSTRAINED)


@every_method
@every_system
def test_step_agrees_with_the_reference(name, scheme, stages):
    """64 ε of q and p; IMS and EMS carry along g_q what rounding g costs, δg/(Δt g_q H_pp g_qᵀ).

    That is 4γ/Δt · ε for a quaternion (test_step_reference.py); here masses of order one play the
    part of γ, and g has terms up to 4. The multipliers hold it once more by Δt.
    """
    step, dt = stepper_for(name, scheme, stages), 0.03125
    for q, p in states(name, 4, step):
        exact = method_for(name, scheme, stages, q, p, dt).step()
        made = step.integrate(q, p, dt=dt, steps=1, parameters=EXAMPLES[name].parameters)
        size = largest(doubles(exact.p))
        rounding = 0.0 if stages or not step.m else 8 * EPS / dt
        assert largest(doubles(made.q[1] - exact.q)) <= 64 * EPS * max(1.0, largest(q))
        assert largest(doubles(made.p[1] - exact.p)) <= 64 * EPS * size + rounding
        if step.m:
            found = made.multipliers[0].reshape(exact.multipliers.shape)
            bound = 64 * EPS * (largest(doubles(exact.multipliers)) + 1 / dt**2)
            assert largest(doubles(found - exact.multipliers)) <= bound


@every_method
@every_system
def test_jacobian_agrees_with_the_reference(name, scheme, stages):
    step, dt, rng = stepper_for(name, scheme, stages), 0.03125, np.random.default_rng(42)
    example = EXAMPLES[name]
    for q, p in states(name, 2, step):
        method = method_for(name, scheme, stages, q, p, dt)
        x = step.guess(q, p, dt=dt, parameters=example.parameters)
        x += 0.05 * rng.standard_normal(step.unknowns)
        run = {"dt": dt, "parameters": example.parameters}
        exact = method.jacobian(x)
        error = np.abs(step.jacobian(x, q, p, **run) - exact)
        assert np.all(error.max(axis=1) <= 1e-12 * np.abs(exact).max(axis=1))
        with mp.workdps(WORKING_DIGITS):
            r = doubles(step.residual(x, q, p, **run)
                        - method.residual(mp.mpf)(numbers(x, mp.mpf)))
        # Gravity of 15 in H_q, forces of a few times 0.05, and x/Δt are what is added up.
        assert largest(r) <= 64 * EPS * (16 + largest(x) + 0.1 / dt)


@every_method
@constrained
def test_constraints_and_energy(name, scheme, stages):
    """g on every step by every scheme, the momentum constraint by SPARK, H by EMS."""
    step, steps, example = stepper_for(name, scheme, stages), 1000, EXAMPLES[name]
    q, p = next(states(name, 1, step))
    run = step.integrate(q, p, dt=0.02, steps=steps, parameters=example.parameters)
    # Sums of six products up to 4, of coordinates rounded by ε/2; quartic g has slopes up to 4.
    assert run.report.constraint_max <= 16 * EPS
    momenta = np.abs(run.p).max()
    if stages:
        assert run.report.momentum_constraint_max <= 32 * EPS * momenta
    error = np.abs(run.energy() - run.energy()[0]).max()
    # Energies of up to 40: the kinetic and the potential part cancel in H.
    rounding = 4 * EPS * np.sqrt(steps) * 40
    # Where H and g are quadratic, IMS and EMS are one scheme.
    exact = scheme == "EMS" or (scheme == "IMS" and name == "pendulum")
    assert error <= rounding if exact else error > 100 * rounding


@every_method
def test_shapes(scheme, stages):
    counts = {"IMS": 1, "EMS": 1, "G-L": 3, "LIIIA-B": 3}
    for name, example in EXAMPLES.items():
        step = stepper_for(name, scheme, stages)
        n, m = len(example.q), len(example.symbolic.constraints)
        assert (step.n, step.m) == (n, m)
        q, p = next(states(name, 1, step))
        run = step.integrate(q, p, dt=0.01, steps=5, parameters=example.parameters)
        assert run.q.shape == run.p.shape == (6, n)
        shapes = {0: (5, 0), 1: (5, counts[scheme]), 2: (5, counts[scheme], 2)}
        assert run.multipliers.shape == shapes[m]
        nodes = counts[scheme] - 1
        assert step.unknowns == (2 * n * stages + m * nodes if stages else 2 * n + m)
        with pytest.raises(gs.GyrosparkError, match="not one rigid body"):
            run.axis()


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize(("scheme", "stages"), METHODS)
def test_order(name, scheme, stages):
    """Halved steps against 4096 of another scheme: 2, 2, 4 and 4, on every system."""
    step, example = stepper_for(name, scheme, stages), EXAMPLES[name]
    q, p = next(states(name, 1, step))
    run = {"parameters": example.parameters}
    other = stepper_for(name, *(("LIIIA-B", 3) if scheme == "G-L" else ("G-L", 2)))
    exact = other.integrate(q, p, dt=0.5 / 4096, steps=4096, every=4096, **run)
    counts = np.array([32, 64, 128])
    errors = [np.abs(step.integrate(q, p, dt=0.5 / n, steps=int(n), **run).q[-1]
                     - exact.q[-1]).max() for n in counts]
    slope = np.polyfit(np.log(0.5 / counts), np.log(errors), 1)[0]
    assert step.order == (4 if stages else 2)
    # Errors from 1e-3 down to 1e-9 and above: no plateau, but the next term is not small.
    assert abs(slope - step.order) < 0.25


@pytest.mark.parametrize("name", EXAMPLES)
@pytest.mark.parametrize(("scheme", "stages"), METHODS)
def test_reversal_and_python(name, scheme, stages):
    step, example, dt = stepper_for(name, scheme, stages), EXAMPLES[name], 0.03125
    for q, p in states(name, 3, step):
        there = step.step(q, p, dt=dt, parameters=example.parameters)
        back = step.step(*there, dt=-dt, parameters=example.parameters)
        slow = step.step(q, p, dt=dt, parameters=example.parameters, solver="python")
        rounding = 0.0 if stages or not step.m else 16 * EPS / dt
        for first, second in ((back, (q, p)), (slow, there)):
            assert largest(first[0] - second[0]) <= 64 * EPS
            assert largest(first[1] - second[1]) <= 64 * EPS * largest(p) + rounding


@constrained
def test_project(name):
    """A state off the constraints is refused, and accepted once projected."""
    step, example = stepper_for(name, "G-L", 2), EXAMPLES[name]
    run = {"dt": 0.01, "parameters": example.parameters}
    with pytest.raises(gs.InputError, match="off the constraints"):
        step.step(example.q, example.p, **run)
    q, p = step.project(example.q, example.p, parameters=example.parameters)
    equations = example.by_hand(float)
    assert largest(equations.g(q)) <= 16 * EPS
    assert largest(equations.G(q) @ equations.H_p(q, p)) <= 32 * EPS * largest(p)
    step.step(q, p, **run)


@pytest.mark.parametrize(("scheme", "stages", "factor"), [
    ("EMS", None, 3), ("G-L", 2, 1), *(
        pytest.param(*method, factor, marks=pytest.mark.slow)
        for method in METHODS for factor in (1, 3)
        if (*method, factor) not in (("EMS", None, 3), ("G-L", 2, 1)))])
@pytest.mark.parametrize("dt", [0.1, 0.01])
def test_redundant_constraints_fail_clearly(scheme, stages, factor, dt):
    """A constraint given twice leaves its multipliers undetermined: a clear failure, or the step.

    It is refused before; who asks for it all the same gets this. Elimination meets a pivot that is
    zero up to rounding only. Newton may then still find q and p, which are determined, with
    multipliers of the right sum; it must not hand over other states.
    """
    x, y, z, a, b, c = sp.symbols("x y z a b c", real=True)
    sphere = x**2 + y**2 + z**2 - 1
    system = System((x, y, z), (a, b, c), (), (a**2 + b**2 + c**2) / 2 + z,
                    (sphere, factor * sphere), name="twice")
    with pytest.raises(gs.InputError, match="g1"):
        gs.stepper(scheme, stages, system=system)
    step = gs.stepper(scheme, stages, system=system, allow_invalid=True)
    for q, p in (([0.6, 0.0, 0.8], [0.0, 1.0, 0.0]), ([0.48, 0.6, 0.64], [0.8, 0.0, -0.6])):
        failure = None
        try:
            found, _ = step.step(q, p, dt=dt, parameters={})
        except gs.StepFailed as caught:
            failure = caught
        if failure is None:
            assert abs(found @ found - 1) < 1e-12
            continue
        assert failure.step == 1
        assert failure.reason in REASONS.values()
        assert failure.trajectory.q.shape == (1, 3)
        assert len(failure.trajectory.multipliers) == 0


@constrained
def test_no_steps(name):
    """An integration of no steps keeps the shapes, for two constraints as well."""
    step = stepper_for(name, "G-L", 2)
    q, p = next(states(name, 1, step))
    run = step.integrate(q, p, dt=0.1, steps=0, parameters=EXAMPLES[name].parameters)
    assert run.multipliers.shape == ((0, 3, 2) if name == "pendulum" else (0, 3))


@every_method
@pytest.mark.parametrize("masses", [(1e-4, 1e-5), (1e3, 1e4), (1e-3, 1.0)])
def test_consistency_is_judged_in_any_units(scheme, stages, masses):
    """What ``project`` returns is a start, whatever the size of the masses."""
    step, rng = stepper_for("pendulum", scheme, stages), np.random.default_rng(43)
    m1, m2 = masses
    parameters = EXAMPLES["pendulum"].parameters | {"m1": m1, "m2": m2}
    for _ in range(10):
        q = np.array(EXAMPLES["pendulum"].q) * (1 + 0.1 * rng.standard_normal(4))
        p = rng.standard_normal(4) * [m1, m1, m2, m2]
        step.step(*step.project(q, p, parameters=parameters), dt=1e-3, parameters=parameters)


@pytest.mark.parametrize("scheme", ["IMS", "EMS"])
@constrained
def test_states_of_ims_and_ems_are_starts(name, scheme):
    """Every state of a run is accepted as a start, and goes on as the run did."""
    step, example = stepper_for(name, scheme, None), EXAMPLES[name]
    q, p = next(states(name, 1, step))
    how = {"dt": 0.02, "parameters": example.parameters}
    run = step.integrate(q, p, steps=50, solver="newton", **how)
    for k in range(50):
        q, p = step.step(run.q[k], run.p[k], solver="newton", **how)
        assert np.array_equal(q, run.q[k + 1])
        assert np.array_equal(p, run.p[k + 1])
        q, p = step.step(run.q[k], run.p[k], **how)
        for new, old in ((q, run.q[k + 1]), (p, run.p[k + 1])):
            assert np.abs(new - old).max() < 1e-13 * (1 + np.abs(old).max())
