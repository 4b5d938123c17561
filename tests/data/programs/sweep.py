"""A parameter sweep, which the same command resumes after a kill."""

import gyrospark as gs

found = gs.sweep(gs.problems.fast_top(), {"dt": [1e-3, 2e-3], "mgl": [0.3, 0.4]}, steps=50,
                 out="sweep.zarr", resume=True)
print(gs.load_sweep("sweep.zarr").energy_error_max.max(), found.sizes)
