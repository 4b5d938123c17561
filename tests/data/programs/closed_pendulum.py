"""A closed pendulum, and a plot of its energy."""

import gyrospark as gs

model = gs.models.four_bar()
step = gs.stepper(system=model)
run = step.integrate(model, dt=2e-3, t_end=1)
run.plot("energy")
