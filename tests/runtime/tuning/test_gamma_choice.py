"""γ chosen by pilot runs: for the motion never worse than γ_m, for the energy than any rule."""

from __future__ import annotations

import math
from functools import cache
from itertools import product

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

import gyrospark as gs
import systems
from calls import refused
from gyrospark.core.registry import MEANS
from gyrospark.runtime.rigid_body.gamma_rules import known_inertia
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix
from gyrospark.runtime.tuning.gamma_choice import PILOT_STEPS
from gyrospark.runtime.tuning.gamma_search import WORTHWHILE, least
from gyrospark.studies.gamma_auto import ALLOWED, LONGER
from gyrospark.studies.gamma_trials import BODIES, METHODS, TIMES, Trial, TrialBody, asymmetric_top

TOP = gs.problems.fast_top()
GAMMA = {"gamma": TOP.inertia}
AUTO = TOP.parameters | {"gamma": "auto"}
#: Of the methods those whose error γ moves most; the others are in the long form.
OFTEN = (("G-L", 1), ("G-L", 2), ("LIIIA-B", 2))
CHAOTIC = asymmetric_top((1.0, 1.7, 0.6), 5.0, 0.9, [0.9, -1.4, 1.1])

#: Every body with a method, in turn: every fourth one.
PAIRS = [(body, method) for (i, body), (j, method) in product(enumerate(BODIES), enumerate(OFTEN))
         if i % 3 == j and i % 4 == 0]

trial_of = cache(Trial)


def choose(step, **changes):
    options = {"dt": 1e-3, "parameters": TOP.parameters, "bodies": GAMMA, "steps": 320} | changes
    return gs.choose_gamma(step, TOP.q0, TOP.p0, **options)


def name_of(value):
    if isinstance(value, TrialBody):
        return value.name
    return f"{value[1] or ''}{value[0]}" if isinstance(value, tuple) else str(value)


# ---------------------------------------------------------------- the motion, by default


def check_motion(body, method, times):
    """No axis is farther from the true path than with γ_m by more than 5 %, at any time."""
    trial = trial_of(body, *method)
    choice, inertia = trial.for_motion, body.make().inertia
    assert choice.aim == "motion"
    assert min(inertia) / 10 <= choice.gamma <= 10 * max(inertia)
    assert choice.measured_gain >= 1
    assert np.nanmax(trial.ratios(times=times), initial=0) <= ALLOWED


@pytest.mark.parametrize(("body", "method"), PAIRS, ids=name_of)
def test_no_path_gets_worse(body, method):
    check_motion(body, method, TIMES[:1])


@pytest.mark.slow
@pytest.mark.parametrize(("body", "method"), list(product(BODIES, METHODS)), ids=name_of)
def test_no_path_gets_worse_in_a_hundred_seconds(body, method):
    check_motion(body, method, TIMES)


@pytest.mark.slow
@settings(deadline=None, max_examples=60)
@given(st.tuples(*[st.floats(0.4, 1.0)] * 3), st.booleans(), st.floats(0.0, 8.0),
       st.floats(0.05, 2.5), st.tuples(*[st.floats(-2.0, 2.0)] * 2), st.floats(-30.0, 30.0),
       st.sampled_from([0.02, 0.05, 0.15]), st.sampled_from(METHODS))
def test_no_path_of_any_top_gets_worse(
        moments, symmetric, weight, theta, omega, spin, turn, method):
    """Tops drawn at random, fast and slow: pilots of 1000 steps judged by 10 000."""
    inertia = (moments[0], moments[0], moments[2]) if symmetric else moments
    assume(2 * max(inertia) < sum(inertia))
    speed = max(math.hypot(*omega, spin), math.sqrt(weight))
    assume(speed > 0.1)
    make = lambda: asymmetric_top(inertia, weight, theta, [*omega, spin])  # noqa: E731
    trial = Trial(TrialBody("drawn", make, turn / speed, 1000), *method)
    times = (1000 * trial.body.dt, 10_000 * trial.body.dt)
    distance = trial.distances(trial.rule("γ_m"), times)
    ratios = trial.ratios(times=times)
    assert np.nanmax(np.where(distance > 1e-11, ratios, 0), initial=0) <= ALLOWED


@pytest.mark.parametrize(("body", "method", "least_loss"), [
    (BODIES[0], ("LIIIA-B", 2), 3), (BODIES[3], ("G-L", 1), 8),
], ids=name_of)
def test_the_energy_is_not_the_motion(body, method, least_loss):
    """A γ chosen for the energy costs an axis what the default saves it; its choice says so."""
    trial = trial_of(body, *method)
    assert np.nanmax(trial.price(TIMES[:1])) > least_loss
    assert np.nanmax(trial.ratios(times=TIMES[:1])) <= 1
    if least_loss > ALLOWED:
        choice = trial.for_energy
        assert "grows" in choice.reason
        assert choice.gains["motion"] < 1 < choice.gains["energy"] == choice.measured_gain


@pytest.mark.parametrize(("body", "method", "gain"), [
    (BODIES[0], ("G-L", 2), 1.7), (BODIES[0], ("LIIIA-B", 2), 1.4),
], ids=name_of)
def test_gains_of_the_motion(body, method, gain):
    """The gain is there, where the law puts it, and lasts: 1 s of pilots, 10 s of motion."""
    choice = trial_of(body, *method).for_motion
    assert choice.measured_gain > gain
    assert choice.expected_gain == pytest.approx(choice.measured_gain, rel=0.05)
    ratios = trial_of(body, *method).ratios(times=TIMES[1:2])[0]
    assert 1 / np.sqrt((ratios**2).mean()) > 0.95 * gain


def test_gain_is_that_of_the_axes():
    """Measured anew: columns of R(q) against a method of order 12, on the pilots' 320 steps."""
    step, choice = gs.stepper("G-L", 2), choose(gs.stepper("G-L", 2))
    exact = gs.stepper("G-L", 6).integrate(TOP.q0, TOP.p0, dt=1e-3, steps=320,
                                           parameters=TOP.parameters | {"gamma": 1.6e-3})
    distances = []
    for value in (choice.pilots[0].values, choice.values):
        run = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=320, parameters=TOP.parameters | value)
        change = rotation_matrix(run.q) - rotation_matrix(exact.q)
        distances.append(np.linalg.norm(change, axis=1)[1:].mean(axis=0))
    ratios = distances[1] / distances[0]
    assert 1 / choice.measured_gain == pytest.approx(np.sqrt((ratios**2).mean()), rel=1e-6)
    own = next(p for p in choice.pilots if p.values == choice.values)
    assert own.worst == pytest.approx(ratios.max(), rel=1e-6)


def test_ems_moves_too():
    """Its energy is round-off; on a slow top, seen to its end, γ helps the motion."""
    step = gs.stepper("EMS")
    run = {"dt": 5e-3, "parameters": CHAOTIC.parameters, "bodies": {"gamma": CHAOTIC.inertia}}
    choice = gs.choose_gamma(step, CHAOTIC.q0, CHAOTIC.p0, run_steps=1000, **run)
    assert choice.aim == "motion"
    assert choice.measured_gain > 3
    energy = gs.choose_gamma(step, CHAOTIC.q0, CHAOTIC.p0, aim="energy", **run)
    assert energy.gamma == gs.gamma(CHAOTIC.inertia)
    assert "round-off" in energy.reason


# ---------------------------------------------------------------- what pilots cannot tell


def test_where_the_error_does_not_grow_like_t_nothing_is_said_of_longer_runs():
    step = gs.stepper("G-L", 2)
    run = {"dt": 5e-3, "parameters": CHAOTIC.parameters, "bodies": {"gamma": CHAOTIC.inertia}}
    choice = gs.choose_gamma(step, CHAOTIC.q0, CHAOTIC.p0, **run)
    assert choice.gamma == gs.gamma(CHAOTIC.inertia)
    assert "like t" in choice.reason
    assert choice.measured_gain == choice.expected_gain == 1
    whole = gs.choose_gamma(step, CHAOTIC.q0, CHAOTIC.p0, run_steps=1000, **run)
    assert "like t" not in whole.reason


def test_a_lost_motion_is_not_chosen_for():
    body = gs.problems.regular_precession()
    choice = gs.choose_gamma(gs.stepper("IMS"), body.q0, body.p0, dt=5e-3,
                             parameters=body.parameters, bodies={"gamma": body.inertia})
    assert "7 steps" in choice.reason


@pytest.mark.parametrize("steps", [0, 1, 2, 5, 9])
def test_runs_of_a_few_steps(steps):
    """Pilots that are the whole run see all there is; nothing is said of a longer one."""
    run = gs.stepper("G-L", 1).integrate(TOP.q0, TOP.p0, dt=1e-3, steps=steps, parameters=AUTO)
    assert run.parameters["gamma"] > 0
    longer = choose(gs.stepper("G-L", 1), steps=max(steps, 2))
    assert ("pilots of" in longer.reason) == (steps < 8)


def test_steps_that_lose_the_motion_at_once():
    choice = choose(gs.stepper("G-L", 1), dt=0.03, steps=50)
    assert "2 steps" in choice.reason
    assert choose(gs.stepper("G-L", 1), dt=0.03, steps=50, aim="energy").gains["energy"] >= 1


def test_round_off_is_not_chosen_for():
    choice = choose(gs.stepper("G-L", 3), dt=2e-5)
    assert "round-off" in choice.reason
    assert choice.gains == {"motion": 1, "energy": 1}
    assert math.isnan(choice.pilots[0].motion)


def test_free_body_of_second_order_says_that_gamma_does_nothing():
    body = gs.problems.free_body()
    choice = gs.choose_gamma(gs.stepper("IMS"), body.q0, body.p0, dt=1e-3, steps=200,
                             parameters=body.parameters, bodies={"gamma": body.inertia},
                             aim="energy")
    assert choice.gamma == gs.gamma(body.inertia)
    assert choice.measured_gain == 1
    assert "hardly" in choice.reason


def test_steps_that_converge_with_no_gamma():
    with pytest.raises(gs.StepFailed):
        choose(gs.stepper("G-L", 2), dt=1.0)


# ---------------------------------------------------------------- the energy


def check_energy(body, method):
    """No rule is better by 5 %, on the pilots' length and, above round-off, on ten times it."""
    choice = trial_of(body, *method).for_energy
    assert choice.aim == "energy"
    best = min(pilot.energy for pilot in choice.pilots if pilot.label in MEANS.values())
    if "round-off" not in choice.reason:
        assert choice.pilots[0].energy / choice.measured_gain <= ALLOWED * best
    if not trial_of(body, *method).at_round_off(LONGER):
        assert trial_of(body, *method).energy_gain(times=LONGER) >= 1 / ALLOWED


@pytest.mark.parametrize(("body", "method"), PAIRS, ids=name_of)
def test_no_rule_has_a_better_energy(body, method):
    check_energy(body, method)


@pytest.mark.slow
@pytest.mark.parametrize(("body", "method"), list(product(BODIES, METHODS)), ids=name_of)
def test_no_rule_has_a_better_energy_anywhere(body, method):
    check_energy(body, method)


@pytest.mark.parametrize(("method", "least_gain"), [
    (("G-L", 1), 100), (("G-L", 2), 100), (("LIIIA-B", 2), 100),
    *(pytest.param(*row, marks=pytest.mark.slow) for row in (
        (("IMS", None), 1e6), (("G-L", 3), 10), (("LIIIA-B", 4), 10))),
], ids=name_of)
def test_fast_top_gains(method, least_gain):
    """The symmetric top: one γ cancels the error at every step; see erratum 25 for the zeros."""
    trial = trial_of(BODIES[0], *method)
    assert min(trial.energy_gain("γ_m"), trial.energy_gain("γ_h")) > least_gain


@pytest.mark.parametrize(("method", "inverse"), [
    (("LIIIA-B", 2), 550), (("G-L", 2), 903),
    *(pytest.param(*row, marks=pytest.mark.slow)
      for row in ((("IMS", None), 500), (("G-L", 1), 440))),
], ids=name_of)
def test_zeros_of_erratum_25(method, inverse):
    assert 1 / trial_of(BODIES[0], *method).for_energy.gamma == pytest.approx(inverse, rel=5e-3)


def test_a_pilot_is_a_plain_run():
    """Its error is the report's, but for the state at t = 0; gains are ratios of these."""
    step, choice = gs.stepper("G-L", 2), choose(gs.stepper("G-L", 2), aim="energy")
    run = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=320,
                         parameters=TOP.parameters | choice.values)
    own = next(p for p in choice.pilots if p.values == choice.values)
    assert own.energy * 320 / 321 == pytest.approx(run.report.energy_error_mean, rel=1e-12)
    assert choice.measured_gain == choice.pilots[0].energy / own.energy
    assert choice.gains["motion"] == 1 / own.motion
    assert choice.expected_gain == pytest.approx(choice.measured_gain, rel=0.05)


@pytest.mark.parametrize(("aim", "columns"), [("motion", "motion  worst path      energy"),
                                              ("energy", "energy      motion  worst path")])
def test_both_errors_are_printed(aim, columns):
    choice = choose(gs.stepper("G-L", 2), aim=aim)
    first, heading, *rows = str(choice).splitlines()
    assert first == choice.reason
    assert columns in heading
    assert len(rows) == len(choice.pilots)
    assert f"{choice.pilots[0].energy:.3e}" in rows[0]
    assert "(γ_m)" in rows[0]


# ---------------------------------------------------------------- α


@pytest.mark.parametrize("aim", ["motion", "energy"])
def test_alpha_is_refused_where_it_is_idle(aim):
    with refused(r"alpha.*heavy_top_gl2_alpha.*\bm\b"):
        choose(gs.stepper("G-L", 2, "alpha"), bodies={"alpha": TOP.inertia}, aim=aim)


@pytest.mark.parametrize("aim", ["motion", "energy"])
def test_alpha_of_lobatto_is_gamma(aim):
    """LIIIA-B-α = LIIIA-B-γ (erratum 23), so the choice is the same."""
    alpha = choose(gs.stepper("LIIIA-B", 2, "alpha"), bodies={"alpha": TOP.inertia}, aim=aim)
    assert alpha.law == "1/α"
    gamma = choose(gs.stepper("LIIIA-B", 2), aim=aim).gamma
    assert alpha.values["alpha"] == pytest.approx(gamma, rel=1e-6)


# ---------------------------------------------------------------- several bodies


def test_each_body_has_its_own_gamma():
    """Two tops: pilots vary one γ at a time, the minimum is that of both together."""
    case, step = systems.case("double_top"), systems.stepper("double_top")
    q0, p0 = systems.start("double_top", step)
    options = {"dt": 1e-3, "steps": 300, "parameters": dict(case.parameters) | {
        "a_gamma": "auto-energy", "b_gamma": "auto-energy"}}
    choice = gs.choose_gamma(step, q0, p0, **options)
    assert choice.values.keys() == {"a_gamma", "b_gamma"}
    with refused("2 values"):
        _ = choice.gamma
    pilots = [p.values for p in choice.pilots if p.label.startswith("pilot")]
    rules = [p for p in choice.pilots if p.label in MEANS.values()]
    base = min(rules, key=lambda p: p.energy).values
    assert [sum(values[name] != base[name] for name in base) for values in pilots] == [1, 1]
    assert choice.measured_gain * min(rule.energy for rule in rules) > choice.pilots[0].energy
    run = step.integrate(q0, p0, **options)
    assert {name: run.parameters[name] for name in choice.values} == choice.values

    motion = gs.choose_gamma(step, q0, p0, **options, aim="motion", run_steps=300)
    own = next(p for p in motion.pilots if p.values == motion.values)
    assert own.worst <= 1
    with refused("auto and for auto-energy"):
        gs.choose_gamma(step, q0, p0, **options | {
            "parameters": options["parameters"] | {"a_gamma": "auto"}})


# ---------------------------------------------------------------- "auto" as a parameter


@pytest.mark.parametrize(("word", "aim"), [("auto", "motion"), ("auto-energy", "energy")])
def test_auto_is_replaced_in_integrate(word, aim):
    step, parameters = gs.stepper("G-L", 2), TOP.parameters | {"gamma": word}
    run = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=3000, parameters=parameters)
    choice = gs.choose_gamma(step, TOP.q0, TOP.p0, dt=1e-3, parameters=parameters)
    assert choice.aim == aim
    assert run.parameters == TOP.parameters | choice.values
    assert run.report.energy_error_mean < choice.pilots[0].energy / (100 if aim == "energy" else 1)
    assert PILOT_STEPS == 1000


def test_auto_sees_all_of_a_short_run():
    """Pilots as long as the run need no growth like t to be believed."""
    step = gs.stepper("EMS")
    run = step.integrate(CHAOTIC.q0, CHAOTIC.p0, dt=5e-3, steps=900,
                         parameters=CHAOTIC.parameters | {"gamma": "auto"})
    choice = gs.choose_gamma(step, CHAOTIC.q0, CHAOTIC.p0, dt=5e-3, steps=900, run_steps=900,
                             parameters=CHAOTIC.parameters | {"gamma": "auto"})
    assert run.parameters["gamma"] == choice.gamma != gs.gamma(CHAOTIC.inertia)


@pytest.mark.parametrize("word", ["auto", "auto-energy"])
def test_auto_is_refused_where_it_would_be_chosen_again_and_again(word):
    step, parameters = gs.stepper("G-L", 2), TOP.parameters | {"gamma": word}
    with refused(f"'{word}'.*integrate"):
        step.step(TOP.q0, TOP.p0, dt=1e-3, parameters=parameters)
    with refused(f"'{word}'.*integrate"):
        step.integrate_ensemble([TOP.q0], [TOP.p0], dt=1e-3, steps=3, parameters=parameters)


def test_moments_are_given_with_the_parameter():
    assert known_inertia("a_gamma", {"a_I1": 1, "a_I2": 2.0, "a_I3": 3}) == (1, 2, 3)
    with refused("'I2'.*choose_gamma"):
        known_inertia("gamma", {"I1": 1.0})


@pytest.mark.parametrize(("changes", "message"), [
    ({"bodies": {"delta": TOP.inertia}}, "no parameter 'delta'"),
    ({"bodies": {}}, "nothing"),
    ({"bodies": None}, "nothing"),
    ({"bodies": {"gamma": (1, 2)}}, "2 moments"),
    ({"bodies": {"gamma": (1, 2, -3)}}, "above 0"),
    ({"aim": "speed"}, "motion or energy"),
    ({"steps": 1}, "at least 2"),
    ({"run_steps": -1}, "at least 0"),
    ({"dt": 0}, "dt = 0"),
    ({"parameters": {"I1": 1.0}}, "'I2'"),
])
def test_refused(changes, message):
    with refused(message):
        choose(gs.stepper("IMS"), **changes)


# ---------------------------------------------------------------- the minimum of the law


def ratios_of(forms, x):
    """Return √((1, x) F_j (1, x)ᵀ) of each form."""
    one = np.concatenate([[1.0], np.atleast_1d(x)])
    return np.sqrt(np.maximum(np.einsum("i,jik,k->j", one, forms, one), 0))


def forms_of(seed, bodies, paths):
    """Return forms of random errors, each 1 at x = 0 like those of the base."""
    columns = np.random.default_rng(seed).normal(size=(paths, 40, bodies + 1))
    columns /= np.linalg.norm(columns[:, :, :1], axis=1, keepdims=True)
    return np.einsum("jki,jkl->jil", columns, columns), columns


@settings(deadline=None)
@example(seed=0, bodies=1, paths=1)
@given(seed=st.integers(0, 2**32 - 1), bodies=st.integers(1, 4), paths=st.integers(1, 7))
def test_least_is_the_least_square_or_the_least_largest(seed, bodies, paths):
    """Mean squares where no path stands above 1/1.05, else nearly the smallest largest ratio."""
    forms, _ = forms_of(seed, bodies, paths)
    x = least(forms)
    ratios = ratios_of(forms, x)
    mean = np.linalg.solve(forms[:, 1:, 1:].sum(axis=0), -forms[:, 1:, 0].sum(axis=0))
    if ratios_of(forms, mean).max() <= 0.98 * WORTHWHILE:
        assert x == pytest.approx(mean, rel=1e-9, abs=1e-12)
        return
    if ratios.max() <= 0.98 * WORTHWHILE:
        return
    for direction in [*np.eye(bodies), *np.random.default_rng(seed).normal(size=(4, bodies))]:
        for length in (-1e-1, -1e-2, 1e-2, 1e-1):
            assert ratios_of(forms, x + length * direction).max() > 0.97 * ratios.max()


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_an_exact_zero_is_found(seed, bodies):
    _, columns = forms_of(seed, bodies, 3)
    zero = np.random.default_rng(seed).normal(size=bodies)
    columns[:, :, 0] = -columns[:, :, 1:] @ zero
    assert least(np.einsum("jki,jkl->jil", columns, columns)) == pytest.approx(zero, rel=1e-8)


def test_no_slope_leaves_the_values():
    forms = np.zeros((3, 3, 3))
    forms[:, 0, 0] = 1
    assert least(forms).tolist() == [0, 0]
