"""An ensemble over a parameter, one member of it, and its table."""

import numpy as np

import gyrospark as gs

top, step = gs.problems.fast_top(), gs.stepper()
many = step.integrate_ensemble(top, dt=1e-3, steps=100, every=10,
                               parameters={"mgl": np.linspace(0.3, 0.4, 5)})
print(many.q.shape, many.members[3].body().euler("ZXZ")[-1], many.failures)
many.save("many.npz")
