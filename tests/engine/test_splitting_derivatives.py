"""Derivatives of splittings: against a splitting in 50 digits, differences, and each other."""

from __future__ import annotations

from functools import cache

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.tableaux.compositions import COMPOSITIONS

TOP = gs.problems.fast_top()
SYMMETRIC = TOP.parameters | {"gamma": 1.0}
ASYMMETRIC = SYMMETRIC | {"I2": 1.3 * TOP.parameters["I1"]}
MOMENTS = ["I1", "I2", "I3", "mgl"]


@cache
def splitting():
    return gs.stepper("splitting", order=4)


def product(a, b):
    """Return the product of two quaternions."""
    return [a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
            a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
            a[0] * b[2] + a[2] * b[0] + a[3] * b[1] - a[1] * b[3],
            a[0] * b[3] + a[3] * b[0] + a[1] * b[2] - a[2] * b[1]]


def conjugate(a):
    return [a[0], -a[1], -a[2], -a[3]]


class HeavyTop:
    """The top's splitting by its formulas: H = ½ |m|²/I1 + rotations about axes 3 and 2 + V."""

    def __init__(self, I1, I2, I3, mgl):
        self.a, self.mgl = 1 / I1, mgl
        self.rates = {2: 1 / I2 - 1 / I1, 3: 1 / I3 - 1 / I1}

    def momentum(self, q, l, axis):  # noqa: E741
        """Return m_axis, m = R(q)ᵀ l."""
        return product(product(conjugate(q), [0, *l]), q)[axis]

    def turn(self, q, l, axis, t):  # noqa: E741
        angle = t * self.rates[axis] * self.momentum(q, l, axis) / 2
        e = [mp.cos(angle), 0, 0, 0]
        e[axis] = mp.sin(angle)
        return product(q, e)

    def drift(self, q, l, t):  # noqa: E741
        q = self.turn(q, l, 3, t)
        size = mp.sqrt(sum(x * x for x in l))
        k = mp.sin(self.a * size * t / 2) / size if size else self.a * t / 2
        return product([mp.cos(self.a * size * t / 2), *(k * x for x in l)], q)

    def kick(self, q, l, t, kappa=0):  # noqa: E741
        """Return l behind a kick by V = mgl z, z = R33, and G = mgl²(1 − z²)/I1."""
        x, y, z = product(product(q, [0, 0, 0, 1]), conjugate(q))[1:]
        rate = t * (self.mgl - 2 * kappa * self.mgl**2 * z * self.a)
        return [l[0] - rate * y, l[1] + rate * x, l[2]]


def reference(q, p, h, values, steps):
    """Return the end of steps of order 4, of the composition that the parameters choose."""
    top, even = HeavyTop(*values), values[0] == values[1]
    composition = COMPOSITIONS[splitting().manifest.scheme.compositions[even]]
    q, l = list(q), [x / 2 for x in product(p, conjugate(q))[1:]]  # noqa: E741
    for _ in range(steps):
        for i, b in enumerate(composition.kicks):
            q = top.drift(q, l, h * mp.mpf(composition.drifts[i].numerator)
                          / composition.drifts[i].denominator)
            t = h * mp.mpf(b.numerator) / b.denominator
            if even:
                c = -composition.gradients[i] / b
                l = top.kick(q, l, t, h**2 * mp.mpf(c.numerator) / c.denominator)  # noqa: E741
                continue
            l = top.kick(q, l, t / 2)  # noqa: E741
            q = top.turn(q, l, 2, t)
            l = top.kick(q, l, t / 2)  # noqa: E741
        a = composition.drifts[-1]
        q = top.drift(q, l, h * mp.mpf(a.numerator) / a.denominator)
    return q + [2 * x for x in product([0, *l], q)]


@pytest.mark.parametrize("case", ["symmetric", "asymmetric", "at rest"])
def test_tangents_against_differences_in_50_digits(case):
    values = ASYMMETRIC if case == "asymmetric" else SYMMETRIC
    p0 = TOP.p0 * (case != "at rest")
    steps, h = 3, 2e-3
    free = MOMENTS if case == "asymmetric" else ["I3", "mgl"]
    run = splitting().integrate(TOP.q0, p0, dt=h, steps=steps, parameters=values,
                         tangents=gs.Tangents(parameters=free, dt=True))
    tangents = np.concatenate([run.tangents.q, run.tangents.p], axis=1)
    first, final = tangents[0], tangents[-1]
    with mp.workdps(50):
        numbers = [mp.mpf(values[name]) for name in MOMENTS]

        def end(row, name, shift):
            z = [mp.mpf(float(x)) + shift * mp.mpf(float(d))
                 for x, d in zip([*TOP.q0, *p0], row, strict=True)]
            parameters = [x + shift * (m == name) for m, x in zip(MOMENTS, numbers, strict=True)]
            return mp.matrix(reference(z[:4], z[4:], mp.mpf(h) + shift * (name == "dt"), parameters,
                                       steps))

        for k, name in enumerate(run.tangents.names):
            exact = (end(first[:, k], name, mp.mpf(10)**-15)
                     - end(first[:, k], name, -mp.mpf(10)**-15)) / (2 * mp.mpf(10)**-15)
            exact = np.array([float(x) for x in exact])
            assert np.abs(final[:, k] - exact).max() <= 2e-13 * np.abs(exact).max()
    omega = np.kron([[0, 1], [-1, 0]], np.eye(4))
    defect = final[:, :6].T @ omega @ final[:, :6] - first[:, :6].T @ omega @ first[:, :6]
    assert np.abs(defect).max() < 1e-15 * np.abs(final[:, :6]).max()**2 + 1e-14
    w = np.random.default_rng(1).normal(size=8)
    gradient = splitting().gradient(run, {"q": w[:4], "p": w[4:]},
                                    wrt=["start", *free, "dt"]).vector()
    assert np.abs(gradient - w @ final).max() <= 1e-14 * np.abs(w[:, None] * final).max()


def test_runs_backwards_from_checkpoints_and_in_reverse():
    run = splitting().integrate(TOP.q0, TOP.p0, dt=2e-3, steps=200, parameters=ASYMMETRIC, every=10)
    cotangents = {"q": run.q, "p": 3 * run.q}
    stored, pieces, reverse = (splitting().gradient(run, cotangents, memory=memory).vector()
                               for memory in ("256 MB", "10 kB", "none"))
    assert np.array_equal(stored, pieces)
    assert np.allclose(stored, reverse, rtol=1e-9, atol=1e-9 * np.abs(stored).max())


def test_symmetric_bodies_have_the_derivative_by_what_breaks_the_symmetry():
    """The derivative of order 2 approaches the derivative of a nearly symmetric body."""
    nearly_symmetric = SYMMETRIC | {"I2": SYMMETRIC["I1"] * (1 + 1e-9)}
    errors = []
    for steps in (20, 40):
        derivatives = [splitting().integrate(
            TOP.q0, TOP.p0, dt=0.04 / steps, steps=steps, parameters=values,
            tangents=gs.Tangents(start=None, parameters=["I2"])).tangents.q[-1]
            for values in (SYMMETRIC, nearly_symmetric)]
        errors.append(np.abs(derivatives[0] - derivatives[1]).max() / np.abs(derivatives[1]).max())
    assert errors[1] < 1e-3
    assert errors[0] / errors[1] > 3.5


def on_constraints(z):
    """Return q and p of a state z near |q| = 1 and q.p = 0, moved onto both."""
    q, p = z.reshape(2, -1).copy()
    q[:4] /= np.sqrt(q[:4] @ q[:4])
    p[:4] -= q[:4] * (q[:4] @ p[:4])
    return q, p


@cache
def everything(torque: float = 0.0) -> gs.Model:
    """An asymmetric body with drag on a spring along x that changes to a driven point, in axes
    that turn.

    ``torque`` adds one that is no drag, so that kicks depend on momenta.
    """
    model = gs.Multibody("everything", gravity=(0, 0, -1))
    a = model.body("a", mass=1, inertia=(1, 1.2, 0.7), angular_velocity=(0.5, 0.2, 1))
    b = model.point_mass("b", mass=2, position=(1.5, 0.2, 0.1), velocity=(0, 0.3, 0))
    k, c, u = (model.parameter("k", 2.0, positive=True), model.parameter("c", 0.2),
               model.input("u", 0.3))
    reach = a.point((0.2, 0, 0))[0] - b.point((0, 0, 0))[0]
    model.potential(k * reach**2 / 2 * (1 + sp.cos(2 * model.time) / 3))
    model.torque(a, [-c * (1 + torque * i) * sp.Symbol(f"a_I{i}", positive=True) * w
                     for i, w in zip((1, 2, 3), a.angular_velocity, strict=True)])
    model.force(b, [u, 0, 0])
    momentum = sum((sp.Matrix(body.x).cross(sp.Matrix(body.p_x)) for body in (a, b)),
                   sp.Matrix(a.angular_momentum))
    model.potential(-model.parameter("w", 0.3) * (momentum[0] + momentum[2] / 2))
    return model.model()


@pytest.mark.slow  # derives and compiles two orders of derivatives of a system with all features
@pytest.mark.parametrize(("torque", "even"), [(0.0, False), (0.3, False), (0.3, True)])
def test_forces_points_inputs_and_time(torque, even):
    """Tangents agree with differences, adjoints and Hessians with tangents and each other."""
    model, h, rng = everything(torque), 0.05, np.random.default_rng(3)
    step = gs.stepper("splitting", order=2 if torque else 4, system=model.system)
    n, parameters = step.n, [x for x in model.parameters if x != "u"]
    names = [*parameters, "dt", "t0"]
    changes = [dict(zip([*names, "u"], rng.normal(size=len(names) + 1), strict=True))
               for _ in range(2)]
    values = model.parameters | ({"a_I2": model.parameters["a_I1"]} if even else {})
    for d in changes if even else ():
        d["a_I2"] = d["a_I1"]
    directions = rng.normal(size=(2, 2 * n))
    w = rng.normal(size=2 * n)

    def start(q, p, d, s):
        return gs.Start(q, p, t=0.1 + s * d["t0"])

    def arguments(d, s):
        return {"dt": h + s * d["dt"], "parameters": {k: v + s * d[k] for k, v in values.items()}}

    def state_at(direction, s):
        return on_constraints(np.concatenate([model.q0, model.p0]) + s * direction)

    def differences(f, d, direction, s):
        def slope(s):
            return (f(start(*state_at(direction, s), d, s), **arguments(d, s))
                    - f(start(*state_at(direction, -s), d, -s), **arguments(d, -s))) / (2 * s)
        return (slope(2 * s) - 20 * slope(s) + 64 * slope(s / 2)) / 45

    def end(begin, **arguments_of_step):
        return np.concatenate(step.step(begin, **arguments_of_step)[:2])

    def cotangent(begin, **arguments_of_step):
        gradient = step.vjp(begin, wrt=["q", "p", *parameters, "inputs", "dt", "t0"],
                            **arguments_of_step)[2](w[:n], w[n:])
        return np.concatenate([gradient.q, gradient.p, [gradient[name] for name in names],
                               gradient["inputs"].ravel()])

    at_start, begin = arguments(changes[0], 0), start(model.q0, model.p0, changes[0], 0)
    projected = [np.concatenate([model.q0, model.p0]) * 0 for _ in directions]
    pairs = []
    for k, (d, direction) in enumerate(zip(changes, directions, strict=True)):
        x = direction.copy()
        x[:4] -= model.q0[:4] * (model.q0[:4] @ x[:4])
        x[n : n + 4] -= model.q0[:4] * (x[:4] @ model.p0[:4] + model.q0[:4] @ x[n : n + 4])
        projected[k] = x
        derivative = np.concatenate(step.jvp(begin, x[:n], x[n:], d=d, **at_start)[2:])
        exact = differences(end, d, x, 1e-3)
        assert np.abs(derivative - exact).max() < 1e-11 * np.abs(exact).max()
        change_vector = np.concatenate([x, [d[name] for name in [*names, "u"]]])
        pairs.append(change_vector)
        assert w @ derivative == pytest.approx(cotangent(begin, **at_start) @ change_vector,
                                               abs=1e-14 * np.abs(w * derivative).sum())
    hessian = []
    for d, x in zip(changes, projected, strict=True):
        product = step.hvp(begin, x[:n], x[n:], w[:n], w[n:], d=d, **at_start)
        hessian.append(np.concatenate([product.q, product.p, [product[name] for name in names],
                                       product["inputs"].ravel()]))
    assert hessian[0] @ pairs[1] == pytest.approx(hessian[1] @ pairs[0], rel=1e-11)
    exact = differences(cotangent, changes[0], projected[0], 1e-3)[2 * n :]
    assert np.abs(hessian[0][2 * n :] - exact).max() < 1e-9 * np.abs(exact).max()


def test_analyses_of_runs():
    """A pendulum's period and Floquet multipliers are exact; exponents cancel in pairs."""
    q = np.array([np.cos((np.pi - 0.6) / 2), np.sin((np.pi - 0.6) / 2), 0, 0])
    small = 2 * np.pi * np.sqrt(ASYMMETRIC["I1"] / ASYMMETRIC["mgl"])
    orbit = gs.periodic_orbit(splitting(), q, np.zeros(4), dt=1.02 * small / 60, steps=60,
                              parameters=ASYMMETRIC)
    exact = small * 2 / np.pi * float(mp.ellipk(mp.sin(0.3)**2))
    assert orbit.residuals[-1] < 1e-13
    assert float(orbit.period) == pytest.approx(exact, rel=1e-6)
    assert np.prod(orbit.multipliers) == pytest.approx(1, abs=1e-12)
    chaos = gs.lyapunov(splitting(), TOP.q0, TOP.p0 / 20, dt=2e-3, steps=1000,
                        parameters=ASYMMETRIC)
    assert chaos.exponents + chaos.exponents[::-1] == pytest.approx(0, abs=1e-2 * max(
        chaos.exponents))


def test_points_without_bodies():
    """A linear step is its own tangent, and its adjoint is the transposed matrix."""
    x, p, k, m = sp.symbols("x p k m", real=True)
    step = gs.stepper("splitting", order=4, system=gs.System(
        (x,), (p,), (k, m), p**2 / (2 * m) + k * x**2 / 2, [], name="oscillator"))
    arguments = {"dt": 0.3, "parameters": {"k": 1.2, "m": 0.7}}
    columns = np.column_stack([np.concatenate(step.step(*e, **arguments)[:2])
                               for e in ([[1], [0]], [[0], [1]])])
    assert columns == pytest.approx(np.concatenate(step.jvp(
        [0.4], [0.1], [[1, 0]], [[0, 1]], **arguments)[2:]), abs=1e-15)
    assert np.linalg.det(columns) == pytest.approx(1, abs=1e-15)
    cotangent = step.vjp([0.4], [0.1], **arguments)[2]([0.6], [-0.8])
    assert [*cotangent.q, *cotangent.p] == pytest.approx([0.6, -0.8] @ columns, abs=1e-15)
    hessian = step.hvp([0.4], [0.1], [0.3], [-0.2], [0.6], [-0.8], d={"k": 0.5}, **arguments)
    cotangents = [step.vjp([0.4 + s * 0.3], [0.1 - s * 0.2], wrt=["q", "p", "k"], dt=0.3,
                           parameters={"k": 1.2 + s * 0.5, "m": 0.7})[2]([0.6], [-0.8])
                  for s in (1e-5, -1e-5)]
    for name in ("q", "p"):
        ahead, behind = (getattr(gradient, name) for gradient in cotangents)
        assert getattr(hessian, name) == pytest.approx((ahead - behind) / 2e-5, abs=1e-9)
    assert hessian["k"] == pytest.approx((cotangents[0]["k"] - cotangents[1]["k"]) / 2e-5, abs=1e-9)
