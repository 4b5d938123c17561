"""The manifest of a stepper, checked before its sizes are used to hand out memory.

It says how many numbers compiled code reads and writes. One that does not belong to its header, of
a damaged installation say, would let that code write behind the end of an array.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from ...core.errors import InputError
from ...core.real_types import REALS
from .body_columns import bodies_of, joints_of, placed_of

__all__ = ["manifest_warnings", "read_manifest", "sizes_of"]

_DOMAINS = ("positive", "nonzero", "real")
_FRACTION = re.compile(r"-?\d{1,40}(/[1-9]\d{0,39})?")


def read_manifest(name: str, files: Mapping[str, str]) -> dict[str, Any]:
    """Return the manifest of the files of a stepper: ``name.json`` beside ``name.h``.

    Raises
    ------
    InputError
        If it is no manifest, or says something else than the header does.
    """
    damaged = InputError(f"The manifest {name}.json is damaged; generate the stepper again.")
    try:
        content = json.loads(files[f"{name}.json"])
        profile = content.get("profile", "full")
    except (KeyError, ValueError, AttributeError, RecursionError):
        raise damaged from None
    if profile != "full":
        raise InputError(f"The files of {name} are of profile {profile!r:.40}, which has no runs "
                         "and no ensembles for Python; generate them again with --profile full.")
    try:
        said, declared = sizes_of(content), _declared(name, files[f"{name}.h"])
    except (KeyError, TypeError, ValueError, AttributeError):
        raise damaged from None
    for what, value in declared.items():
        if said[what] != value:
            raise InputError(f"The manifest {name}.json does not belong to {name}.h: {what} "
                             f"{said[what]!r:.80} against {value!r:.80}; generate the stepper "
                             "again.")
    manifest: dict[str, Any] = content
    return manifest


def manifest_warnings(manifest: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the warnings of a manifest, on tableau, scheme and system, with the part of each."""
    return [(part, remark) for part in ("tableau", "scheme", "system")
            for remark in manifest.get(part, {}).get("remarks", ())]


def sizes_of(content: Any) -> dict[str, Any]:
    """Return the sizes in a manifest that its header declares too.

    Raises ``ValueError``, ``TypeError``, ``KeyError`` or ``AttributeError`` for a manifest in
    which something is missing or of another type.
    """
    system, scheme, fast = content["system"], content["scheme"], content["fast_path"]
    rows = system.get("velocity_constraints", {"names": [], "expressions": [], "velocities": []})
    texts = (content["name"], system["name"], scheme["method"], *system["coordinates"],
             *system["momenta"], *system["constraints"], *system.get("constraint_names", ()),
             *system["parameters"], *system.get("velocity_names", ()),
             *system.get("quantities", ()), system.get("time", ""),
             *content.get("tableau", {}).get("remarks", ()), *system.get("remarks", ()),
             system.get("jumps", ""), fast.get("reason", ""), *rows["names"],
             *rows["expressions"], *rows["velocities"])
    lists = (system["coordinates"], system["momenta"], system["constraints"],
             system.get("constraint_names", []), system.get("forces", []),
             system.get("velocity_names", []),
             content.get("tableau", {}).get("remarks", []), system.get("remarks", []),
             rows["names"], rows["expressions"], rows["velocities"])
    flags = (system["rigid_body"], scheme["unknowns_are_state"],
             scheme["keeps_momentum_constraint"], fast["available"],
             system.get("quantities_take_time", False))
    counts = (scheme["unknowns"], scheme["multipliers"], scheme["order"], scheme["stages"] or 0,
              scheme.get("reactions", 0))
    m = len(system["constraints"])
    bodies_of(content), joints_of(content), placed_of(content)  # which raise for what are none
    sound = (
        all(isinstance(x, str) for x in texts) and all(isinstance(x, list) for x in lists)
        and all(isinstance(x, bool) for x in flags) and all(type(x) is int for x in counts)
        and all(x in _DOMAINS for x in system["parameters"].values())
        and isinstance(system.get("quantities", {}), dict)
        and len(system.get("constraint_names", [0] * m)) == m
        and len(rows["names"]) == len(rows["expressions"])
        and len(system["coordinates"]) == len(system["momenta"])
        and len(system.get("velocity_names", system["momenta"])) == len(system["momenta"])
        and (fast["available"] or "reason" in fast)
        and (not system["rigid_body"] or len(system["coordinates"]) == 4)
    )
    if not sound or not _is_sound_frame(content.get("frame", {"symmetries": []}), system):
        raise ValueError("the manifest holds something of another type")
    time = [system["time"]] if "time" in system else []
    reactions = scheme.get("reactions", 0) * len(rows["names"])
    return {
        "name": content["name"],
        "real": REALS[content["real"]].c_type,
        "parameters": [*system["parameters"], *time] or ["none"],
        "coordinates": len(system["coordinates"]),
        "constraints": m,
        "unknowns": scheme["unknowns"],
        "order": scheme["order"],
        "multipliers": scheme["multipliers"] * m + reactions,
        "forces": "forces" in system,
        "velocities": "velocity_names" in system,
        "fast path": fast["available"],
        "quantities": len(system.get("quantities", ())),
        "quantities in time": bool(system.get("quantities"))
        and system.get("quantities_take_time", False),
    }


def _is_sound_frame(frame: Mapping[str, Any], system: Mapping[str, Any]) -> bool:
    """Whether the symmetries of a co-moving frame have the form that ``Symmetry.of`` reads."""
    n, names = len(system["coordinates"]), {*system["parameters"]}
    return isinstance(frame["symmetries"], list) and all(
        symmetry["name"] in names and type(symmetry["group"]) is int
        and all(isinstance(x, str) for x in (symmetry["meaning"], symmetry["J"],
                                             *symmetry["conditions"]))
        and all(type(i) is type(j) is int and 0 <= min(i, j) <= max(i, j) < n
                and _FRACTION.fullmatch(x) for i, j, x in symmetry["A"])
        and all(_FRACTION.fullmatch(x) and {*powers} <= names
                and all(type(power) is int and 0 < power < 100 for power in powers.values())
                for terms in symmetry["vanishing"] for x, powers in terms)
        for symmetry in frame["symmetries"])


def _declared(name: str, header: str) -> dict[str, Any]:
    """Return the sizes that a header declares; raise if it is none of gyrospark."""
    sizes = _found(r"n = (\d+) coordinates, m = (\d+) constraints, (\d+) unknowns a step, "
                   r"order (\d+)\.", header)
    step = _found(rf"multipliers \((\d+)\n \* of them\)[^;]*\n"
                  rf"int ({name})_step\([^;]*?\n    (.+?) dt,", header)
    fields = _found(rf"typedef struct {{([^{{}}]*)}} {name}_parameters;", header)[0]
    # A comment may stand behind a field.
    parameters = re.findall(r"^    [^/;]*?(\w+);", fields, flags=re.MULTILINE)
    rows = re.search(r"Quantities of `count` states, in rows of (\d+):", header)
    return {
        "name": step[1],
        "real": step[2],
        "parameters": parameters,
        "coordinates": int(sizes[0]),
        "constraints": int(sizes[1]),
        "unknowns": int(sizes[2]),
        "order": int(sizes[3]),
        "multipliers": int(step[0]),
        "forces": " *work_out," in header,
        "velocities": f" {name}_momenta(" in header,
        "fast path": f" {name}_lanes(void)" in header,
        "quantities": int(rows[1]) if rows else 0,
        "quantities in time": re.search(rf" {name}_quantities\([^;]*\*t,", header) is not None,
    }


def _found(pattern: str, text: str) -> tuple[str, ...]:
    match = re.search(pattern, text)
    if match is None:
        raise ValueError(f"no {pattern} in the header")
    return match.groups()
