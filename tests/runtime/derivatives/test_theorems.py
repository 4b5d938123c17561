"""What the theory of derivatives proves (docs/theory/derivatives.md), measured."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from derivative_cases import (
    SCHEMES,
    SYMMETRIC,
    case_of,
    difference,
    label,
    product,
    start_of,
    stepper_for,
    tangents_of_step,
)
from gyrospark.runtime.derivatives.tangent_space import TangentSpace

SPARK = [s for s in SCHEMES if s[0] not in ("IMS", "EMS")]
FEW = {"driven_pendulum": [("G-L", 2)], "heavy_top": [("G-L", 2)]}


def some(few, pairs):
    """Return pairs as parameters, those not in ``few`` slow."""
    return [pytest.param(*given, id=f"{given[0]}-{label(given[1])}",
                         marks=[] if given[1] in few.get(given[0], []) else pytest.mark.slow)
            for given in pairs]


def space_at(step, name, q, p, t):
    """Return the tangent space of the constraints at a state of a case.

    Rates of a frame are 0 where the case has none.
    """
    own, parameters = step._derivative_binding().own, case_of(name).parameters
    numbers = {k: own.number(parameters.get(k, 0.0)) for k in own.parameter_names}
    return TangentSpace(step._derivative_binding(), own.parameters(numbers, own.number(t)), q, p,
                        step.constraint_names)


def ends_of(name, step, dt=None):
    """Return start and end of a step, as q and p each."""
    case, (q, p) = case_of(name), start_of(name, step)
    run = step.integrate(gs.Start(q, p, t=case.t0), dt=case.dt if dt is None else dt, steps=1,
                         parameters=case.parameters)
    return (q, p), (run.q[-1], run.p[-1])


def omega(n):
    """Return the matrix of the symplectic form dq ∧ dp."""
    zero, one = np.zeros((n, n)), np.eye(n)
    return np.block([[zero, one], [-one, zero]])


# ------------------------------------------------------------ adjoint, tangency, kernel


@pytest.mark.parametrize(("name", "scheme"), some(FEW, product()))
def test_cotangents_are_transposed(name, scheme):
    """⟨w, Φ'v⟩ = ⟨Φ'ᵀw, v⟩ along start, parameters, inputs, dt and t0."""
    step, case = stepper_for(name, scheme), case_of(name)
    (q, p), rng = start_of(name, step), np.random.default_rng(3)
    begin, run = gs.Start(q, p, case.parameters, case.t0), {"dt": case.dt}
    names = [*case.parameters, "dt", "t0"]
    _, _, back = step.vjp(begin, **run)
    for _ in range(4):
        w = rng.normal(size=(2, step.n))
        gradient = back(*w)
        y = rng.normal(size=gradient.basis.shape[1])
        v = gradient.basis @ y
        d = dict(zip(names, rng.normal(size=len(names)), strict=True))
        *_, dq, dp = step.jvp(begin, v[: step.n], v[step.n :], d=d, **run)
        terms = [*(w[0] * dq), *(w[1] * dp)]
        pulled = [*(gradient.start * y), *(gradient[k] * x for k, x in d.items())]
        size = np.abs(terms).sum() + np.abs(pulled).sum()
        assert abs(sum(terms) - sum(pulled)) <= 1e-14 * size


def test_cotangents_are_transposed_over_two_thousand_steps():
    """The same of a run whose cotangents enter at all its stored states."""
    name, labels = "driven_pendulum", ["m", "l", "push"]
    step, case = stepper_for(name, ("G-L", 2)), case_of(name)
    (q, p), rng = start_of(name, step), np.random.default_rng(4)
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


@pytest.mark.parametrize(("name", "scheme"), some(FEW, product()))
def test_images_are_tangent_to_the_constraints(name, scheme):
    """G₁ dq₁ = 0, and of SPARK steps df₁ = 0: at the end, at fixed parameters."""
    step, case = stepper_for(name, scheme), case_of(name)
    _, ends = tangents_of_step(name, step)
    _, (q1, p1) = ends_of(name, step)
    space = space_at(step, name, q1, p1, case.t0 + case.dt)
    for rows, holds in ((space.g, step.m), (space.f, step.m and scheme in SPARK)):
        if holds:
            defect = rows[:, : 2 * step.n] @ ends
            assert np.abs(defect).max() <= 4e-15 * np.abs(rows[:, : 2 * step.n]).max() * (
                np.abs(ends).max())


@pytest.mark.parametrize(("name", "scheme"), some(
    {"heavy_top": [("G-L", 2)], "driven_pendulum": [("G-L", 2)]},
    [(name, scheme) for name in ("heavy_top", "driven_pendulum", "breathing") for scheme in SPARK]))
def test_momenta_along_the_constraints_are_absorbed(name, scheme):
    """Φ'(0, G₀ᵀ) = 0 of SPARK steps: the first multiplier takes them up."""
    step, case = stepper_for(name, scheme), case_of(name)
    (q, p), binding = start_of(name, step), stepper_for(name, scheme)._derivative_binding()
    kept, space = step._kept_step(step._single(
        gs.Start(q, p, case.parameters, case.t0), None, case.dt, None, None))
    dz = np.zeros((binding.rows, step.m + 1))
    dz[step.n : 2 * step.n, : step.m] = space.g[:, : step.n].T
    dz[step.n : 2 * step.n, step.m] = np.arange(step.n) + 1.0  # any other momentum moves the end
    ends = kept.tangent(dz)
    sizes = np.abs(ends).max(axis=0) / np.abs(dz).max(axis=0)
    assert sizes[:-1].max() < 1e-14 < 1e-3 < sizes[-1]


# ------------------------------------------------------------ A, B


THEOREM_A = some({"heavy_top": [("G-L", 2)], "ellipse": [("G-L", 2)]},
                 [(name, scheme) for name in ("free_body", "heavy_top", "ellipse", "breathing",
                                              "heavy_bob") for scheme in SYMMETRIC])


@pytest.mark.parametrize(("name", "scheme"), THEOREM_A)
def test_the_adjoint_is_the_tangent_of_the_step_back(name, scheme):
    """Theorem A: Φ_h'(z₀)ᵀ Ω u = Ω Φ_−h'(z₁) u on the tangent space at z₀."""
    step, case = stepper_for(name, scheme), case_of(name)
    (q0, p0), (q1, p1) = ends_of(name, step)
    run, n, form = {"parameters": case.parameters}, step.n, omega(step.n)
    _, _, back = step.vjp(gs.Start(q0, p0, t=case.t0), dt=case.dt, **run)
    B1 = space_at(step, name, q1, p1, case.t0 + case.dt).basis()
    for u in B1.T:
        w = form @ u
        gradient = back(w[:n], w[n:])
        *_, uq, up = step.jvp(gs.Start(q1, p1, t=case.t0 + case.dt), u[:n], u[n:], dt=-case.dt,
                              **run)
        expected = gradient.basis.T @ form @ np.concatenate([uq, up])
        assert np.abs(gradient.start - expected).max() <= 1e-14 * max(1, np.abs(expected).max())


@pytest.mark.parametrize(("scheme", "real"), [
    (SYMMETRIC[0], "double"),
    *(pytest.param(s, "float128", marks=pytest.mark.slow) for s in SYMMETRIC)], ids=label)
def test_parameters_are_quadratures(scheme, real):
    """Theorem B: (Ωu₁)·δz₁ − (Ωu₀)·δz₀ is the derivative of a sum over the nodes along u."""
    name, names = "ellipse", ["m", "k", "g", "l"]
    step, case = stepper_for(name, scheme, real), case_of(name)
    _, moved = tangents_of_step(name, step, start=None, parameters=names)
    start, _ = tangents_of_step(name, step, start=None, parameters=names)
    basis, images = tangents_of_step(name, step)
    form = omega(step.n)
    pairs = images.T @ (form @ moved) - basis.T @ (form @ start)
    # of a difference of order 4 with h, h^4 and ε/h are equal at h = ε^(1/5)
    size, digits = (2.0**-10, 1e-10) if real == "double" else (2.0**-36, 1e-20)
    sums = np.array([difference(lambda e, u=u: node_sum(name, step, scheme, u, e), size)
                     for u in basis.T])
    assert float(np.abs(pairs + sums).max()) <= digits * float(np.abs(sums).max())
    assert case.parameters.keys() == {*names}


def node_sum(name, step, scheme, u, shift):
    """Return h Σ b_i H_θ(Q_i, P_i) + h Σ b̃_l Λ_l·g_θ(Q̃_l) of a step from a start moved by u."""
    case, system = case_of(name), case_of(name).options["system"]
    (q, p), n = start_of(name, step), step.n
    found = step.consistent(q + shift * u[:n], p + shift * u[n:], parameters=case.parameters)
    q, p = found.q, found.p
    x = step._kept_step(step._single(q, p, case.dt, case.parameters, None))[0].unknowns
    run = step.integrate(q, p, dt=case.dt, steps=1, parameters=case.parameters)
    one, Lambda = q[0] - q[0] + 1, run.multipliers[0]
    table = gs.tableau(scheme[0], stages=scheme[1]).numeric(digits=40)
    A, A_hat, A_tilde, A_bar, b, b_tilde = (one * np.array(a, dtype=object) for a in (
        table.A, table.A_hat, table.A_tilde, table.A_bar, table.b, table.b_tilde))
    s, h = len(b), one * case.dt
    k, k_hat = x[: s * n].reshape(s, n), x[s * n : 2 * s * n].reshape(s, n)
    numbers = [one * case.parameters[str(theta)] for theta in system.parameters]
    energy = sp.lambdify([*system.q, *system.p, *system.parameters],
                         [sp.diff(system.H, theta) for theta in system.parameters], "math")
    (g,) = system.constraints
    row = sp.lambdify([*system.q, *system.parameters],
                      [*sp.Matrix([g]).jacobian(system.q),
                       *(sp.diff(g, theta) for theta in system.parameters)], "math")
    nodes = [row(*(q + h * (A_bar[i] @ k)), *numbers) for i in range(len(b_tilde))]
    force = np.array([[Lambda[i] * e for e in node[:n]] for i, node in enumerate(nodes)])
    total = sum(h * b_tilde[i] * Lambda[i] * np.array(node[n:], dtype=object)
                for i, node in enumerate(nodes))
    for i in range(s):
        Q = q + h * (A[i] @ k)
        P = p + h * (A_hat[i] @ k_hat) - h * (A_tilde[i] @ force)
        total = total + h * b[i] * np.array(energy(*Q, *P, *numbers), dtype=object)
    return total


# ------------------------------------------------------------ energy, frames


@pytest.mark.parametrize("name", ["two_rods"])
def test_energy_momentum_tangents_keep_the_energy(name):
    """Theorem E: ∇H·dz + H_θ dθ is the same at both ends of an EMS step."""
    step, case = stepper_for(name, ("EMS", None)), case_of(name)
    system = case.options["system"]
    names = [str(theta) for theta in system.parameters]
    start, end = tangents_of_step(name, step, parameters=names)
    one = start[0, 0] * 0 + 1
    symbols = [*system.q, *system.p, *system.parameters]
    slope = sp.lambdify(symbols, [sp.diff(system.H, z) for z in symbols], "math")
    numbers = [one * case.parameters[name] for name in names]
    changes = []
    for (q, p), dz in zip(ends_of(name, step), (start, end), strict=True):
        slopes = np.array(slope(*q, *p, *numbers), dtype=object)
        change = slopes[: 2 * step.n] @ dz
        change[-len(names) :] += slopes[2 * step.n :]
        changes.append(change)
    assert np.abs(changes[0]).max() > 0.1
    assert float(np.abs(changes[1] - changes[0]).max()) <= 2e-13 * np.abs(slopes).max()
