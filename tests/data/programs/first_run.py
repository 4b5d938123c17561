"""The first run of the README: attitude, angular velocity and energy of a top."""

import gyrospark as gs

step = gs.stepper("G-L", stages=3)
run = step.integrate(gs.problems.fast_top(), dt=1e-3, steps=200)
print(run.body().euler("ZXZ")[-1], run.angular_velocity()[-1], run.energy_error().max())
run.show("top.html")
