"""Runs on disk: streamed while they are computed, gone on with after any end, read by anyone.

    durable      a Zarr store each of whose files appears whole and stays, whatever happens
    lock         one writer a store
    identity     what makes two runs the same, and what differs
    layout       the arrays of a run: names, dimensions, units
    checkpoint   the bytes from which a run goes on
    writer       writes in a thread what another computes
    record       the loop: steps, commits, the end
    recording    a stored run, to read
    table        the states as columns, of a store or in memory
    export       these as .csv and .nc
"""
