"""Accelerations of systems of sympy.physics.mechanics against those of ``form_eoms``.

Nine systems with bases that move, joints of all kinds, actuators, and loads of every kind.
"""

import warnings

import numpy as np
import pytest
import sympy as sp
import sympy.physics.mechanics as me

import gyrospark as gs
from gyrospark.core.errors import InputError, InputWarning
from gyrospark.generator.symbolic.shared_subexpressions import expand_shared
from mechanics_systems import sides

T = me.dynamicsymbols._t
M, I, LENGTH, K, C, G = sp.symbols("m I l k c g", positive=True)  # noqa: E741
VALUES = {"m": 1.3, "I": 0.1, "l": 0.6, "k": 2.0, "c": 0.3, "g": 9.81, "base_mass": 1.7}
FIFTH = sp.Rational(1, 5)


def number(name):
    return me.dynamicsymbols(f"q{name} u{name}")


def ground():
    """Return a system, its frame, its fixed point, and a body that stands there."""
    N, O = me.ReferenceFrame("N"), me.Point("O")  # noqa: E741
    return me.System(N, O), N, O, me.RigidBody("ground", O, N)


def moving(N, O, path, axes):  # noqa: E741
    """Return a base whose motion is a law of t."""
    B = O.locatenew("B", path)
    B.set_vel(N, path.dt(N))
    return me.RigidBody("base", B, axes)


def body(name):
    """Return a body with three different moments."""
    A, P = me.ReferenceFrame(f"A_{name}"), me.Point(f"P_{name}")
    return me.RigidBody(name, P, A, M, (me.inertia(A, I, 2 * I, sp.Rational(5, 2) * I), P))


def bead_on_a_bar_on_a_moving_base():
    """Return a pin on a moving base, an oblique slide, an actuator, a torque, a timed force."""
    system, N, O, _ = ground()  # noqa: E741
    base = moving(N, O, FIFTH * (sp.sin(3 * T) * N.x + T**2 * N.y), N.orientnew(
        "F", "Axis", [0, N.z]))
    bar, bead = body("bar"), body("bead")
    system.add_joints(
        me.PinJoint("pin", base, bar, *number(1), child_point=LENGTH * bar.frame.y,
                    joint_axis=N.z),
        me.PrismaticJoint("slide", bar, bead, *number(2),
                          joint_axis=(3 * bar.frame.x + 4 * bar.frame.y) / 5))
    off = bar.masscenter.locatenew("off", LENGTH * bar.frame.z)
    q, u = number(2)
    system.add_actuators(me.ForceActuator(-K * sp.sin(q) - C * u, me.LinearPathway(
        off, bead.masscenter)))
    system.add_loads(me.Torque(bar, C * sp.cos(number(1)[0]) * N.z),
                     me.Force(bead, K * sp.sin(2 * T) * N.x),
                     me.Force(bar.masscenter, -M * G * N.y), me.Force(bead, -M * G * N.y))
    return system


def slide_on_a_turning_base():
    """Return a base turning by a law, a slide on it with a pin, and a damper from space."""
    system, N, O, _ = ground()  # noqa: E741
    base = moving(N, O, FIFTH * sp.cos(2 * T) * N.x, N.orientnew("F", "Axis", [sp.sin(2 * T), N.z]))
    sledge, arm = body("sledge"), body("arm")
    system.add_joints(
        me.PrismaticJoint("slide", base, sledge, *number(1), joint_axis=base.frame.x),
        me.PinJoint("pin", sledge, arm, *number(2), child_point=LENGTH * (
            arm.frame.x + arm.frame.y), joint_axis=sledge.frame.y))
    system.add_actuators(me.LinearDamper(C, me.LinearPathway(
        O.locatenew("far", 3 * N.y), arm.masscenter)))
    system.apply_uniform_gravity(-G * N.z)
    return system


def on_a_moving_base_with_the_axes_of_space():
    """Return joints on a moving base, whose velocity they set to 0 in its axes, those of space."""
    system, N, O, _ = ground()  # noqa: E741
    base, arm = moving(N, O, FIFTH * sp.sin(3 * T) * N.x, N), body("arm")
    system.add_joints(me.PinJoint("pin", base, arm, *number(1), child_point=LENGTH * arm.frame.y,
                                  joint_axis=N.z))
    system.add_loads(me.Force(arm, -M * G * N.y), me.Force(arm, K * sp.cos(T) * arm.frame.x))
    return system


def drum():
    """Return a cylindrical joint and a slide across it, with constant and timed loads."""
    system, N, _, earth = ground()
    drum, pin = body("drum"), body("pin")
    (q, z), (u, w) = number(1), number(3)
    system.add_joints(
        me.CylindricalJoint("axle", earth, drum, q, u, z, w, joint_axis=N.z),
        me.PrismaticJoint("slide", drum, pin, *number(2), joint_axis=drum.frame.x,
                          parent_point=LENGTH * drum.frame.y))
    system.add_loads(me.Force(pin, K * sp.sin(T) * N.x - M * G * N.z),
                     me.Force(drum, (K - M * G) * N.z))
    return system


def plate():
    """Return a planar joint with a force that turns with the body."""
    system, N, _, earth = ground()
    plate = body("plate")
    system.add_joints(me.PlanarJoint(
        "plane", earth, plate, *(me.dynamicsymbols(x) for x in ("q1", "q2 q3", "u1", "u2 u3"))))
    system.add_loads(me.Force(plate.masscenter.locatenew("edge", LENGTH * plate.frame.y),
                              K * plate.frame.x + C * N.y), me.Torque(plate, C * sp.sin(T) * N.x))
    return system


def ball():
    """Return a ball joint in body angles, a spring to a point above, a torque in body axes."""
    system, N, O, earth = ground()  # noqa: E741
    bob = body("bob")
    system.add_joints(me.SphericalJoint(
        "ball", earth, bob, me.dynamicsymbols("q1:4"), me.dynamicsymbols("u1:4"),
        child_point=-LENGTH * bob.frame.z, rot_order="ZXZ"))
    system.add_actuators(me.LinearSpring(K, me.LinearPathway(
        O.locatenew("above", 2 * N.x + N.z), bob.masscenter), LENGTH))
    system.add_loads(me.Torque(bob, C * bob.frame.x))
    system.apply_uniform_gravity(-G * N.z)
    return system


def two_arms():
    """Return two arms on joints with frames of their own, and a torque between them."""
    system, N, _, earth = ground()
    upper, lower = body("upper"), body("lower")
    first = me.PinJoint("first", earth, upper, *number(1), child_point=LENGTH * upper.frame.x,
                        joint_axis=N.x + N.y)
    second = me.PinJoint("second", upper, lower, *number(2), parent_point=-LENGTH * upper.frame.x,
                         child_point=LENGTH * lower.frame.z,
                         parent_interframe=upper.frame.x - upper.frame.z)
    system.add_joints(first, second)
    (q, _), (_, u) = number(1), number(2)
    system.add_actuators(me.TorqueActuator(
        -K * sp.sin(q) - C * u + sp.cos(3 * T), second.joint_axis, lower.frame, upper.frame))
    system.apply_uniform_gravity(-G * N.z)
    return system


def potential():
    """Return a bead on a turning hoop, in speeds that are no rates, with weight and drag."""
    N, O = me.ReferenceFrame("N"), me.Point("O")  # noqa: E741
    q, u = number(1)
    hoop = N.orientnew("H", "Axis", [2 * T, N.z])
    arm = hoop.orientnew("A", "Axis", [q, hoop.y])
    P = O.locatenew("P", LENGTH * arm.x)
    O.set_vel(N, 0)
    bead = me.Particle("bead", P, M)
    system = me.System(N, O)
    system.add_bodies(bead)
    system.q_ind, system.u_ind = [q], [u]
    system.add_kdes(u - 2 * q.diff(T) - sp.cos(T))
    system.add_loads(me.Force(P, -M * G * N.z), me.Force(P, -C * P.vel(N)))
    return system


def moved_load():
    """Return a bead free in a plane with a force from a point that moves by a law."""
    system, N, O, earth = ground()  # noqa: E741
    slider, bead = body("one"), body("two")
    system.add_joints(me.PrismaticJoint("x", earth, slider, *number(1), joint_axis=N.x),
                      me.PrismaticJoint("y", slider, bead, *number(2), joint_axis=N.y + N.z))
    hand = O.locatenew("hand", (2 + sp.sin(3 * T)) * N.z + 2 * N.y)
    hand.set_vel(N, 3 * sp.cos(3 * T) * N.z)
    path = me.LinearPathway(hand, bead.masscenter)
    system.add_actuators(me.ForceActuator(-K * (path.length - LENGTH) + C * sp.cos(T), path),
                         me.LinearDamper(C, path))
    return system


SYSTEMS = (bead_on_a_bar_on_a_moving_base, slide_on_a_turning_base,
           on_a_moving_base_with_the_axes_of_space, drum, plate, ball, two_arms, potential,
           moved_load)


def reference(method, q, v, t):
    """Return q̈ of ``form_eoms``: the derivative of q̇(q, u, t) along its own q̇ and u̇."""
    method.form_eoms()
    state = [*method.q, *method.u]
    places = sp.symbols(f"s:{len(state)}")
    rates = [x.diff(T) for x in method.q]
    speeds = sp.solve(list(method.kdes), list(method.u), dict=True)[0]
    qdot = sp.solve(list(method.kdes), rates, dict=True)[0]
    expressions = (method.mass_matrix_full, method.forcing_full,
                   sp.Matrix([qdot[x] for x in rates]))
    constants = sorted(set().union(*(e.free_symbols for e in expressions)) - {T}, key=str)
    put_in = dict(zip(state, places, strict=True))
    values = sp.lambdify([T, places, constants], [me.msubs(e, put_in) for e in expressions],
                         cse=True)
    numbers = [VALUES[str(x)] for x in constants]
    start = dict(zip([*method.q, *rates], [*q, *v], strict=True))
    u = [float(sp.sympify(me.msubs(speeds[x], start)).subs(T, t)) for x in method.u]
    point = np.array([*q, *u])
    mass, forcing, _ = values(t, point, numbers)
    slope = np.linalg.solve(mass, np.ravel(forcing))
    ahead = values(t + 1e-100j, point + 1e-100j * slope, numbers)[2]
    return np.ravel(ahead).imag / 1e-100


@pytest.mark.filterwarnings("ignore::UserWarning")  # SymPy's, of velocities it knows twice
@pytest.mark.parametrize("make", [
    pytest.param(make, marks=[pytest.mark.slow] * (
        make in (two_arms, slide_on_a_turning_base, drum, plate, ball,
                 bead_on_a_bar_on_a_moving_base)))
    for make in SYSTEMS])
def test_accelerations_are_those_of_form_eoms(make):
    """A base put at rest by a joint lacks its motion in SymPy's own equations as well."""
    method = make()
    if make is on_a_moving_base_with_the_axes_of_space:
        with pytest.warns(InputWarning, match="frame"):
            system = gs.from_mechanics(method, name=make.__name__)
        assert T not in system.L.free_symbols
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("error", InputWarning)
            system = gs.from_mechanics(method, name=make.__name__)
    q, v = np.linspace(0.4, 0.9, system.n), np.linspace(0.5, -0.3, system.n)
    M, right = sides(system, VALUES, q, v, 0.35)
    np.testing.assert_allclose(np.linalg.solve(M, right), reference(method, q, v, 0.35),
                               rtol=1e-11, atol=1e-12)


def test_inputs_of_loads_are_held_over_a_step_and_bodies_are_placed(tmp_path):
    """A controller pushes a wagon on a spring and turns a wheel in it.

    Positions and attitudes of a run agree with SymPy's points and frames, and a page shows them.
    """
    system, N, _, earth = ground()
    wagon, wheel = body("wagon"), body("wheel")
    (x, speed), push = number(1), me.dynamicsymbols("F")
    system.add_joints(
        me.PrismaticJoint("slide", earth, wagon, x, speed, joint_axis=N.x),
        me.PinJoint("pin", wagon, wheel, *number(2), parent_point=LENGTH * wagon.frame.y,
                    joint_axis=wagon.frame.z, child_interframe=wheel.frame.y))
    system.add_loads(me.Force(wagon, (push - K * x) * N.x), me.Torque(wheel, push * N.z / 5))
    pushed = gs.from_mechanics(system, name="pushed", inputs=[push], bodies=True)
    assert [str(u) for u in pushed.inputs] == ["F"]
    values = {str(e): VALUES[str(e)] for e in pushed.parameters if e not in pushed.inputs}
    step, pushes = gs.stepper("G-L", 3, system=pushed), np.sin(np.arange(50.0))
    run = step.integrate([0.0, 0.0], [0.0, 0.0], dt=0.1, steps=50, inputs={"F": pushes},
                         parameters=values)
    gain = pushes / 5 / (2.5 * VALUES["I"]) * 0.1  # change of the wheel's rate in each step
    np.testing.assert_allclose(run.velocities[1:, 1], np.cumsum(gain), rtol=0, atol=1e-11)
    assert {"wagon", "wheel"} <= {*run.bodies}
    substitutions = dict(zip(system.q, run.q[-1], strict=True)) | {LENGTH: VALUES["l"]}
    position = wheel.masscenter.pos_from(system.fixed_point).to_matrix(N).subs(substitutions)
    R = np.array(N.dcm(wheel.frame).subs(substitutions), float)
    motion = run.body("wheel")
    np.testing.assert_allclose(motion.position()[-1], np.array(position, float).ravel(), atol=1e-14)
    now = step.start(run.q[-1], run.p[-1], dt=0.1, parameters=values | {"F": 0.0}).body("wheel")
    np.testing.assert_allclose(now.position(), motion.position()[-1], atol=1e-14)
    np.testing.assert_allclose(now.rotation_matrix(), R, atol=1e-14)
    with pytest.raises(InputError, match="'wheel'"):
        now.angular_velocity()
    np.testing.assert_allclose(motion.rotation_matrix()[-1], R, atol=1e-14)
    assert np.abs(np.diff(motion.attitude, axis=0)).max() < 0.2
    np.testing.assert_allclose(motion.position((0, 0, 1))[-1], motion.position()[-1] + R[:, 2],
                               atol=1e-14)
    with pytest.raises(InputError, match="'wheel'"):
        motion.angular_velocity()
    run.show(tmp_path / "wagon.html")
    assert "wheel" in (tmp_path / "wagon.html").read_text(encoding="utf-8")


def test_inputs_appear_in_loads_alone_and_constants_have_names_of_their_own():
    system, _, _, earth = ground()
    arm = body("arm")
    system.add_joints(me.PinJoint("pin", earth, arm, *number(1), child_point=K * arm.frame.y))
    with pytest.raises(InputError, match="input"):
        gs.from_mechanics(system, inputs=[K])
    q = me.dynamicsymbols("q1")
    system, _, _, earth = ground()
    arm = body("arm")
    system.add_joints(me.PinJoint("pin", earth, arm, q, me.dynamicsymbols("u1")))
    system.add_loads(me.Torque(arm, sp.Symbol("q1", real=True) * arm.frame.x))
    with pytest.raises(InputError, match="another name"):
        gs.from_mechanics(system)


def test_auxiliary_speeds_are_zero():
    """Auxiliary speeds name forces of constraints, and nothing moves with them."""
    system, N, O, _ = ground()  # noqa: E741
    (q, u), extra, m = number("1"), me.dynamicsymbols("extra"), sp.Symbol("m")
    P = O.locatenew("P", q * N.x)
    P.set_vel(N, u * N.x + extra * N.y)
    system.add_bodies(me.Particle("b", P, m))
    system.add_coordinates(q)
    system.add_speeds(u)
    system.add_auxiliary_speeds(extra)
    system.add_kdes(u - q.diff())
    translated = gs.from_mechanics(system)
    (mass,), (v,) = translated.parameters, translated.velocities
    assert expand_shared(translated.L) == mass * v**2 / 2
