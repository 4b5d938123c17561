"""The drag of a top, fitted to measured attitudes."""

import gyrospark as gs

model = gs.load_model("examples/damped_top.toml")
step = gs.stepper(system=model)
seen = step.integrate(model, dt=5e-3, steps=40)
fit = gs.fit(step, model, seen.t[1:], seen.q[1:], dt=5e-3, parameters={"c": 1e-4}, free=["c"])
print(fit.parameters["c"], fit.sigma["c"])
