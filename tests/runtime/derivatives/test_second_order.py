"""Second derivatives against differences of exact gradients in float128, and their symmetry.

Differences of order 4 with a step of 2⁻²⁸ have some 25 digits. Matrices are scaled: a row is one of
relative changes of its variable.
"""

from __future__ import annotations

import warnings
from functools import cache

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
import systems
from calls import integrate
from derivative_cases import case_of, difference, label, start_of, stepper_for
from gyrospark.core.errors import InputError
from gyrospark.runtime.derivatives.tangent_space import TangentSpace

STEPS = 3
#: One of each: SPARK with inputs, forces and times; IMS and EMS with a constraint that moves.
FEW = [("driven_pendulum", ("G-L", 2))]
MORE = [("breathing", ("EMS", None)), ("heavy_top", ("G-L", 3)),
        ("heavy_top_alpha", ("EMS", None)), ("free_body", ("Radau-L", 2)),
        ("breathing", ("LIIIA-B", 3)), ("ellipse", ("EMS", None)),
        ("driven_pendulum", ("IMS", None))]
BOTH = [pytest.param(*case, marks=[] if case in FEW else pytest.mark.slow,
                     id=f"{case[0]}-{label(case[1])}") for case in [*FEW, *MORE]]


def loss_of(step, name):
    """Return a polynomial loss in all states, a parameter, and the time."""
    system = step.manifest.system
    q, p = (sp.symbols(names, real=True) for names in (system.coordinates, system.momenta))
    theta = sp.Symbol(next(iter(case_of(name).parameters)), positive=True)
    time = sp.Symbol(system.time or "t", real=True)
    return (sum((k + 1) * x**3 for k, x in enumerate(q)) + sum(x**2 * q[0] for x in p)
            ) * theta + q[0] ** 2 * time**2


def run_of(name, step, **moved):
    """Return a run of the case, with the moved numbers in place of its own."""
    case = case_of(name)
    arguments = {"q": None, "p": None, "dt": case.dt, "t0": case.t0, "parameters": case.parameters}
    arguments |= moved
    if arguments["q"] is None:
        arguments["q"], arguments["p"] = start_of(name, step)
    return integrate(step, steps=STEPS, every=2, **arguments)


@cache
def names_of(name):
    """Return the names of the variables of a case's Hessian."""
    return ["start", *case_of(name).parameters, "dt", "t0"]


def scales(name, size):
    """Return the size of a relative change of each of these variables."""
    case = case_of(name)
    sizes = [*case.parameters.values(), case.dt, case.dt]
    return np.array([1.0] * (size - len(sizes)) + sizes)


@cache
def expected(name, scheme):
    """Return the scaled Hessian by differences of float128 gradients, and its basis.

    Starts are moved on the constraints.
    """
    step, case = stepper_for(name, scheme, "float128"), case_of(name)
    q, p = start_of(name, step)
    n, unity, loss = step.n, q[0] - q[0] + 1, loss_of(step, name)
    keeps = step.manifest.scheme.keeps_momentum_constraint
    names = step.binding.parameter_names
    binding = step._derivative_binding()
    run = step._rows_by_kind(run_of(name, step)).run
    space = TangentSpace(binding, binding.module.parameters(run.parameters, run.t0), run.q, run.p,
                         step.constraint_names)
    basis = space.basis()
    units = np.zeros((binding.rows, basis.shape[1] + len(case.parameters) + 2), int).astype(q.dtype)
    units[: 2 * n, : basis.shape[1]] = basis
    for k, row in enumerate([*map(names.index, case.parameters), len(names), len(names) + 1]):
        units[2 * n + row, basis.shape[1] + k] = unity
    D = space.project(units) * scales(name, units.shape[1])

    def gradient(dz, e):
        q1, p1 = q + e * dz[:n], p + e * dz[n : 2 * n]
        values = {x: unity * case.parameters[x] + e * dz[2 * n + i] for i, x in enumerate(names)}
        t0, dt = unity * case.t0 + e * dz[-1], unity * case.dt + e * dz[-2]
        if step.m:
            start = step.consistent(q1, p1, parameters=values, t=t0)
            q1, p1 = start.q, start.p if keeps else p1
        moved = run_of(name, step, q=q1, p=p1, parameters=values, t0=t0, dt=dt)
        slopes = step.gradient(moved, loss=loss, wrt=["q", "p", *names, "dt", "t0"])
        return D.T @ np.array([*slopes.q, *slopes.p,
                               *(slopes[x] * unity for x in [*names, "dt", "t0"])])

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", gs.errors.InputWarning)  # of steps long for their order
        columns = [difference(lambda e, dz=dz: gradient(dz, e), 2.0**-28) for dz in D.T]
    return np.array(columns).T, basis


@pytest.mark.parametrize(("name", "scheme"), BOTH)
def test_hessians_are_the_limits_of_differences_of_gradients(name, scheme):
    """A loss over a run has second derivatives by start, parameters, dt and t0, in both types."""
    reference, basis = expected(name, scheme)
    scale = scales(name, len(reference))
    size = np.abs(reference.astype(float)).max()
    for real, tolerance in (("double", 4e-14), ("float128", 1e-24)):
        step = stepper_for(name, scheme, real)
        run = run_of(name, step)
        hessian = step.hessian(run, loss=loss_of(step, name), wrt=names_of(name))
        turn = np.eye(len(reference), dtype=int).astype(hessian.matrix.dtype)
        k = basis.shape[1]
        if real == "double":
            turn[:k, :k] = basis.astype(float).T @ hessian.basis
        scaled = hessian.matrix * scale * scale[:, None]  # not by products, which are rounded
        error = turn @ scaled @ turn.T - reference.astype(scaled.dtype)
        assert np.abs(error.astype(float)).max() <= tolerance * size
        assert hessian.asymmetry <= 64 * float(step.binding.epsilon)
        gradient = step.gradient(run, loss=loss_of(step, name), wrt=names_of(name)).vector()
        assert np.abs((hessian.gradient - gradient).astype(float)).max() <= (
            1e3 * float(step.binding.epsilon) * np.abs(gradient.astype(float)).max())


def test_rows_of_inputs_are_moved_by_no_parameter():
    """Rows of one number give the run of this parameter, which then has no effect."""
    name, scheme = FEW[0]
    step, wrt = stepper_for(name, scheme, "double"), names_of(name)
    u, = step.binding.input_names
    rows = {"inputs": {u: [case_of(name).parameters[u]] * STEPS}}
    plain, fed = (step.hessian(run_of(name, step, **options), loss=loss_of(step, name), wrt=wrt)
                  for options in ({}, rows))
    index = fed.names.index(u)
    assert not fed.matrix[index].any()
    assert plain.matrix[index].any()
    remaining = np.delete(np.arange(len(fed.names)), index)
    assert np.array_equal(fed.matrix[np.ix_(remaining, remaining)],
                          plain.matrix[np.ix_(remaining, remaining)])


@pytest.mark.slow  # second derivatives of one more stepper
def test_a_step_has_the_derivative_of_its_vjp_along_a_direction():
    """Products agree with differences of ``vjp``, and along v₁ and v₂ in either order."""
    name = "ellipse"
    step, case = stepper_for(name, ("EMS", None)), case_of(name)
    q, p = start_of(name, step)
    w, zero, h = np.linspace(1, 2, 4), np.zeros(2), 1e-4
    arguments = {"dt": case.dt, "parameters": case.parameters}
    product = step.hvp(q, p, zero, zero, w[:2], w[2:], d={"k": 1.0, "dt": 0.01}, **arguments)
    ends = []
    for sign in (1, -1):
        moved = case.parameters | {"k": case.parameters["k"] + sign * h}
        *_, back = step.vjp(q, p, dt=case.dt + sign * 0.01 * h, parameters=moved)
        ends.append(back(w[:2], w[2:]))
    for key in ("start", "m", "k", "g", "dt"):
        slope = (np.asarray(ends[0][key]) - np.asarray(ends[1][key])) / (2 * h)
        assert np.abs(slope - np.asarray(product[key])).max() < 1e-7
        assert np.abs(product[key]).max() > 1e-5
    for v, by_start in zip(product.basis.T, product.start, strict=True):
        along_v = step.hvp(q, p, v[:2], v[2:], w[:2], w[2:], **arguments)
        assert along_v["k"] + 0.01 * along_v["dt"] == pytest.approx(by_start, rel=1e-12)
    with pytest.raises(InputError, match="project"):
        step.hvp(q, p, q, p, w[:2], w[2:], **arguments)


def test_a_function_of_python_gives_the_slopes_of_its_cotangents():
    """|q - q*|² has the matrix of the same expression; at the end alone it has another one."""
    name = "driven_pendulum"
    step, case = stepper_for(name, ("G-L", 2)), case_of(name)
    q, p = start_of(name, step)
    run = step.integrate(gs.Start(q, p, t=case.t0), dt=case.dt, steps=700, every=700,
                         parameters=case.parameters)
    target = np.array([0.3, 0.1])
    last = {"q": 2 * (run.q[-1] - target)}
    of_end = step.hessian(run, last, slopes=lambda along: {"q": 2 * along["q"][-1]})
    start = 2 * (run.q[0] - target)  # the expression is summed over both states
    both = step.hessian(run, {"q": np.stack([start, last["q"]])},
                        slopes=lambda along: {"q": 2 * along["q"]})
    x, y = sp.symbols("x y", real=True)
    by_expression = step.hessian(
        run, loss=(x - sp.Rational(3, 10)) ** 2 + (y - sp.Rational(1, 10)) ** 2)
    assert np.abs(by_expression.matrix - both.matrix).max() <= 1e-12 * np.abs(both.matrix).max()
    assert of_end.matrix.shape == (8, 8)
    assert np.abs(of_end.matrix - both.matrix).max() > 0.1
    assert of_end.asymmetry < 1e-12


def test_the_last_state_counts_if_it_is_stored_beside_the_others():
    name = "driven_pendulum"
    step, case = stepper_for(name, ("G-L", 2)), case_of(name)
    q, p = start_of(name, step)
    matrices = []
    for every in (1, 4, 20):
        run = step.integrate(gs.Start(q, p, t=case.t0), dt=case.dt, steps=10, every=every,
                             parameters=case.parameters)
        weight = 12 * run.q[-1] ** 2
        matrices.append(step.hessian(
            run, {"q": 4 * run.q[-1] ** 3},
            slopes=lambda along, weight=weight: {"q": weight * along["q"][-1]}).matrix)
    assert np.array_equal(matrices[0], matrices[1])
    assert np.array_equal(matrices[0], matrices[2])


def test_what_has_no_second_derivatives_says_so():
    step = systems.differentiable("bead")
    run = run_of("bead", step)
    with pytest.raises(InputError, match="Lagrangian"):
        step.hessian(run, {"q": np.ones(step.n)})
    step = stepper_for("driven_pendulum", ("G-L", 2))
    run = run_of("driven_pendulum", step)
    with pytest.raises(InputError, match="start"):
        step.hessian(run, {"q": np.ones(2)}, wrt=["q"])
    with pytest.raises(InputError, match="bytes"):
        step.hessian(run, {"q": np.ones(2)}, memory="0.1 kB")


@pytest.mark.parametrize(("real", "width"), [("double", 8), ("float128", 16)])
def test_a_hessian_keeps_the_states_and_unknowns_of_all_steps(real, width):
    name = "driven_pendulum"
    step = stepper_for(name, ("G-L", 2), real)
    run = run_of(name, step)
    needed = STEPS * (2 * step.n + step.unknowns) * width
    options = {"loss": loss_of(step, name), "wrt": ["start"]}
    assert np.isfinite(step.hessian(run, memory=needed, **options).matrix.astype(float)).all()
    with pytest.raises(InputError, match=f"{needed:,} bytes"):
        step.hessian(run, memory=needed - 1, **options)
