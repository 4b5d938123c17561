"""Steps and runs as functions of other libraries, with their derivatives.

    discrete_flow  N steps as a function of one vector, its tangent and its adjoint
    flow_function  arguments that the functions of all libraries have
    jax            JAX: primitives for jit, vmap, grad, jvp
    torch          PyTorch: functions of torch.autograd and torch.func
    casadi         CasADi: functions for Opti, with Jacobians

The last three need a package each: the extras ``jax``, ``torch``, ``casadi``. SciPy needs no
module: see ``Stepper.value_and_gradient``.
"""
