"""The manifest of a stepper, compared with its header before its sizes are used for memory.

It says how many numbers compiled code reads and writes. One that does not belong to its header, of
a damaged installation say, would let that code write behind the end of an array.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from ...core.errors import InputError
from ...core.json_records import UnfitError
from ...core.manifest import Manifest
from ...core.real_types import REALS
from .body_columns import bodies_of, joints_of, placed_of

__all__ = ["parse_manifest", "read_manifest", "sizes_of"]


def read_manifest(name: str, files: Mapping[str, str]) -> Manifest:
    """Return the manifest of the files of a stepper: ``name.json`` beside ``name.h``.

    Raises InputError if it is no manifest, or has other sizes than the header.
    """
    try:
        manifest = parse_manifest(json.loads(files[f"{name}.json"]))
        is_full = manifest.profile == "full"
        header_sizes = _sizes_in_header(name, files[f"{name}.h"]) if is_full else {}
    except (KeyError, ValueError, RecursionError) as error:
        reason = f": {error}" if isinstance(error, UnfitError) else ""
        raise InputError(f"The manifest {name}.json is damaged{reason}; generate the stepper "
                         "again.") from None
    if not is_full:
        raise InputError(f"The files of {name} are of profile {manifest.profile!r:.40}, which has "
                         "no runs and no ensembles for Python; generate them again with --profile "
                         "full.")
    # memory of these sizes is read and written by the C: a wrong one would be an overrun
    sizes = sizes_of(manifest)
    for quantity, declared_size in header_sizes.items():
        if sizes[quantity] != declared_size:
            raise InputError(f"The manifest {name}.json does not belong to {name}.h: {quantity} "
                             f"{sizes[quantity]!r:.80} against {declared_size!r:.80}; generate the "
                             "stepper again.")
    return manifest


def parse_manifest(content: Any) -> Manifest:
    """Return the manifest of JSON content, with bodies and joints that its names have.

    Raises UnfitError with the place of a value that does not belong there.
    """
    manifest = Manifest.from_json(content)
    bodies_of(manifest), joints_of(manifest), placed_of(manifest)
    return manifest


def sizes_of(manifest: Manifest) -> dict[str, Any]:
    """Return the sizes in a manifest that its header declares too."""
    system, scheme = manifest.system, manifest.scheme
    time = [] if system.time is None else [system.time]
    reactions = scheme.reactions * len(system.velocity_constraint_names)
    return {
        "name": manifest.name,
        "real": REALS[manifest.real].c_type,
        # C has no empty struct
        "parameters": [*system.parameters, *time] or ["none"],
        # in scaled time t is one more coordinate
        "coordinates": len(system.coordinates) + (system.clock is not None),
        "constraints": len(system.constraints),
        "unknowns": scheme.unknowns,
        "order": scheme.order,
        "multipliers": scheme.multipliers * len(system.constraints) + reactions,
        "forces": bool(system.forces),
        "velocities": bool(system.velocity_names),
        "fast path": manifest.fast_path.available,
        "quantities": len(system.quantities),
        "quantities in time": bool(system.quantities) and system.quantities_take_time,
    }


def _sizes_in_header(name: str, header: str) -> dict[str, Any]:
    """Return the sizes that a header declares, by the keys of ``sizes_of``.

    Raises ValueError for a header that is none of gyrospark's.
    """
    coordinates, constraints, unknowns, order = _groups(
        r"n = (\d+) coordinates, m = (\d+) constraints, (\d+) unknowns a step, order (\d+)\.",
        header)
    multipliers, stepper_name, real = _groups(
        rf"multipliers \((\d+)\n \* of them\)[^;]*\n"
        rf"int ({name})_step\([^;]*?\n    (.+?) dt,", header)
    (fields,) = _groups(rf"typedef struct {{([^{{}}]*)}} {name}_parameters;", header)
    # a comment may follow a field
    parameters = re.findall(r"^    [^/;]*?(\w+);", fields, flags=re.MULTILINE)
    rows = re.search(r"Quantities of `count` states, in rows of (\d+):", header)
    return {
        "name": stepper_name,
        "real": real,
        "parameters": parameters,
        "coordinates": int(coordinates),
        "constraints": int(constraints),
        "unknowns": int(unknowns),
        "order": int(order),
        "multipliers": int(multipliers),
        "forces": " *work_out," in header,
        "velocities": f" {name}_momenta(" in header,
        "fast path": f" {name}_lanes(void)" in header,
        "quantities": int(rows[1]) if rows else 0,
        "quantities in time": re.search(rf" {name}_quantities\([^;]*\*t,", header) is not None,
    }


def _groups(pattern: str, text: str) -> tuple[str, ...]:
    """Return the groups of a pattern in a header, or raise ValueError."""
    match = re.search(pattern, text)
    if match is None:
        raise ValueError(f"no {pattern} in the header")
    return match.groups()
