"""The engine: algorithms in C that do not depend on a system, put into the file of a stepper.

The files of ``engine/`` are plain C against the interface that ``engine/README.md`` describes.
They are read, never rendered; what differs from stepper to stepper without being a number is
spelled with macros, which are written out here so that the C of a stepper has none of them:

    NAME(step)        a public function        heavy_top_gl3_gamma_step
    MATH(fabs)(x)     a function of <math.h>   fabsf(x)
    LIMIT(MIN)        a limit of <float.h>     FLT_MIN
    ON(factor)        for numbers or lanes     factor, lanes_factor
    NUMBER            what these work on       real, lanes
    HELD              constants of these       constants, lane_constants
    ONE(sweep)        of one trajectory        stages_sweep, mean_sweep
    MANY(sweep)       of W of them             trajectories_sweep, mean_sweep
    RUN(sweep)        of either                as the file is put in for the one or the other
    TABLE(mu)         a table of the tableau   w->mu in lanes, &fast_mu[0][0] as numbers
    TURNED(call);     a line of its own        the call in a co-moving frame, else left out;
                                               TURNED(int x;) the same of a declaration
    CARRIED(call);    the same                 where forces do work along a frame

Where t stands in H or g, kernels find it among the constants, and whoever calls them says when:

    AT(c, t)               at the time t           at_time(c, t); elsewhere c alone
    BETWEEN(c, t, late)    from t to t + late      between(c, t, late); elsewhere c alone
    LANES_AT(c, t), ...    the same on lanes       lanes_at_time(c, t), ...
    TIMED(statement)       for such systems only   statement; elsewhere nothing, and no line
    INPUT(statement)       for systems with inputs, the same
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ...core.real_types import Real

__all__ = ["ENGINE", "Proved", "engine_of", "with_times"]

ENGINE = Path(__file__).resolve().parents[2] / "engine"
_COMMENT = re.compile(r"^/\*(?! -).*?\*/\n", re.MULTILINE | re.DOTALL)
_TURNED, _CARRIED = (re.compile(rf"^( *){name}\((.*)\)(;?)\n", re.MULTILINE)
                     for name in ("TURNED", "CARRIED"))
_MACRO = re.compile(r"\b(NAME|MATH|LIMIT|ON|ONE|MANY|RUN|TABLE)\((\w+)\)|\b(?:NUMBER|HELD)\b")


#: A macro with expressions in it → what takes its place where t stands in H or g.
_TIMES = {"AT": "at_time", "BETWEEN": "between", "LANES_AT": "lanes_at_time",
          "LANES_BETWEEN": "lanes_between"}
_TIMED = re.compile(r"\b((?:LANES_)?(?:AT|BETWEEN)|TIMED|INPUT)\(")


def engine_of(
    name: str, real: Real, one: str = "", many: str = "", *, timed: bool = False,
    fed: bool = False, own: Mapping[str, str] | None = None, framed: bool = False,
    carried: bool = False,
) -> Callable[..., str]:
    """Return the function by which a template puts in a file of the engine.

    Its arguments are the file's name without ending, ``on`` ("" or "lanes_") for a file that is
    written for numbers and for lanes, and ``run`` for one that serves one trajectory or many.
    ``own`` are kernels that sweeps have under another name than Newton.
    """

    def put(file: str, on: str = "", run: str = "") -> str:
        spelled: dict[str, Callable[[str], str]] = {
            "NAME": f"{name}_{{}}".format,
            "MATH": f"{{}}{real.suffix.lower()}".format,
            "LIMIT": f"{real.limits}_{{}}".format,
            "ON": lambda kernel: (own or {}).get(kernel, f"{on}{kernel}"),
            "ONE": f"{one}_{{}}".format,
            "MANY": f"{many}_{{}}".format,
            "RUN": f"{run}_{{}}".format,
            "TABLE": ("w->{}" if run == one else "&fast_{}[0][0]").format,
        }

        def spell(found: re.Match[str]) -> str:
            if found[0] == "HELD":
                return "lane_constants" if on else "constants"
            if found[1] is None:
                return "lanes" if on else "real"
            return spelled[found[1]](found[2])

        text = _TURNED.sub(r"\1\2\3\n" if framed else "", _text(file, timed, fed))
        text = _CARRIED.sub(r"\1\2\3\n" if carried else "", text)
        if run == many != one:  # the same again, told once
            text = _COMMENT.sub("", text)
        return _MACRO.sub(spell, text).rstrip("\n")

    return put


@cache
def _text(file: str, timed: bool, fed: bool) -> str:
    text = (ENGINE / f"{file}.h").read_text(encoding="utf-8")
    return with_times(text, timed=timed, fed=fed)


def with_times(text: str, *, timed: bool, fed: bool = False) -> str:
    """Return C of the engine with times and inputs spelled out, or without any."""
    while found := _TIMED.search(text):
        end, depth = found.end(), 1
        while depth:
            depth += {"(": 1, ")": -1}.get(text[end], 0)
            end += 1
        before, inside, after = text[: found.start()], text[found.end() : end - 1], text[end:]
        if found[1] in _TIMES:
            inside = " ".join(inside.split())
            spelled = f"{_TIMES[found[1]]}({inside})" if timed else inside.split(",")[0]
            text = before + spelled + after
        elif timed if found[1] == "TIMED" else fed:
            text = before + inside.strip() + after
        elif after.startswith("\n"):  # it is all that stands in its line
            text = before.rstrip(" ") + after[1:]
        else:
            text = before + after.removeprefix(" ")
    return text


@dataclass(frozen=True)
class Proved:
    """What decides which files of the engine a stepper has."""

    n: int
    m: int
    stages: bool
    structured: bool
    forced: bool
    constant_schur: bool = False
    correction: bool = False
    separable: bool = False
    timed: bool = False
    fed: bool = False
    lagrangian: bool = False
    framed: bool = False
    halves: bool = False
    #: EMS of a Lagrangian, in terms of the velocities of both ends.
    ends: bool = False
    #: M of a Lagrangian was seen to be positive definite, so that it needs no pivots.
    definite: bool = True

    @property
    def _suits(self) -> str:
        return "constrained" if self.m else "free"

    @property
    def _kind(self) -> str:
        return "forms" if self.structured else "dense"

    @property
    def _ends(self) -> str:
        return "legendre_ends_" * self.ends

    def solver_files(self, fast: bool) -> dict[str, list[str]]:
        """Return the files before and behind those of the scheme: constraints, Newton, steps."""
        solve = [] if self.structured else ["solve"]
        projection = [*solve, f"constraints_{self._kind}", "project"]
        return {
            "files": [*self.legendre_files(), *(projection if self.m else [])],
            "solver_files": [
                "lands" if self.m else "lands_free",
                "newton",
                *(["simplified_newton"] if fast else []),
                "work" if self.forced else "work_free",
                "observe", f"observe_{self._suits}",
                "halves_turned" if self.framed else "halves",
                "step",
            ],
        }

    def legendre_files(self) -> list[str]:
        """Return the files that make H of a Lagrangian, for numbers or for lanes."""
        if not self.lagrangian:
            return []
        if self.ends:
            motion = ["legendre_ends", *(["legendre_ends_drive"] if self.timed else [])]
        else:
            drives = ["legendre_drive", *([] if self.stages else ["legendre_mean_drive"])]
            motion = [*(["legendre_work"] if self.forced else []), *(drives if self.timed else [])]
        mass = "mass" if self.definite else "mass_indefinite"
        bound = ["legendre_bound"] if self.m else []
        return [mass, "mass_velocities", "legendre", *bound, *motion]

    def legendre_lane_files(self) -> list[str]:
        """Return the same on lanes, with the rates that sweeps ask for."""
        if not self.lagrangian:
            return []
        rates = ["legendre_rates" if self.stages else
                 "legendre_ends_rates" if self.ends else "legendre_mean_rates"]
        return [*self.legendre_files(), *(["legendre_schur"] if self.m else []), *rates]

    def scheme_files(self) -> dict[str, list[str]]:
        """Return the files of the scheme up to its Jacobian, and those behind it."""
        free = "" if self.m else "_free"
        dense = not self.structured
        force = "legendre_force_change" if self.forced else "legendre_no_force"
        made = ["legendre_gradient", force, "legendre_hessian"] if self.lagrangian else []
        if not self.stages:
            made = ["legendre_ends_mean"] if self.ends else [*made, "legendre_mean"] if made else []
            pull = [f"mean_pull_{self._kind}"] if self.m else []
            rows = ["mean_constrained" if self.m else "mean_free"]
            jacobian = [f"mean_columns{free}", "mean_jacobian"] if dense else []
            return {"stage_files": [*made, *pull, *rows, "mean", *jacobian],
                    "finish_files": ["mean_finish", *([f"mean_drive{free}"] if self.timed else []),
                                     *([f"{self._ends}mean_work"] if self.forced else [])]}
        hessian = [] if made else [
            "hessian_with_forces" if self.forced else "hessian_of_potential"]
        nodes = "spark_constrained" if self.m else "spark_free"
        return {"stage_files": [*made, nodes, "spark",
                                *([*hessian, f"spark_jacobian{free}"] if dense else [])],
                "finish_files": [f"spark_finish{free}",
                                 *([f"spark_drive{free}"] if self.timed else []),
                                 *(["spark_work"] if self.forced else [])]}

    def sweep_files(self, one: str, many: str) -> dict[str, Any]:
        """Return the files of the sweeps, those that serve one trajectory and many by use."""
        parts = "stages_parts" if self.stages else "mean_parts"
        return {
            "lane_files": self._lane_files(),
            "sweep_files": {run: self._spark(run) if self.stages else self._mean()
                            for run in (one, many)},
            "one_files": [*(["unscale"] if self.stages else []), parts,
                          f"lanes_observe_{self._suits}"],
            "batch_files": ["batch", f"batch_observe_{self._suits}",
                            *(["inputs_lanes"] if self.fed else []), "integrate_lanes"],
        }

    def _lane_files(self) -> list[str]:
        again = ["load_again", "learn"] if self.stages else []
        if not self.m or (self.constant_schur and not self.stages):
            return again  # nothing is factorised
        if self.structured:
            return [*again, "lanes_cells"]
        factors = "lanes_lu" if self.m > 1 else "lanes_inverse"
        return [*again, factors, *(["lanes_force_dense"] if self.stages else [])]

    def _schur_set(self) -> list[str]:
        if not self.constant_schur:
            return []
        return ["schur_set_scalar" if self.correction else "schur_set"]

    def _layout(self) -> str:
        return "free" if not self.m else "constant" if self.constant_schur else "varying"

    def _spark(self, run: str) -> list[str]:
        several, layout, seidel = run != "stages", self._layout(), "_seidel" * self.separable
        kind = "halves" if self.halves and several else "products"
        work = "sweep_work" if self.forced else "sweep_no_work"
        head = [f"{run}_items", f"layout_{layout}", "lessons", run, f"{kind}_of_stages"]
        if not self.m:
            own = ["sweep_free", "take", f"follow_free{seidel}"]
        else:
            answer = "scalar" if self.correction else "again"
            whole = ["trajectories_whole"] if several and not self.halves else []
            own = [f"{run}_nodes", *whole, f"{kind}_of_nodes", "impulses", f"look_{self._kind}",
                   f"schur_{layout}", *self._schur_set(), "sweep_constrained", "take",
                   f"follow_{answer}{seidel}", f"land_{self._kind}"]
        return [*head, *own, *self._drive("sweep_drive"), work, "recall",
                "learn_nodes" if self.m else "learn_nodes_free", f"{run}_ahead", "foresee",
                *self._stand("stages"), "sweep", "load"]

    def _mean(self) -> list[str]:
        layout = self._layout()
        work = f"{self._ends}mean_sweep_work" if self.forced else "sweep_no_work"
        own = ["mean_follow_free"]
        if self.m:
            answer = "scalar" if self.correction else "again"
            own = [f"look_{self._kind}", f"mean_schur_{layout}", *self._schur_set(),
                   f"mean_respond_{answer}",
                   "mean_constrain", f"mean_follow_{self._kind}"]
        return ["mean_items", f"mean_layout_{layout}", "mean_run", *own,
                *self._drive("mean_sweep_drive"), work, *self._stand("mean"), "mean_sweep"]

    def _stand(self, scheme: str) -> list[str]:
        """Return what keeps a relative equilibrium where it is."""
        return [f"stand_{scheme}", "stand"] if self.framed else []

    def _drive(self, file: str) -> list[str]:
        """Return what a drive does through the constraints."""
        return [file if self.m else f"{file}_free"] if self.timed else []
