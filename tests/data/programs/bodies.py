"""Two bodies with joints and a motor, built in Python, and a run to an event."""

import gyrospark as gs

build = gs.Multibody("swing", gravity=(0, 0, -9.81))
rod = build.body("rod", mass=1, inertia=(0.1, 0.1, 0.01), position=(0.5, 0, 2))
bob = build.point_mass("bob", mass=0.5, position=(1, 0, 1))
build.revolute("pin", build.ground, rod, at=(0, 0, 2), axis=(0, 1, 0), rate=1.0)
build.rod("string", rod, bob, on_a=(0.5, 0, 0))
build.motor("drive", "pin", torque=build.input("u"))
model = build.model()
step = gs.stepper("G-L", stages=3, system=model)
run = step.integrate(model, dt=2e-3, t_end=1, inputs={"u": 0.2},
                     events=gs.Event("bob_x", 0.5, terminal=True))
print(run.joint("pin").angle()[-1], run.body("rod").position()[-1], run.events["bob_x"].t)
