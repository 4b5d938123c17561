"""Systems of sympy.physics.mechanics with joints, and M and the right side of a system of ours."""

from __future__ import annotations

import numpy as np
import sympy as sp
import sympy.physics.mechanics as me

from gyrospark.generator.symbolic.derivatives import along
from gyrospark.generator.symbolic.numeric_evaluation import evaluate

T = me.dynamicsymbols._t


def joints(count, lift=None):
    """Return a System: rods on pin joints about alternating axes, with gravity, on a base."""
    m, length, g = sp.symbols("m l g", positive=True)
    k = sp.Symbol("k", real=True)
    I1, I2 = sp.symbols("I1 I2", positive=True)
    N, O = me.ReferenceFrame("N"), me.Point("O")  # noqa: E741
    O.set_vel(N, 0)
    system, previous = me.System(N, O), me.RigidBody("base", O, N)
    if lift is not None:
        base = N.orientnew("base", "Axis", [0, N.z])
        previous = me.RigidBody("base", O.locatenew("B", lift * N.y), base)
        previous.masscenter.set_vel(N, lift.diff(T) * N.y)
    for i in range(count):
        F, C = me.ReferenceFrame(f"F{i}"), me.Point(f"C{i}")
        body = me.RigidBody(f"rod{i}", C, F, m, (me.inertia(F, I1, I1, I2), C))
        end = previous.masscenter if i == 0 else previous.masscenter.locatenew(
            f"P{i}", length * previous.frame.z)
        joint = me.PinJoint(f"J{i}", previous, body, *me.dynamicsymbols(f"q{i} u{i}"),
                            parent_point=end, child_point=C.locatenew(f"Q{i}", -length * F.z),
                            joint_axis=(previous.frame.x, previous.frame.y)[i % 2])
        system.add_joints(joint)
        system.add_loads(me.Force(C, -m * g * N.z))
        system.add_actuators(me.TorqueActuator(-k * joint.speeds[0], joint.joint_axis, F,
                                               previous.frame))
        previous = body
    return system


def sides(system, values, q, v, t=0.0):
    """Return M and L_q + F − (L_v)_q v − (L_v)_t of a system in numbers."""
    point = {s: values[str(s)] for s in system.parameters}
    point |= dict(zip((*system.q, *system.velocities), (*q, *v), strict=True)) | {T: t}
    entries = evaluate(system.mass_entries, point)
    M = np.zeros((system.n, system.n))
    for position, slot in system.elimination.slot_of.items():
        M[position] = entries[slot]
    time = [] if system.clock is None else [system.clock]
    rate = along(system.L_v, [*system.q, *time],
                 [*system.velocities, *(sp.S.One for _ in time)])
    return M, evaluate(system.generalised_force, point) - evaluate(rate, point)
