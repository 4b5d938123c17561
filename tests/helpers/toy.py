"""The toy of tests/data/toy, by which headers of the engine are compiled without a generator."""

from __future__ import annotations

import re
from fractions import Fraction
from pathlib import Path

import mpmath as mp

import gyrospark as gs
from gyrospark.core.real_types import REALS
from gyrospark.engine.amalgamate import FOLDER
from gyrospark.generator.schemes.fast_tableau import FastTableau
from gyrospark.generator.tableaux.tableau import FIELDS
from gyrospark.generator.tableaux.velocity_rows import velocity_enclosures
from processes import DATA, ROOT

TOY = DATA / "toy"
HEADERS = sorted(FOLDER.glob("gyrospark/**/*.h"))
#: For files that include the toy: not all of its kernels are called.
FLAGS = ["-std=c11", "-Wall", "-Wextra", "-Wno-unused-function", "-Wno-unused-const-variable",
         f"-I{FOLDER}", f"-I{TOY}"]


def tables(stages: int) -> str:
    """Return the tables of G-L with so many stages, as a generated file has them."""
    tableau, double = gs.tableau("G-L", stages), REALS["double"]
    numeric, fast = tableau.numeric(20), FastTableau(tableau)
    kinds = {"s": "S", "p": "P + 1"}
    shape = {field: "".join(f"[{kinds[k]}]" for k in ks) for field, ks in FIELDS.items()}
    lines = [f"/* Tables of G-L, s = {stages}. */", "static const struct {",
             *(f"    real {field}{shape[field]};" for field in FIELDS), "} tableau = {",
             *(f"    .{field} = {braced(getattr(numeric, field))}," for field in FIELDS), "};"]
    for prefix, entries in (("table", fast.tables(double)),
                            ("even_odd", fast.even_odd_tables(double))):
        lines += [f"static const real {prefix}_{name}[{len(rows)}][{len(rows[0])}] = "
                  f"{braced(rows)};" for name, rows in entries.items()]
    lines += [f"static const real {name}[S] = {braced(getattr(numeric, field))};"
              for name, field in (("weights", "b"), ("weights_hat", "b_hat"), ("nodes", "c"))]
    rows = [[double.round(e) for e in row] for row in velocity_enclosures(tableau)]
    lines.append(f"static const real velocity_table[P + 1][P + 1] = {braced(rows)};")
    return "\n".join([*lines, ""])


def braced(value: object) -> str:
    """Return numbers in lists as C initialises an array."""
    if isinstance(value, (list, tuple)):
        return "{ " + ", ".join(map(braced, value)) + " }"
    return repr(float(value)) if isinstance(value, Fraction) else mp.nstr(value, 20)


def flags_of(header: Path) -> dict[str, str]:
    """Return the macros that .clangd gives a header."""
    path = header.relative_to(ROOT).as_posix()
    return dict(re.findall(r"-D(\w+)=(\w+)", " ".join(
        added for pattern, added in re.findall(
            r"PathMatch: (.+)\nCompileFlags:\n  Add: \[(.+)\]", (ROOT / ".clangd").read_text())
        if re.fullmatch(pattern, path))))


#: Features by which headers differ: name → macros. What a header does not name makes no variant.
VARIANTS: dict[str, dict[str, object]] = {
    "of .clangd": {},
    "free": {"TOY_CONSTRAINTS": 0},
    "two constraints": {"TOY_CONSTRAINTS": 2},
    "one stage": {"TOY_STAGES": 1, "TOY_TABLES": '"tables1.h"'},
    "constant W": {"GS_CONSTANT_SCHUR": 1},
    "scalar W": {"GS_CONSTANT_SCHUR": 1, "GS_SCALAR_SCHUR": 1},
    "separable": {"GS_SEPARABLE": 1},
    "separable, scalar W": {"GS_CONSTANT_SCHUR": 1, "GS_SCALAR_SCHUR": 1, "GS_SEPARABLE": 1},
    "separable, free": {"GS_SEPARABLE": 1, "TOY_CONSTRAINTS": 0},
    "even and odd": {"GS_EVEN_ODD": 1, "TOY_STAGES": 7, "TOY_TABLES": '"tables7.h"'},
    "midpoint": {"TOY_STAGES": 0},
    "midpoint, free": {"TOY_STAGES": 0, "TOY_CONSTRAINTS": 0},
    "midpoint, constant W": {"TOY_STAGES": 0, "GS_CONSTANT_SCHUR": 1},
    "midpoint, scalar W": {"TOY_STAGES": 0, "GS_CONSTANT_SCHUR": 1, "GS_SCALAR_SCHUR": 1},
    "batch": {"TOY_SINGLE": 0},
    "lanes": {"TOY_LANES": 1},
    "Newton alone": {"GS_FIXED_POINT": 0},
    "plain numbers": {"GYROSPARK_PLAIN": 1},
    "wide numbers": {"GS_WIDE_REAL": 1},
    "float": {"GS_SHORT_REAL": 1},
    "compensated": {"GS_COMPENSATED_LANES": 1},
    "compensated, wide": {"GS_COMPENSATED_LANES": 1, "GS_WIDE_REAL": 1},
    **{f"{scheme}{name}": {**stages, **features}
       for scheme, stages in (("", {}), ("midpoint, ", {"TOY_STAGES": 0}))
       for name, features in {
           "forces": {"GS_FORCES": 1},
           "time": {"GS_TIME_DEPENDENT": 1},
           "time, forces, free": {"GS_TIME_DEPENDENT": 1, "GS_FORCES": 1, "TOY_CONSTRAINTS": 0},
           "inputs": {"GS_INPUTS": 1, "GS_FORCES": 1},
           "frame": {"GS_FRAME": 1},
           "frame, forces": {"GS_FRAME": 1, "GS_FRAME_WORK": 1, "GS_FORCES": 1},
           "frame, multipliers": {"GS_FRAME": 1, "GS_ROTATING_MULTIPLIERS": 1},
           "Lagrangian": {"GS_LAGRANGIAN": 1},
           "Lagrangian, free": {"GS_LAGRANGIAN": 1, "TOY_CONSTRAINTS": 0},
           "Lagrangian, forces": {"GS_LAGRANGIAN": 1, "GS_FORCES": 1},
           "Lagrangian, time": {"GS_LAGRANGIAN": 1, "GS_TIME_DEPENDENT": 1, "GS_FORCES": 1},
           "velocities": {"GS_VELOCITY_CONSTRAINTS": 1},
           "velocities, free": {"GS_VELOCITY_CONSTRAINTS": 1, "TOY_CONSTRAINTS": 0},
           "velocities, forces": {"GS_VELOCITY_CONSTRAINTS": 1, "GS_FORCES": 1},
           "velocities, time": {"GS_VELOCITY_CONSTRAINTS": 1, "GS_TIME_DEPENDENT": 1,
                                "GS_FORCES": 1},
           "velocities, Lagrangian": {"GS_VELOCITY_CONSTRAINTS": 1, "GS_LAGRANGIAN": 1},
           "indefinite mass": {"GS_LAGRANGIAN": 1, "GS_INDEFINITE_MASS": 1},
           "elements": {"GS_ELEMENTS": 1, "TOY_CONSTRAINTS": 2},
           "elements, free": {"GS_ELEMENTS": 1, "TOY_CONSTRAINTS": 0},
           "profile run": {"GS_PROFILE_RUN": 1},
           "profile run, forces": {"GS_PROFILE_RUN": 1, "GS_FORCES": 1},
           "profile run, free": {"GS_PROFILE_RUN": 1, "TOY_CONSTRAINTS": 0, "GS_FORCES": 1},
           "profile run, scalar W": {"GS_PROFILE_RUN": 1, "GS_CONSTANT_SCHUR": 1,
                                     "GS_SCALAR_SCHUR": 1},
           "profile control": {"GS_PROFILE_CONTROL": 1},
           "profile control, held": {"GS_PROFILE_CONTROL": 1, "GS_HELD": 1},
           "profile control, free": {"GS_PROFILE_CONTROL": 1, "TOY_CONSTRAINTS": 0},
           "profile control, time": {"GS_PROFILE_CONTROL": 1, "GS_FORCED_BY_TIME": 1},
           "profile control, separable": {"GS_PROFILE_CONTROL": 1, "GS_SEPARABLE": 1},
       }.items()},
    "drag": {"GS_DRAG": 1},
    "drag, forces": {"GS_DRAG": 1, "GS_FORCES": 1},
    "rotating axes": {"GS_ROTATING_AXES": 1},
    "forces of momenta": {"GS_MOMENTUM_FORCES": 1, "GS_FORCES": 1},
    "second derivatives": {"GS_SECOND_DERIVATIVES": 1},
    "derivatives in lanes": {"GS_DERIVATIVES_IN_LANES": 1},
    "derivatives in lanes, time": {"GS_DERIVATIVES_IN_LANES": 1, "GS_TIME_DEPENDENT": 1,
                                   "GS_FORCES": 1},
    "derivatives in lanes, free": {"GS_DERIVATIVES_IN_LANES": 1, "TOY_CONSTRAINTS": 0},
    "midpoint, derivatives in lanes": {"GS_DERIVATIVES_IN_LANES": 1, "TOY_STAGES": 0},
    "EMS": {"TOY_STAGES": 0, "GS_LAGRANGIAN": 1, "GS_ENERGY_MOMENTUM": 1},
    "EMS, time": {"TOY_STAGES": 0, "GS_LAGRANGIAN": 1, "GS_ENERGY_MOMENTUM": 1,
                  "GS_TIME_DEPENDENT": 1, "GS_FORCES": 1},
}


def variants(header: Path) -> dict[str, dict[str, object]]:
    """Return the macros of each variant that the text of a header distinguishes."""
    text, header_macros = header.read_text(encoding="ascii"), flags_of(header)
    macro_names = {*header_macros, *re.findall(r"\bGS_\w+", text)}
    if "GS_SPARK" in macro_names:
        macro_names.add("TOY_STAGES")
    if "table_" in text:
        macro_names |= {"TOY_STAGES", "TOY_TABLES"}
    if {"GS_CONSTRAINED", "GS_SEVERAL_CONSTRAINTS"} & macro_names:
        macro_names.add("TOY_CONSTRAINTS")
    if "LANES" in text:
        macro_names.add("GYROSPARK_PLAIN")
    if "TYPED(" in text:
        macro_names.add("TOY_LANES")
    merged_macros: dict[frozenset[tuple[str, object]], tuple[str, dict[str, object]]] = {}
    for name, macros in VARIANTS.items():
        if not set(macros) <= macro_names or any(
                str(macros.get(key, value)) != value for key, value in header_macros.items()
                if key != "TOY_SINGLE" and not (key == "TOY_STAGES" and macros.get(key))):
            continue
        # headers of constraints are included where there are some
        if (header.parent.name == "constraints" and macros.get("TOY_CONSTRAINTS") == 0
                and "GS_VELOCITY_CONSTRAINTS" not in macros):
            continue
        merged = {**header_macros, **macros}
        merged_macros.setdefault(frozenset(merged.items()), (name, merged))
    return dict(merged_macros.values())
