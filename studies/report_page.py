"""One static page with everything, and JSON, CSV and SVG beside it.

    index.html  results.json  table-N.csv  figure-N.svg  finding-KEY.svg
"""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup, escape

from .._version import __version__
from . import summary
from .drawing import arrange, draw, inline
from .study_result import Cell, Figure, Finding, Result, Table
from .verdict import CONSERVED_EXACTLY

__all__ = ["as_json", "command", "heading", "json_text", "number_text", "report_files"]

#: Verdict → a mark that needs no colour.
MARKS = {"agrees": "✓", "round-off": "≈", "misprint": "✎", "differs": "≠", "not printed": "·"}


def report_files(results: Sequence[Result]) -> dict[str, str]:
    """Return name → text of every file of a report."""
    drawings = {result.name: [draw(panel) for panel in result.panels]
                for result in results if not isinstance(result, Table)}
    files = {"index.html": page(results, drawings), "results.json": as_json(results)}
    for result in results:
        if isinstance(result, Table):
            files[f"{result.name}.csv"] = table_csv(result)
        elif result.panels:
            files[f"{result.name}.svg"] = arrange(drawings[result.name], _columns(result))
    return files


def command(result: Result) -> str:
    """Return the command that makes a result again."""
    return f"gyrospark reproduce {result.name}"


# ---------------------------------------------------------------- data


def as_json(results: Sequence[Result]) -> str:
    """Return all results as one JSON document."""
    document = {
        "gyrospark": __version__,
        "verdicts": dict(summary.counts(summary.tables_of(results))),
        "results": {result.name: result.as_dict() | {"command": command(result)}
                    for result in results},
    }
    return json_text(document)


def json_text(document: Any) -> str:
    """Return strict JSON: numbers that JSON lacks become null."""
    return json.dumps(_finite(document), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(entry) for entry in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def table_csv(table: Table) -> str:
    """Return the cells as CSV."""
    text = io.StringIO()
    writer = csv.DictWriter(text, ["row", "column", "paper", "ours", "ratio", "verdict", "note"],
                            lineterminator="\n")
    writer.writeheader()
    writer.writerows(cell.as_dict() for cell in table.cells)
    return text.getvalue()


# ---------------------------------------------------------------- page


def page(results: Sequence[Result], drawings: dict[str, list[str]]) -> str:
    """Return index.html; ``drawings`` are the panels of each figure and finding as SVG."""
    folder = Path(__file__).resolve().parent
    environment = Environment(loader=FileSystemLoader(folder), undefined=StrictUndefined,
                              autoescape=True, trim_blocks=True, lstrip_blocks=True,
                              keep_trailing_newline=True)
    environment.filters["signs"] = with_signs
    tables = summary.tables_of(results)
    return environment.get_template("report.html.jinja").render(
        version=__version__, marks=MARKS, results=results, verdicts=summary.ALL_VERDICTS,
        counts=[(table, summary.counts([table])) for table in tables],
        total=summary.counts(tables), requirements=summary.requirements(results),
        iterations=summary.iterations_note(results), headlines=summary.headlines(results),
        failing=summary.failing(results),
        claims=[claim for result in results for claim in result.claims],
        pieces=[_piece(result, drawings) for result in results],
    )


#: A letter, perhaps with a tilde above it, and what is written below it: γ_m, γ̃_ht, N_t.
_BELOW = re.compile(r"(?<![^\W\d])(?<![/.<-])([^\W\d_]\u0303?)_(\w{1,3})(?![\w(=])")


def with_signs(text: str) -> Markup:
    """Return text as HTML with what stands below a letter put there."""
    return Markup(_BELOW.sub(r"\1<sub>\2</sub>", str(escape(text))))


def _piece(result: Result, drawings: dict[str, list[str]]) -> dict[str, Any]:
    """Return what the template shows of a result."""
    piece: dict[str, Any] = {
        "result": result, "command": command(result), "kind": type(result).__name__.lower(),
        "heading": heading(result), "short": short_name(result),
        "paragraphs": result.about.split("\n\n"),
        "rows": [], "columns": [], "groups": [], "drawings": [], "width": 1, "file": "",
    }
    if isinstance(result, Table):
        printed = any(cell.verdict != "not printed" for cell in result.cells)
        return piece | {"printed": printed,
                        "columns": _distinct(cell.column for cell in result.cells),
                        "rows": _rows(result), "groups": summary.notes(result),
                        "file": f"{result.name}.csv", "counts": summary.counts_line([result])}
    shown = [inline(drawing, f"{result.name}-{number}", panel.title) for number, (drawing, panel)
             in enumerate(zip(drawings[result.name], result.panels, strict=True))]
    file = f"{result.name}.svg" if shown else ""
    return piece | {"drawings": shown, "width": _columns(result), "file": file}


def heading(result: Result) -> str:
    """Return e.g. "Table 4. Fast spinning top: ..."."""
    if isinstance(result, Finding):
        return result.title
    return f"{short_name(result)}. {result.title}"


def short_name(result: Result) -> str:
    """Return e.g. "Table 4" or "Fig. 10"; a finding's title."""
    if isinstance(result, Finding):
        return result.title
    return f"{'Table' if isinstance(result, Table) else 'Fig.'} {result.number}"


def _columns(result: Figure | Finding) -> int:
    return result.columns if isinstance(result, Figure) else 2


def _distinct(names: Any) -> list[str]:
    return list(dict.fromkeys(names))


def _rows(table: Table) -> list[tuple[str, list[dict[str, Any] | None]]]:
    """Return the cells as text, row by row; None where the table has no cell."""
    places = {(cell.row, cell.column): cell for cell in table.cells}
    scientific = is_scientific(table)
    columns = _distinct(cell.column for cell in table.cells)
    return [
        (row, [_cell_text(places.get((row, column)), scientific) for column in columns])
        for row in _distinct(cell.row for cell in table.cells)
    ]


def _cell_text(cell: Cell | None, scientific: bool) -> dict[str, Any] | None:
    if cell is None:
        return None
    ratio = cell.ratio if cell.verdict in ("misprint", "differs") else None
    return {
        "ours": number_text(cell.ours, scientific, 3),
        "paper": "" if cell.paper is None else number_text(cell.paper, scientific, 2),
        "ratio": "" if ratio is None else f"{ratio:.3g}",
        "verdict": cell.verdict, "mark": MARKS[cell.verdict],
        "slug": cell.verdict.replace(" ", "-"), "note": cell.note,
        "strong": cell.verdict != "not printed" or cell.note == CONSERVED_EXACTLY,
    }


def is_scientific(table: Table) -> bool:
    """Return whether the numbers span more than four powers of ten."""
    sizes = [abs(value) for cell in table.cells for value in (cell.ours, cell.paper)
             if isinstance(value, float) and value and math.isfinite(value)]
    return bool(sizes) and max(sizes) > 1e4 * min(sizes)


def number_text(value: float | str, scientific: bool, digits: int) -> str:
    """Return a number as the table's others are written, or the text."""
    if isinstance(value, str):
        return value
    return f"{value:.{digits}e}" if scientific else f"{value:.4g}"
