"""dt, t0 and parameters with all their digits: exact motions to round-off of long double and quad.

A mass under the force c t² has a motion that is a polynomial in t, of degree 4: three stages are
exact, so rational arithmetic is the reference, at any dt and t0.
"""

from __future__ import annotations

import json
from decimal import Decimal
from fractions import Fraction
from functools import cache

import mpmath as mp
import numpy as np
import pandas
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import equal
from gyrospark.core.exact_numbers import digits_of, exact
from gyrospark.core.warnings import capture_warnings
from gyrospark.runtime.bindings.real_numbers import from_text, rounding
from python_newton import integrate
from stores import assert_same, record
from strategies import tableau_of

WIDE = ["long-double", "float128"]
EPS = {"double": Fraction(1, 2**52), "long-double": Fraction(1, 2**63),
       "float128": Fraction(1, 2**112)}
#: All decimals that no binary number holds, each of another type.
PARAMETERS = {"m": Decimal("0.7"), "c": Fraction(11, 10)}
T0, DT, STEPS = sp.Rational(1, 3), Fraction(1, 30), 9
START = [Fraction(1, 5)], [mp.mpf(3) / 16]
RUN = {"dt": DT, "parameters": PARAMETERS}
BEGIN = gs.Start(*START, t=T0)


@cache
def pushed(real):
    """Return the stepper of a mass m under the force c t², c an input; its age is a quantity."""
    x, p, m, c, t = sp.symbols("x p m c t", real=True, positive=True)
    system = gs.System((x,), (p,), (m, c), p**2 / (2 * m), name="pushed", forces=[c * t**2],
                       time=t, inputs=(c,), quantities={"age": t, "third": x / 3, "trajectory": x})
    return gs.stepper("G-L", 3, system=system, real=real)


def motion(t, t0=Fraction(1, 3), m=Fraction(7, 10), c=Fraction(11, 10)):
    """Return x and p at a time, exactly."""
    x0, p0 = Fraction(1, 5), Fraction(3, 16)
    p = p0 + c * (t**3 - t0**3) / 3
    x = x0 + (p0 * (t - t0) + c * ((t**4 - t0**4) / 12 - t0**3 * (t - t0) / 3)) / m
    return x, p


def assert_near(numbers, expected, real, count=16):
    """Check numbers to some ε of their own type."""
    for a, b in zip(np.ravel(numbers), np.ravel(expected), strict=True):
        assert type(a) is type(rounding(real)(b)) or real == "double"
        assert abs(exact(a) - b) <= count * EPS[real] * max(abs(b), Fraction(1, 8)), (a, float(b))


@pytest.mark.parametrize("real", WIDE)
@pytest.mark.parametrize("solver", ["auto", "newton", "python"])
def test_a_run(real, solver):
    run = integrate(pushed(real), BEGIN, steps=STEPS, solver=solver, **RUN)
    times = [exact(T0) + k * DT for k in range(STEPS + 1)]
    states = [motion(t) for t in times]
    assert_near(run.t, times, real, 2)
    assert_near(run.q[:, 0], [x for x, _ in states], real)
    assert_near(run.p[:, 0], [p for _, p in states], real)
    assert_near(run.quantity("age"), times, real, 2)
    assert_near(run.quantity("third"), [x / 3 for x, _ in states], real)
    assert_near(run.work, [(p**2 - states[0][1] ** 2) / Fraction(14, 10) for _, p in states], real)
    assert run.dt == rounding(real)(DT)
    assert run.parameters == {"m": rounding(real)(Fraction(7, 10)),
                              "c": rounding(real)(Fraction(11, 10))}
    assert run.report.energy_error_max <= 64 * EPS[real]


@pytest.mark.parametrize("real", WIDE)
def test_files_of_a_run_whose_inputs_change(real, tmp_path):
    """A parameter that changes is NaN in the type, and events without crossings are saved."""
    run = pushed(real).integrate(BEGIN, steps=STEPS, **RUN, inputs={"c": np.arange(1, STEPS + 1)},
                                 events=[gs.Event("third", level=-9), gs.Event("x", level=0.21)])
    for ending in ("npz", "nc"):
        again = gs.load(run.save(tmp_path / f"run.{ending}"))
        assert equal(run, again)
        assert again.parameters["m"] == run.parameters["m"]
        changing = again.parameters["c"]
        assert np.isnan(float(changing))
        assert type(changing) is type(run.parameters["c"])
    run.save(tmp_path / "run.parquet")
    crossings = pandas.read_parquet(tmp_path / "run.events.parquet")
    assert [rounding(real)(Fraction(t)) for t in crossings["time"]] == list(run.events["x"].t)


@pytest.mark.parametrize("real", WIDE)
def test_rows_of_a_table_are_found_by_their_time(real):
    """Selected columns of an ensemble have the trajectory too; a quantity may have that name."""
    many = pushed(real).integrate_ensemble([BEGIN, BEGIN], steps=2, **RUN)
    run, frame = many.members[1], many.table("third")
    assert list(frame) == ["third"]
    assert frame.loc[(1, run.t[2]), "third"] == run.quantity("third")[2]
    alone = run.table(["trajectory", "third"])
    assert list(alone) == ["trajectory", "third"]
    assert alone.loc[run.t[2], "trajectory"] == run.q[2, 0]


@pytest.mark.parametrize("real", WIDE)
def test_three_thirds_are_a_whole(real):
    """T = 3 (T/3) has every digit: dt rounded to a double would miss it by 9e-18."""
    T = mp.mpf(1)
    with mp.workdps(40):
        third = T / 3
    step = pushed(real)
    run = step.integrate(*START, dt=third, steps=3, parameters=PARAMETERS)
    assert abs(exact(run.t[-1]) - 1) <= EPS[real]
    assert_near(run.q[-1], motion(Fraction(1), t0=Fraction(0))[:1], real)
    end = step.step(*START, dt=1, parameters=PARAMETERS)
    assert_near(end[0], [exact(run.q[-1, 0])], real)


@pytest.mark.parametrize("real", WIDE)
def test_a_python_float_is_the_number_it_holds(real):
    step = pushed(real)
    runs = [step.integrate(*START, dt=dt, steps=4, parameters={"m": m, "c": 1})
            for dt, m in ((0.1, 0.7), (Fraction(0.1), Fraction(0.7)),
                          (Decimal("0.1"), Decimal("0.7")), (mp.mpf(1) / 10, mp.mpf(7) / 10))]
    assert equal(runs[0], runs[1])
    assert equal(runs[0], runs[3])  # mpmath is set to 53 bits here: the same doubles
    assert not np.array_equal(runs[0].q, runs[2].q)
    assert type(runs[0].dt) is type(rounding(real)(Fraction(0)))


def test_a_double_stepper_rounds_once():
    step = systems.stepper("driven_oscillator")
    with mp.workdps(40):
        exact_numbers = {"k": mp.mpf("1.3"), "c": mp.mpf(1) / 3, "f": Fraction(7, 10),
                         "omega": Decimal("2.1")}
        run = step.integrate(gs.Start(*START, t=Decimal("0.3")), dt=mp.mpf("0.1"), steps=4,
                             parameters=exact_numbers)
    again = step.integrate(gs.Start([0.2], [0.1875], t=0.3), dt=0.1, steps=4,
                           parameters={"k": 1.3, "c": 1 / 3, "f": 0.7, "omega": 2.1})
    assert equal(run, again)
    assert (type(run.dt), run.t.dtype) == (float, np.float64)
    assert all(type(x) is float for x in run.parameters.values())


@pytest.mark.parametrize("real", WIDE)
@pytest.mark.parametrize("solver", ["auto", "newton"])
def test_an_ensemble(real, solver):
    """Each member has a dt, a t0 and a mass of its own, from arrays of any exact numbers."""
    steps = [Fraction(1, 30), Fraction(1, 7), Fraction(2, 9)]
    masses = np.array([Decimal("0.7"), Decimal("1.3"), Decimal("0.1")], dtype=object)
    begin = [Fraction(1, 3), Fraction(0), Fraction(-1, 7)]
    with mp.workdps(40):
        dts = [mp.mpf(x.numerator) / x.denominator for x in steps]
    ensemble = pushed(real).integrate_ensemble(gs.Start([START[0]] * 3, [START[1]] * 3, t=begin),
                                               dt=dts, steps=3, solver=solver,
                                               parameters={"m": masses, "c": PARAMETERS["c"]})
    for i, (dt, t0, m) in enumerate(zip(steps, begin, map(exact, masses), strict=True)):
        times = [t0 + k * dt for k in range(4)]
        assert_near(ensemble.t[i], times, real, 2)
        assert_near(ensemble.q[i, :, 0], [motion(t, t0, m)[0] for t in times], real, 32)
        assert_near(ensemble.members[i].quantity("age"), times, real, 2)
    sets = [{"m": m, "c": PARAMETERS["c"]} for m in masses]
    listed = pushed(real).integrate_ensemble([gs.Start(*START, values, t) for values, t in zip(
        sets, begin, strict=True)], dt=dts, steps=3, solver=solver)
    assert np.array_equal(listed.q, ensemble.q)


@pytest.mark.filterwarnings("ignore:The fastest rotation")
@pytest.mark.parametrize("real", WIDE)
def test_a_member_that_fails_has_no_time(real):
    step = gs.stepper("G-L", 2, "gamma", real=real)
    top = {"I1": 0.3, "I2": 0.31, "I3": 0.2, "mgl": 5.0, "gamma": 0.27}
    q, p = step.project([0.5, 0.5, -0.5, 0.5], [0.25, 0.75, 1.5, 0.5], parameters=top)
    ensemble = step.integrate_ensemble([q, q], [p, p], dt=[Fraction(1, 90), 900], steps=2,
                                       parameters=top, solver=gs.Solver("auto", max_iterations=10))
    assert list(ensemble.failures) == [1]
    assert type(ensemble.failures[1].t) is float
    assert all(x != x for x in (*ensemble.t[1, 1:], *ensemble.q[1, 1:].flat))
    assert_near(ensemble.t[0], [Fraction(k, 90) for k in range(3)], real, 2)


@pytest.mark.parametrize("real", WIDE)
def test_residual_jacobian_and_guess(real):
    """The residual at k = 0 is (−p/m, −c (t + c_i Δt)²); Jacobian and guess are exact, too."""
    step, t = pushed(real), exact(T0)
    nodes = [exact(c) for c in tableau_of("G-L", 3).c]
    arguments = {"dt": DT, "t": T0, "parameters": PARAMETERS}
    r = step.residual([0] * 6, *START, **arguments)
    speed, forces = exact(START[1][0]) / Fraction(7, 10), [
        Fraction(11, 10) * (t + c * DT) ** 2 for c in nodes]
    assert_near(r, [-speed] * 3 + [-f for f in forces], real)
    J = step.jacobian([0] * 6, *START, **arguments)
    expected = [[-DT * exact(a) / Fraction(7, 10) for a in row]
                for row in tableau_of("G-L", 3).A_hat]
    assert_near(J[:3, 3:], expected, real)
    x = step.guess(*START, **arguments)
    assert_near(x[:3], [speed] * 3, real)
    forward = step.quantities([START[0]], [START[1]], t=T0, parameters=PARAMETERS)
    assert_near(forward["age"], [t], real, 1)
    assert_near(step.energy(*START, parameters=PARAMETERS), [
        exact(START[1][0]) ** 2 / Fraction(14, 10)], real)


def turned(angle, axis):
    """Return the quaternion of a turn."""
    return [mp.cos(angle / 2), *(mp.sin(angle / 2) * x for x in axis)]


def times(a, b):
    """Return the product of two quaternions."""
    (u0, *u), (v0, *v) = a, b
    cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
    return [u0 * v0 - sum(x * y for x, y in zip(u, v, strict=True)),
            *(u0 * y + v0 * x + z for x, y, z in zip(u, v, cross, strict=True))]


@pytest.mark.parametrize("real", WIDE)
def test_a_file(real, tmp_path):
    run = pushed(real).integrate(BEGIN, steps=STEPS, **RUN)
    again = gs.load(run.save(tmp_path / "run.npz"))
    assert_same(again, run)
    assert type(again.dt) is type(run.dt)
    assert [type(x) for x in again.parameters.values()] == [type(run.dt)] * 2


def test_a_file_from_before_times_had_all_digits(tmp_path):
    run = pushed("float128").integrate(BEGIN, steps=STEPS, **RUN)
    path = run.save(tmp_path / "run.npz")
    with np.load(path) as file:
        content = dict(file) | {"t": run.t.astype(float)}
    about = json.loads(str(content["about"])) | {"dt": float(run.dt)}
    np.savez(path, **content | {"about": np.array(json.dumps(about))})
    again = gs.load(path)
    assert np.array_equal(again.t, run.t.astype(float))
    assert np.array_equal(again.q, run.q)


@pytest.mark.parametrize("real", [pytest.param(WIDE[0], marks=pytest.mark.slow), WIDE[1]])
def test_a_store(real, tmp_path):
    step, out = pushed(real), tmp_path / "run.zarr"
    recording = record(step, BEGIN, steps=STEPS, out=out, **RUN)
    run = step.integrate(BEGIN, steps=STEPS, **RUN)
    assert_same(recording[:], run)
    attributes = recording.attributes["run"]
    assert (attributes["dt"], attributes["t0"]) == (digits_of(run.dt), digits_of(run.t[0]))
    assert attributes["parameters"] == {"m": "0.7", "c": "1.1"}
    assert attributes["q0"] == ["0.2"]
    with_xarray = recording.dataset()
    assert np.array_equal(with_xarray.time, run.t.astype(float))
    assert with_xarray.time_bytes.shape == (STEPS + 1, 16)
    again = record(step, BEGIN, steps=STEPS, out=out, resume=True, **RUN)
    assert again.status == "complete"


@pytest.mark.parametrize("real", WIDE)
@pytest.mark.parametrize("end", ["age", "t_end"])
def test_the_work_until_an_end_between_two_steps_has_all_digits(end, real, tmp_path):
    """H − H₀ = W holds in the last row too, at a terminal event and at t_end."""
    time = Fraction(1, 3) + Fraction(11, 2) * DT
    span = {"t_end": time} if end == "t_end" else {
        "events": gs.Event("age", level=time, terminal=True), "steps": STEPS, "every": 2}
    run = pushed(real).integrate(BEGIN, **RUN, **span)
    assert float(run.t[-1]) == pytest.approx(float(time))
    assert_near(run.energy_error(), [Fraction(0)] * len(run), real)
    assert_same(pushed(real).integrate(BEGIN, **RUN, **span, out=tmp_path / "run.zarr"), run)


@pytest.fixture(scope="module")
def of_two_steps(tmp_path_factory):
    """Return a stepper, the store of a run of two steps, and its arguments."""
    step, out = pushed("float128"), tmp_path_factory.mktemp("two") / "run.zarr"
    run = {"q": START[0], "p": START[1], "t0": T0, "steps": 2, **RUN}
    record(step, out=out, **run)
    return step, out, run


@pytest.mark.parametrize(("name", "value"), [
    ("dt", DT + Fraction(1, 10**31)), ("t0", exact(T0) + Fraction(1, 10**30)),
    ("parameters", PARAMETERS | {"c": PARAMETERS["c"] + Fraction(1, 10**30)}),
    ("p", [exact(START[1][0]) + Fraction(1, 10**30)])])
def test_a_run_that_differs_in_the_thirtieth_digit_is_another(name, value, of_two_steps):
    step, out, run = of_two_steps
    with pytest.raises(gs.InputError, match="another run") as caught:
        record(step, out=out, resume=True, **run | {name: value})
    assert f"{name}" in str(caught.value)
    assert str(caught.value).count("; ") == 0  # nothing else differs


def test_a_run_that_failed_is_kept_with_its_digits(tmp_path):
    step = gs.stepper("G-L", 2, "gamma", real="float128")
    top = {"I1": Decimal("0.3"), "I2": Decimal("0.31"), "I3": Decimal("0.2"), "mgl": 5,
           "gamma": Fraction(27, 100)}
    q, p = step.project([0.5, 0.5, -0.5, 0.5], [0.25, 0.75, 1.5, 0.5], parameters=top)
    with pytest.raises(gs.StepFailed):
        record(step, q, p, dt=Fraction(2, 3), steps=9, parameters=top, out=tmp_path / "x.zarr")
    failure = gs.load(tmp_path / "x.zarr").failure()
    run = failure.trajectory
    assert run.dt == rounding("float128")(Fraction(2, 3))
    assert run.parameters["I1"] == rounding("float128")(Fraction(3, 10))
    assert failure.t == pytest.approx((failure.step - 1) * 2 / 3)


MODEL = """
name = "swing"
[system]
coordinates = ["x"]
momenta = ["px"]
hamiltonian = "px**2/(2*m)"
forces = ["c*t**2"]
[quantities]
age = "t"
[parameters]
m = 0.7
c = "11*m/7"
[start]
q = ["1/5"]
p = [0.1875]
[run]
dt = "1/30"
steps = 9
"""
BODY = """
name = "leaning"
[body]
inertia = [0.1, "1/7", 0.2]
[parameters]
lean = "pi/9"
[start]
euler = [0.3, "2*lean", "1/3"]
angular_velocity = [0.1, -0.7, "sqrt(2)"]
[run]
dt = 1e-2
"""


@pytest.mark.parametrize("real", WIDE)
def test_the_numbers_of_a_model_file(real, tmp_path):
    (tmp_path / "swing.toml").write_text(MODEL, encoding="utf-8")
    model, rounded = gs.load_model(tmp_path / "swing.toml", real=real), rounding(real)
    assert model.parameters == {"m": rounded(Fraction(7, 10)), "c": rounded(Fraction(11, 10))}
    assert (model.q0[0], model.dt) == (rounded(Fraction(1, 5)), rounded(Fraction(1, 30)))
    assert {type(model.q0[0]), type(model.dt)} == {type(rounded(Fraction(1)))}
    plain = gs.load_model(tmp_path / "swing.toml")
    assert plain.parameters == {"m": 0.7, "c": 1.1}
    assert all(type(x) is float for x in (*plain.parameters.values(), plain.dt))
    assert plain.q0.dtype == plain.p0.dtype == np.float64
    with pytest.raises(gs.InputError, match="float128"):
        gs.load_model(tmp_path / "swing.toml", real="quad")


@pytest.mark.parametrize("kind", ["euler", "quaternion"])
def test_the_start_of_a_body(kind, tmp_path):
    """q, and p = 2 L(q)ᵀ J Ω, have 34 digits of the numbers in the file."""
    with mp.workdps(50):
        phi, theta, psi = mp.mpf("0.3"), 2 * mp.pi / 9, mp.mpf(1) / 3
        q = times(times(turned(phi, [0, 0, 1]), turned(theta, [1, 0, 0])), turned(psi, [0, 0, 1]))
        if kind == "quaternion":
            q = [x / mp.sqrt(30) for x in (1, -2, 3, 4)]
        moments = [mp.mpf("0.1"), mp.mpf(1) / 7, mp.mpf("0.2")]
        omega = [mp.mpf("0.1"), mp.mpf("-0.7"), mp.sqrt(2)]
        p = times(q, [0, *(2 * moment * x for moment, x in zip(moments, omega, strict=True))])
    text = BODY.replace('euler = [0.3, "2*lean", "1/3"]', "quaternion = [1, -2, 3, 4]") if (
        kind == "quaternion") else BODY
    (tmp_path / "leaning.toml").write_text(text, encoding="utf-8")
    with capture_warnings():  # of a quaternion of length √30
        model = gs.load_model(tmp_path / "leaning.toml", real="float128")
        doubles = gs.load_model(tmp_path / "leaning.toml")
    assert_near(model.q0, [exact(x) for x in q], "float128", 1)
    assert_near(model.p0, [exact(x) for x in p], "float128", 1)
    assert model.bodies["gamma"][1] == rounding("float128")(Fraction(1, 7))
    assert doubles.q0.tolist() == [float(x) for x in q]


def test_the_command_line(gyrospark, tmp_path):
    """A file's numbers, --dt and --set t have all digits, also with a stepper from the cache."""
    real = "float128"
    (tmp_path / "swing.toml").write_text(MODEL, encoding="utf-8")
    command = ["run", str(tmp_path / "swing.toml"), "--scheme", "G-L", "--stages", "3", "--json",
               "--real", real]
    for options, dt, t0 in (([], DT, Fraction(0)),
                            (["--dt", "0.1", "--set", "t=0.7"], Fraction(1, 10), Fraction(7, 10))):
        document = gyrospark(*command, *options).document
        digits = document["all_digits"]
        rounded = rounding(real)
        assert digits["parameters"] == {"m": "0.7", "c": "1.1"}
        assert digits["dt"] == digits_of(rounded(dt))
        x, p = motion(t0 + 9 * dt, t0)
        assert_near([from_text(digits[name], real) for name in ("t",)], [t0 + 9 * dt], real, 4)
        assert_near([from_text(digits[name][0], real) for name in "qp"], [x, p], real, 64)
        assert document["t_end"] == pytest.approx(float(t0 + 9 * dt))
        assert document["parameters"] == {"m": 0.7, "c": 1.1}


def test_gamma_on_the_command_line(gyrospark):
    done = gyrospark("run", "fast-top", "--scheme", "G-L", "--stages", "2", "--real",
               "float128", "--dt", "1e-3", "--steps", "2", "--gamma", "0.0016", "--json")
    assert done.document["all_digits"]["parameters"]["gamma"] == "0.0016"


def test_means_of_moments():
    decimals = [Decimal("0.1"), Decimal("0.3"), Decimal("0.7")]
    fractions = [Fraction(x) for x in decimals]
    rules = {"m": Fraction(11, 30), "h": Fraction(63, 310), "mt": Fraction(1, 2),
             "ht": Fraction(21, 50)}
    for rule, mean in rules.items():
        assert gs.gamma(fractions, rule) == mean
        assert gs.gamma(decimals, rule) == rounding("float128")(mean)
        assert type(gs.gamma([0.1, 0.3, 0.7], rule)) is float
        with mp.workdps(40):
            assert gs.gamma([mp.mpf(1) / 3] * 3, rule) == rounding("float128")(Fraction(1, 3))


@pytest.mark.parametrize("real", WIDE)
def test_an_energy_beyond_the_largest_double_is_a_number(real):
    """H = p²/2m is 7e399 and more; a start where it overflows its own type is refused."""
    p = rounding(real)(Fraction(10) ** 200)
    run = pushed(real).integrate([0], [p], dt=DT, steps=1, parameters=PARAMETERS)
    assert_near(run.q[1] / p, [DT / Fraction(7, 10)], real)
    ensemble = pushed(real).integrate_ensemble([[0]], [[p]], dt=DT, steps=1, parameters=PARAMETERS)
    assert np.array_equal(ensemble.q[0], run.q)
    with pytest.raises(gs.InputError, match=r"H = inf.*units"):
        pushed(real).integrate([0], [p**20 * p**4], dt=DT, steps=1, parameters=PARAMETERS)
