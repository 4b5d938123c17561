"""Tangents and adjoints: against differences in 113 bits, and against each other."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from gyrospark.runtime.bindings.array_checks import as_real

x, y, px, py, t = sp.symbols("x y px py t", real=True)
m, g, length, c, a = sp.symbols("m g l c a", positive=True)
u = sp.Symbol("u", real=True)
v, w = sp.symbols("v w", real=True)

VALUES = systems.case("driven_pendulum").parameters
CASES = [("driven_pendulum", "EMS", None), ("lagrangian", "EMS", None), ("heavy_bob", "Radau-L", 2),
         ("double_top", "LIIIA-B", 2), ("double_top", "IMS", None)]


def step_in_113_bits(step, q, p, values, dt, t0):
    """Return unknowns, and end and multipliers of a step, by Newton's method."""
    b = step.binding
    parameters = b.parameters(values, t0)
    unknowns, work = b.new(step.unknowns), b.work()
    status = b.function("T1")(parameters, b.options(None, 60, "newton"), dt, b.pointer(q),
                              b.pointer(p), b.pointer(unknowns), b.ffi.new("int *"), work)
    assert status == 0
    status, *ends = b.finish(parameters, dt, q, p, unknowns, work)
    assert status == 0
    return unknowns, np.concatenate(ends)


@pytest.mark.slow  # seconds each; test_against_differences.py has three through public calls
@pytest.mark.parametrize(("name", "scheme", "stages"), CASES)
def test_tangents_are_limits_of_differences(name, scheme, stages):
    """In 113 bits, along every row of a direction; differences of fourth order of 2⁻³⁶."""
    case = systems.case(name)
    q, p, values = case.q, case.p, case.parameters
    step = systems.differentiable(name, scheme, stages, "float128")
    binding, n = step.derivative_binding(), step.n
    number = step.binding.number
    names = binding.own.parameter_names
    values = {name: as_real(name, values[name], number) for name in names}
    dt, t0 = as_real("dt", 0.02, number), as_real("t0", 0.3, number)
    start = step.consistent(q, p, parameters=values, t=t0)
    z = np.concatenate([step.binding.array("q", start.q, (n,)),
                        step.binding.array("p", start.p, (n,))])
    unknowns, _ = step_in_113_bits(step, z[:n].copy(), z[n:].copy(), values, dt, t0)
    unit = binding.own.new(binding.rows, binding.rows)
    unit[np.arange(binding.rows), np.arange(binding.rows)] = 1
    parameters = binding.own.parameters(values, t0)
    forces = binding.own.new(binding.own.multipliers, binding.rows)
    status, ends = binding.tangent(parameters, dt, z[:n].copy(), z[n:].copy(), unknowns, unit,
                                   forces)
    assert status == 0
    ends = np.concatenate([ends, forces])

    def end(place, change):
        state, here, size, time = z.copy(), dict(values), dt, t0
        if place < 2 * n:
            state[place] += change
        elif place < binding.rows - 2:
            here[names[place - 2 * n]] += change
        elif place == binding.rows - 2:
            size = size + change
        else:
            time = time + change
        return step_in_113_bits(step, state[:n].copy(), state[n:].copy(), here, size, time)[1]

    scales = [1] * (2 * n) + [abs(values[name]) or 1 for name in names] + [dt, dt]
    largest = [max([abs(e) * s for row in rows for e, s in zip(row, scales, strict=True)] or [0])
               for rows in (ends[: 2 * n], forces)]
    h = as_real("h", 2.0**-36, number)
    places = range(binding.rows - (step.binding.time is None))
    for place in places if n < 4 else [0, n, 2 * n, 2 * n + 3, 2 * n + len(names)]:
        e = h * scales[place]
        slope = (8 * (end(place, e) - end(place, -e)) - (end(place, 2 * e) - end(place, -2 * e))
                 ) / 12
        off = abs(slope - e * ends[:, place])
        assert max(off[: 2 * n]) <= 1e-21 * h * largest[0], place
        assert max(off[2 * n :], default=0) <= 1e-19 * h * largest[1], place
    weights = np.array([as_real("w", k % 5 - 2, number) for k in range(len(ends))], dtype=object)
    status, cotangent = binding.adjoint(parameters, dt, z[:n].copy(), z[n:].copy(), unknowns,
                                        weights[: 2 * n].copy(), weights[2 * n :].copy())
    assert status == 0
    expected = weights @ ends
    assert max(abs(expected - cotangent)) <= 1e-30 * max(abs(expected))


@pytest.fixture(scope="module")
def top():
    step, problem = systems.differentiable("heavy_top", "G-L", 3), gs.problems.fast_top()
    return step, problem, problem.parameters | {"gamma": 0.0016}


def test_a_gradient_is_the_same_however_it_is_computed(top):
    """Checkpoints have the bits; running backwards has them but for round-off; so have tangents."""
    step, problem, parameters = top
    arguments = {"dt": 1e-3, "steps": 300, "every": 7, "parameters": parameters}
    run = step.integrate(problem.q0, problem.p0, **arguments,
                         tangents=gs.Tangents("all", ["I3", "mgl"], dt=True))
    plain = step.integrate(problem.q0, problem.p0, **arguments)
    assert (run.q == plain.q).all()
    assert (run.p == plain.p).all()
    cotangents = {"q": np.sin(run.q), "p": run.p}
    wrt = ["start", "I3", "mgl", "dt"]
    kept = run.gradient(cotangents, wrt=wrt)
    assert (run.gradient(cotangents, wrt=wrt, memory="2 MB").vector() == kept.vector()).all()
    by_tangents = (np.einsum("rn,rnk->k", cotangents["q"], run.tangents.q)
                   + np.einsum("rn,rnk->k", cotangents["p"], run.tangents.p))
    assert np.abs(by_tangents - kept.vector()).max() <= 1e-12 * np.abs(by_tangents).max()
    backwards = run.gradient(cotangents, wrt=wrt, memory="none")
    assert np.abs(backwards.vector() - kept.vector()).max() <= 1e-11 * np.abs(by_tangents).max()
    other = pickle.loads(pickle.dumps(step))
    assert (other.gradient(run, cotangents, wrt=wrt).vector() == kept.vector()).all()


def test_a_loss_may_be_an_expression():
    """Its sum over the states, with time and parameters in it; against differences."""
    step = systems.differentiable("driven_pendulum")
    start = step.consistent([0.5, -0.8], [0.3, 0.4], parameters=VALUES, t=0.3)
    loss = m * x**2 + sp.sin(t) * v + c

    def value(**changes):
        here = VALUES | {k: e for k, e in changes.items() if k != "dt"}
        moved = step.consistent(start.q, start.p, parameters=here, t=0.3)
        run = step.integrate(moved.q, moved.p, dt=changes.get("dt", 0.02), steps=12, every=5,
                             t0=0.3, parameters=here)
        return run.gradient(loss=loss, wrt=["m", "c", "dt"])

    gradient = value()
    for name, size in (("m", 1.1), ("c", 0.3), ("dt", 0.02)):
        low, high = (value(**{name: size * (1 + s * 1e-5)}).value for s in (-1, 1))
        assert gradient[name] == pytest.approx((high - low) / (2e-5 * size), rel=1e-7)
    with pytest.raises(gs.InputError):
        step.integrate(start.q, start.p, dt=0.02, steps=2, t0=0.3, parameters=VALUES).gradient(
            loss=sp.Symbol("z"))


@pytest.mark.parametrize("scheme", [
    ("G-L", 2), pytest.param(("IMS", None), marks=pytest.mark.slow)], ids=["G-L", "IMS"])
def test_a_loss_may_have_reactions(scheme):
    """The force in a joint is its multipliers; by parameters and dt, against differences."""
    model = gs.models.double_top()
    step, force = systems.differentiable("double_top", *scheme), sp.symbols("lambda_2:5")
    loss = sum(part**2 for part in force) * (1 + sp.Symbol("b_q0"))

    def gradient(name="dt", change=0.0, every=1):
        here = {**model.parameters, "dt": 0.01}
        here[name] += change
        dt = here.pop("dt")
        run = step.integrate(model.q0, model.p0, dt=dt, steps=12, every=every, parameters=here)
        return run, run.gradient(loss=loss, wrt=["a_m", "gravity_z", "dt"])

    run, found = gradient()
    expected = (run.joint("joint").force()**2).sum(axis=1) @ (1 + run.q[:, 4])
    assert found.value == pytest.approx(expected, rel=1e-13)
    for name, size in (("a_m", 1.0), ("gravity_z", 10.0), ("dt", 0.01)):
        e = 1e-4 * size
        near, far = ([gradient(name, s * k * e)[1].value for s in (1, -1)] for k in (1, 2))
        slope = (8 * (near[0] - near[1]) - (far[0] - far[1])) / (12 * e)
        assert found[name] == pytest.approx(slope, rel=1e-7)
    with pytest.raises(gs.InputError, match="every = 1"):
        gradient(every=5)


@pytest.mark.parametrize("real", ["double", "float128"])
def test_a_file_keeps_tangents(tmp_path, real):
    step, problem = systems.differentiable("heavy_top", real=real), gs.problems.fast_top()
    parameters = problem.parameters | {"gamma": 0.0016}
    start = step.project(problem.q0, problem.p0, parameters=parameters)
    run = step.integrate(*start, dt=1e-3, steps=3, parameters=parameters,
                         tangents=gs.Tangents("all", ["I1"], multipliers=True))
    read = gs.Trajectory.load(run.save(tmp_path / "run.npz")).tangents
    assert read.names == run.tangents.names
    for name in ("q", "p", "start", "t", "multipliers"):
        assert (getattr(read, name) == getattr(run.tangents, name)).all()


def test_checkpoints_of_many_pieces_have_the_same_bits(top):
    step, problem, parameters = top
    run = step.integrate(problem.q0, problem.p0, dt=1e-3, steps=3000, every=3000,
                         parameters=parameters)
    whole = run.gradient({"q": run.q[-1]})
    with pytest.raises(gs.InputError, match="1,000"):
        run.gradient({"q": run.q[-1]}, memory="1 kB")
    assert (run.gradient({"q": run.q[-1]}, memory="0.8 MB").vector() == whole.vector()).all()


def test_a_step_has_the_derivatives_of_a_run(top):
    step, problem, parameters = top
    run = step.integrate(problem.q0, problem.p0, dt=1e-3, steps=1, parameters=parameters,
                         tangents=gs.Tangents("all", ["I3"], multipliers=True))
    start, n = run.tangents.start, step.n
    *_, dq, dp = step.jvp(problem.q0, problem.p0, start[:n, :6], start[n:, :6], dt=1e-3,
                          parameters=parameters)
    assert (dq == run.tangents.q[-1][:, :6]).all()
    assert (dp == run.tangents.p[-1][:, :6]).all()
    q1, p1, back = step.vjp(problem.q0, problem.p0, dt=1e-3, parameters=parameters)
    assert (q1 == run.q[-1]).all()
    assert (p1 == run.p[-1]).all()
    gradient = back([1, 2, 3, 4], [4, 3, 2, 1])
    expected = (np.array([1, 2, 3, 4, 4, 3, 2, 1])
                @ np.concatenate([run.tangents.q[-1], run.tangents.p[-1]]))
    assert np.allclose(gradient.start, expected[:6], rtol=0, atol=1e-13)
    assert gradient["I3"] == pytest.approx(expected[6], rel=1e-12)
    gradient = back([0] * 4, [0] * 4, [1, -2, 3, 1])
    expected = np.array([1, -2, 3, 1]) @ run.tangents.multipliers[0]
    found = np.array([*gradient.start, gradient["I3"]])
    assert np.abs(found - expected).max() <= 1e-12 * np.abs(expected).max()


def test_multipliers_that_turn_with_a_frame_are_refused():
    """Two points at one place: the constraints turn with the plane."""
    q, p = sp.symbols("x1 y1 x2 y2", real=True), sp.symbols("p1 p2 p3 p4", real=True)
    H = sum(part**2 for part in p) / 2 + (q[0]**2 + q[1]**2) / 2
    step = gs.stepper("G-L", stages=1, frame="symmetries", system=gs.System(
        q, p, (), H, [q[0] - q[2], q[1] - q[3]], name="joined"))
    rates = {symmetry.name: 0.5 for symmetry in step.symmetries}
    assert rates
    run = step.integrate([1, 0, 1, 0], [0, 1, 0, 1], dt=0.1, steps=3, parameters=rates)
    with pytest.raises(gs.InputError, match="frame"):
        run.gradient({"multipliers": np.ones(run.multipliers.shape)})
    with pytest.raises(gs.InputError, match="frame"):
        step.integrate([1, 0, 1, 0], [0, 1, 0, 1], dt=0.1, steps=3, parameters=rates,
                       tangents=gs.Tangents(multipliers=True))


def test_inputs_and_moving_constraints():
    """A length moves the start too; each row of inputs has its gradient; by differences."""
    step = systems.differentiable("driven_pendulum")
    values = {name: value for name, value in VALUES.items() if name != "push"}
    inputs = np.linspace(-1, 1, 5)[:, None]

    def loss(run):
        return run.q[-1] @ run.q[-1] + run.p[-1, 0], {"q": 2 * run.q[-1], "p": [1.0, 0.0]}

    start = step.consistent([0.5, -0.8], [0.3, 0.4], parameters=VALUES, t=0.3)
    wrt = ["start", "inputs", "l", "m", "dt"]
    f = step.value_and_gradient(loss, start.q, start.p, wrt=wrt, parameters=values, dt=0.02,
                                steps=10, inputs=inputs, hold=2, t0=0.3)
    at = np.concatenate([[0.0, 0.0], inputs[:, 0], [values["l"], values["m"], 0.02]])
    _, gradient = f(at)
    for i, size in enumerate([1, 1, 1, 1, 1, 1, 1, 1, 1, 0.02]):
        e = np.zeros(len(at))
        e[i] = 1e-5 * size
        slope = (f(at + e)[0] - f(at - e)[0]) / (2 * e[i])
        assert gradient[i] == pytest.approx(slope, rel=2e-7, abs=2e-7), i


def test_frames_have_the_derivatives_of_the_motion_at_rest(top):
    """The rates of a frame change the error of a run alone: derivatives by them are tiny."""
    step, problem, parameters = top
    moving = gs.stepper("G-L", stages=3, frame="symmetries")
    names = [symmetry.name for symmetry in moving.symmetries]
    run = moving.integrate(problem.q0, problem.p0, dt=1e-3, steps=50,
                           parameters=parameters | {"frame": "start"},
                           tangents=gs.Tangents("all", ["I3", *names], dt=True))
    rest = step.integrate(problem.q0, problem.p0, dt=1e-3, steps=50, parameters=parameters,
                          tangents=gs.Tangents("all", ["I3"], dt=True))
    for name in ("start[0]", "start[5]", "I3", "dt"):
        size = np.abs(rest.tangents[name]).max()
        assert np.abs(run.tangents[name] - rest.tangents[name]).max() <= 1e-7 * size
    assert all(np.abs(run.tangents[name]).max() < 1e-10 for name in names)
    cotangents = {"q": run.q**2, "p": run.p}
    expected = (np.einsum("rn,rnk->k", cotangents["q"], run.tangents.q)
                + np.einsum("rn,rnk->k", cotangents["p"], run.tangents.p))
    found = run.gradient(cotangents, wrt=["start", "I3", *names, "dt"]).vector()
    assert np.abs(found - expected).max() <= 1e-11 * np.abs(expected).max()
