"""A tableau of a paper: Radau IIA."""

import gyrospark as gs

tableau = gs.tableau(A=[["5/12", "-1/12"], ["3/4", "1/4"]], b=["3/4", "1/4"], name="radau_iia")
step = gs.stepper(tableau=tableau, system="heavy_top")
print(step.integrate(gs.problems.fast_top(), dt=1e-3, steps=100).report)
