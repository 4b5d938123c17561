"""Systems without quaternions: two constraints, a quartic one, none, redundant ones.

    pendulum   n = 4, m = 2: two rods, a planar double pendulum in Cartesian coordinates
    runner     n = 2, m = 1: H = √(M² + p²)(1 + x²/4) + k/(2 + y), not separable and not quadratic
               in p, on x⁴ + y² = 1
    Hénon      n = 2, m = 0: the Hénon-Heiles oscillator

Each is written twice: in SymPy for ``gyrospark.System``, and by hand for the reference, with the
discrete gradients that follow from Δ(uv) = ūΔv + v̄Δu, Δ√u = Δu/(√u₁ + √u₀), Δ(1/u) = −Δu/(u₀u₁).
"""

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from generic_systems import EXAMPLES, stepper_for
from gyrospark.generator.systems.system import System
from gyrospark.runtime.bindings.binding import REASONS
from reference import WORKING_DIGITS, Method, doubles, numbers
from strategies import EPS


def states(name, count, step):
    """Yield states near the example's that ``project`` makes consistent."""
    example, rng = EXAMPLES[name], np.random.default_rng(41)
    for _ in range(count):
        q, p = (np.array(x) * (1 + 0.1 * rng.standard_normal(len(x)))
                for x in (example.q, example.p))
        yield step.project(q, p, parameters=example.parameters)


def largest(x):
    return float(np.abs(x).max(initial=0.0))


#: Each method, and each system with one.
PAIRS = [("runner", "EMS", None),
         *(pytest.param("runner", *scheme, marks=pytest.mark.slow)  # a stepper more
           for scheme in (("IMS", None), ("LIIIA-B", 3))),
         ("pendulum", "G-L", 2),
         pytest.param("oscillator", "EMS", None, marks=pytest.mark.slow)]
pairs = pytest.mark.parametrize(("name", "scheme", "stages"), PAIRS)


@pairs
def test_step_and_jacobian_agree_with_the_reference(name, scheme, stages):
    """q and p agree to 64 ε, and by IMS and EMS to the rounding of g, δg/(Δt g_q H_pp g_qᵀ).

    The rounding costs 4γ/Δt · ε for a quaternion (test_step_reference.py); here masses of order one
    play the part of γ, and g has terms up to 4. In multipliers it is divided by Δt once more.
    """
    step, dt, example = stepper_for(name, scheme, stages), 0.03125, EXAMPLES[name]
    (q, p), run = next(states(name, 1, step)), {"dt": dt, "parameters": example.parameters}
    method = Method(example.by_hand, scheme, stages, q, p, dt)
    exact, computed = method.step(), step.integrate(q, p, steps=1, **run)
    size = largest(doubles(exact.p))
    rounding = 0.0 if stages or not step.m else 8 * EPS / dt
    assert largest(doubles(computed.q[1] - exact.q)) <= 64 * EPS * max(1.0, largest(q))
    assert largest(doubles(computed.p[1] - exact.p)) <= 64 * EPS * size + rounding
    if step.m:
        multipliers = computed.multipliers[0].reshape(exact.multipliers.shape)
        bound = 64 * EPS * (largest(doubles(exact.multipliers)) + 1 / dt**2)
        assert largest(doubles(multipliers - exact.multipliers)) <= bound
    x = step.guess(q, p, **run)
    x += 0.05 * np.random.default_rng(42).standard_normal(step.unknowns)
    exact = method.jacobian(x)
    error = np.abs(step.jacobian(x, q, p, **run) - exact)
    assert np.all(error.max(axis=1) <= 1e-12 * np.abs(exact).max(axis=1))
    with mp.workdps(WORKING_DIGITS):
        r = doubles(step.residual(x, q, p, **run) - method.residual(mp.mpf)(numbers(x, mp.mpf)))
    # The residual adds up gravity of 15 in H_q, forces of a few times 0.05, and x/Δt.
    assert largest(r) <= 64 * EPS * (16 + largest(x) + 0.1 / dt)


@pytest.mark.parametrize("dt", [0.1, 0.01])
def test_redundant_constraints_fail_clearly(dt):
    """A constraint given twice is refused; if allowed, it fails clearly or makes the right step.

    Its multipliers are undetermined, and elimination meets a pivot that is zero up to rounding.
    Newton may then still find q and p, which are determined, with multipliers of the right sum; it
    must not return other states.
    """
    x, y, z, a, b, c = sp.symbols("x y z a b c", real=True)
    sphere = x**2 + y**2 + z**2 - 1
    system = System((x, y, z), (a, b, c), (), (a**2 + b**2 + c**2) / 2 + z,
                    (sphere, 3 * sphere), name="twice")
    with pytest.raises(gs.InputError, match="g1"):
        gs.stepper("EMS", system=system)
    step = gs.stepper("EMS", system=system, allow_invalid=True)
    for q, p in (([0.6, 0.0, 0.8], [0.0, 1.0, 0.0]), ([0.48, 0.6, 0.64], [0.8, 0.0, -0.6])):
        failure = None
        try:
            end, _ = step.step(q, p, dt=dt, parameters={})
        except gs.StepFailed as caught:
            failure = caught
        if failure is None:
            assert abs(end @ end - 1) < 1e-12
            continue
        assert failure.step == 1
        assert failure.reason in REASONS.values()
        assert "'g0', 'g1'" in failure.detail
        assert failure.trajectory.q.shape == (1, 3)
        assert len(failure.trajectory.multipliers) == 0


@pytest.mark.parametrize("mass", [1e-4, 1e4])
def test_consistency_is_checked_in_any_units(mass):
    """States of ``project`` are starts, whatever the size of the mass."""
    step, case, rng = systems.stepper("ellipse"), systems.case("ellipse"), np.random.default_rng(43)
    parameters = case.parameters | {"m": mass, "k": mass}
    for _ in range(10):
        q, p = case.q * (1 + 0.1 * rng.standard_normal(2)), mass * rng.standard_normal(2)
        step.step(*step.project(q, p, parameters=parameters), dt=1e-3, parameters=parameters)
