"""Sweeps: many short runs over a grid of parameters, steps, schemes and starts.

    axes         what varies, along which dimension
    study        a sweep as data: steppers, axes, what is common to all cells
    model        what moves, as steppers and numbers
    plan         from what is asked for to a checked study
    study_file   the same from TOML
    tiles        the cells in blocks, each a chunk of every array of the result
    watched      cells whose events are looked for
    compute      the cells of a tile, side by side in the lanes of compiled code
    results      what is kept of a cell, in memory or in a store
    local        tiles on the threads of this process
    cluster      tiles on a Dask cluster
    estimate     what a sweep will cost
    sweep        ``gyrospark.sweep``
    picture      a quantity over two axes
"""

from .. import storage as storage  # says which extra is not installed
