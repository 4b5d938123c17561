"""The summary of all results: counts of verdicts, and claims that hold or do not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from .study_result import Cell, Claim, Result, Table, Verdict

__all__ = ["ALL_VERDICTS", "Group", "counts", "counts_line", "failing", "iterations_note", "notes",
           "requirements", "tables_of", "unexpected", "unexplained"]

ALL_VERDICTS: tuple[Verdict, ...] = ("agrees", "round-off", "misprint", "differs", "not printed")
#: Tables of accuracy, and how many of their cells must agree, and be round-off, at least.
ACCURACY_TABLES = (4, 6, 7)
FIRST_ITERATION_TABLE = 8
WANTED_AGREE, WANTED_ROUND_OFF = 96, 18


@dataclass(frozen=True)
class Group:
    """Cells of one table with the same verdict for the same reason."""

    verdict: Verdict
    note: str
    cells: list[Cell]

    @property
    def places(self) -> str:
        """Where the cells are; only how many, if they are many."""
        if len(self.cells) > 6:
            return f"{len(self.cells)} cells"
        return "; ".join(f"{cell.row}, {cell.column}" for cell in self.cells)


def counts(tables: Iterable[Table]) -> Counter[Verdict]:
    """Return how many cells have each verdict."""
    return Counter(cell.verdict for table in tables for cell in table.cells)


def counts_line(tables: Iterable[Table]) -> str:
    """Return e.g. "30 agrees, 3 round-off, 3 misprint"."""
    verdict_counts = counts(tables)
    return ", ".join(f"{verdict_counts[verdict]} {verdict}" for verdict in ALL_VERDICTS
                     if verdict_counts[verdict])


def tables_of(results: Iterable[Result]) -> list[Table]:
    """Return the tables among the results."""
    return [result for result in results if isinstance(result, Table)]


def requirements(results: Iterable[Result]) -> list[Claim]:
    """Return three requirements on Tables 4, 6 and 7; [] unless all three are among the results.

    96 of 120 cells agree with the printed digits, 18 more are round-off in both numbers, and each
    of the others has a reason (erratum 19).
    """
    tables = [table for table in tables_of(results) if table.number in ACCURACY_TABLES]
    if len(tables) < len(ACCURACY_TABLES):
        return []
    verdict_counts = counts(tables)
    total = sum(verdict_counts.values())
    deviating = total - verdict_counts["agrees"] - verdict_counts["round-off"]
    explained = not any(unexplained(table) for table in tables)
    return [
        Claim(f"Cells of Tables 4, 6 and 7, {total} in all, that agree to every printed digit",
              str(verdict_counts["agrees"]), f"at least {WANTED_AGREE}",
              verdict_counts["agrees"] >= WANTED_AGREE),
        Claim("Further cells with round-off in both numbers", str(verdict_counts["round-off"]),
              f"at least {WANTED_ROUND_OFF} more",
              verdict_counts["agrees"] + verdict_counts["round-off"]
              >= WANTED_AGREE + WANTED_ROUND_OFF),
        Claim("Other cells, each with an explanation", f"{verdict_counts['misprint']} misprints, "
              f"{verdict_counts['differs']} differences with a reason",
              f"all {deviating}", explained),
    ]


def iterations_note(results: Iterable[Result]) -> str:
    """Return why cells of Tables 8-14 differ so often; "" without these tables."""
    if not any(table.number >= FIRST_ITERATION_TABLE for table in tables_of(results)):
        return ""
    return ("Table 8 and the later tables measure an iteration, not a scheme, and the paper "
            "describes neither its Jacobian nor its initial guess nor its search. Most cells are "
            "compared twice, with full Newton and with a reconstruction of the paper's "
            "iteration; if the results differ the table gives the reason. Where the last bits "
            "decide, another processor or compiler may count other iterations.")


def unexplained(table: Table) -> list[Cell]:
    """Return the cells that differ and have no note."""
    return [cell for cell in table.cells if cell.verdict == "differs" and not cell.note]


def failing(results: Iterable[Result]) -> list[tuple[Result, Claim]]:
    """Return the claims that do not hold, each with its result."""
    return [(result, claim) for result in results for claim in result.claims if not claim.holds]


def unexpected(results: Iterable[Result]) -> list[tuple[Result, Claim]]:
    """Return the claims that do not hold although, as far as is known, they should."""
    return [(result, claim) for result, claim in failing(results) if not claim.known]


def notes(table: Table) -> list[Group]:
    """Return the misprints and differences of a table, grouped by their reason."""
    groups: dict[tuple[Verdict, str], list[Cell]] = {}
    for cell in table.cells:
        if cell.verdict in ("misprint", "differs"):
            groups.setdefault((cell.verdict, cell.note), []).append(cell)
    return [Group(verdict, note, cells) for (verdict, note), cells in groups.items()]
