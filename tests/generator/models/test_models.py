"""The example models against mechanics written another way, in SciPy and in closed form.

    satellite         Euler's equations in inertial axes with the torque 3n² c × Jc, c(t) turning
    double_top        Newton and Euler with the joint's force, accelerations from a linear system
    four_bar          three angles, index 1

SciPy's DOP853 runs at its tightest tolerance, 2.3e-14 of relative local error.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gyrospark as gs
import systems
from gyrospark.runtime.rigid_body.quaternion import (
    angular_velocity,
    left_matrix,
    rotation_matrix,
)
from strategies import EPS


def reference(f, y0, t_end):
    return solve_ivp(f, (0, t_end), y0, method="DOP853", rtol=2.3e-14, atol=1e-15,
                     max_step=t_end / 200).y[:, -1]


def turning(q, omega):
    """Return q̇ = ½ Lᵀ Ω."""
    return 0.5 * left_matrix(q).T @ omega


def satellite(t):
    """Return q(t) in orbit axes from the motion in inertial axes."""
    model = gs.models.satellite()
    J = np.array(model.bodies["a_gamma"])
    n = model.parameters["n"]

    def orbit(t):  # quaternion of the turn by n t about y
        return np.array([np.cos(n * t / 2), 0, np.sin(n * t / 2), 0])

    def product(x, y):
        v = x[0] * y[1:] + y[0] * x[1:] + np.cross(x[1:], y[1:])
        return np.array([x[0] * y[0] - x[1:] @ y[1:], *v])

    def f(t, y):
        q, w = y[:4], y[4:]
        up = rotation_matrix(orbit(t))[:, 2]
        c = rotation_matrix(q).T @ up
        return np.concatenate([
            turning(q, w), (3 * n**2 * np.cross(c, J * c) - np.cross(w, J * w)) / J])

    start = [*model.q0, *angular_velocity(model.q0, model.p0, J)]
    q = reference(f, start, t)[:4]
    return product(orbit(t) * [1, -1, -1, -1], q)


def cross_matrix(r):
    x, y, z = r
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def double_top(t):
    """Return both quaternions: unknown accelerations Ω̇_a, Ω̇_b and the force F on a's head."""
    model = gs.models.double_top()
    Ja, Jb = (np.array(J) for J in model.bodies.values())
    ma, mb, g = 1.0, 0.4, np.array([0, 0, -9.81])
    ca, ra, rb = np.array([0, 0, 0.25]), np.array([0, 0, 0.5]), np.array([0, 0, -0.15])

    def f(_, y):
        qa, qb, wa, wb = y[:4], y[4:8], y[8:11], y[11:]
        Ra, Rb = rotation_matrix(qa), rotation_matrix(qb)
        A, b = np.zeros((9, 9)), np.zeros(9)
        # J Ω̇ + Ω × JΩ = torques, in body axes; a about its tip, b about its centre
        A[:3, :3], A[:3, 6:] = np.diag(Ja), -cross_matrix(ra) @ Ra.T
        b[:3] = np.cross(ca, Ra.T @ (ma * g)) - np.cross(wa, Ja * wa)
        A[3:6, 3:6], A[3:6, 6:] = np.diag(Jb), cross_matrix(rb) @ Rb.T
        b[3:6] = -np.cross(wb, Jb * wb)
        # m_b (head of a − R_b r_b)¨ = m_b g − F
        A[6:, :3], A[6:, 3:6] = -mb * Ra @ cross_matrix(ra), mb * Rb @ cross_matrix(rb)
        A[6:, 6:] = np.eye(3)
        b[6:] = mb * (g - Ra @ np.cross(wa, np.cross(wa, ra)) + Rb @ np.cross(wb, np.cross(wb, rb)))
        rates = np.linalg.solve(A, b)
        return np.concatenate([turning(qa, wa), turning(qb, wb), rates[:6]])

    start = [*model.q0[:8], 0.2, 0, 40, 0, 0.3, 70]
    return reference(f, start, t)[:8]


def four_bar(t):
    """Return the direction of each bar, from angles φ with Σ l_j e(φ_j) constant."""
    points = np.array([[0, 0], [0, 0.4], [0.9, 0.8], [1, 0]])
    bars = np.diff(points, axis=0)
    length = np.linalg.norm(bars, axis=1)
    inertia = length * (length**2 + 0.03**2) / 12
    reach = np.tril(np.tile(length, (3, 1)), -1) + np.diag(length / 2)  # centre i = Σ reach_ij e_j
    weight = np.einsum("i,ij,ik->jk", length, reach, reach)
    heavy = length @ reach

    def f(_, y):
        phi, v = y[:3], y[3:]
        apart = phi[:, None] - phi
        M = weight * np.cos(apart) + np.diag(inertia)
        G = np.array([-length * np.sin(phi), length * np.cos(phi)])
        bend = np.array([length * np.cos(phi), length * np.sin(phi)]) @ v**2
        push = -(weight * np.sin(apart)) @ v**2 - 9.81 * heavy * np.cos(phi)
        A = np.block([[M, G.T], [G, np.zeros((2, 2))]])
        return [*v, *np.linalg.solve(A, [*push, *bend])[:3]]

    second, third = np.linalg.solve(bars[1:].T, -3.0 * bars[0])
    phi = reference(f, [*np.arctan2(bars[:, 1], bars[:, 0]), 3.0, second, third], t)[:3]
    return np.concatenate([np.cos(phi), np.sin(phi)])


def seen(name, q):
    """Return the values that the reference of a model has, from its coordinates."""
    if name == "double_top":
        return q[:8]
    if name == "four_bar":
        ends = [rotation_matrix(q[7 * i : 7 * i + 4])[:2, 0] for i in range(3)]
        return np.array(ends).T.ravel()
    return q


REFERENCES = {
    # model: (function, end, step, tolerance); the satellite's is the truncation of its long step
    "satellite": (satellite, 6000.0, 40.0, 5e-12),
    "double_top": (double_top, 0.2, 2.5e-4, 64 * EPS),
    "four_bar": (four_bar, 0.6, 1e-3, 256 * EPS),
}


def run(model, step, dt, t_end):
    steps = round(t_end / dt)
    return step.integrate(model.q0, model.p0, dt=t_end / steps, steps=steps,
                          parameters=model.parameters, every=steps)


@pytest.mark.slow  # a stepper of three stages for each, to the last digits
@pytest.mark.parametrize("name", REFERENCES)
def test_against_another_formulation(name):
    function, t_end, dt, tolerance = REFERENCES[name]
    model = getattr(gs.models, name)()
    end = run(model, gs.stepper("G-L", 3, system=model.system), dt, t_end).q[-1]
    assert np.abs(seen(name, end) - function(t_end)).max() <= tolerance


@pytest.mark.parametrize("name", ["four_bar", *(
    pytest.param(name, marks=pytest.mark.slow) for name in ("satellite", "double_top"))])
def test_another_formulation_is_approached_with_the_fourth_power_of_the_step(name):
    function, t_end, dt, _ = REFERENCES[name]
    step, model, exact = systems.stepper(name), systems.case(name).system, function(t_end)
    errors = [np.abs(seen(name, run(model, step, n * dt, t_end).q[-1]) - exact).max()
              for n in (8, 4)]
    assert errors[1] < 1e-5
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.3)


def centres_of(model):
    """Return the position of each body at the start, by its name with _x."""
    return {name: model.q0[i:i + 3] for i, name in enumerate(map(str, model.system.q))
            if name.endswith("_x")}


def test_rods_of_the_delta_robot_have_their_length():
    """Between elbows, at .3 m from shoulders at .2 m, and wrists they have .6 m: 9 freedoms."""
    model = gs.models.delta_robot()
    centres = centres_of(model)
    assert (model.system.n - model.system.m, len(centres)) == (9, 10)
    for k in range(3):
        shoulder = 0.2 * np.array([np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3), 0])
        wrist = centres["platform_x"] + 0.3 * shoulder
        elbow = 2 * centres[f"arm{k}_x"] - shoulder
        left, right = (centres[f"rod{k}_{side}_x"] for side in ("left", "right"))
        assert np.linalg.norm(elbow - shoulder) == pytest.approx(0.3)
        assert np.linalg.norm(elbow - wrist) == pytest.approx(0.6)
        assert (left + right) / 2 == pytest.approx((elbow + wrist) / 2)
        assert np.linalg.norm(left - right) == pytest.approx(0.1)


def test_legs_of_the_stewart_platform_lie_between_their_joints():
    """Uniform tubes of .35 m lead from feet at .5 m from the middle along the rods: 12 freedoms."""
    model = gs.models.stewart_platform()
    centres = centres_of(model)
    assert model.system.n - model.system.m == 12
    for k in range(6):
        tube, rod = centres[f"tube{k}_x"], centres[f"rod{k}_x"]
        half = 0.175 * (rod - tube) / np.linalg.norm(rod - tube)
        side, middle = (-1, 1)[k % 2], 2 * np.pi * (k // 2) / 3
        for point, radius, angle in (
                (tube - half, 0.5, middle + 0.2 * side),
                (rotation_matrix(model.q0[:4]).T @ (rod + half - centres["platform_x"]), 0.3,
                 middle + (np.pi / 3 - 0.2) * side)):
            assert point == pytest.approx(
                [radius * np.cos(angle), radius * np.sin(angle), 0], abs=64 * EPS)


@pytest.mark.parametrize("count", [0, -1, 2.5, True])
def test_chain_takes_whole_numbers(count):
    with pytest.raises(gs.InputError, match="from 1"):
        gs.models.chain(count)


@pytest.mark.parametrize("name", gs.models.__all__)
def test_every_model_starts_on_its_constraints(name):
    """Starts hold the constraints, also in the second representation of one body and of two."""
    for rep in ("gamma", "alpha")[:2 if name in ("lagrange_top", "double_top") else 1]:
        model = getattr(gs.models, name)(rep=rep)
        assert {key.split("_")[-1] for key in model.bodies} == {rep}
        state = [model.q0, model.p0]
        moved = gs.consistent(model.system, *state, parameters=model.parameters)
        assert moved.q_moved <= 4 * EPS
        assert moved.p_moved <= 64 * EPS * max(1, np.abs(model.p0).max())
        assert model.dt > 0
        assert model.description.endswith(".")


@pytest.mark.parametrize("dt", ["fast", np.inf, [1e-3, 1e-3]])
def test_the_step_of_a_model_is_a_finite_number(dt):
    with pytest.raises(gs.InputError, match="dt"):
        replace(gs.models.double_top(), dt=dt)
