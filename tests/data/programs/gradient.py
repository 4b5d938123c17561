"""The gradient of a motion in JAX."""

import jax
import jax.numpy as jnp

import gyrospark as gs
import gyrospark.interop.jax as gj

jax.config.update("jax_enable_x64", True)
top, step = gs.problems.fast_top(), gs.stepper()
flow = gj.run(step, steps=50, dt=1e-3)
values = top.parameters | {"gamma": gs.gamma(top.inertia)}
print(jax.grad(lambda numbers: jnp.sum(flow(top.q0, top.p0, numbers)[0] ** 4))(values)["mgl"])
