"""Steps as PyTorch functions: backward, forward mode, torch.func."""

from __future__ import annotations

import numpy as np
import pytest

from flows import PARAMETERS, TOP, close, flow_of, inputs_of, start_of, stepper_of
from gyrospark.core.errors import InputError

torch = pytest.importorskip("torch", reason="PyTorch is not installed: the extra torch brings it")

import gyrospark.interop.torch as gt  # noqa: E402

#: PyTorch calls functions of its own that it deprecates.
pytestmark = [pytest.mark.filterwarnings(f"ignore:.*torch.jit.*:{category}")
              for category in ("DeprecationWarning", "FutureWarning")]


def tensor(values):
    return torch.tensor(np.array(values, dtype=float))


THETA = tensor([*TOP.parameters.values(), 0.0016])
Q, P = tensor(TOP.q0), tensor(TOP.p0)


def top(steps=12, **more):
    """Return (q, p) of the fast top, and its concatenation, as functions of q, p and a tensor."""
    flow = gt.run(stepper_of("top"), steps=steps, dt=1e-3, **more)
    return flow, lambda q, p, theta: torch.cat(flow(q, p, theta))


def test_values_and_jacobians_are_those_of_the_flow():
    flow, x = flow_of("top", 12)
    _, F = top()
    assert np.array_equal(F(Q, P, THETA), flow.value(x[None])[0])
    expected = np.split(flow.jacobian(x[None])[0], [4, 8, 13], axis=1)[:3]
    for jacobian in (torch.func.jacfwd, torch.func.jacrev):
        blocks = jacobian(F, (0, 1, 2))(Q, P, THETA)
        assert all(close(block, expected_block)
                   for block, expected_block in zip(blocks, expected, strict=True))
    by_hand = torch.autograd.functional.jacobian(F, (Q, P, THETA))
    assert all(close(block, expected_block)
               for block, expected_block in zip(by_hand, expected, strict=True))


def test_backward_and_dual_numbers_are_transposes():
    _, F = top()
    leaves = [x.clone().requires_grad_() for x in (Q, P, THETA)]
    w = tensor(np.arange(1.0, 9))
    (F(*leaves) @ w).backward()
    directions = [x.flip(0) for x in (Q, P, THETA)]
    with torch.autograd.forward_ad.dual_level():
        duals = map(torch.autograd.forward_ad.make_dual, (Q, P, THETA), directions)
        by_duals = torch.autograd.forward_ad.unpack_dual(F(*duals)).tangent
    by_backward = sum(x.grad @ dx for x, dx in zip(leaves, directions, strict=True))
    assert close(by_backward, by_duals @ w)
    _, pull = torch.func.vjp(lambda theta: F(Q, P, theta), THETA)
    by_w = torch.func.jacrev(lambda w: pull(w)[0])(w)
    assert close(by_w.T, torch.func.jacfwd(F, 2)(Q, P, THETA))
    theta_leaf = THETA.clone().requires_grad_()
    F(Q, P, theta_leaf)[0].backward()
    assert close(theta_leaf.grad, torch.func.grad(lambda theta: F(Q, P, theta)[0])(THETA))


def test_maps_have_the_bits_of_single_calls():
    _, F = top()
    thetas = THETA * (1 + 0.01 * torch.arange(3)[:, None])
    gradient = torch.func.grad(lambda q, p, theta: ((F(q, p, theta) - 0.5) ** 2).sum(), (0, 2))
    functions = [F, lambda *z: gradient(*z)[0], lambda *z: gradient(*z)[1],
                 torch.func.jacfwd(F, 2), torch.func.jacrev(F, 2)]
    for function in functions:
        singles = torch.stack([function(Q, P, theta) for theta in thetas])
        assert torch.equal(torch.func.vmap(function, (None, None, 0))(Q, P, thetas), singles)
        beside = torch.func.vmap(function, (None, None, 1), out_dims=1)(Q, P, thetas.T)
        assert torch.equal(beside.movedim(1, 0), singles)


def test_inputs_dt_and_parameters_by_name():
    flow, x = flow_of("pushed", 3)
    function = gt.run(stepper_of("pushed"), steps=3)
    q, p, parameters, dt, _ = start_of("pushed")
    k, h, u = (tensor(value).requires_grad_() for value in (parameters["k"], dt,
                                                            inputs_of("pushed", 3)))
    w = np.arange(1.0, 5)
    (torch.cat(function(q, p, {"k": k}, dt=h, inputs=u)) @ tensor(w)).backward()
    expected = flow.adjoint(x[None], w[None, None])[0, 0]
    assert close([k.grad, h.grad, *u.grad.ravel()], expected[[4, 5, *range(7, 13)]])


def test_second_derivatives_are_exact_or_differences_or_refused():
    w = tensor(np.arange(1.0, 9))
    _, F = top(second_order="refuse")
    with pytest.raises(InputError, match="second_order"):
        torch.func.hessian(lambda theta: F(Q, P, theta) @ w)(THETA)
    _, rough = top(second_order="differences")
    _, F = top()
    loss = lambda theta: F(Q, P, theta) @ w  # noqa: E731
    scale = np.outer(THETA, THETA)
    inner, x = flow_of("top", 12)
    expected = inner.second(inner.adjoint, x[None], np.tile(w, (1, 5, 1)),
                            np.eye(inner.size)[None, 8:13])[0, :, 8:13]
    for hessian in (torch.func.hessian(loss), torch.func.jacfwd(torch.func.jacfwd(loss))):
        assert close(np.asarray(hessian(THETA)) * scale, expected * scale, 1e-14)
    second = torch.func.hessian(lambda theta: rough(Q, P, theta) @ w)(THETA)
    assert close(np.asarray(second) * scale, expected * scale, 1e-8)
    for reverse in (torch.func.jacrev(torch.func.jacrev(loss)),
                    lambda theta: torch.autograd.functional.hessian(loss, theta)):
        with pytest.raises(InputError, match=r"torch\.func\.hessian"):
            reverse(THETA)


def test_a_failed_step_is_nan():
    flow, _ = top()
    ends = torch.func.vmap(lambda theta: flow(Q, P, theta)[0])(torch.stack([THETA, -THETA]))
    assert torch.isfinite(ends[0]).all()
    assert torch.isnan(ends[1]).all()
    assert "I1" in flow.failures[-1]


def test_tensors_are_double_and_on_the_cpu():
    flow, _ = top()
    for tensor_of_other_kind in (Q.float(), Q.to("meta")):
        for q in (tensor_of_other_kind, list(tensor_of_other_kind)):
            with pytest.raises(InputError, match="float64"):
                flow(q, P, THETA)
    rows = [[*inputs_of("pushed", 1)[0]], list(torch.zeros(2))]
    with pytest.raises(InputError, match="float32"):
        gt.run(stepper_of("pushed"), steps=2, dt=0.1)([0.6, 0.8], [0, 0], {"k": 1.3}, inputs=rows)
    assert np.array_equal(flow(list(Q), P, THETA)[0], flow(Q, P, THETA)[0])
    assert flow(list(map(float, Q)), P, PARAMETERS)[0].dtype is torch.float64


def test_unusable_arguments_are_refused():
    flow, F = top(1, second_order="differences")
    for q in ("word", None, {"q": Q}, [1j, *Q[1:].tolist()]):
        with pytest.raises(InputError, match="q has entries"):
            flow(q, P, THETA)
    x = torch.ones((), dtype=torch.float64, requires_grad=True)
    with pytest.raises(InputError, match="q is a list"):
        flow([x, *Q[1:]], P, THETA)
    assert torch.func.vmap(lambda q: F(q, P, THETA))(Q.expand(0, 4)).shape == (0, 8)
    with pytest.raises(InputError, match="third"):
        torch.func.jacfwd(torch.func.hessian(lambda q: F(q, P, THETA).sum()))(Q)
