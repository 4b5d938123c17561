"""Incompatible features: a table of pairs, each with its reason and a cure.

``refuse_together`` raises for the first pair of which a call has both. ``docs/limits.md`` has the
table as ``table`` prints it; ``pytest tests/core/test_incompatibilities.py --update`` writes it
there.
"""

from __future__ import annotations

from .errors import InputError
from .records import dataclass

__all__ = ["FEATURES", "LARGEST", "PAIRS", "Pair", "refuse_together", "table"]

#: Coordinates of the largest system that C, CUDA and second derivatives write out in full.
LARGEST = 28

#: Feature → its name in documents.
FEATURES = {
    "accelerations": "accelerations, mass matrices, inverse dynamics",
    "artefact": "artefacts of `build`",
    "changing_inputs": "inputs that change along the run",
    "cluster": "a Dask cluster (`dask=`)",
    "command": "Lyapunov exponents and periodic orbits (`gs.lyapunov`, `gs.periodic_orbit`)",
    "control": "profile `control`",
    "cuda": "graphics cards (`device=\"cuda\"`)",
    "derivatives": "derivatives",
    "energy": "exact energy (`energy=True`)",
    "ensemble": "ensembles",
    "events": "events",
    "fixed_point": "solver `fixed-point`",
    "float128": "`float128`",
    "fmu": "FMUs",
    "frame": "co-moving frames",
    "impacts": "impacts",
    "inputs": "inputs",
    "interop": "steps in other libraries",
    "joint_gradients": "gradients of forces in joints",
    "lagrangian": "systems from a Lagrangian",
    "large": f"more than {LARGEST} coordinates",
    "long_numbers": "`long-double`, `float128`",
    "multiplier_derivatives": "derivatives of multipliers",
    "new_parameters": "parameters that are set between two steps",
    "newton": "solver `newton`",
    "newton_only": "tableaux and systems without a fixed-point iteration",
    "open_end": "`t_end` in scaled time",
    "other_runs": "sweeps, sections",
    "other_scheme": "schemes IMS, EMS, LIIIA-B, `splitting`; given tableaux",
    "not_double": "other types than `double`",
    "profile": "profiles `control` and `run`",
    "recording": "simulations with `record=True`",
    "reversed": "gradients with `memory=\"none\"`",
    "rules": "γ and frames by `gs.tune`",
    "scaled": "systems with `time_scale`",
    "second": "second derivatives",
    "solver": "solvers `fixed-point` and `newton`",
    "splitting": "scheme `splitting`",
    "stored": "stored runs (`out=`)",
    "structured": "loops over element templates",
    "sweep": "sweeps",
    "t_eval": "`t_eval`",
    "tangents": "tangents",
    "terminal": "terminal events",
    "time": "time in H or in constraints",
    "tolerance": "`tolerance`",
    "turning_frame": "co-moving frames in which constraints turn",
    "velocity_constraints": "velocity constraints",
    "workers": "`workers`",
}


@dataclass(frozen=True)
class Pair:
    """Pair of incompatible features, the reason and the cure."""

    first: str
    second: str
    reason: str
    cure: str


_ON_CPU = "leave device out"
_OF_PYTHON = "take profile full, of Python"
_UNSCALED = "take a stepper of the system without time_scale"
_ONE_LENGTH = ("no crossing ends one of their trajectories",
               "leave terminal=True out, and look at the first crossing")

PAIRS = tuple(Pair(*pair) for pair in (
    ("splitting", "frame", "each flow commutes with the symmetries, so that the motion would be "
     "the same", "leave out frame"),
    ("splitting", "solver", "compositions of exact flows solve no equations", "leave out solver"),
    ("profile", "frame", "plain steps have no frame", "leave out frame, or take profile 'full'"),
    ("profile", "lagrangian", "plain steps need H in closed form",
     "take the system of system.legendre(), or profile full, of Python"),
    ("profile", "large", f"plain steps write a system out in full, up to {LARGEST} coordinates",
     _OF_PYTHON),
    ("profile", "time", "plain steps take time in forces alone", _OF_PYTHON),
    ("profile", "newton_only", "plain steps solve by fixed-point iteration", _OF_PYTHON),
    ("control", "long_numbers", "a controller computes with float or double",
     "choose one of these, or profile run or full"),
    ("energy", "frame", "the parameter θ of a step has no equation in a frame", "leave out one"),
    ("energy", "profile", "the parameter θ of a step needs Newton's method", "leave out one"),
    ("energy", "derivatives", "the parameter θ of a step has no derivatives", "leave out one"),
    ("other_scheme", "velocity_constraints", "the scheme has no equations for them",
     "choose G-L or Radau-L"),
    ("profile", "velocity_constraints", "plain steps have no equations for them",
     "take profile 'full'"),
    ("frame", "velocity_constraints", "steps in a frame have no equations for them",
     "leave out frame"),
    ("energy", "velocity_constraints", "steps of exact energy have no equations for them",
     "leave out energy"),
    ("derivatives", "velocity_constraints", "tangents of steps have no equations for them",
     "use differences of runs"),
    ("structured", "velocity_constraints", "element templates have no equations for them",
     "leave out structured"),
    ("frame", "time", "the symmetries of a frame keep H at all times", "leave out frame, or time"),
    ("frame", "lagrangian", "a frame needs H in closed form",
     "leave out frame, or take the system that its legendre() returns"),
    ("splitting", "scaled", "σ(H + e) has no parts with exact flows", _UNSCALED),
    ("frame", "scaled", "frames are not derived in scaled time", _UNSCALED),
    ("profile", "scaled", "plain steps are not derived in scaled time", _UNSCALED),
    ("scaled", "velocity_constraints", "steps in scaled time have no equations for them",
     "take with_row_integrals(), which makes constraints on positions of those that are "
     "integrable, or leave out time_scale"),
    ("scaled", "inputs", "inputs are held over steps of t",
     "make them parameters, or functions of time, or leave out time_scale"),
    ("scaled", "lagrangian", "steps in scaled time need H in closed form",
     "give H(q, p) to System(...), or leave out time_scale"),
    ("second", "scaled", "adjoints in scaled time are not differentiated",
     f"take differences of gradients, or {_UNSCALED}"),
    ("accelerations", "scaled", "they are not derived in scaled time", _UNSCALED),
    ("joint_gradients", "scaled", "they are not derived in scaled time",
     f"give cotangents of \"multipliers\", or {_UNSCALED}"),
    ("interop", "scaled", "flows are not derived in scaled time",
     f"take run.gradient, or {_UNSCALED}"),
    ("command", "scaled", "their equations are those of steps of t", _UNSCALED),
    ("rules", "scaled", "pilot runs compare states of equal τ", "give numbers for γ"),
    ("second", "lagrangian", "the mass matrix is factorised for numbers alone",
     "take differences of gradients, which are exact"),
    ("second", "frame", "adjoints in a frame are not differentiated",
     "leave out frame, or take differences of gradients, which are exact"),
    ("second", "large", f"their code writes a system out in full, up to {LARGEST} coordinates",
     "take differences of gradients, which are exact"),
    ("derivatives", "tolerance", "a tolerance stops a step before its equations hold, and "
     "derivatives are those of the equations", "leave out tolerance"),
    ("multiplier_derivatives", "turning_frame", "multipliers turn with the frame",
     "take a stepper without frame"),
    ("reversed", "inputs", "a run with inputs does not run backwards", "give memory=\"256 MB\""),
    ("reversed", "frame", "a run in a frame does not run backwards", "give memory=\"256 MB\""),
    ("stored", "t_eval", "a store has a row for each so many steps",
     "leave out out, or ask the stored run, run.at(times)"),
    ("stored", "tangents", "a store has no place for them",
     "leave out out, or ask the stored run, run.gradient(...)"),
    ("stored", "changing_inputs", "a store has one value of each", "leave out out, and save the "
     "run"),
    ("stored", "open_end", "a store has room for a number of steps, and steps in scaled time "
     "adapt", "give steps in place of t_end, or an event that ends the run"),
    ("recording", "new_parameters", "a trajectory has one value of each",
     "declare what changes as an input, System(..., inputs=...), and give it to advance, or start "
     "without record=True"),
    ("ensemble", "terminal", *_ONE_LENGTH),
    ("sweep", "terminal", *_ONE_LENGTH),
    ("sweep", "open_end", "cells take different numbers of steps to t_end",
     "give steps, or integrate each of them to t_end"),
    ("sweep", "float128", "results of a sweep are doubles", "choose long-double, double or float"),
    ("fixed_point", "newton_only", "there is none to iterate", "choose auto or newton"),
    ("impacts", "other_runs", "their runs have no impacts", "integrate each of them"),
    ("impacts", "events", "crossings are located by steps of the grid, within which impacts lie",
     "look at the run's impacts and rows"),
    ("impacts", "second", "the jump of the momenta is differentiated once",
     "take differences of gradients, which are exact"),
    ("impacts", "tangents", "ensembles with impacts have none", "integrate each of them"),
    ("reversed", "impacts", "a run with impacts does not run backwards",
     "give memory=\"256 MB\""),
    ("impacts", "splitting", "parts of steps have no metric", "choose G-L or EMS"),
    ("impacts", "frame", "gaps do not turn with the frame", "leave out frame"),
    ("impacts", "energy", "the parameter θ of a step has no derivatives", "leave out energy"),
    ("impacts", "scaled", "impacts are located on a grid of t", _UNSCALED),
    ("impacts", "velocity_constraints", "the law has no equations for them",
     "take with_row_integrals(), which makes constraints on positions of those that are "
     "integrable"),
    ("impacts", "large", "the law is solved with dense matrices", "build of fewer bodies"),
    ("impacts", "float128", "their memory is of machine numbers",
     "choose long-double, double or float"),
    ("artefact", "events", "artefacts look for none",
     "leave events, contacts and stops out of the model"),
    ("fmu", "not_double", "an FMU holds numbers of type double", "choose real='double'"),
    ("cuda", "events", "a card looks for none", "leave events or device out"),
    ("cuda", "inputs", "a card takes none", "leave inputs or device out"),
    ("cuda", "tangents", "a card computes none", "leave tangents or device out"),
    ("cuda", "workers", "a card has no threads to choose", "leave workers or device out"),
    ("cluster", "workers", "its own workers compute, with the threads that they have",
     "leave workers or dask out"),
    ("cuda", "newton", "a card iterates a step to a fixed point",
     f"choose auto or fixed-point, or {_ON_CPU}"),
    ("cuda", "long_numbers", "a card has float and double", _ON_CPU),
    ("cuda", "large", f"a kernel writes a system out in full, up to {LARGEST} coordinates",
     _ON_CPU),
    ("cuda", "frame", "a kernel has no frame", _ON_CPU),
    ("cuda", "scaled", "a kernel has no clock", _ON_CPU),
    ("cuda", "velocity_constraints", "a kernel has no equations for them", _ON_CPU),
    ("cuda", "energy", "the parameter θ of a step needs Newton's method", _ON_CPU),
    ("cuda", "newton_only", "a card iterates a step to a fixed point", _ON_CPU),
))


def refuse_together(**present: str | bool | None) -> None:
    """Refuse the first pair of the table of which both features are present.

    Parameters
    ----------
    present : dict of str to str, bool or None
        Feature → what a caller calls it, with its value; False, None or "" where it is absent.

    Raises
    ------
    InputError
        For a pair, with its reason and its cure.
    """
    for pair in PAIRS:
        first, second = present.get(pair.first), present.get(pair.second)
        if first and second:
            raise InputError(f"{str(first)[0].upper()}{str(first)[1:]} cannot be combined with "
                             f"{second}: {pair.reason}; {pair.cure}.")


def table() -> str:
    """Return the pairs as a table in Markdown, a row for each feature and reason."""
    rows = ["| feature | cannot be combined with | because | cure |", "|---|---|---|---|"]
    for pair in PAIRS:
        cells = FEATURES[pair.first], FEATURES[pair.second], pair.reason, pair.cure
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"
