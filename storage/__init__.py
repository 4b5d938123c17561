"""Runs on disk: streamed while they are computed, resumed after any end, read by anyone.

    durable_files  a Zarr store each of whose files appears whole and stays, whatever happens
    writer_lock    one writer a store
    staging        a new store appears whole
    chunks         how arrays are cut and packed
    identity       what makes two runs the same, and what differs
    array_layout   the arrays of a run: names, dimensions, units
    event_store    the arrays of events, to append to
    checkpoint     the bytes from which a run resumes
    writer         writes in a thread what another computes
    record         ``record``: a run begun, or resumed
    recorder       the loop: steps, events, commits, the end
    validation     a store is read only if it is whole
    recording      a stored run, to read
    state_tables   the states as columns, of a store or in memory
    table_files    these as .npz, .csv and .nc
"""

from importlib.util import find_spec

from ..core.errors import MissingDependencyError
from ..core.extras import install

for _package in ("zarr", "xarray", "google_crc32c", "filelock"):
    if find_spec(_package) is None:
        raise MissingDependencyError(
            f"Stored runs and sweeps need {_package}; {install('storage')} brings it.")
