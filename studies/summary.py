"""What all results together say: counts of verdicts, claims, and ``docs/paper.md``.

Every number in the text comes out of the results. Digits below the round-off floor are not
written: they differ between machines.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .study_result import Cell, Claim, Figure, Finding, Result, Table, Verdict
from .verdict import CONSERVED_EXACTLY, ROUND_OFF

__all__ = [
    "ALL_VERDICTS",
    "Group",
    "counts",
    "counts_line",
    "failing",
    "headlines",
    "iterations_note",
    "notes",
    "requirements",
    "section",
    "unexpected",
    "unexplained",
    "write_summary",
]

ALL_VERDICTS: tuple[Verdict, ...] = ("agrees", "round-off", "misprint", "differs", "not printed")
#: The tables whose cells issue 3 counts, and how many of them.
ACCURACY_TABLES = (4, 6, 7)
FIRST_ITERATION_TABLE = 8
WANTED_AGREE, WANTED_ROUND_OFF = 96, 18
#: Results whose first claim stands at the top of the page.
HEADLINES = ("table-2", "table-3", "table-5", "table-6", "figure-10", "figure-11", "figure-12",
             "figure-13", "figure-15", "figure-16")


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
    found = counts(tables)
    return ", ".join(f"{found[verdict]} {verdict}" for verdict in ALL_VERDICTS if found[verdict])


def tables_of(results: Iterable[Result]) -> list[Table]:
    """Return the tables among the results."""
    return [result for result in results if isinstance(result, Table)]


def requirements(results: Iterable[Result]) -> list[Claim]:
    """Return what issue 3 asks of Tables 4, 6 and 7, if all three are there."""
    tables = [table for table in tables_of(results) if table.number in ACCURACY_TABLES]
    if len(tables) < len(ACCURACY_TABLES):
        return []
    found = counts(tables)
    total = sum(found.values())
    rest = total - found["agrees"] - found["round-off"]
    explained = not any(unexplained(table) for table in tables)
    return [
        Claim(f"Cells of Tables 4, 6 and 7, {total} in all, that agree to every printed digit",
              str(found["agrees"]), f"at least {WANTED_AGREE}", found["agrees"] >= WANTED_AGREE),
        Claim("Further cells with round-off in both numbers", str(found["round-off"]),
              f"at least {WANTED_ROUND_OFF} more",
              found["agrees"] + found["round-off"] >= WANTED_AGREE + WANTED_ROUND_OFF),
        Claim("Other cells, each with an explanation", f"{found['misprint']} misprints, "
              f"{found['differs']} differences with a reason", f"all {rest}", explained),
    ]


def iterations_note(results: Iterable[Result]) -> str:
    """Return why Tables 8-14 differ so often, if some of them are there."""
    if not any(table.number >= FIRST_ITERATION_TABLE for table in tables_of(results)):
        return ""
    return ("Table 8 and the later tables measure an iteration, not a scheme, and the paper "
            "describes neither its Jacobian nor its initial guess nor its search. Most cells are "
            "compared twice, with full Newton and with a reconstruction of the paper's "
            "iteration; if the results differ the table gives the reason.")


def unexplained(table: Table) -> list[Cell]:
    """Return the cells that differ without a word."""
    return [cell for cell in table.cells if cell.verdict == "differs" and not cell.note]


def failing(results: Iterable[Result]) -> list[tuple[Result, Claim]]:
    """Return the claims that do not hold, each with its result."""
    return [(result, claim) for result in results for claim in result.claims if not claim.holds]


def unexpected(results: Iterable[Result]) -> list[tuple[Result, Claim]]:
    """Return the claims that do not hold although, as far as is known, they should."""
    return [(result, claim) for result, claim in failing(results) if not claim.known]


def headlines(results: Sequence[Result]) -> list[tuple[Result, Claim]]:
    """Return the first claims of the results in ``HEADLINES`` and of every finding."""
    return [(result, result.claims[0]) for result in results
            if result.claims and (result.name in HEADLINES or isinstance(result, Finding))]


def notes(table: Table) -> list[Group]:
    """Return the misprints and differences of a table, grouped by their reason."""
    groups: dict[tuple[Verdict, str], list[Cell]] = {}
    for cell in table.cells:
        if cell.verdict in ("misprint", "differs"):
            groups.setdefault((cell.verdict, cell.note), []).append(cell)
    return [Group(verdict, note, cells) for (verdict, note), cells in groups.items()]


# ---------------------------------------------------------------- Markdown


def write_summary(results: Sequence[Result]) -> str:
    """Return ``docs/paper.md``."""
    parts = [
        "# The paper, reproduced",
        "`gyrospark reproduce all --summary docs/paper.md` writes this page; every number below "
        "is computed. If both numbers are round-off, none is given.",
    ]
    parts += _overview(results)
    parts += [section(result) for result in results]
    return "\n\n".join(parts) + "\n"


def _overview(results: Sequence[Result]) -> list[str]:
    parts = []
    if tables_of(results):
        parts += ["## Verdicts", _verdict_table(tables_of(results))]
        if iterations_note(results):
            parts.append(iterations_note(results))
    if requirements(results):
        parts.append(_claims(requirements(results)))
    claims = [claim for result in results for claim in result.claims]
    if claims:
        holding = sum(claim.holds for claim in claims)
        text = f"{holding} of {len(claims)} claims hold."
        if holding < len(claims):
            names = dict.fromkeys(result.name for result, _ in failing(results))
            text += f" The others are in {', '.join(names)}" + (
                "." if unexpected(results) else ", and why is known.")
        parts.append(text)
    return parts


def section(result: Result) -> str:
    """Return a result's part of ``docs/paper.md``."""
    heading = {Table: "Table", Figure: "Fig."}.get(type(result))
    number = f"{heading} {result.number}. " if not isinstance(result, Finding) else ""
    parts = [f"## {number}{result.title}", f"`gyrospark reproduce {result.name}`", result.about]
    if isinstance(result, Table):
        parts.append(counts_line([result]) + ".")
        if any(cell.verdict == "not printed" for cell in result.cells):
            parts.append(_numbers(result))
        if notes(result):
            parts.append("\n".join(_group(group) for group in notes(result)))
    if result.claims:
        parts.append(_claims(result.claims))
    return "\n\n".join(parts)


def _verdict_table(tables: Sequence[Table]) -> str:
    rows = [["table", *ALL_VERDICTS]]
    for table in tables:
        found = counts([table])
        rows.append([str(table.number), *(str(found[verdict]) for verdict in ALL_VERDICTS)])
    total = counts(tables)
    rows.append(["all", *(str(total[verdict]) for verdict in ALL_VERDICTS)])
    return _grid(rows)


def _numbers(table: Table) -> str:
    """Return our numbers of a table whose printed ones are lost."""
    places = {(cell.row, cell.column): cell for cell in table.cells}
    columns = list(dict.fromkeys(cell.column for cell in table.cells))
    rows = [["ours", *columns]]
    for row in dict.fromkeys(cell.row for cell in table.cells):
        rows.append([row, *(_number(places.get((row, column))) for column in columns)])
    return _grid(rows)


def _number(cell: Cell | None) -> str:
    if cell is None:
        return ""
    return cell.note if cell.note in (ROUND_OFF, CONSERVED_EXACTLY) else shown(cell.ours)


def _group(group: Group) -> str:
    places = group.places
    if len(group.cells) == 1:
        places += f" (ours {shown(group.cells[0].ours)}, paper {shown(group.cells[0].paper)})"
    return f"- *{group.verdict}*: {places}" + (f": {group.note}" if group.note else "")


def shown(value: float | str | None) -> str:
    """Return a number with four digits, or the text."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _claims(claims: Sequence[Claim]) -> str:
    rows = [["claim", "found", "wanted", ""]]
    rows += [[claim.statement, claim.found, claim.wanted, _outcome(claim)] for claim in claims]
    return _grid(rows)


def _outcome(claim: Claim) -> str:
    if claim.holds:
        return claim.outcome
    return f"**{claim.outcome}**" + (f": {claim.known}" if claim.known else "")


def _grid(rows: Sequence[Sequence[str]]) -> str:
    head, *body = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
                   for row in rows]
    return "\n".join([head, "|" + "---|" * len(rows[0]), *body])
