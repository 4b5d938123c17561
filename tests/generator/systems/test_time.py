"""Time in H and in constraints: driven systems, each against the same with time as a coordinate.

    car axis     the IVP test set's, n = 4, m = 2: digits of a run of another length, 1e-17
    wire         a bead on a wire that turns: r = r₀ cosh ωt
    shaken       a pendulum whose pivot is shaken: in the plane, and in its angle with t in H
    chain        masses on a shaken string, in forms, dense, on lanes

The second way to every number is H + p_τ with the coordinate τ: q and p are those of the direct
way, and W = −(p_τ − p_τ(0)).
"""

from __future__ import annotations

from fractions import Fraction
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.generator.pipeline import generate
from gyrospark.generator.schemes.midpoint_conditions import check_mean_scheme
from gyrospark.generator.schemes.step_equations import MeanScheme
from gyrospark.generator.spec import Spec
from gyrospark.runtime.steppers.stepper import Stepper
from processes import ROOT
from strategies import EPS

t = sp.Symbol("t", real=True)
w, a = sp.symbols("w a", positive=True)
NUMBERS = {"w": 2.5, "a": 0.3}


def symbols(text, prefix="p"):
    names = text.split()
    return (sp.symbols(names, real=True), sp.symbols([prefix + x for x in names], real=True))


@cache
def car_axis():
    q, p = symbols("xl yl xr yr")
    xl, yl, xr, yr = q
    m, half = sp.Rational(1, 2000), sp.Rational(1, 2)
    yb = sp.sin(10 * t) / 10
    xb = sp.sqrt(1 - yb**2)
    H = (sum(x**2 for x in p) / (2 * m) + m * (yl + yr) + (sp.sqrt(xl**2 + yl**2) - half)**2 / 2
         + (sp.sqrt((xr - xb)**2 + (yr - yb)**2) - half)**2 / 2)
    g = [xb * xl + yb * yl, (xl - xr)**2 + (yl - yr)**2 - 1]
    return gs.System(q, p, (), H, g, name="car_axis", time=t)


@cache
def wire(*, dragged=False):
    (x, y), p = symbols("x y")
    g = [y * sp.cos(w * t) - x * sp.sin(w * t)]
    return gs.System((x, y), p, (w, a), sum(u**2 for u in p) / 2, g, time=t,
                     name="dragged_wire" if dragged else "wire",
                     forces=[-a * p[0] + sp.cos(t), -a * p[1]] if dragged else (),
                     quantities={"radius": x * sp.cos(w * t) + y * sp.sin(w * t)})


@cache
def shaken():
    (x, y), p = symbols("x y")
    return gs.System((x, y), p, (w, a), sum(u**2 for u in p) / 2 + 9 * y,
                     [x**2 + (y - a * sp.sin(w * t))**2 - 1], name="shaken", time=t)


@cache
def shaken_angle():
    """The same in its angle: x = sin θ, y = a sin wt − cos θ, p = θ' + a w cos(wt) sin θ."""
    angle, p = sp.symbols("angle p", real=True)
    rate = a * w * sp.cos(w * t)
    H = ((p - rate * sp.sin(angle))**2 - rate**2) / 2 + 9 * (a * sp.sin(w * t) - sp.cos(angle))
    return gs.System((angle,), (p,), (w, a), H, name="shaken_angle", time=t)


@cache
def chain(count=4):
    names = " ".join(f"x{i} y{i}" for i in range(count))
    q, p = symbols(names)
    end, g, H = (0, a * sp.sin(w * t)), [], sp.Integer(0)
    for i in range(count):
        x, y = q[2 * i : 2 * i + 2]
        H += (p[2 * i]**2 + p[2 * i + 1]**2) / 2 + 9 * y + a * sp.cos(t) * x**2
        g.append((x - end[0])**2 + (y - end[1])**2 - 1)
        end = (x, y)
    return gs.System(q, p, (w, a), H, g, name="shaken_chain", time=t)


def as_coordinate(system):
    """Return H + p_τ: time as one more coordinate."""
    tau, p_tau = sp.symbols("tau p_tau", real=True)
    there = {t: tau}
    forces = [f.xreplace(there) for f in system.forces]
    return gs.System((*system.q, tau), (*system.p, p_tau), system.parameters,
                     system.H.xreplace(there) + p_tau,
                     [g.xreplace(there) for g in system.constraints],
                     forces=[*forces, 0] if forces else (), name=system.name + "_tau")


STARTS = {  # near a consistent one
    "car_axis": (car_axis, {}, [0, 0.5, 1, 0.5], [-2.5e-4, 0, -2.5e-4, 0], 0.003),
    "wire": (wire, NUMBERS, [0.4, 0], [0, 1.0], 0.01),
    "dragged_wire": (lambda: wire(dragged=True), NUMBERS, [0.4, 0], [0, 1.0], 0.01),
    "shaken": (shaken, NUMBERS, [0.6, -0.8], [0.8, 1.35], 0.01),
    "shaken_angle": (shaken_angle, NUMBERS, [0.5], [0.1], 0.01),
}
every = pytest.mark.parametrize("name", STARTS)
SLOW = [("car_axis", "EMS", None), ("wire", "G-L", 2), ("shaken_angle", "G-L", 2)]
PAIRS = [("car_axis", "G-L", 2), ("dragged_wire", "EMS", None), ("dragged_wire", "LIIIA-B", 3),
         ("shaken", "IMS", None), ("shaken_angle", "EMS", None),
         *(pytest.param(*pair, marks=pytest.mark.slow) for pair in SLOW)]
pairs = pytest.mark.parametrize(("name", "scheme", "stages"), PAIRS)


@cache
def stepper(name, scheme, stages):
    return gs.stepper(scheme, stages, system=STARTS[name][0]())


def start(name, step, t0=0.0):
    _, numbers, q, p, dt = STARTS[name]
    q, p = (np.array(x, dtype=float) for x in (q, p))
    if step.m:
        q, p = step.project(q, p, parameters=numbers, t=t0)
    return q, p, {"dt": dt, "parameters": numbers}


# ---------------------------------------------------------------- digits of others

CAR_AXIS = {  # at t = 3, [ours, 900 and 1200 steps]
    "q": [0.049345578427524092132, 0.49698946023000810676, 1.0417425248854261152,
          0.37391102726536581936],
    "v": [-0.077058368403592084284, 0.0074468665920684164914, 0.01755681575354173663,
          0.77034104377960106312],
    "lambda": [0.0047368865908533265153, 0.0011046803312595658399],
}
@pytest.mark.parametrize("source", ["system", "file"])
@pytest.mark.parametrize("solver", ["auto", "newton"])
def test_car_axis_has_the_digits_of_the_test_set(source, solver):
    file = ROOT / "examples" / "car_axis.toml"
    step = gs.stepper("G-L", 5, system=file if source == "file" else car_axis())
    run = step.integrate([0, 0.5, 1, 0.5], [-2.5e-4, 0, -2.5e-4, 0], dt=0.003, steps=1000,
                         parameters={}, solver=solver)
    assert np.abs(run.q[-1] - CAR_AXIS["q"]).max() < 1e-14
    assert np.abs(run.p[-1] * 2000 - CAR_AXIS["v"]).max() < 1e-12
    last = run.multipliers.reshape(1000, -1, 2)[-1, -1]
    assert np.abs(last - CAR_AXIS["lambda"]).max() < 1e-11
    assert run.report.constraint_max <= 8 * EPS
    assert run.report.energy_error_max < 1e-15


@pytest.mark.parametrize(("scheme", "stages"), [("EMS", None), ("IMS", None), ("G-L", 2)])
def test_bead_on_a_wire_that_turns(scheme, stages):
    step = stepper("wire", scheme, stages)
    q, p, what = start("wire", step)
    errors = []
    for halvings in range(3):
        steps = 10 << halvings
        run = step.integrate(q, p, **what | {"dt": 1 / steps}, steps=steps)
        x, y = run.q.T
        along = run.p[-1] @ [np.cos(2.5), np.sin(2.5)]
        errors.append(max(abs(run.quantity("radius")[-1] - 0.4 * np.cosh(2.5)),
                          abs(along - np.sinh(2.5))))
        defect = y * np.cos(2.5 * run.t) - x * np.sin(2.5 * run.t)
        assert np.abs(defect).max() <= 4 * EPS * np.abs(run.q).max()
        turning = run.p[:, 0] * -np.sin(2.5 * run.t) + run.p[:, 1] * np.cos(2.5 * run.t)
        if stages:  # the wire gives the bead its speed across
            assert np.abs(turning - 2.5 * run.quantity("radius")).max() <= 64 * EPS
    orders = [np.log2(one / two) for one, two in pairwise(errors)]
    assert abs(orders[-1] - step.manifest["scheme"]["order"]) < 0.1


# ---------------------------------------------------------------- the second way

@pairs
@pytest.mark.parametrize("solver", ["fixed-point", "newton", "python"])
def test_time_as_a_coordinate_gives_the_same(name, scheme, stages, solver):
    step = stepper(name, scheme, stages)
    q, p, what = start(name, step)
    other = gs.stepper(scheme, stages, system=as_coordinate(STARTS[name][0]()))
    run = step.integrate(q, p, steps=60, **what, solver=solver)
    same = other.integrate([*q, 0], [*p, 0], steps=60, **what, solver=solver)
    n = len(q)
    assert np.abs(run.q - same.q[:, :n]).max() <= 1e4 * EPS * np.abs(run.q).max()
    assert np.abs(run.p - same.p[:, :n]).max() <= 1e4 * EPS * np.abs(run.p).max()
    assert np.abs(run.t - same.q[:, n]).max() <= 60 * EPS
    own = run.work - (same.work if other.binding.has_forces else 0)
    assert np.abs(own + same.p[:, n]).max() <= 1e4 * EPS * (1 + np.abs(run.energy()).max())
    if step.m:
        assert run.report.constraint_max <= 8 * EPS


@every
def test_energy_momentum_scheme_balances_energy(name):
    step = stepper(name, "EMS", None)
    q, p, what = start(name, step)
    run = step.integrate(q, p, steps=400, **what)
    size = np.abs(run.energy()).max() + np.abs(run.work).max()
    assert np.abs(run.work).max() > 1e-3 * size  # the drive does do work
    assert run.report.energy_error_max <= 100 * EPS * size
    H = run.energy()
    assert np.array_equal(H, step.energy(run.q, run.p, parameters=what["parameters"], t=run.t))
    assert np.abs(H - H[0] - run.work).max() <= 100 * EPS * size


@pytest.mark.parametrize("name", ["wire", "shaken", "shaken_angle", "car_axis"])
def test_balance_and_constraint_work_are_identities(name):
    scheme = MeanScheme(STARTS[name][0](), discrete=True)
    found = {line.name: line for line in check_mean_scheme(scheme)}
    for law in ("energy", "constraint work", "symmetric", "consistent", "order"):
        assert found[law].holds, found[law]
    if name in ("wire", "shaken"):  # no root: proved
        assert "D_t" in found["energy"].equation


@pytest.mark.parametrize(("scheme", "stages"), [
    ("EMS", None), ("IMS", None), ("G-L", 2), ("LIIIA-B", 2),
    pytest.param("G-L", 1, marks=pytest.mark.slow)])
def test_orders_on_a_shaken_pivot(scheme, stages):
    """Against the angle in short steps."""
    fine = stepper("shaken_angle", "G-L", 2)
    exact = fine.integrate([0.5], [0.1], dt=0.0005, steps=2000, parameters=NUMBERS).q[-1, 0]
    step = stepper("shaken", scheme, stages)
    rate = 0.75 * np.cos(0)
    velocity = 0.1 - rate * np.sin(0.5)
    q0 = [np.sin(0.5), -np.cos(0.5)]
    p0 = [velocity * np.cos(0.5), velocity * np.sin(0.5) + rate]
    errors = []
    for steps in (20, 40, 80):
        run = step.integrate(q0, p0, dt=1 / steps, steps=steps, parameters=NUMBERS)
        x, y = run.q[-1]
        errors.append(abs(np.arctan2(x, 0.3 * np.sin(2.5) - y) - exact))
        lengths = run.q[:, 0]**2 + (run.q[:, 1] - 0.3 * np.sin(2.5 * run.t))**2 - 1
        assert np.abs(lengths).max() <= 4 * EPS
    orders = [np.log2(one / two) for one, two in pairwise(errors)]
    assert abs(orders[-1] - step.manifest["scheme"]["order"]) < 0.3, orders


# ---------------------------------------------------------------- lanes, batches, forms, times

@pytest.mark.parametrize(("scheme", "stages"), [("EMS", None), ("G-L", 2)])
@pytest.mark.parametrize("name", ["dragged_wire", "shaken"])
def test_ensembles_give_what_single_runs_do(name, scheme, stages):
    step = stepper(name, scheme, stages)
    q, p, what = start(name, step)
    starts = [step.project(q + d, p, parameters=NUMBERS) for d in np.linspace(0, 0.2, 5)]
    q0s, p0s = (np.array(x) for x in zip(*starts, strict=True))
    many = step.integrate_ensemble(q0s, p0s, steps=30, every=10, **what)
    for i in range(5):
        one = step.integrate(q0s[i], p0s[i], steps=30, every=10, **what)
        assert np.abs(many.q[i] - one.q).max() <= 64 * EPS
        assert np.abs(many.p[i] - one.p).max() <= 256 * EPS


@pytest.mark.parametrize(("scheme", "stages"), [
    ("G-L", 2), *(pytest.param(scheme, None, marks=pytest.mark.slow) for scheme in ("IMS", "EMS"))])
def test_forms_give_what_dense_code_does(scheme, stages):
    steppers = []
    for structured in (False, True):
        made = generate(Spec.checked(scheme, stages), system=chain(), structured=structured)
        steppers.append(Stepper(made.source.name, made.source.files()))
    dense, forms = steppers
    q0, p0 = dense.project([0.6, -0.8, 1.2, -1.6, 1.2, -2.6, 2.0, -3.2], np.zeros(8),
                           parameters=NUMBERS)
    for solver in ("auto", "newton"):
        runs = [step.integrate(q0, p0, dt=0.01, steps=50, parameters=NUMBERS, solver=solver)
                for step in steppers]
        assert np.abs(runs[0].q - runs[1].q).max() <= 1e4 * EPS
        assert np.abs(runs[0].p - runs[1].p).max() <= 1e5 * EPS
        assert np.abs(runs[0].work - runs[1].work).max() <= 1e5 * EPS
        assert all(run.report.constraint_max <= 16 * EPS for run in runs)
        if scheme == "EMS":
            assert all(run.report.energy_error_max <= 1e3 * EPS * 100 for run in runs)
    x = dense.guess(q0, p0, dt=0.01, parameters=NUMBERS, t=0.3)
    one, two = (step.jacobian(x, q0, p0, dt=0.01, parameters=NUMBERS, t=0.3) for step in steppers)
    assert np.abs(one - two).max() <= 1e3 * EPS * np.abs(one).max()
    many = forms.integrate_ensemble([q0, q0], [p0, p0], dt=0.01, steps=50, parameters=NUMBERS)
    single = forms.integrate(q0, p0, dt=0.01, steps=50, parameters=NUMBERS)
    assert np.abs(many.q[1] - single.q).max() <= 1e4 * EPS


@pairs
def test_jacobian_is_the_derivative_of_the_residual(name, scheme, stages):
    step = stepper(name, scheme, stages)
    q, p, what = start(name, step, t0=0.7)
    q, p = q + 0.01, p - 0.002
    x = step.guess(q, p, **what, t=0.7) + 0.01
    J = step.jacobian(x, q, p, **what, t=0.7)
    h = 1e-6
    columns = [(step.residual(x + h * e, q, p, **what, t=0.7)
                - step.residual(x - h * e, q, p, **what, t=0.7)) / (2 * h) for e in np.eye(len(x))]
    assert np.abs(np.transpose(columns) - J).max() <= 1e-7 * np.abs(J).max()


def test_a_run_may_start_at_any_time_and_go_on():
    step = stepper("wire", "G-L", 2)
    q, p, what = start("wire", step)
    whole = step.integrate(q, p, steps=40, **what)
    rest = step.integrate(whole.q[20], whole.p[20], steps=20, **what, t0=whole.t[20])
    assert np.abs(rest.q[-1] - whole.q[-1]).max() <= 64 * EPS
    one = step.step(whole.q[20], whole.p[20], **what, t0=whole.t[20])
    assert np.abs(one[0] - whole.q[21]).max() <= 16 * EPS


# ---------------------------------------------------------------- wrong use

def test_time_that_nobody_declared_is_refused():
    (x, y), p = symbols("x y")
    for H, g in ((p[0]**2 + x * t, []), (p[0]**2, [x - sp.sin(t)])):
        with pytest.raises(InputError, match=r"'t'.* time"):
            gs.System((x, y), p, (), H, g, name="undeclared")


def test_a_start_off_a_moving_constraint_is_refused():
    step = stepper("wire", "G-L", 2)
    with pytest.raises(InputError, match="project"):
        step.integrate([0.4, 0], [0, 0.9], dt=0.01, steps=1, parameters=NUMBERS)
    with pytest.raises(InputError, match="project"):
        step.integrate([0.4, 0], [0, 1.0], dt=0.01, steps=1, parameters=NUMBERS, t0=0.1)
    moved = gs.consistent(wire(), [0.4, 0], [0, 0.9], NUMBERS, t=0.0)
    assert np.allclose(moved.p, [0, 1.0], atol=4 * EPS)
    there = gs.consistent(wire(), [0.4, 0], [0, 0.9], NUMBERS, t=0.1)
    same = step.consistent([0.4, 0], [0, 0.9], parameters=NUMBERS, t=0.1)
    assert np.allclose(there.q, same.q, atol=8 * EPS)
    assert np.allclose(there.p, same.p, atol=8 * EPS)


def test_control_says_that_it_takes_time_in_forces_only():
    spec = Spec.checked("G-L", 2).with_profile("control")
    with pytest.raises(InputError, match="profile full"):
        generate(spec, system=wire())


# ---------------------------------------------------------------- who else asks

WIRE_FILE = """
name = "wire"
[system]
coordinates = ["x", "y"]
momenta = ["px", "py"]
time = "s"
hamiltonian = "(px**2 + py**2)/2"
constraints = ["y*cos(w*s) - x*sin(w*s)"]
[parameters]
w = 2.5
[start]
q = [0.4, 0]
p = [0, 1]
[run]
dt = 0.01
steps = 40
"""


@pytest.mark.parametrize(("scheme", "stages"), [("EMS", None), ("G-L", 2)])
def test_certificate_of_a_driven_model(scheme, stages):
    _, numbers, q, p, dt = STARTS["wire"]
    found = gs.certify(gs.Model(wire(), {"w": numbers["w"], "a": 1.0}, q, p, dt=dt, steps=100),
                       scheme, stages)
    assert found.holds, found
    assert found.line("energy").holds is (True if scheme == "EMS" else None)
    assert "less work" in found.line("energy").quantity
    assert found.line("reversal").holds


def test_a_run_from_the_command_line_may_start_later(gyrospark, tmp_path):
    path = tmp_path / "wire.toml"
    path.write_text(WIRE_FILE, encoding="utf-8")
    end = gyrospark("run", path, "--scheme", "G-L", "--stages", "2", "--t0", "0.2",
                    "--json").document
    assert end["constraint_max"] <= 4 * EPS
    x, y = map(float, end["q"])
    assert abs(np.arctan2(y, x) - 2.5 * 0.6) <= 8 * EPS


def test_wide_numbers_have_time_too():
    step = gs.stepper("G-L", 2, system=wire(), real="float128")
    numbers = {"w": Fraction(5, 2), "a": Fraction(3, 10)}
    q, p = step.project([0.4, 0], [0, 1], parameters=numbers)
    run = step.integrate(q, p, dt=Fraction(1, 100), steps=20, parameters=numbers)
    assert run.report.constraint_max <= 4 * 2.0**-112
    double = stepper("wire", "G-L", 2).integrate([0.4, 0], [0, 1.0], dt=0.01, steps=20,
                                                 parameters=NUMBERS)
    assert np.abs(run.q.astype(float) - double.q).max() <= 16 * EPS
    assert np.abs(run.work.astype(float) - double.work).max() <= 16 * EPS
