"""A robot of MJCF with a torque at a motor, and inverse dynamics."""

import gyrospark as gs

model = gs.load_model("examples/pumpjack.xml", keyframe="running")
step = gs.stepper(system=model)
run = step.integrate(model, dt=2e-3, steps=50, inputs={"drive": 1.5})
print(run.joint("crank").rate(), step.inverse_dynamics(run[-1], {"crank": 2.0}))
