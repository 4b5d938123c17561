"""The result of a study: the only input of the report, the command line and the tests."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

__all__ = ["Cell", "Claim", "Figure", "Finding", "Panel", "Result", "Series", "Table", "Verdict"]

Verdict = Literal["agrees", "round-off", "misprint", "differs", "not printed"]


@dataclass(frozen=True)
class Cell:
    """One number of a table beside the paper's.

    ``paper`` is a number, the text the paper prints instead of one ("divergent"), or None where
    our copy lost it; ``ours`` likewise a number or a text.
    """

    row: str
    column: str
    paper: float | str | None
    ours: float | str
    verdict: Verdict
    note: str = ""

    @property
    def ratio(self) -> float | None:
        """Ours over the paper's, where both are numbers."""
        if isinstance(self.paper, float) and isinstance(self.ours, float) and self.paper:
            return self.ours / self.paper
        return None

    def as_dict(self) -> dict[str, Any]:
        """Return the cell as the contract's JSON has it."""
        return {"row": self.row, "column": self.column, "paper": self.paper, "ours": self.ours,
                "ratio": self.ratio, "verdict": self.verdict, "note": self.note}


@dataclass(frozen=True)
class Claim:
    """A checked statement, with the number that decides it.

    ``how`` is "proved" for a symbolic identity and "measured" for a numerical law; ``known`` has
    the reason why it does not hold, if that is expected.
    """

    statement: str
    found: str
    wanted: str
    holds: bool
    how: Literal["proved", "measured"] = "measured"
    known: str = ""

    @property
    def outcome(self) -> str:
        """The outcome in a word or two."""
        if self.holds:
            return "proved" if self.how == "proved" else "holds"
        return "not met, as is known" if self.known else "fails"

    def as_dict(self) -> dict[str, Any]:
        """Return the claim for JSON."""
        return {"statement": self.statement, "found": self.found, "wanted": self.wanted,
                "holds": self.holds, "how": self.how, "known": self.known}


@dataclass(frozen=True)
class Table:
    """A table of the paper, cell by cell."""

    number: int
    title: str
    about: str  # what was computed: problem, steps, definitions, in a few sentences
    cells: list[Cell]
    claims: list[Claim] = field(default_factory=list)

    @property
    def name(self) -> str:
        """As on the command line."""
        return f"table-{self.number}"

    def as_dict(self) -> dict[str, Any]:
        """Return the contract's JSON."""
        return {"table": self.number, "title": self.title, "about": self.about,
                "cells": [cell.as_dict() for cell in self.cells],
                "claims": [claim.as_dict() for claim in self.claims]}


@dataclass(frozen=True)
class Series:
    """One curve: points (x, y) under a label; ``style`` as in matplotlib, e.g. "-", "o", "x--"."""

    label: str
    x: list[float]
    y: list[float]
    style: str = "-"


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    xlabel: str
    ylabel: str
    series: list[Series]
    xscale: Literal["linear", "log"] = "linear"
    yscale: Literal["linear", "log"] = "linear"
    zero: bool = False  # the y axis reaches down (or up) to 0


@dataclass(frozen=True)
class Figure:
    """A figure of the paper, redrawn in its arrangement."""

    number: int
    title: str
    about: str
    panels: list[Panel]
    columns: int = 2
    claims: list[Claim] = field(default_factory=list)

    @property
    def name(self) -> str:
        """As on the command line."""
        return f"figure-{self.number}"

    def as_dict(self) -> dict[str, Any]:
        """Return the figure's data for JSON."""
        return {
            "figure": self.number, "title": self.title, "about": self.about,
            "panels": [
                {"title": p.title, "xlabel": p.xlabel, "ylabel": p.ylabel,
                 "xscale": p.xscale, "yscale": p.yscale,
                 "series": [{"label": s.label, "x": s.x, "y": s.y} for s in p.series]}
                for p in self.panels
            ],
            "claims": [claim.as_dict() for claim in self.claims],
        }


@dataclass(frozen=True)
class Finding:
    """Something the paper left open, with its proof or its measured law."""

    key: str  # e.g. "odd-stages"
    title: str
    about: str  # the argument, in paragraphs separated by blank lines
    claims: list[Claim]
    panels: list[Panel] = field(default_factory=list)

    @property
    def name(self) -> str:
        """As on the command line."""
        return f"finding-{self.key}"

    def as_dict(self) -> dict[str, Any]:
        """Return the finding for JSON."""
        return {"finding": self.key, "title": self.title, "about": self.about,
                "claims": [claim.as_dict() for claim in self.claims]}


Result = Table | Figure | Finding
