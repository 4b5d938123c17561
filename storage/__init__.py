"""Runs on disk: streamed while they are computed, resumed after any interruption.

In: a stepper, a start and a folder.
Out: a Zarr store, complete up to its last commit after any interruption.
Open first: ``record.record``.

    durable_files  a Zarr store with atomic, durable files
    staging        atomic creation of stores, and their writer lock
    chunk_writer   chunks of arrays, written side by side
    identity       everything that determines the bits of a run
    array_layout   the arrays of a run: names, dimensions, units
    event_store    appendable arrays of events
    checkpoint     the bytes from which a run resumes
    writer         the writer thread
    record         ``record``: begins or resumes a run
    recorder       the loop: steps, events, commits, the end
    validation     checks of a store before it is read
    recording      a stored run, read-only
    saved_run      a run in memory as a store
"""

from importlib.util import find_spec

from ..core.errors import MissingDependencyError
from ..core.extras import install

for _package in ("zarr", "xarray", "filelock"):
    if find_spec(_package) is None:
        raise MissingDependencyError(
            f"Stored runs and sweeps need {_package}; {install('storage')} brings it.")
