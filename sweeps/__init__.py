"""Parameter sweeps: many short runs over a grid of parameters, steps, schemes and starts.

In: a model and a grid of values.
Out: a dataset with the grid's axes, in memory or in a store.
Open first: ``run_sweep.sweep``.

    axes           axes of the grid, each a dimension of the result
    study          a sweep as data: steppers, axes, arguments common to all cells
    sweep_model    the model as steppers and numbers
    plan           arguments of ``sweep`` to a checked study
    study_file     a study file (TOML) to a study
    tiles          the cells in blocks, each a chunk of every array of the result
    cell_events    cells with events
    compute_tile   the cells of a tile in lanes of compiled code; tiles on local threads
    results        results of cells, in memory or in a store
    cluster        tiles on a Dask cluster
    cost_estimate  time and size of a sweep, from a few cells
    run_sweep      ``gyrospark.sweep``
    sweep_plots    a quantity over one or two axes
"""

from .. import storage as storage  # says which extra is not installed
