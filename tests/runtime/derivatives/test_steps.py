"""Tangents and adjoints against differences and against each other."""

from __future__ import annotations

import pickle
import warnings

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from derivative_cases import (
    label,
    product,
    stepper_for,
    transposition_defect,
)
from gyrospark.runtime.derivatives.kept_steps import PIECE
from gyrospark.runtime.derivatives.tangent_space import null_space, solve
from gyrospark.runtime.results.joint_motion import (
    cotangents_of_multipliers,
    multipliers_at_states,
)

x, v, t = sp.symbols("x v t", real=True)
m, c = sp.symbols("m c", positive=True)

VALUES = systems.case("driven_pendulum").parameters


@pytest.fixture(scope="module")
def top():
    step, problem = systems.differentiable("heavy_top"), gs.problems.fast_top()
    return step, problem, problem.parameters | {"gamma": 0.0016}


def test_a_gradient_is_the_same_however_it_is_computed(top):
    """Checkpoints have the same bits; running backwards and tangents agree to round-off."""
    step, problem, parameters = top
    arguments = {"dt": 1e-3, "steps": 300, "every": 7, "parameters": parameters}
    run = step.integrate(problem.q0, problem.p0, **arguments,
                         tangents=gs.Tangents("all", ["I3", "mgl"], dt=True))
    plain = step.integrate(problem.q0, problem.p0, **arguments)
    assert (run.q == plain.q).all()
    assert (run.p == plain.p).all()
    cotangents = {"q": np.sin(run.q), "p": run.p}
    wrt = ["start", "I3", "mgl", "dt"]
    gradient = run.gradient(cotangents, wrt=wrt)
    assert (run.gradient(cotangents, wrt=wrt, memory="2 MB").vector() == gradient.vector()).all()
    by_tangents = (np.einsum("rn,rnk->k", cotangents["q"], run.tangents.q)
                   + np.einsum("rn,rnk->k", cotangents["p"], run.tangents.p))
    assert np.abs(by_tangents - gradient.vector()).max() <= 1e-12 * np.abs(by_tangents).max()
    backwards = run.gradient(cotangents, wrt=wrt, memory="none")
    assert np.abs(backwards.vector() - gradient.vector()).max() <= 1e-11 * np.abs(by_tangents).max()
    unpickled = pickle.loads(pickle.dumps(step))
    assert (unpickled.gradient(run, cotangents, wrt=wrt).vector() == gradient.vector()).all()


def test_a_loss_may_be_an_expression():
    """The loss is a sum over states, of time and parameters too; differences have its gradient."""
    step = systems.differentiable("driven_pendulum")
    start = step.consistent([0.5, -0.8], [0.3, 0.4], parameters=VALUES, t=0.3)
    loss = m * x**2 + sp.sin(t) * v + c

    def value(**changes):
        numbers = VALUES | {k: e for k, e in changes.items() if k != "dt"}
        moved = step.consistent(start.q, start.p, parameters=numbers, t=0.3)
        run = step.integrate(gs.Start(moved.q, moved.p, t=0.3), dt=changes.get("dt", 0.02),
                             steps=12, every=5, parameters=numbers)
        return run.gradient(loss=loss, wrt=["m", "c", "dt"])

    gradient = value()
    for name, size in (("m", 1.1), ("c", 0.3), ("dt", 0.02)):
        low, high = (value(**{name: size * (1 + s * 1e-5)}).value for s in (-1, 1))
        assert gradient[name] == pytest.approx((high - low) / (2e-5 * size), rel=1e-7)
    with pytest.raises(gs.InputError, match="'z'"):
        step.integrate(gs.Start(start.q, start.p, VALUES, 0.3), dt=0.02, steps=2).gradient(
            loss=sp.Symbol("z"))


@pytest.mark.parametrize("span", [{"steps": 12}, {"t_end": 0.1137}])
def test_a_loss_may_have_reactions(span):
    """The tension of a rod is its multiplier; differences by g and dt have the gradient."""
    step, case = systems.differentiable("two_rods"), systems.case("two_rods")
    loss = sp.Symbol("lambda_1")**2 * (1 + sp.Symbol("x1", real=True))

    def gradient(name="dt", change=0.0, every=1):
        numbers = {**case.parameters, "dt": 0.01}
        numbers[name] += change
        dt = numbers.pop("dt")
        q, p = step.project(case.q, case.p, parameters=numbers)
        run = step.integrate(q, p, dt=dt, every=every, parameters=numbers, **span)
        return run, run.gradient(loss=loss, wrt=["g", "dt"])

    run, slopes = gradient()
    tension = multipliers_at_states(run)[:, 1]
    assert slopes.value == pytest.approx(tension**2 @ (1 + run.q[:, 0]), rel=1e-13)
    for name, size in (("g", 10.0), ("dt", 0.01)):
        e = 1e-4 * size
        near, far = ([gradient(name, s * k * e)[1].value for s in (1, -1)] for k in (1, 2))
        slope = (8 * (near[0] - near[1]) - (far[0] - far[1])) / (12 * e)
        assert slopes[name] == pytest.approx(slope, rel=1e-7)
    with pytest.raises(gs.InputError, match="every = 1"):
        gradient(every=5)


@pytest.mark.parametrize("scheme", ["G-L", "IMS"])
def test_multipliers_at_states_before_an_end_between_two_steps(scheme):
    """Rows of six steps come first, then of a shorter last one; cotangents are the transpose."""
    step, dt = systems.stepper("two_rods", scheme), systems.case("two_rods").dt
    full_steps = systems.run("two_rods", step, 6)
    run = systems.run("two_rods", step, None, t_end=6.4 * dt)
    at_states = multipliers_at_states(run)
    assert np.array_equal(at_states[:-1], multipliers_at_states(full_steps))
    assert np.array_equal(at_states[-1], run.multipliers[-1, -1])
    w = np.random.default_rng(2).normal(size=at_states.shape)
    assert (cotangents_of_multipliers(run, w) * run.multipliers).sum() == pytest.approx(
        (w * at_states).sum(), rel=1e-13)


@pytest.mark.parametrize("real", ["double", "float128"])
def test_a_file_keeps_tangents(tmp_path, real):
    step, case = systems.differentiable("driven_pendulum", real=real), systems.case(
        "driven_pendulum")
    begin = gs.Start(*systems.start("driven_pendulum", step), t=case.t0)
    level = float(step.integrate(begin, dt=case.dt, steps=2, parameters=case.parameters).q[1, 0])
    run = step.integrate(begin, dt=case.dt, steps=3, parameters=case.parameters, events=[
        gs.Event("x", level=level + 1e-3), gs.Event("y", level=9)],
        tangents=gs.Tangents("all", ["m"], multipliers=True))
    read = gs.load(run.save(tmp_path / "run.npz")).tangents
    assert read.names == run.tangents.names
    for name in ("q", "p", "start", "t", "multipliers"):
        assert (getattr(read, name) == getattr(run.tangents, name)).all()
    assert [len(rows.t) for rows in read.events.values()] == [1, 0]
    for event, tangents in run.tangents.events.items():
        for name in ("q", "p", "t", "start"):
            assert (getattr(read.events[event], name) == getattr(tangents, name)).all()


def test_a_step_has_the_derivatives_of_a_run(top):
    step, problem, parameters = top
    run = step.integrate(problem.q0, problem.p0, dt=1e-3, steps=1, parameters=parameters,
                         tangents=gs.Tangents("all", ["I3"], multipliers=True))
    start, n = run.tangents.start, step.n
    *_, dq, dp = step.jvp(problem.q0, problem.p0, start[:n, :6], start[n:, :6], dt=1e-3,
                          parameters=parameters)
    for derivative, tangents in ((dq, run.tangents.q), (dp, run.tangents.p)):
        assert np.abs(derivative - tangents[-1][:, :6]).max() <= 1e-13 * np.abs(tangents).max()
    q1, p1, back = step.vjp(problem.q0, problem.p0, dt=1e-3, parameters=parameters)
    assert (q1 == run.q[-1]).all()
    assert (p1 == run.p[-1]).all()
    gradient = back([1, 2, 3, 4], [4, 3, 2, 1])
    expected = (np.array([1, 2, 3, 4, 4, 3, 2, 1])
                @ np.concatenate([run.tangents.q[-1], run.tangents.p[-1]]))
    assert np.allclose(gradient.start, expected[:6], rtol=0, atol=1e-13)
    assert gradient["I3"] == pytest.approx(expected[6], rel=1e-12)
    gradient = back([0] * 4, [0] * 4, [1, -2, 3])
    expected = np.array([1, -2, 3]) @ run.tangents.multipliers[0]
    derivative = np.array([*gradient.start, gradient["I3"]])
    assert np.abs(derivative - expected).max() <= 1e-12 * np.abs(expected).max()


def test_inputs_and_moving_constraints():
    """A length moves the start too; each row of inputs has its gradient, as differences have."""
    step = systems.differentiable("driven_pendulum")
    values = {name: value for name, value in VALUES.items() if name != "push"}
    inputs = np.linspace(-1, 1, 5)[:, None]

    def loss(run):
        return run.q[-1] @ run.q[-1] + run.p[-1, 0], {"q": 2 * run.q[-1], "p": [1.0, 0.0]}

    start = step.consistent([0.5, -0.8], [0.3, 0.4], parameters=VALUES, t=0.3)
    wrt = ["start", "inputs", "l", "m", "dt"]
    f = step.value_and_gradient(loss, gs.Start(start.q, start.p, t=0.3), wrt=wrt,
                                parameters=values, dt=0.02, steps=10,
                                inputs=gs.Inputs(inputs, hold=2))
    point = np.concatenate([[0.2, -0.1], inputs[:, 0], [values["l"], values["m"], 0.02]])
    _, gradient = f(point)
    for i, size in enumerate([1, 1, 1, 1, 1, 1, 1, 1, 1, 0.02]):
        e = np.zeros(len(point))
        e[i] = 1e-5 * size
        slope = (f(point + e)[0] - f(point - e)[0]) / (2 * e[i])
        assert gradient[i] == pytest.approx(slope, rel=2e-7, abs=2e-7), i


@pytest.mark.parametrize("t0", [0.3, 1000.0])
def test_a_start_time_moves_the_constraints_whatever_its_size(t0):
    """Differences of the loss have its slope; integers in x are the same numbers as floats."""
    step, case = systems.differentiable("driven_pendulum"), systems.case("driven_pendulum")

    def loss(run):
        return run.q[-1] @ run.q[-1] + run.p[-1, 0], {"q": 2 * run.q[-1], "p": [1.0, 0.0]}

    start = step.consistent(case.q, case.p, parameters=case.parameters, t=t0)
    begin = gs.Start(start.q, start.p, case.parameters, t=t0)
    f = step.value_and_gradient(loss, begin, wrt=["start", "t0"], dt=0.02, steps=10)
    point, e = np.array([0.1, 0.1, t0]), np.array([0.0, 0.0, 1e-3])
    slope = (8 * (f(point + e)[0] - f(point - e)[0]) - f(point + 2 * e)[0]
             + f(point - 2 * e)[0]) / 12e-3
    assert f(point)[1][2] == pytest.approx(slope, rel=1e-8)
    f = step.value_and_gradient(loss, begin, wrt=["l"], dt=0.02, steps=10)
    assert np.array_equal(f([1])[1], f([1.0])[1])
    with pytest.raises(gs.InputError, match="'l' 2 times"):
        step.value_and_gradient(loss, begin, wrt=["l", "l"], dt=0.02, steps=10)


def test_gamma_by_a_rule_does_not_follow_the_moments_of_x():
    """A value with a γ that followed would have another slope than its gradient."""
    step, top = systems.differentiable("heavy_top"), gs.problems.fast_top()

    def loss(run):
        return run.p[-1].sum(), {"p": np.ones(4)}

    f = step.value_and_gradient(loss, top, wrt=["I1"], dt=4e-3, steps=20)
    moment, h = top.parameters["I1"], 1e-3 * top.parameters["I1"]
    a, b, c, d = (f([moment + k * h])[0] for k in (1, -1, 2, -2))
    assert f([moment])[1] == pytest.approx((8 * (a - b) - c + d) / (12 * h), rel=1e-7)


@pytest.mark.parametrize(("name", "scheme"), [
    pytest.param(name, scheme, id=f"{name}-{label(scheme)}", marks=[pytest.mark.slow] * (
        (name, scheme) not in (("driven_pendulum", ("G-L", 2)), ("breathing", ("EMS", None)))))
    for name, scheme in product()])
def test_cotangents_are_transposed(name, scheme):
    step, case = stepper_for(name, scheme), systems.case(name)
    begin = systems.timed_start(name, step).replace(parameters=case.parameters)
    assert transposition_defect(step, begin, case.dt, 4) <= 200 * step.binding.epsilon


# The iteration contracts by 0.003 to 0.02 a time at 0.02, and by 0.05 to 0.1 at 0.1; at 0.3, with
# 0.4, J is factorised.
@pytest.mark.parametrize("dt", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("scheme", ["G-L", pytest.param("EMS", marks=pytest.mark.slow)])
def test_cotangents_of_sums_over_elements_are_transposed(scheme, dt):
    step = systems.differentiable("beads", scheme)
    begin = systems.timed_start("beads", step).replace(parameters=systems.case("beads").parameters)
    assert transposition_defect(step, begin, dt) <= 200 * step.binding.epsilon


def test_cotangents_are_transposed_over_two_thousand_steps():
    """Sums of cotangents times tangents are the gradient, over all rows of a run."""
    name, labels = "driven_pendulum", ["m", "l", "push"]
    step, case = systems.differentiable(name), systems.case(name)
    (q, p), rng = systems.start(name, step), np.random.default_rng(4)
    run = step.integrate(gs.Start(q, p, t=case.t0), dt=case.dt / 10, steps=2000, every=100,
                         parameters=case.parameters,
                         tangents=gs.Tangents(start="all", parameters=labels, dt=True, t0=True))
    w = {"q": rng.normal(size=run.q.shape), "p": rng.normal(size=run.p.shape)}
    gradient = step.gradient(run, w)
    pulled = [*gradient.start, *(gradient[k] for k in (*labels, "dt", "t0"))]
    terms = [w["q"][:, :, None] * run.tangents.q, w["p"][:, :, None] * run.tangents.p]
    sums = sum(x.sum(axis=(0, 1)) for x in terms)
    sizes = sum(np.abs(x).sum(axis=(0, 1)) for x in terms)
    assert np.abs(sums - pulled).max() <= 1e-12 * sizes.max()
    assert (np.abs(sums - pulled) <= 1e-9 * sizes).all()


def test_inputs_have_the_same_bits_from_checkpoints():
    step = systems.differentiable("pushed_pendulum")
    rows = np.random.default_rng(6).normal(size=(3000, 2))
    run = step.integrate([0.6, -0.8], [0.4, 0.3], dt=1e-3, steps=3000, every=10, inputs=rows,
                         parameters={"k": 9.81})
    w = {"q": run.q, "p": 2 * run.p}
    wrt = ("start", "inputs", "k", "dt")
    at_once, pieces = (step.gradient(run, w, wrt=wrt, memory=m) for m in ("256 MB", "500 kB"))
    assert at_once.inputs.shape == rows.shape
    assert np.array_equal(at_once.vector(), pieces.vector())
    assert np.array_equal(at_once.inputs, pieces.inputs)


def test_cotangents_of_multipliers_belong_to_their_steps_wherever_pieces_begin():
    """A piece of a run may begin at a stored state and end between two; zeros add nothing."""
    name, gradients = "driven_pendulum", []
    step, case = systems.differentiable(name), systems.case(name)
    (q, p), steps = systems.start(name, step), 4 * PIECE
    for every in (2 * PIECE, PIECE):
        run = step.integrate(gs.Start(q, p, t=case.t0), dt=case.dt / 10, steps=steps, every=every,
                             parameters=case.parameters)
        cotangents = np.zeros_like(run.multipliers)
        cotangents[2 * PIECE // every - 1 :: 2 * PIECE // every] = 1.0
        gradients.append(step.gradient(run, {"multipliers": cotangents}, memory="none"))
    assert np.array_equal(*(gradient.vector() for gradient in gradients))


@pytest.mark.parametrize(("size", "count", "dependent"), [
    (8, 2, 0), (28, 16, 1), (14, 6, 2), (6, 0, 0), (5, 5, 1)])
def test_a_basis_is_orthonormal_and_complete(size, count, dependent):
    rows = np.random.default_rng(0).normal(size=(count, size))
    for k in range(dependent):
        rows[-1 - k] = rows[0] + (k + 1) * rows[1]
    basis = null_space(rows)
    assert basis.shape == (size, size - count + dependent)
    assert np.abs(rows @ basis).max(initial=0) < 1e-14 * max(np.abs(rows).max(initial=1), 1)
    assert np.abs(basis.T @ basis - np.eye(basis.shape[1])).max() < 1e-15


SWITCHED = {"dt": 0.0313, "steps": 400, "parameters": {"c": 0.1}}


@pytest.fixture(scope="module")
def dry():
    """Return an oscillator with drag that jumps at x = 0, and a force that begins at t = 1."""
    drag, push = (sp.Piecewise((v, x < 0), (2 * v, True)),
                  sp.Piecewise((t - 1, t > 1), (0, True)))
    return gs.stepper("G-L", stages=1, system=gs.System(
        (x,), (v,), (c,), v**2 / 2 + x**2 / 2, forces=(c * (push - drag),), time=t, name="dry"))


def changes(values):
    return int((np.diff(np.sign(values)) != 0).sum())


def test_forces_that_jump_are_warned_of(dry):
    with pytest.warns(gs.errors.InputWarning, match="steps"):
        run = dry.integrate(gs.Start([1.0], [0.02], t=2.0), **SWITCHED,
                            tangents=gs.Tangents(None, ["c"]))
    crossed = changes(run.q[:, 0])
    assert run.tangents.switched_steps == crossed > 0
    for memory in ("256 MB", "80 kB"):
        with pytest.warns(gs.errors.InputWarning, match=f"{crossed} step"):
            assert run.gradient({"q": [1.0]}, memory=memory).switched_steps == crossed


@pytest.mark.parametrize(("t0", "count"), [(0.7, 1), (2.0, 0)])
def test_switches_of_the_time_are_counted(dry, t0, count):
    """A run without such a switch has no warning."""
    run = dry.integrate(gs.Start([1.0], [0.0], t=t0), **SWITCHED | {"steps": 20})
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert run.gradient({"q": [1.0]}).switched_steps == count
    assert len(caught) == count


@pytest.mark.parametrize("m", [2.0**-80, 1.0, 2.0**100])
def test_growth_is_warned_of_whatever_the_units(m):
    """Beside a pendulum on its head directions grow by e^t, beside a hanging one by t."""
    step, arguments = systems.differentiable("pendulum"), {
        "dt": 0.1, "parameters": {"m": m, "g": 1.0, "l": 1.0}, "tangents": gs.Tangents()}
    hanging = step.integrate([0.0, -1.0], [m, 0.0], steps=320, **arguments)
    loss = {"q": hanging.q[-1], "p": hanging.p[-1] / m**2}
    hanging.gradient(loss)
    with pytest.warns(gs.errors.InputWarning, match="float128"):
        standing = step.integrate([0.0, 1.0], [0.0, 0.0], steps=320, **arguments)
    with pytest.warns(gs.errors.InputWarning, match="float128"):
        standing.gradient(loss)


@pytest.mark.parametrize("count", [1, 5])
def test_wide_numbers_are_eliminated_with_pivots(count):
    """A first pivot of 0 and a row far larger than others cost no digit."""
    A = np.random.default_rng(count).normal(size=(5, 5)).astype(np.longdouble)
    A[0, 0], A[1] = 0, 1e9 * A[1]
    x = np.arange(5 * count).reshape(5, count).astype(np.longdouble) + 1
    assert np.abs(solve(A, A @ x) - x).max() <= 1e3 * np.finfo(np.longdouble).eps * np.abs(x).max()
