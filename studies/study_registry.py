"""The name of every table, figure and finding → how to compute it."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ..core.arguments import proposal
from ..core.errors import InputError
from . import accuracy, beyond, convergence, invariants, iterations, parameter, robustness
from .case_runner import Engine
from .study_result import Result

__all__ = ["RESULTS", "chosen", "compute"]

RESULTS: dict[str, Callable[[Engine], Result]] = {
    "table-2": invariants.table_2,
    "table-3": invariants.table_3,
    "table-4": accuracy.table_4,
    "table-5": accuracy.table_5,
    "table-6": accuracy.table_6,
    "table-7": accuracy.table_7,
    "table-8": robustness.table_8,
    "table-9": iterations.table_9,
    "table-10": iterations.table_10,
    "table-11": iterations.table_11,
    "table-12": iterations.table_12,
    "table-13": iterations.table_13,
    "table-14": iterations.table_14,
    "figure-5": invariants.figure_5,
    "figure-6": invariants.figure_6,
    "figure-7": invariants.figure_7,
    "figure-8": accuracy.figure_8,
    "figure-9": accuracy.figure_9,
    "figure-10": convergence.figure_10,
    "figure-11": parameter.figure_11,
    "figure-12": parameter.figure_12,
    "figure-13": parameter.figure_13,
    "figure-14": parameter.figure_14,
    "figure-15": parameter.figure_15,
    "figure-16": convergence.figure_16,
    **{f"finding-{key}": make for key, make in beyond.FINDINGS.items()},
}


def chosen(name: str) -> list[str]:
    """Return the results that a name on the command line means.

    Raises
    ------
    InputError
        For an unknown name, with the known ones.
    """
    if name == "all":
        return list(RESULTS)
    if name not in RESULTS:
        findings = [result for result in RESULTS if result.startswith("finding-")]
        raise InputError(f"Unknown result {name!r}; choose all, table-2 to table-14, figure-5 to "
                         f"figure-16, or {', '.join(findings)}{proposal(name, RESULTS)}.")
    return [name]


def compute(
    names: Sequence[str], engine: Engine, progress: Callable[[str, int], None] | None = None
) -> list[Result]:
    """Compute results one after the other; ``progress`` gets a name and the finished count."""
    results = []
    for finished_count, name in enumerate(names):
        if progress is not None:
            progress(name, finished_count)
        results.append(RESULTS[name](engine))
    return results
