"""Systems of sympy.physics.mechanics with joints."""

from __future__ import annotations

import sympy as sp
import sympy.physics.mechanics as me

T = me.dynamicsymbols._t


def joints(count, lift=None):
    """A chain of rods on pin joints about alternating axes, with gravity, on a base: a System."""
    m, length, g = sp.symbols("m l g", positive=True)
    k = sp.Symbol("k", nonnegative=True)
    I1, I2 = sp.symbols("I1 I2", positive=True)
    N, O = me.ReferenceFrame("N"), me.Point("O")  # noqa: E741
    O.set_vel(N, 0)
    system, before = me.System(N, O), me.RigidBody("base", O, N)
    if lift is not None:
        base = N.orientnew("base", "Axis", [0, N.z])
        before = me.RigidBody("base", O.locatenew("B", lift * N.y), base)
        before.masscenter.set_vel(N, lift.diff(T) * N.y)
    for i in range(count):
        F, C = me.ReferenceFrame(f"F{i}"), me.Point(f"C{i}")
        body = me.RigidBody(f"rod{i}", C, F, m, (me.inertia(F, I1, I1, I2), C))
        end = before.masscenter if i == 0 else before.masscenter.locatenew(
            f"P{i}", length * before.frame.z)
        joint = me.PinJoint(f"J{i}", before, body, *me.dynamicsymbols(f"q{i} u{i}"),
                            parent_point=end, child_point=C.locatenew(f"Q{i}", -length * F.z),
                            joint_axis=(before.frame.x, before.frame.y)[i % 2])
        system.add_joints(joint)
        system.add_loads(me.Force(C, -m * g * N.z))
        system.add_actuators(me.TorqueActuator(-k * joint.speeds[0], joint.joint_axis, F,
                                               before.frame))
        before = body
    return system
