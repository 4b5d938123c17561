"""Steps and runs as functions of other libraries, with their derivatives.

In: a compiled stepper.
Out: its step or run as a differentiable function of another library.
Open first: ``discrete_flow.DiscreteFlow``.

    discrete_flow  N steps as a function of one vector, its tangent and its adjoint
    flow_function  arguments that the functions of all libraries have
    jax            JAX: primitives for jit, vmap, grad, jvp
    torch          PyTorch: functions of torch.autograd and torch.func
    casadi         CasADi: functions for Opti, with Jacobians

The last three need a package each: the extras ``jax``, ``torch``, ``casadi``. SciPy needs no
module: see ``Stepper.value_and_gradient``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import casadi as casadi
    from . import jax as jax
    from . import torch as torch

#: Empty, so that ``from gyrospark.interop import *`` needs no library.
__all__: list[str] = []

_LIBRARIES = ("casadi", "jax", "torch")


def __getattr__(name: str) -> Any:
    from ..core.arguments import proposal

    if name in _LIBRARIES:
        return import_module(f".{name}", __name__)
    raise AttributeError(
        f"module {__name__!r} has no attribute {name!r}{proposal(name, _LIBRARIES)}")


def __dir__() -> list[str]:
    return list(_LIBRARIES)
