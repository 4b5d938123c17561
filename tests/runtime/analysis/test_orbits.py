"""Lyapunov exponents and periodic orbits: linear, regular, chaotic motions, pairs, multipliers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import by_names
from gyrospark.runtime.analysis.unitary_frame import (
    UnitaryFrame,
    _inverse_mass,
    canonical_form,
    isotropic_flag,
)

PARAMETERS = systems.case("two_rods").parameters
#: A pendulum that stands on its head, at which x'' = x.
SADDLE = {"q": [0.0, 1.0], "p": [0.0, 0.0], "parameters": {"m": 1.0, "g": 1.0, "l": 1.0}}


def pendulum(scheme: str = "G-L", stages: int | None = 2, real: str = "double") -> gs.Stepper:
    """Return the stepper of a plane double pendulum, with derivatives."""
    return systems.differentiable("two_rods", scheme, stages, real)


def released(a: float, b: float, step: gs.Stepper | None = None):
    """Return the state at rest with these angles against the downward vertical."""
    q = [np.sin(a), -np.cos(a), np.sin(a) + np.sin(b), -np.cos(a) - np.cos(b)]
    return (step or pendulum()).project(q, np.zeros(4), parameters=PARAMETERS)


def test_saddle():
    """The exponents are ±1; their vectors are along (x, u) = (1, ±1)."""
    spectrum = by_names(gs.lyapunov, systems.differentiable("pendulum"), **SADDLE, dt=0.01,
                        steps=4000, every=10, covariant=True)
    later = spectrum.running[-1] * spectrum.times[-1] - spectrum.running[199] * spectrum.times[199]
    rates = later / (spectrum.times[-1] - spectrum.times[199])  # without the first seconds
    assert np.abs(rates - [1, -1]).max() < 1e-9  # of order 4
    assert spectrum.pairing < 1e-13
    assert abs(spectrum.ftle - 1) < 1e-8  # the flow is symmetric, of norm e^t
    slopes = spectrum.covariant[200, 2] / spectrum.covariant[200, 0]
    assert np.abs(slopes - [1, -1]).max() < 1e-7


def test_megno_is_a_mean_of_second_order():
    """Decompositions after a second give the MEGNO of decompositions after each step."""
    fine, coarse = (by_names(gs.lyapunov, systems.differentiable("pendulum"), **SADDLE, dt=0.01,
                             steps=1000, every=every).megno for every in (1, 100))
    assert abs(coarse - fine) < 0.1  # (1 s)²/10 s; a rule of first order has an error of 0.5


def test_small_oscillations():
    """Periods are equal, so that directions do not even grow linearly."""
    spectrum = gs.lyapunov(systems.differentiable("pendulum"), [1e-4, -np.sqrt(1 - 1e-8)],
                           [0.0, 0.0], dt=0.05, steps=4000, every=50,
                           parameters={"m": 1.0, "g": 2.0, "l": 1.0})
    assert np.abs(spectrum.exponents).max() < 5e-3
    assert abs(spectrum.megno) < 0.1
    assert spectrum.symplectic_defect < 1e-13


def test_damping_contracts_volume():
    """The sum of the exponents of x'' = −k x − c x' is the rate of the volume, −c."""
    values = systems.case("driven_oscillator").parameters
    spectrum = gs.lyapunov(systems.differentiable("driven_oscillator"), [0.0], [0.0], dt=0.02,
                           steps=1000, parameters=values)
    assert abs(spectrum.volume_rate + values["c"]) < 1e-9  # of the form, ½ log det
    assert abs(spectrum.exponents.sum() + values["c"]) < 1e-9
    assert spectrum.symplectic_defect > 1e-3  # areas shrink between two decompositions


def test_regular_motion():
    """A large oscillation of a plane pendulum has exponents of 0 within errors, and MEGNO 2."""
    spectrum = gs.lyapunov(systems.differentiable("pendulum"), [np.sin(2.9), -np.cos(2.9)], [0, 0],
                           dt=0.05, steps=8000, every=40, parameters={"m": 1.0, "g": 1.0, "l": 1.0})
    assert np.all(np.abs(spectrum.exponents) < 3 * spectrum.errors)
    assert spectrum.exponents[0] < 0.02
    assert abs(spectrum.megno - 2) < 0.25
    assert spectrum.pairing < 1e-13


@pytest.mark.parametrize("intervals", [8, 32, 40])
def test_errors_of_exponents_from_means_over_blocks(intervals):
    """The largest over B = 4, 8, 16, 32 blocks of the standard deviation of their means over √B.

    Intervals are a quarter of the period, so that growth alternates and short blocks decide.
    """
    spectrum = gs.lyapunov(systems.differentiable("pendulum"), [1.0, 0.0], [0.0, 0.0], dt=0.05,
                           steps=37 * intervals, every=37, parameters=SADDLE["parameters"])
    logs = np.diff(spectrum.running * spectrum.times[:, None], axis=0, prepend=0.0)
    errors = []
    for count in {8: (4, 8), 32: (4, 8, 16, 32), 40: (4, 8, 16, 32)}[intervals]:
        cuts = [k * intervals // count for k in range(count + 1)]
        means = [logs[a:b].sum(axis=0) / (37 * 0.05 * (b - a)) for a, b in pairwise(cuts)]
        errors.append(np.std(means, axis=0, ddof=1) / count**0.5)
    # of differences of sums of logarithms, of the size t/Δt
    assert spectrum.errors == pytest.approx(np.max(errors, axis=0), rel=1e-9, abs=1e-12)
    assert spectrum.errors.min() > 1e-6


@pytest.mark.slow  # thousands of steps of a stepper with three stages
@pytest.mark.parametrize(("every", "steps"), [(40, 1500), (1, 6000), (40, 6000)])
def test_chaotic_pendulum_is_paired(every, steps):
    """Exponents are paired at any time, though none has converged; the volume needs no R."""
    spectrum = gs.lyapunov(pendulum(stages=3), *released(2, 2), dt=0.01, steps=steps, every=every,
                           parameters=PARAMETERS)
    assert spectrum.pairing < 1e-12
    assert np.abs(spectrum.running + spectrum.running[:, ::-1]).max() < 1e-10
    assert abs(spectrum.volume_rate) < 1e-13
    assert spectrum.symplectic_defect < 1e-13
    assert spectrum.exponents[0] > 0.5
    if steps == 6000:
        # 1.265 in a Euclidean norm
        assert abs(spectrum.exponents[0] - 1.265) < 2 * spectrum.errors[0] < 0.4
        assert abs(spectrum.exponents[1]) < 2 * spectrum.errors[1]
        assert spectrum.megno == pytest.approx(0.5 * 60 * spectrum.exponents[0], rel=0.2)
        assert spectrum.ftle > spectrum.exponents[0]


def test_first_exponents_alone():
    """Runs with fewer directions have the first exponents of a run with all directions."""
    arguments = {"dt": 0.01, "steps": 500, "parameters": PARAMETERS}
    full, first = (gs.lyapunov(pendulum(), *released(2, 2), count=count, **arguments)
                   for count in (None, 2))
    assert np.abs(full.exponents[:2] - first.exponents).max() < 1e-12
    assert np.isnan(first.pairing)
    assert np.isnan(first.volume_rate)


def test_covariant_vectors_follow_the_run():
    """The derivative of the run takes each vector to a multiple of the later one."""
    step, (q, p) = pendulum(), released(2, 2)
    spectrum = gs.lyapunov(step, q, p, dt=0.01, steps=2000, parameters=PARAMETERS, covariant=True)
    run = step.integrate(q, p, dt=0.01, steps=2000, every=10, parameters=PARAMETERS)
    V = spectrum.covariant
    for row in (0, 80):
        ahead = step.integrate(run.q[row], run.p[row], dt=0.01, steps=200, every=200,
                               parameters=PARAMETERS, tangents=gs.Tangents(start=V[row]))
        end = np.concatenate([ahead.tangents.q[-1], ahead.tangents.p[-1]])
        cosines = np.abs((end * V[row + 20]).sum(axis=0)) / (
            np.linalg.norm(end, axis=0) * np.linalg.norm(V[row + 20], axis=0))
        assert np.abs(cosines - 1).max() < 1e-6


def test_frame_is_unitary():
    """Ω is J, orthogonal and skew; directions have the coordinates from which they were built."""
    step, (q, p) = pendulum(), released(0.5, 2)
    frame = UnitaryFrame(step._derivative_binding(), PARAMETERS, 0.0, q, p)
    J, unit = frame.J, np.eye(4)
    assert np.abs(J + J.T).max() < 1e-14
    assert np.abs(J @ J + unit).max() < 1e-14
    B = frame.directions(unit)
    assert np.abs(B.T @ canonical_form(4) @ B - J).max() < 1e-14
    assert np.abs(frame.coordinates(B) - unit).max() < 1e-14
    flag = isotropic_flag(J)
    assert np.abs(flag.T @ flag - unit).max() < 1e-14
    assert np.abs(flag[:, :2].T @ J @ flag[:, :2]).max() < 1e-14


def test_progress_and_display():
    done = []
    spectrum = gs.lyapunov(pendulum(), *released(2, 2), dt=0.01, steps=1200, parameters=PARAMETERS,
                           progress=done.append)
    assert done[-1] == 1200
    assert done == sorted(done)
    assert f"{spectrum.exponents[0]:.4g}" in repr(spectrum)
    above, below = spectrum.plot().axes
    assert [line.get_ydata()[-1] for line in above.get_lines()[:4]] == spectrum.exponents.tolist()
    assert below.get_lines()[0].get_ydata()[-1] == spectrum.megno
    assert (above.get_ylabel(), below.get_xlabel()) == ("exponents so far [1/s]", "t [s]")


def test_too_few_decompositions():
    """Half of the digits are lost where directions grow 1e8 times more than others."""
    with pytest.warns(gs.errors.InputWarning, match="every"):
        by_names(gs.lyapunov, systems.differentiable("pendulum"), **SADDLE, dt=0.1, steps=400,
                 every=200)


def test_a_start_near_rest_has_the_metric_of_one_at_rest():
    """A kinetic energy of 1e-18 J has no digit beside a potential one of 1 J."""
    at_rest, near_rest = (
        by_names(gs.lyapunov, systems.differentiable("pendulum"), **SADDLE | {"p": [p, 0.0]},
                 dt=0.01, steps=200, every=10) for p in (0.0, 1e-9))
    assert abs(near_rest.ftle - at_rest.ftle) < 1e-7  # the motion moves by 1e-8


@pytest.mark.slow  # derivatives compiled for this
@pytest.mark.parametrize("k", [0.0, 1e3])
def test_the_metric_is_that_of_small_momenta(k):
    """H is not quadratic in p: differences of larger momenta would give another H_pp.

    T = (1 + x²/4) √(m² + p²): H_pp at p = 0, of which differences by p miss the share (p/m)².
    """
    binding, q = systems.differentiable("relativistic")._derivative_binding(), np.array([0.8, 0.77])
    H_pp = _inverse_mass(binding, {"m": 0.8, "k": k}, 0.0, q, np.array([6e-3, -8e-3]))
    assert H_pp == pytest.approx(1.16 / 0.8 * np.eye(2), rel=1e-3, abs=1e-3)


def test_a_state_without_a_finite_energy_is_refused():
    with pytest.raises(gs.InputError, match="H = inf"):
        gs.lyapunov(systems.differentiable("driven_oscillator"), [1e200], [0.0], dt=0.05,
                    steps=100, parameters=systems.case("driven_oscillator").parameters)


@pytest.mark.parametrize(("change", "word"), [
    ({"count": 5}, "4"), ({"count": 0}, "count"), ({"every": 0}, "every"), ({"steps": 0}, "steps"),
    ({"covariant": 1}, "covariant"), ({"progress": 3}, "progress"),
    ({"parameters": {"g": 9.81}}, "l"),
    ({"q": [1, 0, 3, 0]}, "constraints"),
])
def test_bad_input(change, word):
    q, p = released(2, 2)
    arguments = {"q": q, "p": p, "dt": 0.01, "steps": 100, "parameters": PARAMETERS} | change
    with pytest.raises(gs.InputError, match=word):
        by_names(gs.lyapunov, pendulum(), **arguments)


#: A period 10 % above that of small oscillations in phase, in 160 steps.
DT = 1.1 * 2 * np.pi / np.sqrt(9.81 * (2 - np.sqrt(2))) / 160


def orbit(step=None, dt=DT, steps=160, parameters=PARAMETERS, **options):
    step = step or pendulum()
    return gs.periodic_orbit(step, *released(1.0, 1.4142 * 0.95, step), dt=dt, steps=steps,
                             parameters=parameters, **options)


def closed(cycle):
    """Return the largest departure from the start after one period and after two."""
    run = cycle.run(2, every=cycle.steps)
    return max(np.abs(run.q[1:] - run.q[0]).max(), np.abs(run.p[1:] - run.p[0]).max())


def test_energy():
    """Five iterations reach 1e-14, each doubles the digits; multipliers lie on the unit circle."""
    done = []
    cycle = orbit(dt=DT / 5, steps=800, progress=done.append)
    q, p = released(1.0, 1.4142 * 0.95)
    assert cycle.iterations == 5
    assert done == [*range(6)]
    assert cycle.residuals[-1] < 1e-14
    assert all(after < before**1.5 for before, after in zip(cycle.residuals[1:-2],
                                                           cycle.residuals[2:-1], strict=True))
    assert np.abs(cycle.multipliers[:2] - [-0.98739271 + 0.15828973j,
                                           -0.98739271 - 0.15828973j]).max() < 1e-8
    assert np.abs(cycle.multipliers[2:] - 1).max() < 1e-6
    assert cycle.symplectic_defect < 1e-14
    energy = pendulum().energy([q, cycle.q], [p, cycle.p], parameters=PARAMETERS)
    assert abs(energy[1] - energy[0]) < 1e-13
    assert float(cycle.period) == pytest.approx(2.80500369297318, abs=1e-9)  # of order 4
    assert closed(cycle) < 1e-13
    assert np.prod(cycle.multipliers) == pytest.approx(1, abs=1e-12)
    assert "2.805" in repr(cycle)
    assert "2.805" in cycle._repr_html_()
    motion, multipliers = cycle.plot().axes
    assert motion.get_xlabel() == "t [s]"
    assert all(abs(np.ptp(line.get_ydata()[[0, -1]])) < 1e-13 for line in motion.get_lines())
    points = multipliers.collections[0].get_offsets()
    assert np.abs(points @ [1, 1j] - cycle.multipliers).max() < 1e-15


@pytest.mark.parametrize(("fix", "T"), [("energy", 2.0**30), ("x1", 2.0**-30)])
def test_orbits_do_not_depend_on_units(fix, T):
    """T seconds are another unit of time, in which momenta have 2^±30 of their size."""
    cycle, (q, p) = orbit(fix=fix), released(1.0, 1.4142 * 0.95)
    again = gs.periodic_orbit(pendulum(), q, p / T, dt=DT * T, steps=160,
                              parameters=PARAMETERS | {"g": PARAMETERS["g"] / T**2}, fix=fix)
    assert np.abs(np.r_[again.q - cycle.q, again.p * T - cycle.p]).max() < 1e-12  # round-off of B
    assert again.dt / T == pytest.approx(cycle.dt, rel=1e-12)
    assert again.iterations == cycle.iterations
    assert np.abs(again.multipliers - cycle.multipliers)[:2].max() < 1e-11
    end = again.run(every=again.steps)
    assert np.abs(end.p[1] - end.p[0]).max() * T < 1e-13
    assert np.abs(again.basis.T @ again.basis - np.eye(4)).max() < 1e-13
    assert np.trace(again.monodromy) == pytest.approx(np.trace(cycle.monodromy), abs=1e-6)


@pytest.mark.parametrize("fix", ["period", "x1"])
def test_others_of_the_family(fix):
    cycle, (q, _) = orbit(fix=fix), released(1.0, 1.4142 * 0.95)
    assert closed(cycle) < 1e-13
    assert (cycle.dt == DT) if fix == "period" else abs(cycle.q[0] - q[0]) < 1e-13


@pytest.mark.parametrize(("free", "value"), [("l", 1.1082591), ("g", 9.2234015)])
def test_free_parameter(free, value):
    """The energy and the period stay: the lower rod gets another length, or both other weights."""
    cycle = orbit(fix=("energy", "period"), free=free)
    assert cycle.dt == DT
    assert cycle.iterations <= 5  # the digits double
    assert cycle.parameters[free] == pytest.approx(value, abs=1e-6)
    assert closed(cycle) < 1e-13


def test_large_steps():
    """A discrete family is pairs of orbits: with 18 steps the search ends at a saddle."""
    cycle = orbit(dt=160 / 18 * DT, steps=18)
    assert cycle.residuals[-1] < 1e-13
    product = cycle.multipliers[np.abs(cycle.multipliers.imag) < 1e-9].real
    assert len(product) == 2
    assert product.max() > 1.01
    assert product.prod() == pytest.approx(1, abs=1e-9)


def test_a_scheme_that_does_not_keep_the_momentum_constraint():
    """Multipliers are of the map of angles and their rates, by differences of projected runs."""
    step = pendulum("EMS", None)
    cycle = orbit(step)
    assert cycle.iterations <= 6
    assert cycle.residuals[-1] < 1e-13

    def rods(x):  # of two points: from the pivot, and from the first to the second
        return x.reshape(2, 2) - [[0, 0], x[:2]]

    def angles(q, p):
        d, v = rods(q), rods(p)  # of mass 1
        return np.append(np.arctan2(d[:, 0], -d[:, 1]), d[:, 0] * v[:, 1] - d[:, 1] * v[:, 0])

    def end_of(y):
        q = np.stack([np.sin(y[:2]), -np.cos(y[:2])], axis=1)
        v = -q[:, ::-1] * [1, -1] * y[2:, None]
        run = step.integrate(np.cumsum(q, axis=0).ravel(), np.cumsum(v, axis=0).ravel(),
                             dt=cycle.dt, steps=cycle.steps, parameters=PARAMETERS)
        return angles(*step.project(run.q[-1], run.p[-1], parameters=PARAMETERS))

    start, h = angles(cycle.q, cycle.p), 1e-5
    assert end_of(start) == pytest.approx(start, abs=1e-11)
    M = np.array([(end_of(start + e) - end_of(start - e)) / (2 * h) for e in h * np.eye(4)]).T
    multiplier = max(np.linalg.eigvals(M), key=np.imag)
    assert multiplier == pytest.approx(max(cycle.multipliers, key=np.imag), abs=1e-7)


@pytest.mark.slow  # three seconds in float128
def test_many_digits():
    """In float128 iterations go on to where the orbits of the discrete family differ."""
    cycle = orbit(pendulum(stages=3, real="float128"))
    assert cycle.residuals[-1] < 1e-25
    assert np.abs(cycle.multipliers[:2].real + 0.98739271).max() < 1e-7


def test_limit_cycle():
    """Van der Pol's oscillator keeps nothing; its cycle attracts with exp(−7.06) a period."""
    q, p, mu = *sp.symbols("q p", real=True), sp.Symbol("mu", real=True)
    system = gs.System((q,), (p,), (mu,), (p**2 + q**2) / 2, forces=[mu * (1 - q**2) * p],
                       name="van_der_pol")
    step = gs.stepper("G-L", 2, system=system)
    cycle = gs.periodic_orbit(step, [2.0], [0.0], dt=6.5 / 400, steps=400, parameters={"mu": 1.0},
                              fix=None)
    assert float(cycle.period) == pytest.approx(6.66328686, abs=1e-7)  # Andersen, Geer 1982
    assert closed(cycle) < 1e-12
    assert cycle.multipliers[0] == pytest.approx(1, abs=1e-9)
    assert 0 < cycle.multipliers[1].real < 1e-3


def test_driven_oscillator():
    """x'' = −k x − c x' + f cos ωt has one orbit of the period of its force, an ellipse."""
    step, values = systems.differentiable("driven_oscillator"), systems.case(
        "driven_oscillator").parameters
    k, c, f, omega = (values[name] for name in ("k", "c", "f", "omega"))
    arguments = {"dt": 2 * np.pi / omega / 200, "steps": 200, "parameters": values}
    cycle = gs.periodic_orbit(step, [0.0], [0.0], fix="period", **arguments)
    exact = f / (k - omega**2 + 1j * c * omega)
    assert cycle.q[0] == pytest.approx(exact.real, abs=1e-8)
    assert cycle.p[0] == pytest.approx((1j * omega * exact).real, abs=1e-8)
    assert np.abs(cycle.multipliers) == pytest.approx(np.exp(-c * np.pi / omega), abs=1e-9)
    with pytest.raises(gs.InputError, match="period"):
        gs.periodic_orbit(step, [0.0], [0.0], **arguments)


def test_no_orbit():
    """The message has the number of iterations, or names the equilibrium that was reached."""
    with pytest.raises(gs.GyrosparkError, match="1 iteration"):
        orbit(max_iterations=1)
    with pytest.raises(gs.GyrosparkError, match="equilibrium"):
        gs.periodic_orbit(pendulum(), *released(0.01, 0.01), dt=0.01, steps=100,
                          parameters=PARAMETERS, fix="period")


@pytest.mark.parametrize(("change", "word"), [
    ({"fix": "enrgy"}, "energy"), ({"fix": 3}, "fix"), ({"free": "gg"}, "g"),
    ({"steps": 0}, "steps"), ({"max_iterations": 0}, "max_iterations"),
    ({"parameters": {"g": 9.81}}, "l"),
])
def test_bad_input_of_orbits(change, word):
    with pytest.raises(gs.InputError, match=word):
        orbit(**change)
