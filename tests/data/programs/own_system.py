"""A Hamiltonian with a constraint, an input and a quantity, and a controller at 10 Hz."""

import sympy as sp

import gyrospark as gs

q, p = sp.symbols("x y", real=True), sp.symbols("px py", real=True)
m, g, length = sp.symbols("m g l", positive=True)
u = sp.Symbol("u", real=True)
pendulum = gs.System(q, p, (m, g, length, u), (p[0]**2 + p[1]**2) / (2 * m) + m * g * q[1],
                     constraints=(q[0]**2 + q[1]**2 - length**2,), forces=(u, 0),
                     quantities={"height": q[1] + length}, inputs=(u,), name="driven_pendulum")
step = gs.stepper("G-L", stages=2, system=pendulum)
start = gs.Start([0.6, -0.8], [0, 0], {"m": 1, "g": 9.81, "l": 1, "u": 0})
sim = step.start(start, dt=0.01, record=True)
for _ in range(20):
    sim.advance(10, u=-2 * float(sim.p[0]))
print(sim.trajectory.quantity("height").max(), sim.report)
