"""Splittings of Hamiltonians, and refusals that name the terms left over."""

from dataclasses import replace

import pytest
import sympy as sp

import gyrospark as gs
from gyrospark.generator.multibody.rigid_body import (
    alpha,
    body_system,
    free_body,
    gamma,
    heavy_top,
    kinetic_energy,
    mgl,
    moments,
    p,
    q,
    rotation_matrix,
)
from gyrospark.generator.normal_forms.canonical_system import canonical
from gyrospark.generator.splitting.decomposition import _eigenaxes, _new_symbols, split
from gyrospark.generator.symmetry.frame_symmetries import frame_of
from gyrospark.generator.systems.system import System
from splitting_systems import SYSTEMS, UNIT, molecules

I1, I2, I3 = moments
x, y, px, py = sp.symbols("x y px py", real=True)
b, c = sp.symbols("b c", positive=True)


def plane(H):
    return System((x, y), (px, py), (b, c), H, name="plane")


@pytest.mark.parametrize("rep", ["gamma", "alpha", "original"])
def test_the_top_does_not_depend_on_alpha_and_gamma(rep):
    for system in (heavy_top(rep), canonical(heavy_top(rep))):
        splitting = split(system, symmetric=True)
        (body,) = splitting.bodies
        assert body.a == 1 / I1
        (axis,) = body.axes
        assert axis.axis == (0, 0, 1)
        assert sp.simplify(axis.d - (1 / I3 - 1 / I1)) == 0
        assert axis.steady
        assert not body.further
        assert splitting.conditions == (I1 - I2,)
        assert not splitting.V.has(alpha, gamma)
        R = rotation_matrix(q)
        torque = sp.Matrix([-R[1, 2], R[0, 2], 0]) * mgl  # of a weight on axis 3
        assert sp.expand(sp.Matrix(splitting.kick.torques[0]) - torque) == sp.zeros(3, 1)
        assert splitting.is_exact
        assert splitting.has_gradient
        assert splitting.highest_order is None


def test_an_exact_gradient_of_a_top_and_one_more_rotation_of_an_asymmetric_body():
    splitting = split(heavy_top("gamma"), symmetric=True)
    height = 1 - 2 * q[1]**2 - 2 * q[2]**2
    for N, G in zip(splitting.kick.torques[0], splitting.gradient.torques[0], strict=True):
        assert sp.expand(G + 2 * N * mgl * height / I1) == 0
    splitting = split(heavy_top("gamma"))
    (body,) = splitting.bodies
    (further,) = body.further
    assert further.axis == (0, 1, 0)
    assert body.symmetric_if == (I1 - I2,)
    assert not splitting.conditions
    assert not splitting.is_exact
    assert not splitting.has_gradient
    assert sp.simplify(body.S - sp.diag(1 / I1, 1 / I2, 1 / I3)) == sp.zeros(3, 3)


def test_kovalevskaya_and_free_bodies():
    T = kinetic_energy("gamma").xreplace({I2: I1, I3: I1 / 2})
    top = System(q, p, (I1, gamma, mgl), T + mgl * rotation_matrix(q)[2, 0], UNIT, name="kov")
    splitting = split(top)
    assert splitting.is_exact
    assert sp.diag(1, 1, 2) / I1 == splitting.bodies[0].S
    assert not splitting.bodies[0].axes[0].steady
    free = split(free_body("alpha"), symmetric=True)
    assert free.V == 0
    assert free.kick.torques == ((0, 0, 0),)
    ball = System(q, p, (I1, gamma), kinetic_energy("gamma").xreplace({I2: I1, I3: I1}), UNIT,
                  name="ball")
    assert split(ball).bodies[0].axes == ()


@pytest.mark.parametrize("moments", [(1, 1, 2), (1, 2, 1), (2, 1, 1), (1, 2, 3), (1, 1, 1)])
def test_equal_moments_stand_in_any_places(moments):
    S = {(i, j): sp.Integer(moments[i] * (i == j)) for i in range(3) for j in range(3)}
    a, axes = _eigenaxes("top", "body", S)
    assert a * sp.eye(3) + sum((d * sp.Matrix(e) * sp.Matrix(e).T for e, d in axes),
                               sp.zeros(3)) == sp.diag(*moments)
    assert len(axes) == len(set(moments)) - 1


def test_a_tensor_with_an_axis_of_symmetry():
    e = sp.Matrix([1, 2, 2]) / 3
    J_inverse = sp.eye(3) * b + c * e * e.T
    K = [J_inverse[i, j] for i in range(3) for j in range(i, 3)]
    H = kinetic_energy("gamma", inertia=K)
    (body,) = split(System(q, p, (b, c, gamma), H, UNIT, name="skew")).bodies
    assert sp.simplify(body.a - b) == 0
    assert sp.simplify(body.S - J_inverse) == sp.zeros(3, 3)
    with pytest.raises(gs.GyrosparkError, match="principal axes"):
        split(body_system("tensor", "gamma", sp.Integer(0), tensor=True))


def test_gyrostats_turn_across_their_axis_too_if_they_are_symmetric():
    (body,) = split(SYSTEMS["gyrostat"][0]).bodies
    rates = {axis.axis: axis.c for axis in (*body.axes, *body.further)}
    assert [str(rates[e]) for e in ((1, 0, 0), (0, 1, 0), (0, 0, 1))] == ["c1", "c2", "c3"]
    assert not body.symmetric_if
    system = SYSTEMS["gyrostat"][0]
    (body,) = split(replace(system, H=system.H.subs(I2, I1))).bodies
    axis, across = (*body.axes, *body.further)
    assert (axis.axis, str(axis.c)) == ((0, 0, 1), "c3")
    assert [str(sp.simplify(across.c * e)) for e in across.axis] == ["c1", "c2", "0"]
    assert across.d == 0


def test_frames_are_rotations_of_space():
    splitting = split(gs.models.satellite().system)
    assert [str(e) for e in splitting.space[0].omega] == ["0", "n", "0"]
    system = canonical(heavy_top("gamma"))
    framed = split(frame_of(system).moving(system))
    assert [str(e) for e in framed.space[0].omega] == ["0", "0", "omega_space"]
    assert str(framed.bodies[0].axes[0].c) == "-omega_body"
    magnetic = split(plane(((px - c * y)**2 + (py + c * x)**2) / (2 * b)))
    assert magnetic.space[0].omega == (0, 0, -c / b)
    assert magnetic.space[0].points == ((0, 1, -1),)
    assert magnetic.translation.inverse_mass == {(0, 0): 1 / b, (1, 1): 1 / b}


def test_translations_and_time():
    t = sp.Symbol("t", real=True)
    system = System((x, y), (px, py), (b, c), px**2 / (2 * b) + px * py / c + c * py
                    + sp.cos(t) * (x - y)**4, time=t, forces=(-b * px, sp.sin(t)), name="points")
    splitting = split(system)
    move = splitting.translation
    assert move.inverse_mass == {(0, 0): 1 / b, (0, 1): 1 / c, (1, 0): 1 / c}
    assert move.velocity == {1: c}
    assert move.drag == {0: b}
    assert splitting.applied.forces == (0, sp.sin(t))
    assert splitting.time_dependent
    assert not splitting.other_forces


def test_drag_is_found_and_other_forces_limit_the_order():
    drag = split(SYSTEMS["drag"][0])
    assert str(drag.bodies[0].drag) == "k"
    assert drag.highest_order is None
    driven = split(SYSTEMS["driven"][0], symmetric=True)
    assert driven.highest_order == 2
    assert not driven.has_gradient
    assert driven.time_dependent
    u = sp.Symbol("u", real=True)
    pushed = split(body_system("pushed", "gamma", sp.Integer(0), (u,), torque=[u, 0, 0]))
    assert pushed.highest_order is None
    assert pushed.kick.torques[0] == tuple(sp.Matrix(pushed.applied.torques[0]))


def test_equal_bodies_share_templates():
    system = molecules(4, (1, 1.4, 0.8), neighbours=2).system
    splitting = split(system)
    assert [body.name for body in splitting.bodies] == ["w0", "w1", "w2", "w3"]
    (template,) = splitting.templates
    pairs = {instance.bodies for instance in template.instances}
    assert len(template.instances) == len(pairs) == 5
    assert len(template.bodies) == 2
    assert len(template.coordinates) == 6
    assert all(system.q[i] in system.q
               for instance in template.instances for i in instance.coordinates)


def test_joints_masses_of_time_lagrangians_and_odd_inertia_are_refused():
    with pytest.raises(gs.GyrosparkError, match=r"double_pendulum.*'joint: x'"):
        split(gs.models.double_pendulum().system)
    t = sp.Symbol("t", real=True)
    system = System((x,), (px,), (b,), px**2 / (2 * b) * (1 + t), time=t, name="rocket")
    with pytest.raises(gs.GyrosparkError, match="px"):
        split(system)
    v = sp.Symbol("v", real=True)
    system = System.from_lagrangian(b * v**2 / 2 * (1 + x**2), (x,), (v,), (b,), name="rod")
    with pytest.raises(gs.GyrosparkError, match="legendre"):
        split(system)
    H = kinetic_energy("gamma") + p[0]**2 * q[1] / 8
    with pytest.raises(gs.GyrosparkError, match="exact flow"):
        split(System(q, p, (*moments, gamma), H, UNIT, name="odd"))


@pytest.mark.parametrize(("H", "words"), [
    (px**2 / 2 + b * px * py * sp.cos(x - y) + py**2, ["px*py*cos(x - y)"]),
    (px**4 / 2 + py**2, ["degree 4 in p"]),
    (sp.sqrt(1 + px**2) + py**2, ["polynomial in p"]),
    (px**2 / 2 + py**2 / x**2, ["py**2/x**2"]),
    (px**2 / 2 + py**2 / 4 - b * (x * py - y * px), ["px*y"]),
    (px**2 / 2 + py**2 / 2 - b * x * py, ["py*x"]),
])
def test_what_is_left_over_is_named(H, words):
    with pytest.raises(gs.GyrosparkError) as error:
        split(plane(H))
    assert all(word in str(error.value) for word in words)


def test_new_symbols_are_none_of_the_system():
    assert [x.name for x in _new_symbols("x", {"x3", "x_1", "y1"})] == ["x__1", "x__2", "x__3"]
