"""A stored run, resumed to a later time, and its energy error."""

import gyrospark as gs

top, step = gs.problems.fast_top(), gs.stepper()
step.integrate(top, dt=1e-3, t_end=0.2, every=10, out="top.zarr")
gs.resume("top.zarr", t_end=0.5)
run = gs.load("top.zarr")
print(run.t[-1], run.energy_error().max(), len(run[5::2]))
