"""How the equations of a step are solved."""

from __future__ import annotations

import math
from typing import Any, Literal, get_args

from .arguments import as_integer, choose, shown
from .errors import InputError
from .exact_numbers import Number, exact
from .records import dataclass

__all__ = ["AUTO", "Solver", "SolverName", "as_solver"]

SolverName = Literal["auto", "newton", "fixed-point"]


@dataclass(frozen=True)
class Solver:
    """How the equations of a step are solved, where ``solver="auto"`` does not say enough.

    Attributes
    ----------
    kind : {"auto", "newton", "fixed-point"}
        ``auto`` is the fixed-point iteration with a Schur correction of the multipliers, from
        values predicted from past steps, with Newton's method for steps where it does not
        converge; ``fixed-point`` has no fallback; ``newton`` is full Newton from a constant guess.
    tolerance : number, optional
        Bound on the last increment relative to the state; by default down to round-off.
    max_iterations : int
        Iterations (of each kind) before a step counts as failed.

    Raises
    ------
    InputError
        For another kind, a tolerance that is not above 0, fewer than one iteration.
    """

    kind: SolverName = "auto"
    tolerance: Number | None = None
    max_iterations: int = 50

    def __post_init__(self) -> None:
        """Check all fields; 50.0 iterations are 50."""
        choose("solver", self.kind, get_args(SolverName))
        bound = 1 if self.tolerance is None else exact(self.tolerance)  # 1: none is allowed too
        if bound is None or not 0 < bound < math.inf:
            raise InputError(f"tolerance = {shown(self.tolerance)} is not positive and finite; "
                             "give none for round-off.")
        count = as_integer(self.max_iterations)
        # a whole number that a store keeps as an int64; the C counts to 2³¹ − 1 at most
        if count is None or not 0 < count < 2**63:
            raise InputError(f"max_iterations = {shown(self.max_iterations)} is no whole number; "
                             "give at least 1.")
        object.__setattr__(self, "max_iterations", count)


#: Made once: most calls give a name, and the checks of a record take 2 µs, as a step does.
_SOLVERS: dict[SolverName, Solver] = {name: Solver(name) for name in get_args(SolverName)}


#: The default, which every scheme takes.
AUTO = _SOLVERS["auto"]


def as_solver(value: Any) -> Solver:
    """Return the solver of a name; a ``Solver`` unchanged.

    Raises InputError for anything else, with the names.
    """
    if isinstance(value, Solver):
        return value
    return _SOLVERS[choose("solver", value, _SOLVERS, " or gs.Solver(...)")]
