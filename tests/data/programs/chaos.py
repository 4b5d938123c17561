"""A Poincaré section, and Lyapunov exponents."""

import gyrospark as gs

model = gs.models.double_pendulum()
step = gs.stepper(system=model)
found = gs.section(step, [model], event=gs.Event("b_y"), dt=2e-3, t_end=4)
assert len(found.q) > 0
print(found.q.shape, gs.lyapunov(step, model, dt=2e-3, t_end=2, count=2).exponents)
