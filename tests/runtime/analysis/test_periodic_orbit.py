"""Periodic orbits: Newton's convergence, multipliers, what is fixed and free, failures."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from chaotic_pendulum import PARAMETERS, pendulum, released

#: A period 10 % above that of small oscillations in phase, in 160 steps.
DT = 1.1 * 2 * np.pi / np.sqrt(9.81 * (2 - np.sqrt(2))) / 160


def orbit(step=None, dt=DT, steps=160, parameters=PARAMETERS, **how):
    step = step or pendulum()
    return gs.periodic_orbit(step, *released(1.0, 1.4142 * 0.95, step), dt=dt, steps=steps,
                             parameters=parameters, **how)


def closed(found):
    """Whether a run of the orbit ends where it began."""
    run = found.run(2, every=found.steps)
    return max(np.abs(run.q[1:] - run.q[0]).max(), np.abs(run.p[1:] - run.p[0]).max())


def test_energy():
    """1e-14 after five iterations that double the digits; multipliers on the unit circle."""
    done = []
    found = orbit(dt=DT / 5, steps=800, progress=done.append)
    q, p = released(1.0, 1.4142 * 0.95)
    assert found.iterations == 5
    assert done == [*range(6)]
    assert found.residuals[-1] < 1e-14
    assert all(after < before**1.5 for before, after in zip(found.residuals[1:-2],
                                                           found.residuals[2:-1], strict=True))
    assert np.abs(found.multipliers[:2] - [-0.98739271 + 0.15828973j,
                                           -0.98739271 - 0.15828973j]).max() < 1e-8
    assert np.abs(found.multipliers[2:] - 1).max() < 1e-6
    assert found.symplectic_defect < 1e-14
    energy = pendulum().energy([q, found.q], [p, found.p], parameters=PARAMETERS)
    assert abs(energy[1] - energy[0]) < 1e-13
    assert float(found.period) == pytest.approx(2.80500369297318, abs=1e-9)  # of order 4
    assert closed(found) < 1e-13
    assert np.prod(found.multipliers) == pytest.approx(1, abs=1e-12)
    assert "2.805" in repr(found)
    assert "2.805" in found._repr_html_()
    left, right = found.plot().axes
    assert left.get_xlabel() == "t [s]"
    assert all(abs(np.ptp(line.get_ydata()[[0, -1]])) < 1e-13 for line in left.get_lines())
    points = right.collections[0].get_offsets()
    assert np.abs(points @ [1, 1j] - found.multipliers).max() < 1e-15


@pytest.mark.parametrize("fix", ["period", "x1"])
def test_others_of_the_family(fix):
    found, (q, _) = orbit(fix=fix), released(1.0, 1.4142 * 0.95)
    assert closed(found) < 1e-13
    assert (found.dt == DT) if fix == "period" else abs(found.q[0] - q[0]) < 1e-13


@pytest.mark.parametrize(("free", "value"), [("l", 1.1082591), ("g", 9.2234015)])
def test_free_parameter(free, value):
    """The energy and the period stay: the lower rod gets another length, or both other weights."""
    cycle = orbit(fix=("energy", "period"), free=free)
    assert cycle.dt == DT
    assert cycle.iterations <= 5  # the digits double
    assert cycle.parameters[free] == pytest.approx(value, abs=1e-6)
    assert closed(cycle) < 1e-13


def test_large_steps():
    """A discrete family is pairs of orbits: with 18 steps one of them is found, and is a saddle."""
    found = orbit(dt=160 / 18 * DT, steps=18)
    assert found.residuals[-1] < 1e-13
    product = found.multipliers[np.abs(found.multipliers.imag) < 1e-9].real
    assert len(product) == 2
    assert product.max() > 1.01
    assert product.prod() == pytest.approx(1, abs=1e-9)


@pytest.mark.slow  # a stepper and its derivatives
def test_a_scheme_that_does_not_keep_the_momentum_constraint():
    found = orbit(pendulum("EMS", None))
    assert found.iterations <= 6
    assert found.residuals[-1] < 1e-13


@pytest.mark.slow  # three seconds in float128; test_lyapunov.py has its tangents
def test_many_digits():
    """In float128 iterations go on to where the orbits of the discrete family differ."""
    found = orbit(pendulum(stages=3, real="float128"))
    assert found.residuals[-1] < 1e-25
    assert np.abs(found.multipliers[:2].real + 0.98739271).max() < 1e-7


def test_limit_cycle():
    """Van der Pol's oscillator keeps nothing; its cycle attracts with exp(−7.06) a period."""
    q, p, mu = *sp.symbols("q p", real=True), sp.Symbol("mu", real=True)
    system = gs.System((q,), (p,), (mu,), (p**2 + q**2) / 2, forces=[mu * (1 - q**2) * p],
                       name="van_der_pol")
    step = gs.stepper("G-L", 2, system=system)
    found = gs.periodic_orbit(step, [2.0], [0.0], dt=6.5 / 400, steps=400, parameters={"mu": 1.0},
                              fix=None)
    assert float(found.period) == pytest.approx(6.66328686, abs=1e-7)  # Andersen, Geer 1982
    assert closed(found) < 1e-12
    assert found.multipliers[0] == pytest.approx(1, abs=1e-9)
    assert 0 < found.multipliers[1].real < 1e-3


def test_driven_oscillator():
    """x'' = −k x − c x' + f cos ωt has one orbit of the period of its force, an ellipse."""
    step, values = systems.differentiable("driven_oscillator"), systems.case(
        "driven_oscillator").parameters
    k, c, f, omega = (values[name] for name in ("k", "c", "f", "omega"))
    arguments = {"dt": 2 * np.pi / omega / 200, "steps": 200, "parameters": values}
    found = gs.periodic_orbit(step, [0.0], [0.0], fix="period", **arguments)
    exact = f / (k - omega**2 + 1j * c * omega)
    assert found.q[0] == pytest.approx(exact.real, abs=1e-8)
    assert found.p[0] == pytest.approx((1j * omega * exact).real, abs=1e-8)
    assert np.abs(found.multipliers) == pytest.approx(np.exp(-c * np.pi / omega), abs=1e-9)
    with pytest.raises(gs.InputError, match="period"):
        gs.periodic_orbit(step, [0.0], [0.0], **arguments)


def test_no_orbit():
    """What was reached is in the message."""
    with pytest.raises(gs.GyrosparkError, match="1 iterations"):
        orbit(max_iterations=1)
    with pytest.raises(gs.GyrosparkError, match="equilibrium"):
        gs.periodic_orbit(pendulum(), *released(0.01, 0.01), dt=0.01, steps=100,
                          parameters=PARAMETERS, fix="period")


@pytest.mark.parametrize(("change", "word"), [
    ({"fix": "enrgy"}, "energy"), ({"fix": 3}, "fix"), ({"free": "gg"}, "g"),
    ({"steps": 0}, "steps"), ({"max_iterations": 0}, "max_iterations"),
    ({"parameters": {"g": 9.81}}, "l"),
])
def test_bad_input(change, word):
    with pytest.raises(gs.InputError, match=word):
        orbit(**change)
