"""A satellite with reaction wheels, and a PD controller at 10 Hz."""

import numpy as np

import gyrospark as gs

model = gs.load_model("examples/control_c/satellite.toml")
step = gs.stepper("G-L", stages=2, system=model)
sim = step.start(model, dt=0.02)
for _ in range(100):
    satellite = sim.body()
    turn = np.copysign(1, satellite.attitude[0]) * satellite.attitude[1:]
    u1, u2, u3 = np.clip(-0.5 * turn - 4.0 * satellite.angular_velocity(), -0.2, 0.2)
    sim.advance(5, u1=u1, u2=u2, u3=u3)
print(sim.report)
