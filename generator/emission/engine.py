"""The engine: algorithms in C that do not depend on a system, put into the file of a stepper.

The files of ``engine/`` are plain C against the interface that ``engine/README.md`` describes.
They are read, never rendered; what differs from stepper to stepper without being a number is
spelled with macros, which are written out here so that the C of a stepper has none of them:

    NAME(step)        a public function        heavy_top_gl3_gamma_step
    MATH(fabs)(x)     a function of <math.h>   fabsf(x)
    LIMIT(MIN)        a limit of <float.h>     FLT_MIN
    ON(factor)        for numbers or lanes     factor, lanes_factor
    NUMBER            what these work on       real, lanes
    ONE(sweep)        of one trajectory        stages_sweep, mean_sweep
    MANY(sweep)       of W of them             trajectories_sweep, mean_sweep
    RUN(sweep)        of either                as the file is put in for the one or the other
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

from ...real import Real

__all__ = ["ENGINE", "engine_of", "files_of_solver"]

ENGINE = Path(__file__).resolve().parents[2] / "engine"
_MACRO = re.compile(r"\b(NAME|MATH|LIMIT|ON|ONE|MANY|RUN)\((\w+)\)|\bNUMBER\b")


def engine_of(name: str, real: Real, one: str = "", many: str = "") -> Callable[..., str]:
    """Return the function by which a template puts in a file of the engine.

    Its arguments are the file's name without ending, ``on`` ("" or "lanes_") for a file that is
    written for numbers and for lanes, and ``run`` for one that serves one trajectory or many.
    """

    def put(file: str, on: str = "", run: str = "") -> str:
        spelled: dict[str, Callable[[str], str]] = {
            "NAME": f"{name}_{{}}".format,
            "MATH": f"{{}}{real.suffix.lower()}".format,
            "LIMIT": f"{real.limits}_{{}}".format,
            "ON": f"{on}{{}}".format,
            "ONE": f"{one}_{{}}".format,
            "MANY": f"{many}_{{}}".format,
            "RUN": f"{run}_{{}}".format,
        }

        def spell(found: re.Match[str]) -> str:
            if found[1] is None:
                return "lanes" if on else "real"
            return spelled[found[1]](found[2])

        return _MACRO.sub(spell, _text(file)).rstrip("\n")

    return put


@cache
def _text(file: str) -> str:
    return (ENGINE / f"{file}.h").read_text(encoding="utf-8")


def files_of_solver(
    *, constrained: bool, structured: bool, forced: bool, fast: bool
) -> dict[str, list[str]]:
    """Return the files before and behind those of the scheme: what was proved chooses them."""
    projection = [*(["constraints_forms"] if structured else ["solve", "constraints_dense"]),
                  "project"]
    suits = "constrained" if constrained else "free"
    return {
        "files": projection if constrained else [],
        "solver_files": [
            "lands" if constrained else "lands_free",
            "newton",
            *(["simplified_newton"] if fast else []),
            "work" if forced else "work_free",
            "observe", f"observe_{suits}",
            "step",
        ],
    }
