"""Results as Markdown, JSON, CSV and SVG.

    paper.md  results.json  table-N.csv  figure-N.svg  finding-KEY.svg

Every number of the page comes out of the results. ``docs/paper.md`` has no pictures and no digits
below the round-off floor; limits of convergence and counts of stagnating steps (Tables 8 to 14)
depend on the last bits, and so on the processor.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from typing import Any

from .._version import __version__
from ..core import strict_json
from .drawing import draw
from .study_result import Cell, Claim, Figure, Finding, Result, Table
from .summary import (
    ALL_VERDICTS,
    Group,
    counts,
    counts_line,
    failing,
    iterations_note,
    notes,
    requirements,
    tables_of,
    unexpected,
)
from .verdict import CONSERVED_EXACTLY, ROUND_OFF

__all__ = ["MARKS", "as_json", "heading", "is_scientific", "json_text", "number_text", "page",
           "report_files", "section"]

#: Verdict → a mark that needs no colour.
MARKS = {"agrees": "✓", "round-off": "≈", "misprint": "✎", "differs": "≠", "not printed": "·"}


def report_files(results: Sequence[Result]) -> dict[str, str]:
    """Return name → text of every file of a report."""
    files = {"paper.md": page(results, complete=True), "results.json": as_json(results)}
    for result in results:
        if isinstance(result, Table):
            files[f"{result.name}.csv"] = table_csv(result)
        elif result.panels:
            columns = result.columns if isinstance(result, Figure) else 2
            files[f"{result.name}.svg"] = draw(result.panels, columns)
    return files


# ---------------------------------------------------------------- data


def as_json(results: Sequence[Result]) -> str:
    """Return all results as one JSON document."""
    return json_text({
        "gyrospark": __version__,
        "verdicts": dict(counts(tables_of(results))),
        "results": {result.name: result.as_dict() | {"command": _command(result)}
                    for result in results},
    })


def json_text(document: Any) -> str:
    """Return strict JSON: numbers that JSON lacks become null."""
    return strict_json.json_text(document, indent=1, ensure_ascii=False) + "\n"


def table_csv(table: Table) -> str:
    """Return the cells as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(text, ["row", "column", "paper", "ours", "ratio", "verdict", "note"],
                            lineterminator="\n")
    writer.writeheader()
    writer.writerows(cell.as_dict() for cell in table.cells)
    return text.getvalue()


def _command(result: Result) -> str:
    """Return the command that computes a result."""
    return f"gyrospark reproduce {result.name}"


# ---------------------------------------------------------------- Markdown


def page(results: Sequence[Result], *, complete: bool = False) -> str:
    """Return ``docs/paper.md``; a complete page has pictures and all numbers, too."""
    incomplete_note = "" if complete else (
        "`gyrospark reproduce all --summary docs/paper.md` writes this page; every number below "
        "is computed. If both numbers are round-off, none is given.")
    parts = ["# The paper, reproduced", incomplete_note, *_overview(results),
             *(section(result, complete=complete) for result in results)]
    return "\n\n".join(filter(None, parts)) + "\n"


def _overview(results: Sequence[Result]) -> Iterator[str]:
    """Yield the counts of verdicts, the requirements, and how many claims hold."""
    if tables_of(results):
        yield "## Verdicts"
        yield _verdict_table(tables_of(results))
        yield iterations_note(results)
    if requirements(results):
        yield _claims(requirements(results))
    claims = [claim for result in results for claim in result.claims]
    if claims:
        holding = sum(claim.holds for claim in claims)
        text = f"{holding} of {len(claims)} claims hold."
        if holding < len(claims):
            names = dict.fromkeys(result.name for result, _ in failing(results))
            text += f" The others are in {', '.join(names)}" + (
                "." if unexpected(results) else ", and why is known.")
        yield text


def section(result: Result, *, complete: bool = False) -> str:
    """Return a result's section of the page; a complete one has its picture and all numbers."""
    parts = [f"## {heading(result)}", f"`{_command(result)}`", result.about]
    if isinstance(result, Table):
        parts.append(counts_line([result]) + ".")
        if complete or any(cell.verdict == "not printed" for cell in result.cells):
            parts.append(_numbers(result, complete=complete))
        if notes(result):
            parts.append("\n".join(_group(group) for group in notes(result)))
    elif complete and result.panels:
        parts.append(f"![{result.title}]({result.name}.svg)")
    if result.claims:
        parts.append(_claims(result.claims))
    return "\n\n".join(parts)


def heading(result: Result) -> str:
    """Return e.g. "Table 4. Fast spinning top: ..."."""
    if isinstance(result, Finding):
        return result.title
    return f"{'Table' if isinstance(result, Table) else 'Fig.'} {result.number}. {result.title}"


def _verdict_table(tables: Sequence[Table]) -> str:
    """Return how many cells have each verdict: a row for each table, and one for all."""
    rows = [["table", *ALL_VERDICTS]]
    groups: list[tuple[str, Sequence[Table]]] = [(str(table.number), [table]) for table in tables]
    for name, group in [*groups, ("all", tables)]:
        verdict_counts = counts(group)
        rows.append([name, *(str(verdict_counts[verdict]) for verdict in ALL_VERDICTS)])
    return _grid(rows)


def _numbers(table: Table, *, complete: bool) -> str:
    """Return a table of our numbers; if complete, each with the printed number and its verdict."""
    # a table may lack cells, whose places stay empty
    cell_at = {(cell.row, cell.column): cell for cell in table.cells}
    columns = list(dict.fromkeys(cell.column for cell in table.cells))
    scientific = is_scientific(table)
    rows = [["ours (paper)" if complete else "ours", *columns]]
    for row in dict.fromkeys(cell.row for cell in table.cells):
        cells = [cell_at.get((row, column)) for column in columns]
        rows.append([row, *(_compare(cell, scientific) if complete else _number(cell)
                            for cell in cells)])
    return _grid(rows)


def _number(cell: Cell | None) -> str:
    """Return our number, or the note of a number whose digits mean nothing; "" for no cell."""
    if cell is None:
        return ""
    return cell.note if cell.note in (ROUND_OFF, CONSERVED_EXACTLY) else shown(cell.ours)


def _compare(cell: Cell | None, scientific: bool) -> str:
    """Return ours, the printed number and the verdict's mark, e.g. "2.355e-06 (2.35e-06) ✓"."""
    if cell is None:
        return ""
    ours = number_text(cell.ours, scientific, digits=3)
    if cell.paper is None:
        return f"{ours} {cell.note}".rstrip()
    return f"{ours} ({number_text(cell.paper, scientific, digits=2)}) {MARKS[cell.verdict]}"


def is_scientific(table: Table) -> bool:
    """Return whether a table's numbers, without zeros, span more than four powers of ten."""
    sizes = [abs(value) for cell in table.cells for value in (cell.ours, cell.paper)
             if isinstance(value, float) and value and math.isfinite(value)]
    return bool(sizes) and max(sizes) > 1e4 * min(sizes)


def number_text(value: float | str, scientific: bool, digits: int) -> str:
    """Return a number as the table's others are written, or the text.

    ``digits`` are decimals of a scientific number; others have four digits.
    """
    return f"{value:.{digits}e}" if scientific and isinstance(value, float) else shown(value)


def shown(value: float | str | None) -> str:
    """Return a number with four digits, or the text."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _group(group: Group) -> str:
    """Return a list item: verdict, cells and reason; both numbers too if the group is one cell."""
    places = group.places
    if len(group.cells) == 1:
        places += f" (ours {shown(group.cells[0].ours)}, paper {shown(group.cells[0].paper)})"
    return f"- *{group.verdict}*: {places}" + (f": {group.note}" if group.note else "")


def _claims(claims: Sequence[Claim]) -> str:
    """Return the Markdown table of claims: statement, measured and required number, outcome."""
    rows = [["claim", "found", "wanted", ""]]
    rows += [[claim.statement, claim.found, claim.wanted, _outcome(claim)] for claim in claims]
    return _grid(rows)


def _outcome(claim: Claim) -> str:
    """Return the outcome of a claim; a failure is bold, with its reason if that is known."""
    if claim.holds:
        return claim.outcome
    return f"**{claim.outcome}**" + (f": {claim.known}" if claim.known else "")


def _grid(rows: Sequence[Sequence[str]]) -> str:
    """Return rows as a Markdown table, the first one as its head; "|" in cells is escaped."""
    head, *body = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |"
                   for row in rows]
    return "\n".join([head, "|" + "---|" * len(rows[0]), *body])
