"""Tangents of a run, and the gradient of the distance of its end to a target."""

import numpy as np

import gyrospark as gs

step, top = gs.stepper(), gs.problems.fast_top()
run = step.integrate(top, dt=1e-3, steps=100, every=20,
                     tangents=gs.Tangents(parameters=["I3", "mgl"], dt=True))
gradient = run.gradient({"q": 2 * (run.q[-1] - np.array([0.9, 0.3, 0.2, 0.2]))})
print(run.tangents["mgl"].shape, gradient["I3"], gradient.start)
