"""Certificates: properties that hold are confirmed, and those broken on purpose are found."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from functools import cache
from types import SimpleNamespace

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from command_line import EXAMPLE
from generic_systems import EXAMPLES
from gyrospark.certificates import certificate, measured_properties
from gyrospark.certificates.measurements import MeasuredOrder, measure_order, reversal, trend
from gyrospark.certificates.round_off import RoundOff
from gyrospark.generator.multibody.rigid_body import heavy_top
from strategies import EPS

LOOP, REVERSAL, G, F = "loop invariant", "reversal", "largest |g(q)|", "largest |g_q H_p|"
VERTICAL, FIGURE = "angular momentum about e3", "angular momentum about the body's axis 3"
TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": gs.gamma_m(TOP.inertia)}


@cache
def model_of(name):
    """Return one of the systems of test_generic_system.py as a model."""
    example = EXAMPLES[name]
    step = gs.stepper("G-L", 2, system=example.symbolic)
    q0, p0 = step.project(example.q, example.p, parameters=example.parameters)
    return gs.Model(example.symbolic, example.parameters, q0, p0, dt=0.01, steps=500)


def bent_tableau(folder, **changes):
    """Write Gauss-Lobatto 2 with some parts changed."""
    content = json.loads(EXAMPLE.read_text(encoding="utf-8")) | {"name": "bent"} | changes
    path = folder / "bent.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


#: 1e-4 in one entry of Â: no longer symplectic, hardly less accurate.
BENT = {"A_hat": [["1/4 + 1/10000", "1/4 - sqrt(3)/6"], ["1/4 + sqrt(3)/6", "1/4"]]}


def verdicts(certificate):
    return {line.quantity: line.holds for line in certificate.lines}


# ---------------------------------------------------------------- the compiled system


@pytest.mark.parametrize("wrong", [
    "mass", "constraint", *(pytest.param(part, marks=pytest.mark.slow)
                            for part in ("potential", None))])  # a stepper each
def test_a_stepper_of_another_system_is_found(wrong, monkeypatch):
    """All that is measured of such a stepper holds: only the model's expressions tell."""
    known = pendulum()
    x, y = known.system.q
    (m, g), H, constraints = known.system.parameters, known.system.H, known.system.constraints
    made = gs.System((x, y), known.system.p, (m, g), {
        "potential": H - 2 * m * g * y, "mass": H + known.system.p[0]**2 * 1e-9}.get(wrong, H),
        constraints=[constraints[0] + (1e-9 if wrong == "constraint" else 0)], name="pendulum")
    compiled = gs.stepper("G-L", 2, system=made)
    monkeypatch.setattr(certificate, "compiled", lambda *_, **__: (known, compiled))
    if wrong == "constraint":  # at a start on its own constraint, which is off by less than is seen
        known = gs.Model(known.system, known.parameters, *compiled.project(
            known.q0, known.p0, parameters=known.parameters), dt=known.dt, steps=known.steps)
    found = verdicts(gs.certify(known, "G-L", 2))
    line = found.pop("compiled H, H_p, H_q − F, g")
    assert line is (wrong is None)
    assert False not in found.values()


# ---------------------------------------------------------------- what holds


@pytest.mark.parametrize(("scheme", "stages", "rep"), [
    ("G-L", 2, "gamma"), *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("G-L", 1, "alpha"), ("G-L", 3, "gamma"), ("G-L", 3, "alpha"), ("LIIIA-B", 4, "gamma"),
        ("LIIIA-B", 4, "alpha")))])
def test_spark_on_the_fast_top(scheme, stages, rep):
    found = gs.certify(TOP, scheme, stages, rep=rep)
    assert found.holds
    assert found.model == "fast-top"
    assert (found.dt, found.steps) == (1e-3, 1000)
    for quantity in (LOOP, REVERSAL, G, F, VERTICAL, FIGURE, "order"):
        line = found.line(quantity)
        assert line.holds is True, line
        assert line.value <= line.bound
    assert found.line("energy").holds is None
    assert found.line(LOOP).value <= 1e-12
    assert abs(found.line("order").value) < 0.1


@pytest.mark.slow
def test_a_chain_whose_motion_parts_neighbours():
    """Five rods stretch a loop a thousandfold: only a small one is still resolved at the end."""
    found = gs.certify(gs.models.chain(5), "G-L", 2, steps=1000)
    assert found.holds
    assert found.line(LOOP).value <= 1e-13


def test_ems_on_the_fast_top():
    """Energy is its promise; the loop invariant strays, and that is no failure."""
    found = gs.certify(TOP, "EMS")
    assert found.holds
    assert found.line("energy").holds is True
    assert found.line(LOOP).holds is None
    assert found.line(LOOP).value > 1e-9
    assert "project" in found.line(LOOP).why
    assert found.line(F).holds is None
    assert found.line(VERTICAL).holds is True  # D turns about the vertical as the gradient does
    assert found.line(FIGURE).holds is None
    assert found.line(FIGURE).value > 1e-9


def test_ims_on_the_fast_top():
    found = gs.certify(TOP, "IMS")
    assert found.holds
    assert found.line(LOOP).holds is None
    assert found.line(FIGURE).holds is True  # bilinear, and g_q X = 0 everywhere
    assert found.line("energy").holds is None


@pytest.mark.slow  # a stepper of its own
def test_ims_without_constraints_is_symplectic():
    found = gs.certify(model_of("oscillator"), "IMS")
    assert found.line(LOOP).holds is True
    assert G not in "".join(verdicts(found))


@pytest.mark.parametrize(("name", "scheme", "stages"), [
    ("oscillator", "LIIIA-B", 3), ("pendulum", "EMS", None),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("pendulum", "G-L", 2), ("runner", "G-L", 2), ("oscillator", "G-L", 2),
        ("pendulum", "LIIIA-B", 3), ("runner", "LIIIA-B", 3), ("runner", "EMS", None),
        ("oscillator", "EMS", None)))])
@pytest.mark.slow  # 3 CPU s; other cases run all its branches
def test_any_system(name, scheme, stages):
    found = gs.certify(model_of(name), scheme, stages)
    assert found.holds, [line for line in found.lines if line.holds is False]
    assert found.line("order").holds is True
    assert found.line("momentum maps").found == "none"
    assert (found.line(LOOP).holds is True) == (scheme != "EMS")
    assert (found.line("energy").holds is True) == (scheme == "EMS")


@pytest.mark.slow  # a stepper of its own
def test_spherical_double_pendulum():
    """Two rods in space: ∮p·dq, the vertical angular momentum, and the user's own quantity."""
    names = [f"{c}{i}" for i in (1, 2) for c in "xyz"]
    q = tuple(sp.Symbol(name, real=True) for name in names)
    p = tuple(sp.Symbol(f"p{name}", real=True) for name in names)
    m, g = sp.symbols("m g", positive=True)
    H = sum(x**2 for x in p) / (2 * m) + m * g * (q[2] + q[5])
    rods = (sum(x**2 for x in q[:3]) - 1,
            sum((a - b) ** 2 for a, b in zip(q[:3], q[3:], strict=True)) - 1)
    system = gs.System(q, p, (m, g), H, rods, name="rods", quantities={"height": q[2] + q[5]})
    start = [0.6, 0, -0.8, 0.6, 0.8, -1.4]
    step = gs.stepper("G-L", 2, system=system)
    values = {"m": 1.0, "g": 9.81}
    q0, p0 = step.project(start, [0.1, 1, 0, 0.3, 0.2, 0.5], parameters=values)
    found = gs.certify(gs.Model(system, values, q0, p0, dt=0.005, steps=100),
                       "G-L", 2)
    assert found.stepper == "rods_gl2"
    assert found.holds
    assert found.line(LOOP).holds is True
    assert found.line(VERTICAL).holds is True
    height = found.line("height")
    assert height.holds is None
    assert height.value > 0.1


@pytest.mark.parametrize("moment", [2, mp.mpf("0.0012"), Fraction(3, 2500)])
def test_parameters_of_any_type(moment):
    """Judged is the double that the run took."""
    found = gs.certify(TOP, "G-L", 2, steps=20, parameters={"I2": moment})
    assert found.holds
    assert found.parameters["I2"] == float(moment)


# ---------------------------------------------------------------- at rest where one looks


def pendulum(at_rest: bool = False):
    """Return a pendulum of 1 rad, 100 steps a period from rest; or hanging down, at rest."""
    (x, y), (u, v) = sp.symbols("x y", real=True), sp.symbols("u v", real=True)
    m, g = sp.symbols("m g", positive=True)
    system = gs.System((x, y), (u, v), (m, g), (u**2 + v**2) / (2 * m) + m * g * y,
                       (x**2 + y**2 - 1,), name="rod")
    angle = 0.0 if at_rest else 1.0
    period = 4 * np.pi / 2 / np.sqrt(9.81) / agm(1.0, np.cos(0.5))
    return gs.Model(system, {"m": 1.0, "g": 9.81}, [np.sin(angle), -np.cos(angle)], [0.0, 0.0],
                    dt=period / 100, steps=200)


def agm(a, b):
    """Return the arithmetic-geometric mean: K(k) = π/2/agm(1, √(1 − k²))."""
    for _ in range(6):
        a, b = (a + b) / 2, np.sqrt(a * b)
    return a


@pytest.mark.parametrize(("scheme", "stages"), [("G-L", 2), ("EMS", None)])
def test_rest_at_the_start_in_the_middle_and_at_the_end(scheme, stages):
    """|g_q H_p| is that of the motion, not of three instants at which there is none."""
    found = gs.certify(pendulum(), scheme, stages)
    assert found.holds, [line for line in found.lines if line.holds is False]
    line = found.line(F)
    if stages:
        assert 1e-17 < line.value < 1e-14
        assert 1e-15 < line.bound < 1e-12
    assert found.line("energy").holds is (None if stages else True)  # H and g are quadratic


@pytest.mark.parametrize(("scheme", "stages"), [("G-L", 2), ("EMS", None)])
def test_equilibrium(scheme, stages):
    """Nothing moves: the scale is that of forces in balance, and no order can be seen."""
    found = gs.certify(pendulum(at_rest=True), scheme, stages)
    assert found.holds
    assert all(line.bound > 0 for line in found.lines if line.holds)
    assert found.line("order").found == "errors are round-off"


@pytest.mark.parametrize("size", [1e-6, 1e-9])
def test_energy_of_a_small_swing(size):
    """1 − cos θ is worth ε, however small θ is: EMS is not accused of it."""
    t, p = sp.symbols("t p", real=True)
    system = gs.System((t,), (p,), (), p**2 / 2 + 9 * (1 - sp.cos(t)), name="small")
    found = gs.certify(gs.Model(system, {}, [size], [0.0], dt=0.01, steps=200), "EMS")
    energy = found.line("energy")
    assert energy.holds is True
    assert energy.value < energy.bound < 1e-12


@pytest.mark.parametrize("start", [([0, 0], [0, 0]), ([1e6, 0], [1, 0])])
def test_a_free_particle(start):
    """At the origin, through it, far from it; at rest and not."""
    (x, y), (u, v) = sp.symbols("x y", real=True), sp.symbols("u v", real=True)
    system = gs.System((x, y), (u, v), (), (u**2 + v**2) / 2, name="particle")
    found = gs.certify(gs.Model(system, {}, *start, dt=0.01, steps=100), "G-L", 2)
    assert found.holds
    assert found.line("momentum u").holds is True
    assert found.line(LOOP).holds is True
    assert found.line("energy").holds is True


def test_sliding_in_a_plane():
    """g = z, and z stays 0 but for what rounding of the weight does to it."""
    q, p = sp.symbols("x y z", real=True), sp.symbols("u v w", real=True)
    system = gs.System(q, p, (), sum(e**2 for e in p) / 2 + 9.81 * q[2], (q[2],), name="table")
    found = gs.certify(gs.Model(system, {}, [0, 0, 0], [1, 0, 0], dt=0.01, steps=100), "G-L", 2)
    assert found.holds
    assert found.line(G).bound < 1e-15


@pytest.mark.slow  # a stepper of its own
def test_a_start_within_round_off_is_not_held_against_the_scheme():
    """|q|² − 1 = 30 ε at the start is allowed; the first step takes it back."""
    top = gs.problems.fast_top()
    q0 = np.array(top.q0) * (1 + 15 * EPS)
    known = gs.Model(heavy_top("gamma"), PARAMETERS, q0, top.p0, dt=1e-3, steps=20)
    found = gs.certify(known, "G-L", 2)
    assert found.line(G).value < 4 * EPS


@pytest.mark.parametrize("dt", [0.01])
def test_high_orders_are_seen_above_round_off(dt):
    """Order 8 on the pendulum: errors from 1e-5 to 1e-12 of the state show it."""
    order = gs.certify(pendulum(), "G-L", 4, dt=dt, steps=20).line("order")
    assert order.holds is True
    assert abs(order.value) < 0.05


def test_slopes_that_differ_are_reported():
    order = gs.certify(pendulum(), "G-L", 6, dt=0.02, steps=20).line("order")
    assert order.holds is None
    assert order.found.startswith("slopes 11.")


# ---------------------------------------------------------------- what does not


def test_a_tableau_that_is_not_symplectic_fails(tmp_path):
    """The certificate can fail: a tableau off by 1e-4 in one condition."""
    path = bent_tableau(tmp_path, **BENT)
    with pytest.raises(gs.TableauError):
        gs.certify(TOP, tableau=path)
    found = gs.certify(TOP, tableau=path, allow_invalid=True)
    assert not found.holds
    loop = found.line(LOOP)
    assert loop.holds is False
    assert loop.value > 1e3 * loop.bound
    assert "b_i â_ij" in loop.why
    assert found.line(VERTICAL).holds is False
    assert found.line(G).holds is True  # constraints are solved by any tableau
    assert found.line(REVERSAL).holds is None
    sound = gs.certify(TOP, tableau=EXAMPLE)
    assert sound.holds


@pytest.mark.slow  # exact algebra refutes the same in test_certificate_pairs.py
def test_a_tableau_with_two_kinds_of_weights_fails(tmp_path):
    path = bent_tableau(tmp_path, b_hat=["501/1000", "499/1000"])
    found = gs.certify(model_of("oscillator"), tableau=path, allow_invalid=True)
    assert found.line(LOOP).holds is False


@pytest.mark.slow  # exact algebra refutes the same in test_certificate_pairs.py
def test_a_projection_that_is_not_symplectic_fails(tmp_path):
    """Ã off: of the constraint forces alone, so that a system without constraints is not hurt."""
    changes = {"A_tilde": [["1/6 + 1/1000", "1/3 - sqrt(3)/6 - 1/1000", 0],
                           ["1/6", "1/3 + sqrt(3)/6", 0]]}
    path = bent_tableau(tmp_path, **changes)
    assert gs.certify(TOP, tableau=path, allow_invalid=True).line(LOOP).holds is False
    free = gs.certify(model_of("oscillator"), tableau=path, allow_invalid=True)
    assert free.line(LOOP).holds is True


@pytest.mark.filterwarnings("ignore:The fastest rotation")
def test_steps_too_long_are_no_certificate():
    with pytest.raises(gs.StepFailed):
        gs.certify(TOP, "G-L", 2, dt=1.0, steps=10)


# ---------------------------------------------------------------- the measurements


def test_reversal_of_a_method_that_is_not_symmetric(tmp_path):
    """The error of the way there and back is far above its bound for a bent tableau."""
    sizes = []
    for step in (gs.stepper("G-L", 2),
                 gs.stepper(tableau=bent_tableau(tmp_path, **BENT), allow_invalid=True)):
        run = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=200, parameters=PARAMETERS)
        back = reversal(step, run, PARAMETERS, (1.0, 0.2))
        assert 1 <= back.growth < 1e3
        sizes.append(back.q_error)
    assert sizes[0] < 1e-12 < 1e-5 < sizes[1]


def test_order_of_each_scheme():
    for scheme, stages in (("G-L", 2), ("G-L", 3), ("EMS", None)):
        step = gs.stepper(scheme, stages)
        seen = measure_order(step, TOP.q0, TOP.p0, 1e-3, PARAMETERS, lambda h: (1.0, 0.2))
        assert abs(seen.order - step.order) < 0.1, (scheme, stages, seen)


class Ladder:
    """A stepper whose end, after T, is off by a given law of the step and T."""

    binding = SimpleNamespace(epsilon=EPS)

    def __init__(self, law):
        self.law = law

    def integrate(self, q, p, *, dt, steps, **_):
        return SimpleNamespace(q=np.array([[1.0 + self.law(dt, steps * dt)]]), p=np.array([[1.0]]))


@pytest.mark.parametrize(("law", "dt", "order"), [
    (lambda h, T: h**6 + 0.1 * h**8, 0.2, 6),
    # A double pendulum's 3-G-L: slopes 6.4, 6.01, 6.00 at long steps, round-off at shorter ones.
    (lambda h, T: (T / 0.53) ** 6 * 60 * h**6 * (1 + 1.1e6 * h**6), 0.01, 6),
    (lambda h, T: 60 * h**6 - 4.6e7 * h**12, 0.4, 6),
    (lambda h, T: 1e3 * h**8 + 1e5 * h**12, 0.4, 8),
    # The error of multipliers' round-off, 1/h, is no order, nor is a plateau.
    (lambda h, T: h**2 + 1e-9 / h * math.sin(1e5 * h), 0.1, 2),
    (lambda h, T: h**4 + 1e-10 * math.sin(1e6 * h), 0.1, 4),
])
def test_two_slopes_that_agree_are_found(law, dt, order):
    seen = measure_order(Ladder(law), np.ones(1), np.ones(1), dt, {}, lambda h: (1.0, 1.0))
    assert seen.spread <= 0.2
    assert seen.order == pytest.approx(order, abs=0.1)


@pytest.mark.parametrize(("seen", "found"), [
    (MeasuredOrder(6.19, 4.02, 0.02, (10.21, 6.19)), "slopes 10.21, 6.19"),
    (None, "errors are round-off"),
    (MeasuredOrder(5.95, 0.11, 0.02, (6.4, 5.84, 5.95)), "5.95 at Δt = 0.02"),
])
def test_what_is_said_of_the_slopes(monkeypatch, seen, found):
    """All that were seen, where no two agree; nothing is said against the method."""
    monkeypatch.setattr(measured_properties, "measure_order", lambda *_: seen)
    run = SimpleNamespace(q=[0], p=[0], dt=0.1)
    measured = SimpleNamespace(step=SimpleNamespace(order=6), run=run, parameters={},
                               round_off=SimpleNamespace(sizes_of_steps=None),
                               switching=SimpleNamespace(named=""), decay=0.0)
    line = measured_properties.Examination._order(measured)
    assert line.found == found
    assert line.holds in (None, True)


def test_round_off_of_a_run():
    """Σ_i |∂g/∂q_i| r_i and Σ_i |∂f/∂q_i| r_i + |∂f/∂p_i| s_i of |q|² − 1 and qᵀp, over the run."""
    step = gs.stepper("G-L", 2)
    run = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=300, parameters=PARAMETERS)
    rounded = RoundOff(heavy_top("gamma"), run, PARAMETERS, step)
    q, p, r, s = np.abs(run.q), np.abs(run.p), rounded.q_sizes, rounded.p_sizes
    assert (r >= q.max(axis=0)).all()
    assert (s >= p.max(axis=0)).all()
    (g,), (f,) = rounded.constraints
    assert g == pytest.approx((2 * q * r).sum(axis=1).max(), rel=1e-3)
    assert f == pytest.approx((p * r + q * s).sum(axis=1).max(), rel=1e-3)
    assert rounded.walk == EPS * 4 * 300**0.5


def test_trend_of_a_line_and_a_wave():
    t = np.linspace(0, 3, 301)
    assert trend(t, 2 + 5 * t) == pytest.approx((15.0, 0.0), abs=64 * EPS * 15)
    slope, swing = trend(t, np.cos(2 * np.pi * t))
    assert abs(slope) < 0.1
    assert swing == pytest.approx(2.0, abs=0.1)


# ---------------------------------------------------------------- arguments


def test_arguments_are_refused_in_words():
    with pytest.raises(gs.InputError, match=r"no gyrospark\.Model"):
        gs.certify("fast-top", "EMS")
    with pytest.raises(gs.InputError, match="rep"):
        gs.certify(model_of("oscillator"), "EMS", rep="gamma")
    example = EXAMPLES["oscillator"]
    without = gs.Model(example.symbolic, {}, example.q, example.p)
    with pytest.raises(gs.InputError, match="give dt"):
        gs.certify(without, "EMS")
    with pytest.raises(gs.InputError, match="'mgl2'"):
        gs.certify(TOP, "EMS", parameters={"mgl2": 1.0})
    with pytest.raises(gs.InputError, match="steps"):
        gs.certify(TOP, "EMS", steps=0)


def test_single_precision_is_held_to_its_own_rounding():
    """The same lines as in double; what round-off bounds is 2²⁹ times as large."""
    found = {real: gs.certify(TOP, "G-L", 2, steps=100, real=real) for real in ("double", "float")}
    assert found["float"].stepper == "heavy_top_gl2_gamma_float"
    assert found["float"].holds
    for name in (LOOP, REVERSAL, G, F, VERTICAL, FIGURE):
        lines = [found[real].line(name) for real in ("double", "float")]
        assert [line.holds for line in lines] == [True, True], name
        if name != REVERSAL:  # of which the growth of errors is measured too
            assert lines[1].bound == pytest.approx(2**29 * lines[0].bound, rel=1e-3)
        assert lines[1].value > 2**9 * lines[0].value  # it is measured in that type


@pytest.mark.parametrize("real", ["long-double", "float128"])
def test_more_digits_than_a_double_are_refused(real):
    with pytest.raises(gs.InputError, match=f"real = '{real}'.*double"):
        gs.certify(TOP, "G-L", 2, real=real)
    with pytest.raises(gs.InputError, match=r"half.*float128"):
        gs.certify(TOP, "G-L", 2, real="half")


def test_own_parameters_and_steps():
    found = gs.certify(TOP, "EMS", parameters={"gamma": 0.002}, dt=5e-4, steps=50)
    assert found.parameters["gamma"] == 0.002
    assert (found.dt, found.steps) == (5e-4, 50)
    assert gs.certify(TOP, "EMS", steps=50).parameters["gamma"] == gs.gamma_m(TOP.inertia)


# ---------------------------------------------------------------- forces


def swing(torque, **more):
    """Return a spherical pendulum of one mass in Cartesian coordinates with a force on it."""
    q, p = sp.symbols("x y z", real=True), sp.symbols("px py pz", real=True)
    c, t = sp.Symbol("c", positive=True), sp.Symbol("t", real=True)
    forces = {"drag": [-c * x for x in p], "turned": [-c * q[1], c * q[0], 0],
              "pumped": [0, 0, c * sp.cos(3 * t)]}[torque]
    system = gs.System(q, p, (c,), sum(x**2 for x in p) / 2 + 9 * q[2],
                       (sum(x**2 for x in q) - 1,), name=torque, forces=forces, time=t)
    return gs.Model(system, {"c": 0.3}, [0.6, 0, -0.8], [0.0, 1.0, 0.0], dt=0.01, steps=300)


@pytest.mark.parametrize(("torque", "scheme", "stages"), [
    ("pumped", "G-L", 2),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ("drag", "EMS", None), ("turned", "G-L", 2),
        ("drag", "G-L", 2), ("turned", "EMS", None), ("pumped", "EMS", None)))])
def test_forces(torque, scheme, stages):
    """No loop invariant without a gradient; constraints, reversal and EMS's energy are kept."""
    found = gs.certify(swing(torque), scheme, stages)
    assert found.holds, [line for line in found.lines if line.holds is False]
    if torque == "pumped":  # a force of t alone is a gradient at every instant
        assert found.line(LOOP).holds is (True if stages else None)
    else:
        assert found.line(LOOP).holds is None
        assert found.line(LOOP).value > 1e-6
    assert found.line(REVERSAL).holds is True
    assert found.line(G).holds is True
    energy = found.line("energy H less work")
    assert energy.holds is (True if scheme == "EMS" else None)
    maps = [line for line in found.lines if line.quantity == VERTICAL]
    assert len(maps) == (torque == "pumped")  # a vertical force does not turn
    if maps and stages:
        assert maps[0].holds is True
