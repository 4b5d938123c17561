"""Table 8: the largest Δt up to which Newton solves every step of the fast top, N_t = 160."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from ..api import stepper
from ..core.inertia import RepName
from ..generator.schemes.named_schemes import SchemeName
from ..runtime.rigid_body.problems import fast_top
from .case_runner import Engine, parameter_value
from .inexact_jacobian import inexact_stepper
from .labels import PARAMETERS, letter
from .newton_study import Rule, march
from .printed_iterations import COLUMNS_8, DIVERGENT, TABLE_8
from .study_result import Cell, Claim, Table
from .verdict import same_digits

__all__ = ["largest_count", "table_8"]

#: Printed: ε_r = 1e-20, iter_max = 50. No double reaches it; read as ‖r‖² < 1e-20.
_MEAN = Rule("state", "r", tolerance=1e-10, most=50, plain=False)
_SPARK = Rule("previous", "r", tolerance=1e-10, most=50, plain=False)
_STEPS = 160
_INEXACT = ", inexact"
#: Where the search begins and ends, in seconds.
_LOWEST, _HIGHEST = 0.0005, 0.2
#: Stages of (LIIIA-B, G-L) at each order.
_STAGES = {2: (2, 1), 4: (3, 2), 6: (4, 3), 8: (5, 4)}
_ORDINALS = {2: "2nd", 4: "4th", 6: "6th", 8: "8th"}

_ABOUT = (
    "Fast top, N_t = 160, iter_max = 50. A Δt converges if every step reaches ‖r‖ < 1e-10 within "
    "iter_max; the printed ε_r = 1e-20 is below double precision and is interpreted as a bound "
    "on ‖r‖². Search: from 0.0005 s (0.001 s if three decimals are printed) Δt is doubled while "
    "20 steps converge, at most to 0.2 s, and halved while 160 steps do not; then a bisection "
    "with 160 steps between the last success and the failure above it, on multiples of the unit "
    "of the last printed digit. Convergence is not monotone in Δt: beyond the limit there are "
    "isolated intervals of convergence, often to another solution of the equations, and the "
    "doubling may reach one. IMS and EMS start from (q_{k−1}, p_{k−1}, 0), the SPARK methods "
    "from the unknowns of the previous step. The columns \"inexact\" drop d(L(q)ᵀ)·u from the "
    "Jacobian (erratum 21, inferred)."
)


def table_8(engine: Engine) -> Table:
    """Return Table 8: the largest Δt at which all 160 steps converge (16 with ``engine.short``).

    SPARK methods stand twice, with the exact Jacobian and with the inexact one of erratum 21.
    """
    steps = 16 if engine.short else _STEPS
    cells = []
    for (order, rep, rule), printed in TABLE_8.items():
        row = f"{_ORDINALS[order]} order, {letter(rep)} = {PARAMETERS[rule]}"
        for scheme, text in zip(COLUMNS_8, printed, strict=True):
            if text is None:
                continue
            stages = _stages(scheme, order)
            if engine.watch is not None:
                engine.watch(f"table 8, {scheme}, {row}")
            # IMS and EMS have the exact Jacobian alone
            for inexact in (False, True)[: 1 if stages is None else 2]:
                step = largest_step(scheme, stages, rep, rule, _unit(text), steps, inexact)
                cells.append(_cell(row, scheme + _INEXACT * inexact, text, step, inexact))
    return Table(
        8, "Fast spinning top: largest time step with convergent results", _ABOUT, cells,
        [_exact_reaches_further(cells), _types_reach_alike(cells), _inexact_explains(cells),
         *_one_stage_alpha(engine)],
    )


def _stages(scheme: SchemeName, order: int) -> int | None:
    """Return the stages with which a scheme has an order; None for IMS and EMS, of order 2."""
    if scheme in ("IMS", "EMS"):
        return None
    return _STAGES[order][("LIIIA-B", "G-L").index(scheme)]


def _unit(printed: str) -> float:
    """Return the unit of the last printed digit, e.g. 0.0001 for "0.0016".

    Where "divergent" is printed the unit is 0.001 s.
    """
    return 10.0 ** -len(printed.partition(".")[2]) if printed != DIVERGENT else 1e-3


# ---------------------------------------------------------------- search


@cache
def largest_step(
    scheme: SchemeName, stages: int | None, rep: RepName, rule: str, unit: float, steps: int,
    inexact: bool,
) -> float:
    """Return the largest Δt in s at which Newton solves every step of the fast top.

    A multiple of ``unit``; 0.0 if the first one, 0.0005 s, fails. ``rule`` gives γ or α, e.g.
    "100m"; ``inexact`` takes the Jacobian without d(L(q)ᵀ)·u.
    """
    top = fast_top()
    parameters = top.parameters | {rep: parameter_value(rule, top.inertia)}
    step = (inexact_stepper(scheme, stages, rep) if inexact and stages is not None
            else stepper(scheme, stages, rep))
    newton = _MEAN if stages is None else _SPARK

    def converges(count: int, length: int) -> bool:
        """Return whether ``length`` steps of ``count`` units of time are all solved."""
        run = march(step, parameters, (top.q0, top.p0), count * unit, length, newton,
                    all_solved=True)
        return not run.divergent

    first, last = max(1, round(_LOWEST / unit)), round(_HIGHEST / unit)
    # an eighth of the steps is enough to see where doubling has to end
    count = largest_count(lambda n: converges(n, steps // 8), lambda n: converges(n, steps),
                          first, last)
    return round(count * unit, 9)  # 3 · 0.0001 = 0.00030000000000000003 in doubles


def largest_count(
    seems: Callable[[int], bool], converges: Callable[[int], bool], first: int, last: int
) -> int:
    """Return a count that converges while the next one does not; 0 if ``first`` does not.

    ``seems`` decides by a short run, ``converges`` by a whole one. The count is doubled from
    ``first`` while it seems to converge, at most to ``last``; halved while the whole run fails;
    then bisection between this success and the failure above it.
    """
    low, high = first, 2 * first
    while high <= last and seems(high):
        low, high = high, 2 * high
    high = min(high, last + 1)
    # from here on, low is the candidate and high a count that fails, or counts as failing beyond
    # ``last``
    while not converges(low):
        low, high = low // 2, low
        if low < first:
            return 0
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if converges(middle) else (low, middle)
    return low


# ---------------------------------------------------------------- verdicts and claims


def _cell(row: str, column: str, printed: str, step: float, inexact: bool) -> Cell:
    """Return the cell of our largest ``step`` in s, 0 where none converges, with its verdict.

    Erratum 22: 1-G-L-α, printed as divergent, converges with the exact Jacobian.
    """
    ours: float | str = step or DIVERGENT
    if printed == DIVERGENT:
        if ours == DIVERGENT:
            return Cell(row, column, DIVERGENT, ours, "agrees")
        return Cell(row, column, DIVERGENT, ours, "differs",
                    "Newton converges; the scheme does not have the behaviour that the paper "
                    "reports (erratum 22)")
    if step >= _HIGHEST:
        return Cell(row, column, float(printed), ours, "differs", "the search ends here")
    if isinstance(ours, float) and same_digits(ours, printed):
        return Cell(row, column, float(printed), ours, "agrees")
    why = ("the inexact Jacobian is inferred; the printed search is not described" if inexact
           else "full Newton with the exact Jacobian; the paper's search is not described")
    return Cell(row, column, float(printed), ours, "differs", why)


def _number(value: float | str | None) -> float:
    """Return a number of a cell, and 0 for a text or a missing one."""
    return value if isinstance(value, float) else 0.0


def _exact_reaches_further(cells: list[Cell]) -> Claim:
    """Return the claim that α-type SPARK methods reach larger Δt with the exact Jacobian."""
    largest = {(c.row, c.column): _number(c.ours) for c in cells}
    pairs = [(largest[c.row, c.column.removesuffix(_INEXACT)], _number(c.ours))
             for c in cells if c.column.endswith(_INEXACT) and "α" in c.row]
    larger = sum(a > b for a, b in pairs)
    return Claim(
        "The limits printed for α-type SPARK methods are limits of the iteration, not of the "
        "scheme: with the exact Jacobian the same equations are solved at larger Δt",
        f"larger than with the inexact one in {larger} of {len(pairs)} cells",
        "at least three of four", 4 * larger >= 3 * len(pairs),
    )


def _types_reach_alike(cells: list[Cell]) -> Claim:
    """Return the claim that γ and α of the same value allow the same Δt, for orders 4 to 8.

    The Jacobian is exact; the measure is the ratio of the largest Δt, γ over α.
    """
    def ratios(attribute: str) -> list[float]:
        """Return γ over α of ``ours`` or of ``paper``, for all rows of γ and all methods."""
        largest = {(c.row, c.column): _number(getattr(c, attribute)) for c in cells}
        # columns with ", inexact" are not in COLUMNS_8
        return [of_gamma / largest[row.replace("γ =", "α ="), column]
                for (row, column), of_gamma in largest.items()
                if "γ =" in row and not row.startswith("2nd") and column in COLUMNS_8]

    ours, printed = ratios("ours"), ratios("paper")
    return Claim(
        "γ is not more robust than α of the same value in methods of order 4 to 8 when Newton is "
        "exact",
        f"ratio of the largest Δt of γ and α: {min(ours):.2f} to {max(ours):.2f}; printed "
        f"{min(printed):.2f} to {max(printed):.2f}", "between 0.8 and 1.25",
        min(ours) > 0.8 and max(ours) < 1.25,
    )


def _inexact_explains(cells: list[Cell]) -> Claim:
    """Return the claim that the inexact Jacobian comes nearer to the printed limits.

    Counted are the cells of SPARK methods whose Δt is within 20 % of the printed one.
    """
    near_counts = []
    for inexact in (False, True):
        ratios = [_number(c.ratio) for c in cells
                  if isinstance(c.paper, float) and c.column not in ("IMS", "EMS")
                  and c.column.endswith(_INEXACT) == inexact]
        near_counts.append(sum(abs(ratio - 1) <= 0.2 for ratio in ratios))
    # both Jacobians have the same number of cells: that of the last ``ratios``
    exact_count, inexact_count = near_counts
    return Claim(
        "The inexact Jacobian explains most printed limits of the SPARK methods within 20%",
        f"{inexact_count} of {len(ratios)} cells; the exact one {exact_count}",
        "at least two of three, and more than the exact one",
        3 * inexact_count >= 2 * len(ratios) and inexact_count > exact_count,
    )


def _one_stage_alpha(engine: Engine) -> list[Claim]:
    """Return the claims of erratum 22: 1-G-L-α has a bounded energy error, and order 2.

    Bounded: the largest error of the last tenth of a long run against the first tenth's. Order 2:
    half the Δt over the same time divides the error by 4.
    """
    top, step = fast_top(), stepper("G-L", 1, "alpha")
    parameters = top.parameters | {"alpha": parameter_value("m", top.inertia)}
    count = 4000 if engine.short else 40_000
    run = step.integrate(top.q0, top.p0, dt=1e-3, steps=count, parameters=parameters,
                         solver="newton")
    errors = abs(run.energy() - run.energy()[0])
    tenth = count // 10  # a drift would show as a larger error in the last tenth
    first, last = float(errors[:tenth].max()), float(errors[-tenth:].max())
    halved = step.integrate(top.q0, top.p0, dt=5e-4, steps=2 * tenth, parameters=parameters,
                            solver="newton")
    ratio = first / float(abs(halved.energy() - halved.energy()[0]).max())
    return [
        Claim("1-G-L-α, printed as divergent, does not drift: its energy error does not grow "
              "(erratum 22)",
              f"{count:,} steps of 0.001 s; largest |ΔH| {first:.3e} in the first tenth, "
              f"{last:.3e} in the last", "last / first < 1.1", last < 1.1 * first),
        Claim("1-G-L-α has order 2", f"halving Δt divides |ΔH| by {ratio:.3f}", "4 ± 0.2",
              abs(ratio - 4) < 0.2),
    ]
