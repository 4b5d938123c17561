"""Kernels evaluated by NumPy, against compiled steppers and complex-step derivatives.

NumPy and C share the statements, which ``test_kernels`` compares with the kernel's own expressions
in exact numbers; a derivative kernel is compared with a complex step of the kernel it is of.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.multibody.rigid_body import heavy_top
from gyrospark.generator.schemes.step_equations import (
    MeanScheme,
    SparkScheme,
    common_kernels,
    hoist_constants,
)
from gyrospark.generator.tableaux.families import gauss_lobatto
from numpy_kernels import carry_out

EPSILON = np.finfo(float).eps
TOP = gs.problems.fast_top()
VALUES = dict(TOP.parameters)


@cache
def pendulum() -> gs.System:
    """A spring with drag: no constraint, forces, a root."""
    q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
    k, l, c = sp.symbols("k l c", positive=True)  # noqa: E741
    H = (p[0]**2 + p[1]**2) / 2 + k * (sp.sqrt(q[0]**2 + q[1]**2) - l)**2 / 2 + q[1]
    drag = [-c * x * sp.sqrt(p[0]**2 + p[1]**2) for x in p]
    return gs.System(q, p, (k, l, c), H, forces=drag, name="dragged_spring")


SYSTEMS = {
    "gamma": (heavy_top("gamma"), VALUES | {"gamma": 0.0013}),
    "alpha": (heavy_top("alpha"), VALUES | {"alpha": 0.0007}),
    "spring": (pendulum(), {"k": 3.0, "l": 1.1, "c": 0.2}),
}
SCHEMES = {
    "2-G-L": lambda system: SparkScheme(system, gauss_lobatto(2)),
    "IMS": lambda system: MeanScheme(system, discrete=False),
    "EMS": lambda system: MeanScheme(system, discrete=True),
}
#: Derivative kernel → the kernel it is of; output → the output differentiated, and by what.
SPARK_DERIVATIVES = {"hessian": ("gradient", {
    "H_qq": ("H_q", "q"), "H_qp": ("H_q", "p"), "H_pq": ("H_p", "q"), "H_pp": ("H_p", "p")})}
MEAN_DERIVATIVES = {"mean_jacobian": ("mean_gradient", {
    "D_qq": ("D_q", "dq"), "D_qp": ("D_q", "dp"), "D_pq": ("D_p", "dq"), "D_pp": ("D_p", "dp")})}


@cache
def kernels_of(system: str, scheme: str):
    hoisted_system, constants = hoist_constants(SYSTEMS[system][0])
    made = SCHEMES[scheme](hoisted_system)
    return {kernel.name: kernel for kernel in (*common_kernels(hoisted_system), *made.kernels())
            }, constants


def inputs_of(kernel, seed=1):
    rng = np.random.default_rng(seed)
    return {name: rng.normal(size=len(symbols)) for name, symbols in kernel.inputs.items()}


@pytest.mark.parametrize(("system", "scheme"), [
    ("gamma", "EMS"), ("alpha", "2-G-L"), ("alpha", "IMS"), ("spring", "2-G-L"), ("spring", "EMS")])
def test_derivative_kernels_are_complex_steps_of_theirs(system, scheme):
    """Im f(x + iε)/ε has no cancellation: 64 ε of the largest entry, for the additions of both.

    A mean's rates are those at (q₀ + q₁)/2, held where Δq moves: its kernel takes both, and is
    differentiated by Δq with qm = q₀ + Δq/2.
    """
    kernels, constants = kernels_of(system, scheme)
    parameters, tiny, compared = SYSTEMS[system][1], 1e-200, 0
    for name, (of, outputs) in (SPARK_DERIVATIVES | MEAN_DERIVATIVES).items():
        if name not in kernels:
            continue
        inputs = inputs_of(kernels[name])
        found = carry_out(kernels[name], constants, parameters, inputs)
        for output, (differentiated, by) in outputs.items():
            if output not in found:
                continue
            columns = []
            for i in range(len(inputs[by])):
                moved = {array: value.astype(complex) for array, value in inputs.items()}
                moved[by][i] += 1j * tiny
                if by in ("dq", "dp"):
                    moved[f"{by[1]}m"][i] += 1j * tiny / 2
                columns.append(carry_out(kernels[of], constants, parameters,
                                         moved)[differentiated].imag / tiny)
            slope = np.stack(columns, axis=-1)
            most = np.abs(slope).max(initial=1)
            assert np.abs(found[output] - slope).max() <= 64 * EPSILON * most
            compared += 1
    assert compared >= 3


def test_kernels_say_what_the_compiled_stepper_says():
    """H, g and f over a whole run: one call for all states, beside the C of one state a call."""
    rep, step = "gamma", gs.stepper("G-L", 2)
    parameters = SYSTEMS[rep][1]
    run = step.integrate(TOP.q0, TOP.p0, dt=1e-3, steps=50, parameters=parameters)
    kernels, constants = kernels_of(rep, "2-G-L")
    states = {"q": run.q.T, "p": run.p.T}
    H = carry_out(kernels["hamiltonian"], constants, parameters, states)[""]
    assert np.abs(H - run.energy()).max() <= 8 * EPSILON * np.abs(H).max()
    g = carry_out(kernels["constraint"], constants, parameters, {"q": run.q.T})["g"]
    assert np.abs(g).max() <= 4 * EPSILON
    f = carry_out(kernels["hidden_constraint"], constants, parameters, states)["f"]
    assert np.abs(f).max() <= 16 * EPSILON * np.abs(run.p).max()
    assert H.shape == (51,)
    assert g.shape == f.shape == (1, 51)


def test_increments_are_differences():
    """g(q + d) − g(q) in long double, beside the kernel that loses no digit for small d."""
    kernels, constants = kernels_of("gamma", "2-G-L")
    rng = np.random.default_rng(3)
    q, d = rng.normal(size=(4, 100)), 1e-9 * rng.normal(size=(4, 100))
    found = carry_out(kernels["constraint_increment"], constants, SYSTEMS["gamma"][1],
                      {"q": q, "d": d})["dg"]
    wide_q, wide_d = q.astype(np.longdouble), d.astype(np.longdouble)
    exact = ((wide_q + wide_d)**2 - wide_q**2).sum(axis=0)
    assert np.abs(found[0] - exact).max() <= 64 * float(np.finfo(np.longdouble).eps)
