"""Parameter sweeps: many short runs over a grid of parameters, steps, schemes and starts.

    axes           what varies, along which dimension
    study          a sweep as data: steppers, axes, arguments common to all cells
    sweep_model    the model as steppers and numbers
    plan           from a caller's arguments to a checked study
    study_file     the same from TOML
    tiles          the cells in blocks, each a chunk of every array of the result
    cell_events    cells with events
    compute_tile   the cells of a tile, side by side in the lanes of compiled code
    results        results of cells, in memory or in a store
    local_threads  tiles on the threads of this process
    cluster        tiles on a Dask cluster
    cost_estimate  time and size of a sweep, from a few cells
    run_sweep      ``gyrospark.sweep``
    sweep_plots    a quantity over one or two axes
"""

from .. import storage as storage  # says which extra is not installed
