"""``docs/references.md``: reference and published values of each problem, error against cost."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from .problem import Reference
from .work_precision import LIMIT, WorkPrecisionRun

__all__ = ["page", "reached"]

_HEAD = """# Reference problems

Problems of the literature with reference solutions of 24 digits, and the errors of our schemes.
`make bench WHAT="references --out docs"` writes this page, `gyrospark reference all --out FILE.md`
the part without other programs. `python -m benchmarks.make_digits` computes each reference solution
by two independent methods.

An error is the error of the final values relative to the largest value of their kind (positions,
velocities). CPU seconds are the time of one run with a compiled stepper on the machine that wrote
the page. Invariants are the largest errors over all steps of the most accurate run.

SciPy and heyoka solve problems whose equations of motion are available without multipliers. SciPy's
DOP853 projects its state onto the constraints after every step; the steps and the projection are
Python code. heyoka compiles Taylor series of the equations.

exudyn and MuJoCo receive the bodies, joints, springs and gravity of our model, but no equations.
exudyn has the trapezoidal rule of index 2 and generalised α, of order 2, with its own tolerances;
bodies of plane mechanisms have three coordinates each. For one body without joints it also has
explicit methods of order 4 and 6. MuJoCo uses the coordinates of a tree of joints; a soft
constraint, at its stiffest for the time step, closes a loop. The number of steps is quadrupled
until a run takes 0.5 s. Missing numbers of steps: Newton's method failed or the motion was
unstable.
"""


def reached(runs: Iterable[WorkPrecisionRun]) -> bool:
    """Return whether one of the runs of a problem has its digits."""
    return any(run.error <= LIMIT for run in runs if not run.peer)


def page(
    measured: Sequence[tuple[Reference, Sequence[WorkPrecisionRun]]], picture: str = ""
) -> str:
    """Return the page of all problems that were measured, with a picture of a file name."""
    parts = [_HEAD, _summary(measured)]
    if picture:
        parts.append(f"![Error against CPU time, a panel for each problem]({picture})\n")
    for problem, runs in measured:
        parts += [f"## {problem.title}\n", _about(problem), _numbers(problem), _costs(runs)]
    return "\n".join(parts)


def _summary(measured: Sequence[tuple[Reference, Sequence[WorkPrecisionRun]]]) -> str:
    """Return the table of the cheapest run for each problem, and errors of published values."""
    table_rows = []
    for problem, runs in measured:
        # peers are beside ours in the tables of the problems
        accurate_runs = [run for run in runs if run.error <= LIMIT and not run.peer]
        cheapest = min(accurate_runs, key=lambda run: run.cpu_seconds, default=None)
        # scheme, steps, error and CPU ms
        cells = ["missed"] * 4 if cheapest is None else [
            cheapest.scheme, f"{cheapest.steps}", f"{cheapest.error:.0e}",
            f"{cheapest.cpu_seconds * 1e3:.1f}"]
        deviation = max(problem.deviations.values(), default=None)
        table_rows.append([f"`{problem.name}`", *cells,
                           "–" if deviation is None else f"{deviation:.0e}"])
    return _table(["problem", f"cheapest to {LIMIT:.0e}", "steps", "error", "CPU ms",
                   "error of the published values"], table_rows)


def _about(problem: Reference) -> str:
    """Return the paragraph on a problem: its source, and where the digits come from."""
    invariants = ", ".join(f"{name} = {formula}" for name, formula in problem.invariants.items())
    solution = problem.truth
    without = problem.no_bodies and f" Without exudyn and MuJoCo: {problem.no_bodies}."
    return (f"`{problem.name}`: {problem.source}. Model: {problem.form}. "
            f"Compared at t = {problem.seconds} s. Invariants: {invariants}.{without}\n\n"
            f"Reference: {solution.made}; they agree to {solution.agreement:.0e}.\n"
            + (f"Published: {problem.published.source}.\n" if problem.published else ""))


def _numbers(problem: Reference) -> str:
    """Return the table of the true values, with the published ones beside them."""
    published = problem.published.values if problem.published else {}
    deviations = problem.deviations
    table_rows = [[name, value, published.get(name, "–"), f"{deviations[name]:.0e}"
                   if name in deviations else "–"]
                  for name, value in problem.truth.values.items()]
    return _table(["quantity", "reference", "published", "error"], table_rows)


def _costs(runs: Sequence[WorkPrecisionRun]) -> str:
    """Return the table of steps, error and CPU time of each run, and the best run's invariants."""
    invariants = min((run for run in runs if not run.peer), key=lambda run: run.error).invariants
    table = _table(["scheme", "steps", "error", "CPU ms"], [
        [run.label, f"{run.steps}", f"{run.error:.1e}", f"{run.cpu_seconds * 1e3:.2f}"]
        for run in runs])
    return table + "\nInvariants: " + ", ".join(
        f"{name} {value:.0e}" for name, value in invariants.items()) + ".\n"


def _table(titles: Sequence[str], cells: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown, with a title for each column and a list of cells for each row."""
    lines = [titles, ["---"] * len(titles), *cells]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
