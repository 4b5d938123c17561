"""What the templates and the manifest are told of the fast path of a stepper."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from ...core.real_types import Real
from ..kernels.c_printer import ON_LANES, CPrinter
from ..kernels.kernel import Constants, EmittedKernel, Target, emit_kernel, sums_products
from ..schemes.fast_path import fast_system
from ..schemes.fast_tableau import FastTableau
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..systems.repeated_structure import Structure

__all__ = ["fast_context", "fast_manifest"]


def fast_context(
    scheme: SparkScheme | MeanScheme, constants: Constants, real: Real
) -> dict[str, Any]:
    """Return what the templates of the fast path need; ``fast`` is False where there is none."""
    system, spark = fast_system(scheme.system), isinstance(scheme, SparkScheme)
    tables, halves = {}, {}
    if isinstance(scheme, SparkScheme):
        tableau = FastTableau(scheme.tableau)
        if tableau.refusal is not None:
            return {"fast": False, "lane_kernels": [], "no_fast_path": tableau.refusal}
        tables, halves = tableau.tables(real), tableau.halves(real)
        own_kernels = system.spark_kernels()
    else:
        own_kernels = system.mean_kernels(scheme)
    folds = {symbol: f"c->{symbol.name.lstrip('_')}"
             for symbol in system.folds.definitions.values()}
    kernels = [emit_kernel(k, constants, real, Target.lanes(folds)) for k in own_kernels]
    values = CPrinter(real, {s: f"from->{s}" for s in scheme.system.parameters})
    m = scheme.system.m
    held = 2 * len(scheme.system.parameters) + len(system.folds.definitions)
    if not m and spark:
        tables = {name: tables[name] for name in ("mu", "mu_hat", "onward")}
        halves = {name: rows for name, rows in halves.items() if name in tables}
    return {
        "fast": True,
        "vectors": not real.wide,
        "lane_kernels": kernels,
        "folded": {symbol.name.lstrip("_"): values(e)
                   for e, symbol in system.folds.definitions.items()},
        **_lane_functions(kernels),
        "fast_tables": _literals(tables, real),
        "half_tables": _literals(halves, real),
        "compensated": any(sums_products(k, "lanes_") for k in kernels),
        "eliminates": scheme.system.m and (spark or system.schur_inverse is None),
        "one": "stages" if spark else "mean",
        "many": "trajectories" if spark else "mean",
        "constant_schur": scheme.system.m and system.schur_inverse is not None,
        "correction": scheme.system.m and system.correction is not None,
        "shared": len(system.shared),
        "separable": system.is_separable,
        "affine": system.is_affine,
        "history": _history(scheme),
        "memory": _memory(scheme, real, held, m * m, one=True),
        "batch_memory": _memory(scheme, real, held, m * m, one=False),
    }


def structured_fast_context(
    scheme: SparkScheme | MeanScheme, structure: Structure, forms: dict[str, Any], real: Real
) -> dict[str, Any]:
    """Return the same for a system in forms: nothing is proved of it but what its forms show."""
    spark, tables, halves = isinstance(scheme, SparkScheme), {}, {}
    if isinstance(scheme, SparkScheme):
        tableau = FastTableau(scheme.tableau)
        if tableau.refusal is not None:
            return {"fast": False, "lane_kernels": [], "no_fast_path": tableau.refusal}
        tables, halves = tableau.tables(real), tableau.halves(real)
        if not scheme.system.m:
            tables = {name: tables[name] for name in ("mu", "mu_hat", "onward")}
            halves = {name: rows for name, rows in halves.items() if name in tables}
    kernels = [k for k in forms["form_kernels"] if k.name.startswith("lanes_")]
    m = scheme.system.m
    held, factor = len(forms["used_constants"]), forms["elimination"]["entries"]
    return {
        "fast": True,
        "vectors": not real.wide,
        "lane_kernels": [],
        "folded": {},
        **_lane_functions(kernels),
        "fast_tables": _literals(tables, real),
        "half_tables": _literals(halves, real),
        "compensated": any(sums_products(k, "lanes_") for k in kernels),
        "eliminates": bool(m),
        "one": "stages" if spark else "mean",
        "many": "trajectories" if spark else "mean",
        "constant_schur": False,
        "correction": False,
        "shared": 0,
        "separable": structure.is_separable,
        "affine": structure.is_quadratic,
        "history": _history(scheme),
        "memory": _memory(scheme, real, held, factor, one=True),
        "batch_memory": _memory(scheme, real, held, factor, one=False),
    }


def _literals(tables: dict[str, list[list[Fraction]]], real: Real) -> dict[str, list[list[str]]]:
    return {name: [[real.literal(e) for e in row] for row in rows]
            for name, rows in tables.items()}


def _lane_functions(kernels: Sequence[EmittedKernel]) -> dict[str, list[str]]:
    """Return what kernels on lanes call: what is done lane by lane, and what all at once."""
    called = set[str]().union(*(k.functions for k in kernels))
    return {"lane_functions": sorted(called - ON_LANES),
            "lane_switches": sorted(called & ON_LANES)}


def fast_manifest(fast: dict[str, Any]) -> dict[str, Any]:
    """Say whether there is a fast path, what was proved for it, or why there is none."""
    if not fast["fast"]:
        return {"available": False, "reason": fast["no_fast_path"]}
    return {
        "available": True,
        "constant_schur": bool(fast["constant_schur"]),
        "scalar_correction": bool(fast["correction"]),
        "gauss_seidel": bool(fast["separable"]),
        "operations": {k.name: k.operations for k in fast["lane_kernels"]},
    }


def _history(scheme: SparkScheme | MeanScheme) -> int:
    """Return how many steps are remembered: 16 for a recurrence, lessons take more."""
    return 32 if scheme.tableau else 16


def _memory(
    scheme: SparkScheme | MeanScheme, real: Real, constants: int, factor: int, *, one: bool
) -> int:
    """Return bytes enough for the fast path's state at any number of lanes; C checks it.

    ``factor`` numbers hold the factors of W at a node.

    One trajectory has its stages in lanes, several are in lanes themselves.
    """
    n, m = scheme.system.n, scheme.system.m
    s, p = (scheme.tableau.s, scheme.tableau.p) if scheme.tableau else (1, 1)
    lanes = 64 // real.bytes if not real.wide else 1
    blocks, nodes = (-(-s // lanes), -(-p // lanes)) if one else (s, p)
    x = 2 * blocks * n + nodes * m
    iterate = x + (blocks + 2 * nodes) * n + nodes * factor
    tables = 3 * s * blocks + s * nodes + p * blocks + 2 * p * nodes + nodes if one else 0
    forced = n if one else s * n
    constants += 3 + 2 * nodes if scheme.system.is_time_dependent else 0
    ring = (_history(scheme) + 1) * x
    lessons = 2 * (s + 30) * blocks + 2 * x + 24 if scheme.tableau else 0
    vectors = (forced + blocks + constants + 42
               + 5 * n + 2 * blocks + tables + 2 * iterate + ring + lessons + 4 * m + m * m
               + 3 * (16 + 17 * 17) + 24)
    return vectors * lanes * real.bytes + 512
