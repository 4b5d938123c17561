"""A time step for an error, and a run with what was found, at given times."""

import numpy as np

import gyrospark as gs

top, step = gs.problems.fast_top(), gs.stepper()
tuned = gs.tune(step, top, step_error=1e-9, t_end=0.4)
run = step.integrate(top, dt=tuned.dt, t_end=0.4, parameters=tuned.parameters,
                     t_eval=np.linspace(0, 0.4, 5), solver=gs.Solver("newton"))
print(tuned.reason, run.at(0.25).q, run.report.energy_error_max)
