"""A start of a body from its attitude, and a certificate of a scheme."""

import numpy as np

import gyrospark as gs

inertia = (0.002, 0.0013, 0.0008)
parameters = dict(zip(("I1", "I2", "I3", "mgl"), (*inertia, 0.0), strict=True))
tilted = gs.Start.of_body(np.eye(3), [0, 5, 100], inertia, parameters)
run = gs.stepper("EMS").integrate(tilted, dt=1e-3, steps=100)
print(run.angular_velocity()[-1], gs.certify(gs.problems.fast_top(), "EMS", steps=20))
