"""Nonholonomic constraints of sympy.physics.mechanics: accelerations against Kane's equations."""

import numpy as np
import pytest
import sympy as sp
import sympy.physics.mechanics as me

import gyrospark as gs
from gyrospark.core.errors import InputError
from gyrospark.generator.symbolic.numeric_evaluation import evaluate

T = me.dynamicsymbols._t
m, r, J, d = sp.symbols("m r J d", positive=True)
grav = sp.Symbol("g", positive=True)
VALUES = {"m": 1.3, "r": 0.7, "J": 0.4, "d": 0.2, "g": 9.81}


def disc():
    """Return a disc on the floor: yaw, lean, spin and position of its centre; speeds are mixed."""
    q, u = me.dynamicsymbols("yaw lean spin x y"), me.dynamicsymbols("u1:6")
    N = me.ReferenceFrame("N")
    yawed = N.orientnew("Y", "Axis", [q[0], N.z])
    leant = yawed.orientnew("L", "Axis", [q[1], yawed.x])
    body = leant.orientnew("R", "Axis", [q[2], leant.y])
    O = me.Point("O")  # noqa: E741
    O.set_vel(N, 0)
    C = O.locatenew("C", q[3] * N.x + q[4] * N.y + r * sp.cos(q[1]) * N.z)
    omega = u[0] * leant.x + u[1] * leant.y + u[2] * leant.z  # speeds are components of ω
    turned = body.ang_vel_in(N)
    kinematics = [omega.dot(e) - turned.dot(e) for e in (leant.x, leant.y, leant.z)]
    kinematics += [u[3] - q[3].diff(T), u[4] - q[4].diff(T)]
    C.set_vel(N, C.pos_from(O).dt(N))
    contact = C.vel(N) + turned.cross(-r * leant.z)
    rows = [sp.trigsimp(contact.dot(e)) for e in (N.x, N.y)]
    inertia = me.inertia(leant, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4)
    rigid_body = me.RigidBody("disc", C, body, m, (inertia, C))
    return me.KanesMethod(N, q, u[:3], kinematics, u_dependent=u[3:], velocity_constraints=rows,
                          bodies=[rigid_body], forcelist=[(C, -m * grav * N.z)])


def sleigh(kind):
    """Return Chaplygin's sleigh by Lagrange's method, or as a System."""
    q, u = me.dynamicsymbols("th x y"), me.dynamicsymbols("w vx vy")
    N, O = me.ReferenceFrame("N"), me.Point("O")  # noqa: E741
    O.set_vel(N, 0)
    B = N.orientnew("B", "Axis", [q[0], N.z])
    C = O.locatenew("C", q[1] * N.x + q[2] * N.y)
    C.set_vel(N, C.pos_from(O).dt(N))
    body = me.RigidBody("sleigh", C, B, m, (me.inertia(B, J, J, J), C))
    blade = (C.vel(N) + B.ang_vel_in(N).cross(-d * B.x)).dot(B.y)
    if kind == "lagrange":
        return me.LagrangesMethod(me.Lagrangian(N, body), q, None, [body], N, nonhol_coneqs=[blade])
    system = me.System(N, O)
    system.add_bodies(body)
    system.add_coordinates(*q)
    system.add_speeds(*u[:2])
    system.add_speeds(u[2], independent=False)
    system.add_kdes(*(b - a.diff(T) for a, b in zip(q, u, strict=True)))
    system.add_nonholonomic_constraints(blade)
    return system


def accelerations(system, q, v):
    """Return v̇ of M v̇ + Aᵀμ = L_q − (L_v)_q v + F, A v̇ = −(A v)_q v."""
    values = dict(zip((*system.q, *system.velocities), (*q, *v), strict=True)) | {
        s: VALUES[str(s)] for s in system.parameters}
    n, rows = system.n, system.velocity_count
    M = evaluate([sp.diff(e, x) for e in system.L_v for x in system.velocities],
                 values).reshape(n, n)
    A = evaluate([e for row in system.A for e in row], values).reshape(rows, n)
    moved = [sp.Add(*(sp.diff(e, x) * w for x, w in zip(system.q, system.velocities, strict=True)))
             for e in (*system.L_v, *system.velocity_constraints)]
    convective = evaluate(moved, values)
    push = evaluate(system.generalised_force, values) - convective[:n]
    matrix = np.block([[M, A.T], [A, np.zeros((rows, rows))]])
    return np.linalg.solve(matrix, np.concatenate([push, -convective[n:]]))[:n]


def state(system, seed):
    """Return random coordinates, and velocities that the rows allow."""
    rng = np.random.default_rng(seed)
    q, v = rng.uniform(0.3, 1.0, (2, system.n))
    values = dict(zip(system.q, q, strict=True)) | {s: VALUES[str(s)] for s in system.parameters}
    A = evaluate([e for row in system.A for e in row], values).reshape(-1, system.n)
    return q, v - np.linalg.pinv(A) @ A @ v


def test_a_rolling_disc_by_kanes_method():
    """Kane's u̇ by M_full (q̇, u̇) = F_full, of speeds along axes of ω, follow from our q̈."""
    method = disc()
    system = gs.from_mechanics(method, name="disc")
    assert (system.m, system.velocity_count) == (0, 2)
    method.kanes_equations()
    q, v = state(system, 4)
    names = dict(zip(method.q, q, strict=True))
    rates = [x.diff(T) for x in method.q]
    speeds = sp.solve(method.kindiffdict() and [
        rate - e for rate, e in method.kindiffdict().items()], method.u)
    at_v = dict(zip(rates, v, strict=True))
    u = {s: float(e.subs(at_v).subs(names)) for s, e in speeds.items()}
    values = {s: VALUES[str(s)] for s in (m, r, grav)}
    full, forcing = (np.array(e.subs(u).subs(names).subs(values), float) for e in (
        method.mass_matrix_full, method.forcing_full))
    kane_rates = np.linalg.solve(full, forcing)[:, 0]
    np.testing.assert_allclose(kane_rates[:5], v, rtol=1e-12)
    v_dot = accelerations(system, q, v)
    second = {x.diff(T, 2): a for x, a in zip(method.q, v_dot, strict=True)}
    slopes = [float(speeds[s].diff(T).subs(second).subs(at_v).subs(names)) for s in method.u]
    np.testing.assert_allclose(kane_rates[5:], slopes, rtol=1e-11)


@pytest.mark.parametrize("kind", ["lagrange", "system"])
def test_a_sleigh_turns_as_its_reduced_equations_say(kind):
    """u̇ = d ω² and ω̇ = −m d u ω/(J + m d²) hold for the speed u of the blade along itself."""
    system = gs.from_mechanics(sleigh(kind), name="sleigh")
    assert system.velocity_count == 1
    q, v = state(system, 5)
    th, w = q[0], v[0]
    forward = v[1] * np.cos(th) + v[2] * np.sin(th)
    v_dot = accelerations(system, q, v)
    mass, moment, arm = (VALUES[key] for key in "mJd")
    assert v_dot[0] == pytest.approx(
        -mass * arm * forward * w / (moment + mass * arm**2), rel=1e-12)
    along = v_dot[1] * np.cos(th) + v_dot[2] * np.sin(th)
    across = v[2] * np.cos(th) - v[1] * np.sin(th)
    assert along + across * w == pytest.approx(arm * w**2, rel=1e-12)


def test_rows_that_others_imply_are_left_out_and_bent_ones_refused():
    method = sleigh("lagrange")
    blade = method.coneqs[0]
    again = me.LagrangesMethod(method._L[0], method.q, None, method.bodies, method.inertial,
                               nonhol_coneqs=[blade, sp.cos(method.q[0]) * blade])
    assert gs.from_mechanics(again).velocity_count == 1
    method = sleigh("lagrange")
    rate = method.q[1].diff(T)
    bent = me.LagrangesMethod(method._L[0], method.q, None, method.bodies, method.inertial,
                              nonhol_coneqs=[rate**2 - method.q[2].diff(T)])
    with pytest.raises(InputError, match="A0"):
        gs.from_mechanics(bent)


@pytest.mark.filterwarnings("ignore::gyrospark.errors.InputWarning")
@pytest.mark.parametrize("placed", [True, False])
def test_rolling_that_was_put_into_a_velocity_is_refused(placed):
    """The disc of SymPy's documentation, with a contact at rest, is refused: T lacks a position."""
    q, u = me.dynamicsymbols("q1:4"), me.dynamicsymbols("u1:4")
    N = me.ReferenceFrame("N")
    yawed = N.orientnew("Y", "Axis", [q[0], N.z])
    leant = yawed.orientnew("L", "Axis", [q[1], yawed.x])
    body = leant.orientnew("R", "Axis", [q[2], leant.y])
    turned, axes = body.ang_vel_in(N), (leant.x, leant.y, leant.z)
    omega = sum((a * e for a, e in zip(u, axes, strict=True)), 0 * N.x)
    contact = me.Point("C")
    contact.set_vel(N, 0 * N.x)
    D = contact.locatenew("D", r * leant.z) if placed else me.Point("D")
    D.set_vel(N, omega.cross(r * leant.z))
    inertia = me.inertia(leant, m * r**2 / 4, m * r**2 / 2, m * r**2 / 4)
    rigid_body = me.RigidBody("disc", D, body, m, (inertia, D))
    method = me.KanesMethod(N, q, u, [(omega - turned).dot(e) for e in axes], bodies=[rigid_body])
    with pytest.raises(InputError, match="D in N"):
        gs.from_mechanics(method)
