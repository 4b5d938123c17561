"""Steps as JAX functions: first and second derivatives, mapped and compiled."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from flows import PARAMETERS, TOP, close, flow_of, inputs_of, start_of, stepper_of
from gyrospark.core.errors import InputError

jax = pytest.importorskip("jax", reason="JAX is not installed: the extra jax brings it")
jnp = jax.numpy

import gyrospark.interop.jax as gj  # noqa: E402

THETA = np.array([*TOP.parameters.values(), 0.0016])
Q, P = np.array(TOP.q0), np.array(TOP.p0)


@pytest.fixture(autouse=True, scope="module")
def _in_double():
    setting = jax.config.jax_enable_x64
    jax.config.update("jax_enable_x64", True)
    yield
    jax.config.update("jax_enable_x64", setting)


def top(steps=12, **more):
    """Return (q, p) of the fast top, and its concatenation, as functions of q, p and an array."""
    flow = gj.run(stepper_of("top"), steps=steps, dt=1e-3, **more)
    return flow, lambda q, p, theta: jnp.concatenate(flow(q, p, theta))


def test_values_have_the_bits_of_the_flow():
    flow, x = flow_of("top", 12)
    _, F = top()
    expected = flow.value(x[None])[0]
    for function in (F, jax.jit(F)):
        assert np.array_equal(function(Q, P, THETA), expected)
    assert np.array_equal(jnp.concatenate(gj.step(stepper_of("top"))(Q, P, PARAMETERS, dt=1e-3)),
                          flow_of("top", 1)[0].value(x[None])[0])


def test_jacobians_forward_and_reverse_are_those_of_the_flow():
    flow, x = flow_of("top", 12)
    expected = np.split(flow.jacobian(x[None])[0], [4, 8, 13], axis=1)[:3]
    _, F = top()
    for jacobian in (jax.jacfwd, jax.jacrev):
        blocks = jax.jit(jacobian(F, (0, 1, 2)))(Q, P, THETA)
        assert all(close(block, expected_block)
                   for block, expected_block in zip(blocks, expected, strict=True))


def test_maps_have_the_bits_of_single_calls():
    _, F = top()
    loss = lambda q, p, theta: jnp.sum((F(q, p, theta) - 0.5) ** 2)  # noqa: E731
    thetas = THETA * (1 + 0.01 * np.arange(3)[:, None])
    for function in (F, jax.grad(loss, 2), jax.jacfwd(F, 2), jax.jacrev(F, 2)):
        single = jax.jit(function)
        singles = np.array([single(Q, P, theta) for theta in thetas])
        mapped = jax.jit(jax.vmap(function, (None, None, 1), out_axes=1))(Q, P, thetas.T)
        assert np.array_equal(np.moveaxis(mapped, 1, 0), singles)
    over_theta = jax.vmap(F, (None, None, 0))
    over_start = jax.jit(jax.vmap(over_theta, (0, None, None)))(np.stack([Q, Q]), P, thetas)
    assert np.array_equal(over_start[1], over_theta(Q, P, thetas))


def test_a_scan_of_steps_has_the_gradient_of_a_run():
    flow, _ = top()
    step = gj.step(stepper_of("top"), dt=1e-3)

    def scanned(parameters):
        (q, _), _ = jax.lax.scan(lambda z, _: (step(*z, parameters), None),
                                 (jnp.array(Q), jnp.array(P)), None, length=12)
        return q.sum()

    gradient = jax.jit(jax.grad(scanned))(PARAMETERS)
    expected = jax.grad(lambda parameters: flow(Q, P, parameters)[0].sum())(PARAMETERS)
    assert gradient.keys() == PARAMETERS.keys()
    for name in TOP.parameters:
        assert close(gradient[name], expected[name], 1e-10), name


def test_inputs_dt_and_t0():
    flow, x = flow_of("pushed", 3)
    function = gj.run(stepper_of("pushed"), steps=3)
    q, p, parameters, dt, t0 = start_of("pushed")
    u, w = inputs_of("pushed", 3), np.arange(1.0, 5)
    gradients = jax.grad(lambda k, dt, t0, u: w @ jnp.concatenate(function(
        q, p, {"k": k}, dt=dt, t0=t0, inputs=u)), (0, 1, 2, 3))(parameters["k"], dt, t0, u)
    expected = flow.adjoint(x[None], w[None, None])[0, 0]
    assert close(np.concatenate([np.ravel(gradient) for gradient in gradients]), expected[4:])
    of_constant = jax.grad(lambda u: w @ jnp.concatenate(function(
        q, p, parameters, dt=dt, inputs=u)))
    of_rows = jax.grad(lambda u: w @ jnp.concatenate(function(
        q, p, parameters, dt=dt, inputs=jnp.stack([u, u, u]))))
    assert close(of_constant(u[0]), of_rows(u[0]))


def test_second_derivatives_are_exact_or_differences_or_refused():
    w = np.arange(1.0, 9)
    _, F = top(second_order="refuse")
    with pytest.raises(InputError, match="second_order"):
        jax.hessian(lambda theta: w @ F(Q, P, theta))(THETA)
    _, rough = top(second_order="differences")
    _, F = top()
    loss = lambda theta: w @ F(Q, P, theta)  # noqa: E731
    inner, x = flow_of("top", 12)
    directions = np.eye(inner.size)[None, 8:13]
    expected = inner.second(inner.adjoint, x[None], np.tile(w, (1, 5, 1)), directions)[0, :, 8:13]
    scale = np.outer(THETA, THETA)
    for hessian in (jax.hessian(loss), jax.jacfwd(jax.jacfwd(loss))):
        second = np.asarray(jax.jit(hessian)(THETA))
        assert close(second * scale, expected * scale, 1e-14)
        assert close(second * scale, (second * scale).T, 1e-14)
    second = jax.hessian(lambda theta: w @ rough(Q, P, theta))(THETA)
    assert close(second * scale, expected * scale, 1e-8)
    mapped = jax.jit(jax.vmap(jax.hessian(loss)))(np.stack([THETA, THETA * 1.01]))
    assert np.array_equal(mapped[0], jax.jit(jax.hessian(loss))(THETA))
    with pytest.raises(InputError, match=r"jax\.hessian"):
        jax.jacrev(jax.jacrev(loss))(THETA)
    with pytest.raises(InputError, match="second_order"):
        top(second_order="third")


def test_a_failed_step_is_nan():
    flow, _ = top()
    thetas = np.stack([THETA, -THETA, THETA])
    ends = jax.jit(jax.vmap(lambda theta: flow(Q, P, theta)[0]))(thetas)
    assert np.isnan(ends[1]).all()
    assert np.isfinite(ends[::2]).all()
    assert "I1" in flow.failures[-1]


def test_threads_run_one_compiled_program():
    flow, _ = top()
    gradient = jax.jit(jax.grad(lambda theta: flow(Q, P, theta)[0].sum()))
    thetas = [THETA * (1 + 0.01 * i) for i in range(8)]
    with ThreadPoolExecutor(4) as pool:
        gradients = list(pool.map(gradient, thetas))
    assert np.array_equal(gradients, [gradient(theta) for theta in thetas])


def test_unusable_arguments_are_refused():
    flow, _ = top()
    for arguments, word in (((Q[:3], P, THETA), "q has shape"), ((Q, P, THETA[:2]), "parameters"),
                            ((Q, P, PARAMETERS | {"I4": 1.0}), "I4")):
        with pytest.raises(InputError, match=word):
            jax.jit(flow)(*arguments)
    with pytest.raises(InputError, match="dt"):
        gj.step(stepper_of("top"))(Q, P, THETA)
    q, p, parameters, dt, _ = start_of("pushed")
    with pytest.raises(InputError, match="push, pull"):
        gj.step(stepper_of("pushed"), dt=dt)(q, p, parameters)
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(InputError, match="jax_enable_x64"):
            flow(Q, P, THETA)
    finally:
        jax.config.update("jax_enable_x64", True)


def test_arguments_without_real_numbers_are_refused():
    flow, F = top()
    for q in ("word", None, {"q": Q}, [1j, *Q[1:]], jnp.array(Q + 1j), jnp.array([True] * 4)):
        with pytest.raises(InputError, match="q has entries"):
            flow(q, P, THETA)
    with pytest.raises(InputError, match="q is a list"):
        jax.grad(lambda x: F([x, *Q[1:]], P, THETA).sum())(1.0)


def test_an_axis_of_no_rows_is_mapped():
    _, F = top()
    assert jax.vmap(lambda q: F(q, P, THETA))(np.zeros((0, 4))).shape == (0, 8)


def test_third_derivatives_are_refused():
    _, F = top(1, second_order="differences")
    with pytest.raises(InputError, match="third"):
        jax.jacfwd(jax.jacfwd(jax.jacfwd(lambda x: F(x * Q, P, THETA))))(1.0)
