"""gs.fit returns parameters within their standard deviations, or names them as undetermined."""

from __future__ import annotations

import dataclasses
import itertools
from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest

import gyrospark as gs
import systems
from benchmarks import fits
from calls import refused
from gyrospark.core.inertia import quaternion_product
from gyrospark.core.manifest import BodyManifest, SystemManifest
from gyrospark.runtime.analysis.fit_coordinates import Coordinates
from gyrospark.runtime.analysis.least_squares import Linear, identify, minimise
from gyrospark.runtime.analysis.observations import Observation
from gyrospark.runtime.compilation.body_columns import BodyAt
from gyrospark.runtime.rigid_body.quaternion import rotation_matrix
from processes import ROOT

top = cache(fits.damped_top)
double = cache(fits.double_body)


@cache
def top_fit():
    return top().fit(top().data(3))


@cache
def pendulum():
    model = gs.load_model(ROOT / "examples" / "pendulum.toml")
    step = gs.stepper("G-L", 2, system=model)
    run = step.integrate(model.q0, model.p0, dt=0.01, steps=120, every=4,
                         parameters=model.parameters)
    return step, model, run


def fit_pendulum(data=None, observe=("x", "y"), free=("l", "g", "start"), guess=None, **options):
    step, model, run = pendulum()
    parameters = dict(model.parameters) | (guess or {"l": 0.6, "g": 8.0})
    begin = options.pop("start", gs.Start([0.6, 0.01], [0.02, 0.1]))
    return gs.fit(step, begin, options.pop("times", run.t), run.q if data is None else data,
                  observe=observe, free=free, parameters=parameters, **{"dt": 0.01} | options)


# ---------------------------------------------------------------- parameters behind the data


def test_a_damped_top_is_found_from_a_far_first_guess():
    fit, true = top_fit(), top().true
    assert fit.converged
    assert not fit.undetermined
    assert fit.rms == pytest.approx(fits.NOISE, rel=0.1)
    assert fit.truncation < 0.01 * fits.NOISE
    for name in top().free:
        assert abs(fit.parameters[name] - true[name]) < 3 * fit.sigma[name]
        assert fit.sigma[name] < 1e-3 * true[name]


@pytest.mark.slow  # statistics of many fits
@pytest.mark.parametrize(("case", "seeds", "fewest", "together"), [
    (top, 100, 88, 0.92), (double, 100, 88, 0.93)])
def test_two_standard_deviations_hold_as_often_as_they_should(case, seeds, fewest, together):
    """Fewer than 88 of 100 have a probability of 0.1 %; 95.4 are expected."""
    recovery = fits.recover(case(), range(seeds))
    assert not recovery.failures
    assert min(recovery.within().values()) >= fewest
    assert sum(recovery.within().values()) >= together * seeds * len(recovery.names)
    assert 0.5 < np.sqrt((recovery.errors**2).mean()) < 1.3


def test_exact_data_give_exact_parameters():
    fit = fit_pendulum()
    assert fit.rms < 1e-9
    assert fit.parameters["l"] == pytest.approx(0.5, rel=1e-9)
    assert fit.parameters["g"] == pytest.approx(9.81, rel=1e-9)
    assert fit.parameters["m"] == 1.0
    assert fit.q == pytest.approx([0.5, 0.0], abs=1e-9)


def test_the_sign_of_a_quaternion_does_not_matter():
    data = top().data(3)
    data[::3] *= -1
    fit = top().fit(data)
    assert fit.parameters == top_fit().parameters


def test_a_start_alone_and_parameters_alone():
    start = fit_pendulum(free=["start"], guess={"l": 0.5})
    assert start.q == pytest.approx([0.5, 0.0], abs=1e-9)
    assert start.names == ["start[0]", "start[1]"]
    _, model, _ = pendulum()
    fit = fit_pendulum(free="g", guess={"g": 8.0}, start=model)
    assert fit.names == ["g"]
    assert fit.parameters["g"] == pytest.approx(9.81, rel=1e-9)


def test_a_fit_with_inputs():
    """Each step has its own push, without which the fitted rate would differ."""
    step, case = systems.differentiable("pushed_pendulum"), systems.case("pushed_pendulum")
    rows = np.random.default_rng(1).normal(size=(30, 2))
    run = step.integrate(case.q, case.p, dt=0.02, steps=60, inputs=gs.Inputs(rows, hold=2),
                         parameters={"k": 2.0})
    fit = gs.fit(step, gs.Start(case.q, case.p, {"k": 1.7}), run.t[4::4], run.q[4::4],
                 observe=("x", "y"), free="k", dt=0.02, inputs=gs.Inputs(rows, hold=2))
    assert fit.parameters["k"] == pytest.approx(2.0, rel=1e-9)


# ---------------------------------------------------------------- undetermined directions


def test_a_common_factor_is_named_and_not_inverted():
    fit = top().fit(top().data(3), free=["I1", "I2", "I3", "mgl", "c", "start"])
    (combination,) = fit.undetermined
    assert set(combination) == {"I1", "I2", "I3", "mgl", "c", "start"}
    assert list(combination.values()) == pytest.approx([1.0] * 6, abs=1e-3)
    assert "common factor" in repr(fit)
    assert fit.rms == pytest.approx(top_fit().rms, rel=1e-4)
    assert np.isfinite(fit.covariance).all()
    for name in ("I1", "I2", "I3", "mgl", "c"):
        assert fit.sigma[name] == np.inf
    true, fixed = top().true, top_fit()
    for name in ("I1", "I2", "I3", "c"):
        ratio = fit.parameters[name] / fit.parameters["mgl"] * true["mgl"]
        assert abs(ratio - fixed.parameters[name]) < 0.1 * fixed.sigma[name]


def test_what_has_no_effect_and_products_are_named():
    fit = fit_pendulum(free=["m", "l", "g", "start"])
    (combination,) = fit.undetermined
    assert combination == pytest.approx({"m": 1.0}, abs=1e-6)  # without the start, which is at rest
    assert fit.sigma["m"] == np.inf
    assert fit.sigma["l"] < 1e-6
    assert fit.parameters["g"] == pytest.approx(9.81, rel=1e-9)


@pytest.mark.parametrize("first", [0.0, 1e-4])
def test_a_damping_that_is_none_is_determined(first):
    step, parameters = top().step, top().true | {"c": 0.0}
    q, p = step.project(top().q, top().p, parameters=parameters)
    run = step.integrate(q, p, dt=5e-3, steps=240, every=4, parameters=parameters)
    noise = fits.NOISE * np.random.default_rng(0).normal(size=(60, 3))
    fit = top().fit(fits.turned(run.q[1:], noise), parameters=parameters | {"c": first},
                    free=["c", "start"])
    assert not fit.undetermined
    assert abs(fit.parameters["c"]) < 4 * fit.sigma["c"] < 1e-5


def test_directions_without_effect_take_no_degree_of_freedom():
    """From rest m moves nothing: deviations equal the ones of a fit of the other parameters."""
    _, model, run = pendulum()
    data = run.q[:6] + 1e-3 * np.random.default_rng(3).normal(size=(6, 2))
    two, three = (fit_pendulum(data, times=run.t[:6], free=free,
                               start=gs.Start(model.q0, model.p0))
                  for free in (["l", "g"], ["l", "m", "g"]))
    assert three.sigma["l"] == pytest.approx(two.sigma["l"], rel=1e-6)


def test_fewer_residuals_than_unknowns():
    step, model, run = pendulum()
    fit = gs.fit(step, model, run.t[1:2], run.q[1:2], observe="q", dt=0.01,
                 free=["l", "g", "start"])
    assert len(fit.undetermined) == 2
    fit_of_x = gs.fit(step, model, run.t[1:2], run.q[1:2, 0], observe="x", dt=0.01, free=["l"])
    assert fit_of_x.residuals.shape == (1, 1)


# ---------------------------------------------------------------- observations


def test_a_function_is_observed_with_its_derivatives():
    """The third axis of the top is observed as a function, a height also by name."""
    def axis(q, p):
        units = np.eye(4)
        by_q = np.stack([(rotation_matrix(q + 1e-3 * e) - rotation_matrix(q - 1e-3 * e))[..., 2]
                         / 2e-3 for e in units], axis=-1)  # exact: R(q) is quadratic
        return rotation_matrix(q)[..., 2], by_q, np.zeros_like(by_q)

    data = rotation_matrix(top().attitudes)[..., 2]
    fit = top().fit(data, observe=axis, free=["c", "start"], parameters=top().true)
    assert fit.parameters["c"] == pytest.approx(4e-4, rel=1e-5)
    assert fit.converged

    def height(q, p):
        return q[:, 1], np.eye(2)[None, 1] + np.zeros((len(q), 1)), np.zeros((len(q), 2))

    _, _, run = pendulum()
    by_function = fit_pendulum(run.q[:, 1], observe=height)
    by_name = fit_pendulum(run.q[:, 1], observe="y")
    assert by_function.parameters == by_name.parameters


def test_angular_velocities_are_observed():
    """Exact data give exact moments; ∂Ω/∂I has two terms, by the run and by Ω = J⁻¹ l."""
    step, problem = systems.stepper("heavy_top"), gs.problems.fast_top()
    run = step.integrate(problem, dt=1e-3, steps=120, every=3)
    omega = run.body().angular_velocity()
    begin = gs.Start(problem.q0, 0.97 * problem.p0)
    fit = partial(gs.fit, step, begin, run.t, dt=1e-3,
                  parameters=run.parameters | {"I3": 0.95 * problem.inertia[2]})
    estimate = fit(np.concatenate([run.p[:, :2], omega, run.body().attitude], axis=1),
                   free=["I3", "start"], observe=["p0", "p1", "body angular_velocity", "attitude"])
    assert estimate.converged
    assert estimate.parameters["I3"] == pytest.approx(problem.inertia[2], rel=1e-8)
    assert estimate.p == pytest.approx(problem.p0, abs=1e-8 * np.abs(problem.p0).max())
    with refused("angular_velocity.*mean"):
        fit(omega, observe="angular_velocty")


def test_residuals_of_two_attitudes_are_those_of_each():
    draw = np.random.default_rng(2)
    q, p = draw.normal(size=(2, 5, 8))
    data, bodies = draw.normal(size=(5, 8)), ([0, 1, 2, 3], [4, 5, 6, 7])
    both, by_q, *_ = Observation(8, [*bodies], None, [""] * 8).residuals(data, q, p, {})
    for k, body in enumerate(bodies):
        r, slopes, *_ = Observation(8, [body], None, [""] * 4).residuals(
            data[:, body], q, p, {})
        assert np.array_equal(both[:, 3 * k : 3 * k + 3], r)
        assert np.array_equal(by_q[:, 3 * k : 3 * k + 3], slopes)


@pytest.mark.parametrize("angle", [1e-3, 1.0, 3.0])
def test_a_residual_of_an_attitude_is_twice_the_sine_of_half_the_angle(angle):
    n, d = np.array([2, -1, 2]) / 3, np.array([0.5, -0.1, 0.7, 0.5])
    turn = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * n])
    q = np.array([quaternion_product(d, turn)])
    for data in (d, -d):
        r, *_ = Observation(4, [[0, 1, 2, 3]], None, [""] * 4).residuals(
            data[None], q, 0 * q, {})
        assert np.abs(r[0] - 2 * np.sin(angle / 2) * n).max() < 1e-15


@pytest.mark.parametrize("entries", [3, 6])
def test_residuals_of_angular_velocities_have_the_slopes_of_differences(entries):
    names = [f"J{k}" for k in range(entries)]
    body = BodyAt([1, 2, 3, 4], names, [], [], [], None)
    observation = Observation(6, [5, body], None, [""] * 4)
    draw = np.random.default_rng(1)
    q, p, data = draw.normal(size=(2, 6)), draw.normal(size=(2, 6)), draw.normal(size=(2, 4))
    inertia = [2.0, 3.0, 2.5] if entries == 3 else [2.0, 0.1, 0.2, 3.0, 0.3, 2.5]
    parameters = dict(zip(names, inertia, strict=True))
    r, *slopes, by_parameters = observation.residuals(data, q, p, parameters)
    assert r.shape == (2, 4)

    def moved(h, dq=0.0, dp=0.0, name=None):
        changed = parameters | ({name: parameters[name] + h} if name else {})
        return observation.residuals(data, q + h * dq, p + h * dp, changed)[0]

    def slope(**change):
        return (moved(1e-6, **change) - moved(-1e-6, **change)) / 2e-6

    for column, unit in enumerate(np.eye(6)):
        assert slope(dq=unit) == pytest.approx(slopes[0][:, :, column], abs=1e-8)
        assert slope(dp=unit) == pytest.approx(slopes[1][:, :, column], abs=1e-8)
    for name in names:
        assert slope(name=name) == pytest.approx(by_parameters[name], abs=1e-8)


def test_coordinates_and_momenta_are_observed_together():
    _, _, run = pendulum()
    fit = fit_pendulum(np.concatenate([run.p, run.q[:, :1]], axis=1), observe=["p", "x"],
                       free=["m", "l", "g", "start"], guess={"m": 1.5})
    assert not fit.undetermined
    assert fit.parameters["m"] == pytest.approx(1.0, rel=1e-9)


def test_horizons_may_begin_with_one_sample():
    estimate = fit_pendulum(horizons=[1, 8], free=["start"], guess={"l": 0.5})
    assert estimate.q == pytest.approx([0.5, 0.0], abs=1e-9)


def test_noise_that_is_known_scales_the_covariance():
    data = top().data(3)
    fit = top().fit(data, sigma=1e-3)
    assert fit.parameters["c"] == pytest.approx(top_fit().parameters["c"], rel=1e-6)
    ratio = top_fit().sigma["c"] / fit.sigma["c"]
    count = top_fit().residuals.size
    assert ratio == pytest.approx(top_fit().rms * np.sqrt(count / (count - 10)) / 1e-3, rel=1e-3)


# ---------------------------------------------------------------- inertias of bodies


@pytest.mark.parametrize("names", [
    ["I1", "I2", "I3"], ["upper_K11", "upper_K12", "upper_K13", "upper_K22", "upper_K23",
                         "upper_K33"]])
def test_each_step_of_an_inertia_is_that_of_a_body(names):
    tensor = len(names) == 6
    quaternion, domains = ("a", "b", "c", "d"), dict.fromkeys(names, "real")
    system = SystemManifest(
        name="upper", coordinates=quaternion, momenta=("s", "t", "u", "v"), parameters=domains,
        hamiltonian="0", constraints=(), hidden=(), start_parameters=(), rigid_body=not tensor,
        bodies={"upper": BodyManifest(q=quaternion, inverse_inertia=(*names,))} if tensor else {})
    step = SimpleNamespace(manifest=SimpleNamespace(system=system), parameter_domains=domains)
    first = dict(zip(names, [3.0, 0.2, -0.1, 2.0, 0.3, 1.8] if tensor else [1.0, 1.5, 2.2],
                     strict=True))
    coordinates, draw = Coordinates(step, names, first), np.random.default_rng(0)
    now = coordinates.inside(first)
    for _ in range(20):
        y = draw.normal(size=len(names))
        exact = coordinates.jacobian(now) @ y
        ahead, back = (coordinates.apply_step(now, sign * 1e-5 * y) for sign in (1, -1))
        slope = [(ahead[name] - back[name]) / 2e-5 for name in names]
        assert exact == pytest.approx(slope, rel=1e-5, abs=1e-6 * np.abs(exact).max())
        now = coordinates.apply_step(now, y)
        moments = [now[name] for name in names]
        if tensor:
            K = np.zeros((3, 3))
            K[np.triu_indices(3)] = moments
            moments = np.linalg.eigvalsh(np.linalg.inv(K + np.triu(K, 1).T))
        assert min(moments) > 0
        for k in range(3):
            assert moments[k] <= (1 + 1e-9) * (sum(moments) - moments[k])


# ---------------------------------------------------------------- input


WRONG = [
    ({"free": ["l", "gg"]}, "free.*mean g"),
    ({"fixed": ["ll"], "free": None}, "fixed.*mean l"),
    ({"free": ["l"], "fixed": ["l"]}, "free.*fixed"),
    ({"free": []}, "Nothing.*free"),
    ({"observe": "xx"}, "observe.*mean x"),
    ({"observe": []}, "names nothing"),
    ({"observe": "x"}, r"31 rows.*\(x\)"),
    ({"data": np.zeros((7, 2))}, r"shape \(7, 2\).*31 rows"),
    ({"dt": 0.007}, "whole number"),
    ({"dt": 0.0}, "time step"),
    ({"sigma": -1.0}, "sigma"),
    ({"sigma": [1.0, 1.0, 1.0]}, "2 columns"),
    ({"horizons": [20, 10]}, "increase"),
    ({"horizons": [100]}, "up to 31"),
    ({"horizons": [0]}, "horizon.*0"),
    ({"start": gs.Start([0.6, 0.01], [0.02, 0.1], t=0.1)}, "start"),
    ({"start": gs.Start([0.6, 0.01], [0.02, 0.1], t="now")}, "'now'"),
    ({"dt": "small"}, "dt"),
    ({"observe": lambda q, p: q}, "returned"),
    ({"observe": lambda q, p: (q, q, q)}, r"\(1, 2, 2\)"),
    ({"observe": "attitude"}, "attitude.*body.*x"),
    ({"observe": lambda q, p: (np.nan * q, *states(q))}, "value.*finite.*q ="),
    ({"observe": lambda q, p: (q, np.nan * states(q)[0], states(q)[1])}, "by q.*finite"),
    ({"observe": lambda q, p: (q, -states(q)[0], states(q)[1])}, "derivatives.*column"),
]


def states(q):
    """Return the derivatives of q by q and by p."""
    by_q = np.tile(np.eye(2), (len(q), 1, 1))
    return by_q, 0 * by_q


@pytest.mark.parametrize(("change", "message"), WRONG,
                         ids=[f"{next(iter(x))}-{i}" for i, (x, _) in enumerate(WRONG)])
def test_what_cannot_be_fitted_is_refused_in_a_sentence(change, message):
    with refused(message):
        fit_pendulum(**change)


def test_data_that_are_no_measurements_are_refused():
    _, _, run = pendulum()
    data = run.q.copy()
    data[4, 1] = np.nan
    with refused(r"data\[4, 1\] = nan"):
        fit_pendulum(data)
    with refused("unit quaternion"):
        top().fit(2 * top().attitudes)
    with refused("samples"):
        fit_pendulum(data[:1], times=run.t[:1], dt=None)
    case = dataclasses.replace(top(), t=top().t[::-1])
    with refused("increase"):
        case.fit(case.attitudes)
    case = dataclasses.replace(top(), t=np.where(top().t < top().t[-1], top().t, np.nan))
    with refused("time in t"):
        case.fit(case.attitudes)


def test_a_first_guess_without_a_motion_fails_as_a_run_does():
    step, model, run = pendulum()
    with pytest.raises(gs.StepFailed):
        gs.fit(step, model, run.t[1:] * 100, run.q[1:], observe="q", dt=4.0,
               parameters={"g": 900.0})


def test_what_is_printed_has_values_and_deviations():
    text = repr(top_fit())
    assert "60 samples" in text
    assert "±" in text
    for name, line in itertools.product(top().free, [text]):
        assert f"\n  {name} = " in line


def test_a_small_part_of_an_undetermined_combination_has_its_own_deviation():
    """Along (1, 0.1) one deviation is 1.43, across it 1e-3: the second is known to 14 %."""
    direction = np.array([1.0, 0.1]) / np.hypot(1, 0.1)
    across = direction[::-1] * [-1, 1]
    J = np.stack([0.7 * direction, 1000 * across])
    directions = identify(Linear(np.zeros(2), J, np.ones(2)), 1.0)
    assert directions.null.shape == (2, 1)
    assert directions.variances[0] == np.inf
    assert np.sqrt(directions.variances[1]) == pytest.approx(0.1 / np.hypot(1, 0.1) / 0.7, rel=1e-4)
    exact = identify(Linear(np.zeros(2), J * [[0], [1]], np.ones(2)), 1.0)
    assert np.all(np.isinf(exact.variances))


#: Residuals ROWS x − b of four numbers by two unknowns.
ROWS = 100 * np.array([[1.0, 0.5], [0.0, 3.0], [2.0, -1.0], [0.3, 0.2]])
SUMS = ROWS @ [3.0, -2.0] + [0.3, -0.2, 0.1, 0.7]


@pytest.mark.parametrize("longest", [np.inf, 0.05])
def test_steps_are_no_longer_than_they_may_be(longest):
    """Steps end at the solution of the normal equations, at the largest length where it is far."""
    lengths = []

    def moved(x, y):
        lengths.append(np.linalg.norm(y))
        return x + y

    minimum = minimise(
        np.array([3.3, -1.7]), lambda x: ROWS @ x - SUMS,
        lambda x: Linear(ROWS @ x - SUMS, ROWS, np.ones(2)), moved,
        lambda x, y: np.linalg.norm(y) / longest, tolerance=1e-20, iteration_limit=60)
    assert minimum.converged
    assert np.abs(minimum.point - np.linalg.solve(ROWS.T @ ROWS, ROWS.T @ SUMS)).max() < 1e-9
    assert max(lengths) <= longest * (1 + 1e-15)
    assert lengths[:4] == pytest.approx(lengths[:1] * 4) or longest == np.inf
