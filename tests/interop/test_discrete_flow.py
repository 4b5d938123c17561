"""N steps as a function of a vector: its value, its tangents, its adjoints, where it fails."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from types import ModuleType

import numpy as np
import pytest

import gyrospark as gs
import systems
from flows import CASES, close, directions, flow_of, inputs_of, start_of, stepper_of
from gyrospark.core.errors import CompilerError, InputError
from gyrospark.interop import discrete_flow
from gyrospark.interop.discrete_flow import DiscreteFlow
from gyrospark.interop.flow_function import FlowFunction
from gyrospark.runtime.derivatives.kept_steps import step_bytes
from rolling_systems import SLEIGH, sleigh_end, sleigh_state


@pytest.mark.parametrize("case", CASES)
def test_the_value_has_the_bits_of_integrate(case):
    steps = 12
    flow, x = flow_of(case, steps)
    q, p, parameters, dt, t0 = start_of(case)
    run = stepper_of(case).integrate(gs.Start(q, p, t=t0), dt=dt, steps=steps,
                                     parameters=parameters, inputs=inputs_of(case, steps))
    assert np.array_equal(flow.value(x[None])[0], np.concatenate([run.q[-1], run.p[-1]]))


@pytest.mark.parametrize("case", CASES)
def test_one_step_has_the_derivatives_of_jvp_and_vjp(case):
    """Directions are tangent to the constraints; ``vjp`` projects the others, too."""
    flow, x = flow_of(case, 1)
    q, p, parameters, dt, t0 = start_of(case)
    step, n, inputs = stepper_of(case), flow.n, inputs_of(case, 1)
    arguments = {"dt": dt, "inputs": None if inputs is None else inputs[0]}
    *_, pullback = step.vjp(gs.Start(q, p, t=t0), parameters=parameters, **arguments)
    dx, w = directions(x, 1)[0, 0], np.random.default_rng(1).normal(size=2 * n)
    gradient = pullback(w[:n], w[n:])
    dx[: 2 * n] = gradient.basis @ (gradient.basis.T @ dx[: 2 * n])
    names = [*flow.names, "dt", "t0", *flow.input_names]
    *_, dq1, dp1 = step.jvp(gs.Start(q, p, t=t0), dx[:n], dx[n : 2 * n], parameters=parameters,
                            **arguments, d=dict(zip(names, dx[2 * n :], strict=True)))
    assert close(flow.tangent(x[None], dx[None, None])[0, 0], np.concatenate([dq1, dp1]), 1e-13)
    cotangent = flow.adjoint(x[None], w[None, None])[0, 0]
    assert close(gradient.basis.T @ cotangent[: 2 * n], gradient.start, 1e-13)
    expected = np.array([gradient[name] for name in names[: len(names) - len(flow.input_names)]])
    assert close(cotangent[2 * n : 2 * n + len(expected)], expected, 1e-13)
    if inputs is not None:
        assert close(cotangent[flow.fields["inputs"]], gradient.inputs[0], 1e-13)


@pytest.mark.parametrize("case", [
    "top", "framed", pytest.param("bead", marks=pytest.mark.slow)])
def test_a_run_has_the_derivatives_of_runs(case):
    flow, x = flow_of(case, 12)
    q, p, parameters, dt, t0 = start_of(case)
    step, n = stepper_of(case), flow.n
    names = [*flow.names, "dt", "t0"]
    run = step.integrate(gs.Start(q, p, t=t0), dt=dt, steps=12, parameters=parameters,
                         tangents=gs.Tangents("all", flow.names, dt=True, t0=True))
    dx = np.zeros((1, len(run.tangents.names), flow.size))
    dx[0, :, : 2 * n] = run.tangents.start.T
    dx[0, -len(names) :, 2 * n :] = np.eye(len(names))
    ends = np.concatenate([run.tangents.q[-1], run.tangents.p[-1]])
    sizes = np.abs(ends).max(axis=0) + 1e-300
    assert close(flow.tangent(x[None], dx)[0].T / sizes, ends / sizes, 1e-12)
    w = np.random.default_rng(1).normal(size=2 * n)
    gradient = step.gradient(run, {"q": w[:n], "p": w[n:]}, wrt=names)
    cotangent = flow.adjoint(x[None], w[None, None])[0, 0]
    assert close(cotangent[2 * n :], gradient.vector(), 1e-12)


@pytest.mark.parametrize("case", CASES)
def test_the_adjoint_is_the_transpose_of_the_tangent(case):
    flow, x = flow_of(case, 12)
    dx, w = directions(x, 4), np.random.default_rng(1).normal(size=(1, 3, 2 * flow.n))
    by_tangent = np.einsum("ki,ji->kj", flow.tangent(x[None], dx)[0], w[0])
    by_adjoint = np.einsum("ki,ji->kj", dx[0], flow.adjoint(x[None], w)[0])
    assert close(by_adjoint, by_tangent, 1e-12)
    J = flow.jacobian(x[None])[0]
    assert close(J @ dx[0].T, flow.tangent(x[None], dx)[0].T, 1e-12)


def test_adjoints_in_blocks_of_steps_are_those_in_one(monkeypatch):
    flow, x = flow_of("framed", 4000)
    w = np.random.default_rng(1).normal(size=(1, 3, 2 * flow.n))
    in_one = flow.adjoint(x[None], w)
    monkeypatch.setattr(discrete_flow, "DEFAULT_MEMORY", 4000 * step_bytes(flow.stepper) - 1)
    assert (flow.adjoint(x[None], w) == in_one).all()


def test_the_jacobian_of_many_inputs_is_made_of_adjoints():
    flow, x = flow_of("pushed", 20)
    assert flow.size > 32
    dx = directions(x, 2)
    assert close(flow.jacobian(x[None])[0] @ dx[0].T, flow.tangent(x[None], dx)[0].T, 1e-12)


@pytest.mark.parametrize("case", CASES)
def test_tangents_are_the_limit_of_differences(case):
    """This holds in every direction, off the constraints too: F projects its start; IMS leaves
    p."""
    flow, x = flow_of(case, 12)
    dx = directions(x, 3)
    if case == "framed":  # a frame that rotates about the axis of a body is for I1 = I2
        dx[..., flow.names.index("I2") + 8] = dx[..., flow.names.index("I1") + 8]
    h = 2e-5
    ends = [flow.value(x + sign * h * dx[0]) for sign in (2, 1, -1, -2)]
    differences = (8 * (ends[1] - ends[2]) - (ends[0] - ends[3])) / (12 * h)
    assert close(flow.tangent(x[None], dx)[0], differences, 1e-8)


def test_a_start_off_the_constraints_is_projected():
    flow, x = flow_of("top", 3)
    q, p, parameters, *_ = start_of("top")
    off_constraints = x.copy()
    off_constraints[:4] *= 1.1
    projected = np.concatenate(stepper_of("top").project(1.1 * q, p, parameters=parameters))
    on_constraints = np.concatenate([projected, x[8:]])
    dx = directions(x, 2)
    assert close(flow.value(off_constraints[None]), flow.value(on_constraints[None]), 1e-14)
    assert close(flow.tangent(off_constraints[None], dx), flow.tangent(on_constraints[None], dx),
                 1e-13)


def test_momenta_off_velocity_constraints_are_projected():
    """Of a sleigh, which has no other constraints; its end is known in closed form."""
    flow = DiscreteFlow(systems.stepper("sleigh"), 20)
    (q, p), row = sleigh_state(1.2, 0.7), [-np.sin(0.3), np.cos(0.3), -SLEIGH["a"]]
    x = np.array([[*q, *momenta, *flow.parameters(SLEIGH), 0.05, 0.0]
                  for momenta in (p, p + 0.4 * np.array(row))])
    end, end_of_projected = flow.value(x)
    u, w, th = sleigh_end(1.2, 0.7, 0.3, t=1.0)
    np.testing.assert_allclose(end_of_projected[2:], [th, *sleigh_state(u, w, th)[1]], atol=1e-7)
    assert close(end_of_projected, end, 1e-14)


def test_a_row_that_fails_is_nan_and_says_why():
    flow, x = flow_of("top", 3)
    rows = np.repeat(x[None], 5, axis=0)
    rows[1, flow.fields["parameters"].start] = -1
    rows[2, flow.fields["dt"]] = 1e6
    rows[3, 0] = np.nan
    dx, w = np.ones((5, 1, flow.size)), np.ones((5, 1, 8))
    for values in (flow.value(rows), flow.tangent(rows, dx), flow.adjoint(rows, w)):
        assert np.isnan(values[1:4]).all()
        assert np.isfinite(values[[0, 4]]).all()
        assert np.array_equal(values[0], values[4])
    assert len(flow.failures) == 9
    assert "I1" in flow.failures[0]
    assert "Step 1" in flow.failures[1]


def test_a_step_of_no_length_and_a_state_that_cannot_be_projected_are_failures():
    flow, x = flow_of("pushed", 2)
    still, centre = x.copy(), x.copy()
    still[flow.fields["dt"]] = 0
    centre[:2] = 0
    assert np.isnan(flow.value(np.array([still, centre]))).all()
    assert "dt" in flow.failures[0]


def test_a_compiler_that_fails_is_no_failure_of_a_row(monkeypatch):
    """Tangents, adjoints and their derivatives compile their code when it is needed."""
    flow, x = flow_of("top", 3)
    failures_before, dx, w = len(flow.failures), np.ones((1, 1, flow.size)), np.ones((1, 1, 8))

    def binding():
        raise CompilerError("no compiler")

    monkeypatch.setattr(flow.stepper, "_derivative_binding", binding)
    for call in (lambda: flow.tangent(x[None], dx), lambda: flow.adjoint(x[None], w),
                 lambda: flow.second(flow.adjoint, x[None], w, dx)):
        with pytest.raises(CompilerError, match="no compiler"):
            call()
    assert len(flow.failures) == failures_before


def test_second_derivatives_are_differences_of_first_ones():
    """Exact second derivatives agree with differences of first ones."""
    flow, x = flow_of("driven", 1)
    w, dx = np.random.default_rng(1).normal(size=(1, 1, 4)), directions(x, 1)
    differences = DiscreteFlow(flow.stepper, 1, exact=False)
    # off the constraints is no start, to which these do not lead
    dx *= [name in ("g", "c", "dt", "push")
           for name in ("", "", "", "", *flow.names, "dt", "t0", *flow.input_names)]
    for first, along in ((flow.adjoint, w), (flow.tangent, directions(x, 1, seed=2))):
        exact, expected = (derivatives_of.second(getattr(derivatives_of, first.__name__), x[None],
                                                 along, dx)
                           for derivatives_of in (flow, differences))
        assert close(exact, expected, 1e-9)


def test_second_derivatives_along_a_curve_on_the_constraints():
    """d²/ds² of wᵀF on a great circle agrees with differences of wᵀF'."""
    flow, x = flow_of("top", 3)
    q = x[:4]
    across = np.array([-q[1], q[0], -q[3], q[2]])
    w = np.random.default_rng(1).normal(size=(1, 1, 8))

    def curve(s):
        return np.concatenate([np.cos(s) * q + np.sin(s) * across, 0 * q, x[8:]])

    def slope(s):
        tangent = np.concatenate([-np.sin(s) * q + np.cos(s) * across, np.zeros(flow.size - 4)])
        return float(flow.adjoint(curve(s)[None], w)[0, 0] @ tangent)

    h = 1e-3
    expected = (8 * (slope(h) - slope(-h)) - (slope(2 * h) - slope(-2 * h))) / (12 * h)
    dx = np.concatenate([across, np.zeros(flow.size - 4)])
    bend = np.concatenate([-q, np.zeros(flow.size - 4)])
    start = curve(0)[None]
    second = (flow.second(flow.adjoint, start, w, dx[None, None])[0, 0] @ dx
              + flow.adjoint(start, w)[0, 0] @ bend)
    assert abs(second - expected) <= 1e-9 * abs(expected)


def test_threads_share_nothing():
    flow, x = flow_of("top", 12)
    rows = x * (1 + 1e-3 * np.arange(8)[:, None] * (np.arange(x.size) == 8))
    w = np.ones((8, 1, 8))
    at_once = flow.adjoint(rows, w)
    with ThreadPoolExecutor(4) as pool:
        by_threads = list(pool.map(lambda i: flow.adjoint(rows[i : i + 1], w[:1]), range(8)))
    assert np.array_equal(np.concatenate(by_threads), at_once)


def test_parameters_are_refused_by_name():
    flow, _ = flow_of("top", 1)
    *_, parameters, _, _ = start_of("top")
    for wrong, word in (({"I4": 1.0}, "I4"), ({"gamma": "m"}, "no number")):
        with pytest.raises(InputError, match=word):
            flow.parameters(parameters | wrong)
    with pytest.raises(InputError, match="mgl"):
        flow.parameters({name: x for name, x in parameters.items() if name != "mgl"})
    framed, _ = flow_of("framed", 1)
    assert framed.parameters(parameters)[-1] == 0.0


@pytest.mark.parametrize(("make", "steps", "word"), [
    (lambda: "G-L", 1, "stepper"), (lambda: stepper_of("top"), 0, "steps"),
    (lambda: systems.stepper("heavy_top", real="float128"), 1, "double")])
def test_other_steppers_are_refused(make, steps, word):
    with pytest.raises(InputError, match=word):
        DiscreteFlow(make(), steps)


def test_a_library_is_imported_when_its_module_is_asked_for(monkeypatch):
    module = ModuleType("gyrospark.interop.casadi")
    monkeypatch.setitem(sys.modules, module.__name__, module)
    monkeypatch.delitem(vars(gs.interop), "casadi", raising=False)
    assert gs.interop.casadi is module


class Numbers(FlowFunction):
    """Steps as a function of NumPy's arrays."""

    _arrays, _stack = (), "numpy.stack"

    def _evaluate(self, parts):
        return self._flow.value(np.concatenate([np.ravel(part) for part, _ in parts])[None])[0]


def test_impacts_of_a_model_are_left_out_with_a_warning(tmp_path):
    """A ball passes through the floor on which the runs of its model bounce."""
    path = tmp_path / "bounce.toml"
    path.write_text(
        'name = "bounce"\ngravity = [0, 0, -9.81]\n[[point_masses]]\nname = "ball"\nmass = 1\n'
        'position = [0, 0, 1]\n[[contacts]]\nname = "floor"\nbodies = ["ball"]\n', encoding="utf-8")
    model = gs.load_model(path)
    for system in (model, path):
        step = gs.stepper("G-L", 2, system=system)
        with pytest.warns(gs.errors.InputWarning, match=r"floor.*integrate"):
            flow = Numbers(step, 10, 0.1, "refuse")
        q, _ = flow(model.q0, model.p0, dict(model.parameters))
        assert q[2] == pytest.approx(1 - 9.81 / 2, abs=1e-13)
    free = gs.stepper("G-L", 2, system=model.system)  # a system has no impacts
    assert np.array_equal(Numbers(free, 10, 0.1, "refuse")(
        model.q0, model.p0, dict(model.parameters))[0], q)
