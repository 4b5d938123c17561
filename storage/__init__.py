"""Runs on disk: streamed while they are computed, gone on with after any end, read by anyone.

    durable      a Zarr store each of whose files appears whole and stays, whatever happens
    lock         one writer a store
    fresh        a store that is begun appears whole
    chunks       how arrays are cut and packed
    identity     what makes two runs the same, and what differs
    layout       the arrays of a run: names, dimensions, units
    happened     the arrays of events, to append to
    checkpoint   the bytes from which a run goes on
    writer       writes in a thread what another computes
    record       a run begun, or gone on with
    course       the loop: steps, events, commits, the end
    soundness    a store is read only if it is whole
    recording    a stored run, to read
    table        the states as columns, of a store or in memory
    export       these as .csv and .nc
"""

from importlib.util import find_spec

from ..errors import MissingDependencyError
from ..extras import install

for _package in ("zarr", "xarray", "google_crc32c", "filelock"):
    if find_spec(_package) is None:
        raise MissingDependencyError(
            f"Stored runs and sweeps need {_package}; {install('storage')} brings it.")
