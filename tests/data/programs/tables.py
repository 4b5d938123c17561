"""A run as a table of pandas and as NetCDF."""

import gyrospark as gs

model = gs.models.double_pendulum()
run = gs.stepper(system=model).integrate(model, dt=2e-3, t_end=0.5)
print(run.table(euler="ZYX").describe())
run.save("run.nc")
