"""A coin that rolls upright on a table, by Kane's method of SymPy."""

import sympy as sp
import sympy.physics.mechanics as me

import gyrospark as gs

m, r, A, B = sp.symbols("m r A B", positive=True)
q = x, y, spin, yaw = me.dynamicsymbols("x y spin yaw")
u = me.dynamicsymbols("vx vy spin_rate yaw_rate")
N, origin, centre = me.ReferenceFrame("N"), me.Point("O"), me.Point("C")
heading = N.orientnew("H", "Axis", [yaw, N.z])
axes = heading.orientnew("D", "Axis", [spin, heading.y])
origin.set_vel(N, 0)
centre.set_pos(origin, x * N.x + y * N.y + r * N.z)
coin = me.RigidBody("coin", centre, axes, m, (me.inertia(axes, A, B, A), centre))
method = me.KanesMethod(
    N, list(q), list(u[2:]),
    [a.diff(me.dynamicsymbols._t) - v for a, v in zip(q, u, strict=True)],
    bodies=[coin], u_dependent=list(u[:2]),
    velocity_constraints=[u[0] - r * u[2] * sp.cos(yaw), u[1] - r * u[2] * sp.sin(yaw)])
step = gs.stepper(system=gs.from_mechanics(method, name="coin"))
parameters = {"m": 1.0, "r": 0.5, "A": 0.0625, "B": 0.125}
p = step.momenta([0, 0, 0, 0], [0.5, 0, 1, 1], parameters=parameters)
print(step.integrate([0, 0, 0, 0], p, dt=0.01, t_end=1, parameters=parameters).report)
