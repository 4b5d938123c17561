"""Certificates confirm properties that hold, and detect properties that a test breaks."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from command_line import EXAMPLE
from gyrospark.certificates import certificate, measured_properties
from gyrospark.certificates.guarantees import SparkGuarantees
from gyrospark.certificates.measurements import MeasuredOrder, measure_order, reversal, trend
from gyrospark.certificates.momentum_maps import momentum_maps
from gyrospark.certificates.round_off import RoundOff
from gyrospark.generator.multibody.rigid_body import heavy_top
from rolling_systems import (
    SKATE_CHAIN,
    SKATE_CHAIN_START,
    SLEIGH,
    skate_chain,
    sleigh,
    sleigh_state,
    transmission,
)
from strategies import EPS

LOOP, REVERSAL, G, F = "loop invariant", "reversal", "largest |g(q)|", "largest |g_q H_p|"
VERTICAL, FIGURE = "angular momentum about e3", "angular momentum about the body's axis 3"
TOP = gs.problems.fast_top()
PARAMETERS = TOP.parameters | {"gamma": gs.gamma(TOP.inertia)}


def model_of(name, **changes):
    """Return a case of the catalogue as a model, at its projected start."""
    case, step = systems.case(name), systems.stepper(name)
    parameters = dict(case.parameters) | changes.pop("parameters", {})
    q, p = step.project(changes.pop("q", case.q), changes.pop("p", case.p), parameters=parameters)
    return gs.Model(case.system, parameters, q, p, **{"dt": case.dt, "steps": 100} | changes)


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


@pytest.mark.parametrize("wrong", ["mass", "constraint", None])
def test_a_stepper_of_another_system_is_found(wrong, monkeypatch):
    """All measurements of such a stepper hold: only the model's expressions show the difference."""
    compiled, model = systems.stepper("pendulum"), model_of("pendulum")
    system = model.system
    changes = {"mass": {"H": system.H + system.p[0]**2 * 1e-9}, "constraint": {
        "constraints": (system.constraints[0] + 1e-9,)}}.get(wrong, {})
    # The start is on the compiled constraint, which is off by less than is seen.
    changed_model = replace(model, system=replace(system, **changes))
    monkeypatch.setattr(certificate, "compile_model", lambda *_, **__: (changed_model, compiled))
    lines = verdicts(gs.certify(changed_model, "G-L", 2))
    assert lines.pop("compiled H, H_p, H_q − F, g") is (wrong is None)
    assert False not in lines.values()


# ---------------------------------------------------------------- what holds


def test_spark_on_the_fast_top():
    certificate = gs.certify(TOP, "G-L", 2)
    assert certificate.holds
    assert certificate.model == "fast-top"
    assert (certificate.dt, certificate.steps) == (1e-3, 1000)
    for quantity in (LOOP, REVERSAL, G, F, VERTICAL, FIGURE, "order"):
        line = certificate.line(quantity)
        assert line.holds is True, line
        assert line.value <= line.bound
    assert certificate.line("energy").holds is None
    assert certificate.line(LOOP).value <= 1e-12
    assert abs(certificate.line("order").value) < 0.1


def test_ems_on_the_fast_top():
    """EMS promises the energy; the loop invariant strays, and that is no failure."""
    certificate = gs.certify(TOP, "EMS")
    assert certificate.holds
    assert certificate.line("energy").holds is True
    assert certificate.line(LOOP).holds is None
    assert certificate.line(LOOP).value > 1e-9
    assert "project" in certificate.line(LOOP).why
    assert certificate.line(F).holds is None
    assert certificate.line(VERTICAL).holds is True  # D turns about the vertical as ∇H does
    assert certificate.line(FIGURE).holds is None
    assert certificate.line(FIGURE).value > 1e-9


def test_ems_in_a_frame_that_turns_with_the_top():
    """Compiled H is the model's, without rates; H − Σ ω_i J_i is constant, and not each J_i."""
    certificate = gs.certify(TOP, "EMS", frame="symmetries", steps=20)
    assert certificate.holds
    assert certificate.line("compiled").holds is True
    assert certificate.parameters["omega_body"] > 100
    assert certificate.line("energy H").holds is None
    assert "angular momentum about the body's axis 3" in certificate.line("energy H").why
    assert certificate.line("energy in the frame").holds is True


def test_a_composition_on_the_fast_top():
    """Each line holds as measured; without V the step is one exact flow."""
    for changes, further in (({}, {FIGURE}), ({"mgl": 0}, {
            FIGURE, "angular momentum about e1", "angular momentum about e2", "energy H"})):
        certificate = gs.certify(TOP, order=4, steps=20, parameters=changes)
        assert certificate.holds
        assert {line.quantity for line in certificate.lines if line.holds} >= {VERTICAL, *further}
        assert (certificate.line("energy").holds is True) is ("energy H" in further)
        for quantity in (LOOP, REVERSAL, G, F):
            assert certificate.line(quantity).holds, quantity


def test_own_parameters_of_any_type_and_steps():
    """The certificate names the doubles with which the run was computed."""
    moments = {"I1": Fraction(3, 2500), "I2": mp.mpf("0.0012"), "mgl": 1, "gamma": 0.002}
    certificate = gs.certify(TOP, "G-L", 2, steps=20, dt=5e-4, parameters=moments)
    assert certificate.holds
    assert {name: certificate.parameters[name] for name in moments} == {
        name: float(value) for name, value in moments.items()}
    assert (certificate.dt, certificate.steps) == (5e-4, 20)
    assert gs.certify(TOP, "EMS", steps=20).parameters["gamma"] == gs.gamma(TOP.inertia)


# ---------------------------------------------------------------- at rest where one looks


@pytest.mark.parametrize(("scheme", "stages"), [("G-L", 2), ("EMS", None)])
def test_rest_at_the_start_in_the_middle_and_at_the_end(scheme, stages):
    """The size of |g_q H_p| comes from the motion, not from three instants of rest."""
    dt = float(mp.ellipk(mp.sin(0.5)**2)) / 25  # 100 steps a period from rest at 1 rad
    certificate = gs.certify(model_of("pendulum", dt=dt, steps=200), scheme, stages)
    assert certificate.holds, [line for line in certificate.lines if line.holds is False]
    line = certificate.line(F)
    if stages:
        assert 1e-17 < line.value < 1e-14
        assert 1e-15 < line.bound < 1e-12
    assert certificate.line("energy").holds is (None if stages else True)  # H and g are quadratic
    assert certificate.line("momentum maps").found == "none"
    tension = certificate.line("tension")  # of the user
    assert tension.holds is None
    assert tension.value > 0.1


@pytest.mark.parametrize(("scheme", "stages", "x"), [
    ("G-L", 2, 0.0), ("G-L", 2, 1e-16), ("EMS", None, 0.0)])
def test_equilibrium(scheme, stages, x):
    """The system rests: scales come from forces and terms of H, and no order can be measured.

    The loop of starts is as large as these also where the motion is round-off.
    """
    certificate = gs.certify(model_of("pendulum", q=(x, -1.0)), scheme, stages)
    assert float(certificate.line("loop invariant").found.split(",")[0]) > 1e-3
    assert certificate.holds
    assert all(line.bound > 0 for line in certificate.lines if line.holds)
    assert certificate.line("order").found == "errors are round-off"


def test_energy_of_a_small_swing():
    """1 − cos θ is worth ε, however small θ is: EMS is not accused of it."""
    system = systems.case("swing").system
    certificate = gs.certify(gs.Model(system, {}, [1e-9], [0.0], dt=0.01, steps=100), "EMS")
    energy = certificate.line("energy")
    assert energy.holds is True
    assert energy.value < energy.bound < 1e-12


@pytest.mark.slow  # a stepper of one system
@pytest.mark.parametrize("start", [([0, 0], [0, 0]), ([1e6, 0], [1, 0])])
def test_a_free_particle(start):
    """The particle is at the origin, passes it, or is far from it; at rest and not."""
    (x, y), (u, v) = sp.symbols("x y", real=True), sp.symbols("u v", real=True)
    system = gs.System((x, y), (u, v), (), (u**2 + v**2) / 2, name="particle")
    certificate = gs.certify(gs.Model(system, {}, *start, dt=0.01, steps=100), "G-L", 2)
    assert certificate.holds
    assert certificate.line("momentum u").holds is True
    assert certificate.line(LOOP).holds is True
    assert certificate.line("energy").holds is True


@pytest.mark.slow  # a stepper of one system
def test_sliding_in_a_plane():
    """With g = z, z stays 0 up to the rounding of the weight."""
    q, p = sp.symbols("x y z", real=True), sp.symbols("u v w", real=True)
    system = gs.System(q, p, (), sum(e**2 for e in p) / 2 + 9.81 * q[2], (q[2],), name="table")
    certificate = gs.certify(gs.Model(system, {}, [0, 0, 0], [1, 0, 0], dt=0.01, steps=100), "G-L",
                             2)
    assert certificate.holds
    assert certificate.line(G).bound < 1e-15


def test_a_start_within_round_off_is_not_held_against_the_scheme():
    """|q|² − 1 = 30 ε at the start is allowed; the first step takes it back."""
    model = model_of("pendulum")
    displaced = replace(model, q0=np.array(model.q0) * (1 + 15 * EPS))
    assert gs.certify(displaced, "G-L", 2, steps=20).line(G).value < 4 * EPS


# ---------------------------------------------------------------- what does not


def test_a_tableau_that_is_not_symplectic_fails(tmp_path):
    """A certificate fails if a tableau is off by 1e-4 in one condition."""
    path = bent_tableau(tmp_path, **BENT)
    with pytest.raises(gs.errors.TableauError):
        gs.certify(TOP, tableau=path)
    certificate = gs.certify(TOP, tableau=path, allow_invalid=True, steps=200)
    assert not certificate.holds
    loop = certificate.line(LOOP)
    assert loop.holds is False
    assert loop.value > 1e3 * loop.bound
    assert "b_i â_ij" in loop.why
    assert certificate.line(VERTICAL).holds is False
    assert certificate.line(G).holds is True  # constraints are solved by any tableau
    assert certificate.line(REVERSAL).holds is None


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
        measured = reversal(step, run, PARAMETERS, (1.0, 0.2))
        assert 1 <= measured.growth < 1e3
        sizes.append(measured.q_error)
    assert sizes[0] < 1e-12 < 1e-5 < sizes[1]


def test_neighbours_of_an_oscillation_stay_neighbours():
    """They turn in the plane of x and p/2, and distances are the larger of the two."""
    step, case = systems.stepper("oscillator"), systems.case("oscillator")
    run = step.integrate(case.q, case.p, dt=case.dt, steps=200, parameters=case.parameters)
    assert 1 <= reversal(step, run, case.parameters, (1.0, 2.0)).growth <= math.sqrt(2) + 1e-6


def test_order_of_each_scheme():
    for scheme, stages in (("G-L", 2), ("EMS", None)):
        step = gs.stepper(scheme, stages)
        measured = measure_order(step, TOP.q0, TOP.p0, 1e-3, PARAMETERS, lambda h: (1.0, 0.2))
        assert abs(measured.order - step.order) < 0.1, (scheme, stages, measured)


class Ladder:
    """A stepper whose end, after T, is off by a given law of the step and T."""

    binding = SimpleNamespace(epsilon=EPS, clocked=False)

    def __init__(self, law):
        self.law = law

    def integrate(self, q, p, *, dt, steps, **_):
        unscaled = SimpleNamespace(system=SimpleNamespace(clock=None))
        return SimpleNamespace(q=np.array([[1.0 + self.law(dt, steps * dt)]]), p=np.array([[1.0]]),
                               manifest=unscaled)


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
    measured = measure_order(Ladder(law), np.ones(1), np.ones(1), dt, {}, lambda h: (1.0, 1.0))
    assert measured.spread <= 0.2
    assert measured.order == pytest.approx(order, abs=0.1)


def test_the_search_for_slopes_ends_where_they_agree_and_where_a_step_fails():
    def first_steps(law):
        ladder, first = Ladder(law), []
        integrate = ladder.integrate

        def counted(q, p, *, dt, steps, **options):
            first.extend([dt] * (steps == 8))
            return integrate(q, p, dt=dt, steps=steps, **options)

        ladder.integrate = counted
        order = measure_order(ladder, np.ones(1), np.ones(1), 0.2, {}, lambda h: (1.0, 1.0))
        return first, order is not None

    smooth = SimpleNamespace(manifest=SimpleNamespace(system=SimpleNamespace(jumps="")))

    def failing(h, T):
        raise gs.StepFailed(step=1, t=0.0, reason="diverged", trajectory=smooth)

    assert first_steps(lambda h, T: h**6 + 0.1 * h**8) == ([0.2], True)
    assert first_steps(failing) == ([0.2], False)


@pytest.mark.parametrize(("seen", "found"), [
    (MeasuredOrder(6.19, 4.02, 0.02, (10.21, 6.19)), "slopes 10.21, 6.19"),
    (None, "errors are round-off"),
    (MeasuredOrder(5.95, 0.11, 0.02, (6.4, 5.84, 5.95)), "5.95 at Δt = 0.02"),
])
def test_what_is_said_of_the_slopes(monkeypatch, seen, found):
    """The line lists all slopes where no two agree, and does not accuse the method."""
    monkeypatch.setattr(measured_properties, "measure_order", lambda *_: seen)
    run = SimpleNamespace(q=[0], p=[0], dt=0.1)
    measured = SimpleNamespace(step=SimpleNamespace(order=6), run=run, parameters={},
                               round_off=SimpleNamespace(sizes_of_steps=None),
                               switching=SimpleNamespace(description=""), decay=0.0)
    line = measured_properties.Examination._order(measured)
    assert line.found == found
    assert line.holds in (None, True)


def test_round_off_of_a_run():
    """The bounds are Σ |∂g/∂q_i| r_i and Σ |∂f/∂q_i| r_i + |∂f/∂p_i| s_i, largest over the run."""
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


@pytest.mark.parametrize(("model", "options", "words"), [
    ("fast-top", {}, r"no gyrospark\.Model"),
    (TOP, {"parameters": {"mgl2": 1.0}}, "'mgl2'"),
    (TOP, {"steps": 0}, "steps"),
    (TOP, {"real": "long-double"}, "real = 'long-double'.*double"),
    (TOP, {"real": "float128"}, "real = 'float128'.*double"),
    (TOP, {"real": "half"}, r"half.*float128"),
    (systems.case("henon_heiles"), {"rep": "gamma"}, "rep"),
    (systems.case("pendulum"), {}, "give dt"),
])
def test_arguments_are_refused_in_words(model, options, words):
    if isinstance(model, systems.Case):
        model = gs.Model(model.system, model.parameters, model.q, model.p)
    with pytest.raises(gs.InputError, match=words):
        gs.certify(model, "EMS", **options)


def test_no_stages_are_refused():
    with pytest.raises(gs.InputError, match="0"):
        gs.certify(TOP, stages=0, steps=2)


def test_single_precision_is_held_to_its_own_rounding():
    """The lines are the same as in double; bounds by round-off are 2²⁹ times as large."""
    certificates = {real: gs.certify(TOP, "G-L", 2, steps=100, real=real)
                    for real in ("double", "float")}
    assert certificates["float"].stepper == "heavy_top_gl2_gamma_float"
    assert certificates["float"].holds
    for name in (LOOP, REVERSAL, G, F, VERTICAL, FIGURE):
        lines = [certificates[real].line(name) for real in ("double", "float")]
        assert [line.holds for line in lines] == [True, True], name
        if name != REVERSAL:  # of which the growth of errors is measured too
            assert lines[1].bound == pytest.approx(2**29 * lines[0].bound, rel=1e-3)
        assert lines[1].value > 2**9 * lines[0].value  # it is measured in that type


# ---------------------------------------------------------------- forces


def test_a_force_of_the_time_alone_is_a_gradient():
    """It is one at every instant, so the loop invariant is constant; with drag it is not."""
    model = model_of("driven_oscillator")
    certificate = gs.certify(model, "G-L", 2)
    assert certificate.holds, [line for line in certificate.lines if line.holds is False]
    assert certificate.line(LOOP).holds is None
    assert certificate.line(LOOP).value > 1e-6
    assert certificate.line(REVERSAL).holds is True
    force = model.system.forces[0].subs(sp.Symbol("c", positive=True), 0)
    for forces, is_invariant in ((model.system.forces, False), ((force,), True)):
        numbers = {s: sp.Rational(model.parameters[str(s)]) for s in model.system.parameters}
        guarantees = SparkGuarantees(replace(model.system, forces=forces), numbers,
                                     gs.tableau("G-L", 2))
        assert guarantees.loop().guaranteed is is_invariant


# ---------------------------------------------------------------- scaled time


@pytest.mark.parametrize(("name", "scheme", "symplectic"), [
    ("eccentric", "G-L", True), ("scaled_pendulum", "EMS", False),
    *(pytest.param(*given, marks=pytest.mark.slow) for given in (  # steppers; the laws have some
        ("eccentric", "EMS", False), ("scaled_pendulum", "G-L", False),
        ("tethered_pair", "G-L", True)))])
def test_properties_in_scaled_time_are_those_of_q_t_p_e(name, scheme, symplectic):
    """The loop lies in (q, t, p, e); e is a momentum map where no force does work."""
    entry, stages = systems.case(name), 2 if scheme == "G-L" else None
    start = systems.stepper(name).project(entry.q, entry.p, parameters=entry.parameters)
    model = gs.Model(entry.system, entry.parameters, *start)
    certificate = gs.certify(model, scheme, stages, dtau=entry.dt, steps=60)
    assert certificate.holds, certificate.lines
    assert certificate.scaled
    loop, energy, order = map(certificate.line, ("loop", "energy H + e", "order"))
    assert loop.holds is (True if symplectic else None)
    assert (loop.value < 1e-12) == symplectic
    assert energy.holds is (True if scheme == "EMS" else None)
    assert (energy.value < 1e-13) == (scheme == "EMS")
    assert abs(order.value) < 0.1  # of orders 4 and 2, of which it is the lack
    assert certificate.line("reversal").value < 1e-12
    works = name == "scaled_pendulum"
    assert any(line.quantity == "momentum p_t" for line in certificate.lines) != works
    with pytest.raises(gs.InputError, match="dtau"):
        gs.certify(model, scheme, stages, steps=3)


@pytest.mark.parametrize(("drag", "exact"), [(0, True), (1, False)])
def test_forces_change_h_plus_e_where_the_rates_are_not_those_of_the_midpoint(drag, exact):
    """EMS moves q along D_pH: of p²/(2(1 + x²)) it is not H_p at the midpoint."""
    x, p, t = sp.symbols("x p t", real=True)
    system = gs.System([x], [p], (), p**2 / (2 * (1 + x**2)) + x**2 / 2 + x * sp.sin(t) / 5, time=t,
                       forces=[-p / 5] * drag, time_scale=gs.scales.rates(1, x), name="dragged")
    model = gs.Model(system, {}, [0.9], [0.3])
    first, second = (gs.certify(model, "EMS", dtau=size, steps=round(4 / size)).line("energy H + e")
                     for size in (0.04, 0.02))
    assert (first.holds, second.holds) == ((True, True) if exact else (None, None))
    if exact:
        assert max(first.value, second.value) < 1e-14
    else:
        assert first.value / second.value == pytest.approx(4, rel=0.05)  # of order 2


def guarantees(system, parameters, tableau=None):
    numbers = {s: sp.Rational(parameters[str(s)]) for s in system.parameters}
    return SparkGuarantees(system, numbers, tableau or gs.tableau("G-L", 2))


def test_a_certificate():
    model = gs.Model(skate_chain(), SKATE_CHAIN, *SKATE_CHAIN_START)
    certificate = gs.certify(model, "G-L", 2, dt=0.02, steps=50)
    assert certificate.holds
    assert certificate.line("largest |g_q H_p|, |A H_p + a|").holds
    assert certificate.line("largest |g(q)|").holds
    assert certificate.line("compiled").holds
    assert "A H_p + a" in certificate.line("compiled").quantity
    assert certificate.line("reversal").holds
    assert certificate.line("order").holds
    for quantity in ("loop", "energy"):
        assert certificate.line(quantity).holds is None
    assert certificate.line("loop").value > 1e-3


def test_another_row_is_noticed(monkeypatch):
    """A certificate compares the compiled rows with the model's, not with themselves."""
    compiled = systems.stepper("sleigh")
    row = sleigh().velocity_constraints[0] + sleigh().velocities[2] / 1000
    start = compiled.project(*sleigh_state(0.7, 1.5), parameters=SLEIGH)
    model = gs.Model(replace(sleigh(), velocity_constraints=(row,)), SLEIGH, *start)
    monkeypatch.setattr(certificate, "compile_model", lambda *args, **more: (model, compiled))
    line = gs.certify(model, "G-L", 2, dt=0.02, steps=10).line("compiled")
    assert line.holds is False
    assert line.value > 1e6


@pytest.mark.parametrize(("change", "said"), [
    ({}, "mirror"), ({"force": True}, "not reversible"), ({"affine": True}, "not reversible")])
def test_energy_is_near_or_drifts(change, said):
    """The guarantee follows from H, F and a; a motion without a mirror drifts all the same."""
    system = transmission()
    if "force" in change:
        system = replace(system, forces=(-system.p[0], sp.Integer(0), sp.Integer(0)))
    if "affine" in change:
        system = replace(system, velocity_constraints=(system.velocity_constraints[0] + 1,))
    guarantee = guarantees(system, {"k": 0.25}).energy()
    assert not guarantee.guaranteed
    assert ("not reversible" in guarantee.why) == (said == "not reversible")
    assert "drift" in guarantee.why
    assert "symmetric" in guarantees(system, {"k": 0.25}, gs.tableau("Radau-L", 2)).energy().why


def test_no_loop_invariant_is_claimed():
    assert not guarantees(sleigh(), SLEIGH).loop().guaranteed


def test_momentum_maps_that_reactions_leave_alone():
    """Momenta of a particle across a row of constraints stay, momenta along it do not."""
    q, p, v = (sp.symbols(f"{c}0:4", real=True) for c in "qpv")
    k = sp.Symbol("k", real=True)
    system = gs.System(q, p, (k,), sum(e**2 for e in p) / 2, velocities=v, name="edge",
                       velocity_constraints=(v[2] - q[0] * v[1],))
    state = np.array([0.2, 0.1, 0.3, 0]), np.array([0.5, 0.6, 0.12, 0.7])
    is_guaranteed = {str(J.J): guarantees(system, {"k": 1}).momentum(J).guaranteed
                     for J in momentum_maps(system, {"k": 1.0}, *state)}
    assert is_guaranteed["p3"]
    assert is_guaranteed["p0"]  # the row does not have the velocity of q0
    assert not is_guaranteed["p1"]
    assert not is_guaranteed["p2"]


def test_works_to_cite():
    assert "modin2020" in [work.key for work in gs.cite(systems.stepper("sleigh"))]
    assert "modin2020" not in [work.key for work in gs.cite(gs.stepper("G-L", 2))]
