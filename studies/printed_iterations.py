"""Tables 8-14 exactly as printed: largest steps and mean iterations.

Numbers stay text, because how many digits were printed is part of what was printed. None is a
cell that our copy of the paper lost; None in Table 8 also where the paper has a dash.
"""

from __future__ import annotations

from ..generator.schemes.named_schemes import SchemeName

__all__ = [
    "COLUMNS_8",
    "COPIED_ROWS",
    "DIVERGENT",
    "ITERATIONS",
    "ROWS",
    "STEPS",
    "TABLE_8",
    "Row",
]

#: (representation, rule of γ or α)
Row = tuple[str, str]

DIVERGENT = "divergent"

ROWS: tuple[Row, ...] = (
    ("gamma", "m"), ("gamma", "h"),
    ("alpha", "m"), ("alpha", "h"), ("alpha", "100m"), ("alpha", "0.01m"),
)

#: Δt of the columns of Tables 9-14.
STEPS = ("0.02", "0.01", "0.005", "0.001")

#: Table → row → mean iterations at each Δt.
ITERATIONS: dict[int, dict[Row, tuple[str | None, ...]]] = {
    9: {
        ("gamma", "m"): ("9", "6.9", "6", "5.1"),
        ("gamma", "h"): ("8", "6", "6", "5.0"),
        ("alpha", "m"): ("10.9", "14.3", "22.7", "54.3"),
        ("alpha", "h"): ("10.6", "15.1", "29.1", "62.8"),
        ("alpha", "100m"): (DIVERGENT, DIVERGENT, DIVERGENT, "92.6"),
        ("alpha", "0.01m"): ("12", "8.0", "15.65", "41.9"),
    },
    10: {
        ("gamma", "m"): (DIVERGENT, None, "6", None),
        ("gamma", "h"): ("8", "6", "6", None),
        ("alpha", "m"): ("9", None, "6", "5"),
        ("alpha", "h"): (None, "7", "6", "5"),
        ("alpha", "100m"): ("13", "10.0", "14.3", "24.6"),
        ("alpha", "0.01m"): (DIVERGENT, "8", "6", "5"),
    },
    11: {
        ("gamma", "m"): ("73", "30.0", "16.0", "9.0"),
        ("gamma", "h"): ("46.9", "23.9", "14.0", "8.0"),
        ("alpha", "m"): ("67.8", DIVERGENT, "25.0", "10.0"),
        ("alpha", "h"): ("74.9", DIVERGENT, "24.0", "10.0"),
        ("alpha", "100m"): (DIVERGENT, DIVERGENT, DIVERGENT, "61.4"),
        ("alpha", "0.01m"): (DIVERGENT, DIVERGENT, DIVERGENT, "10.1"),
    },
    12: {
        ("gamma", "m"): ("27.7", "19", "13.0", "8.0"),
        ("gamma", "h"): ("21.9", "17.0", "12.0", "8.0"),
        ("alpha", "m"): ("67.8", DIVERGENT, "25.0", "10.0"),
        ("alpha", "h"): ("74.9", DIVERGENT, "24.0", "10.0"),
        ("alpha", "100m"): (DIVERGENT, DIVERGENT, DIVERGENT, "42.7"),
        ("alpha", "0.01m"): (DIVERGENT, "30", DIVERGENT, "9"),
    },
    13: {
        ("gamma", "m"): ("21", "17", "13.0", "9.2"),
        ("gamma", "h"): ("18", "15", "11.7", "8.0"),
        ("alpha", "m"): ("43.0", "26.0", "16", "9.0"),
        ("alpha", "h"): ("40", "24", "15", "9.0"),
        ("alpha", "100m"): (DIVERGENT, DIVERGENT, DIVERGENT, "54.6"),
        ("alpha", "0.01m"): ("27.8", "20.0", "14.1", "8.7"),
    },
    14: {
        ("gamma", "m"): ("19", "15.9", "12", "11.7"),
        ("gamma", "h"): ("17.0", "14.0", "11.0", "14.1"),
        ("alpha", "m"): ("29.0", "21", "15", "12.5"),
        ("alpha", "h"): ("28.0", "20.0", "14", "14.9"),
        ("alpha", "100m"): (DIVERGENT, DIVERGENT, DIVERGENT, "55.9"),
        ("alpha", "0.01m"): ("23.8", "18.1", "12.8", "10.2"),
    },
}

#: Rows of Table 12 that are copies of Table 11 (erratum 19).
COPIED_ROWS: tuple[Row, ...] = (("alpha", "m"), ("alpha", "h"))

COLUMNS_8: tuple[SchemeName, ...] = ("IMS", "EMS", "LIIIA-B", "G-L")

#: (order, representation, rule) → largest Δt of each column.
TABLE_8: dict[tuple[int, str, str], tuple[str | None, ...]] = {
    (2, "gamma", "m"): ("0.022", "0.019", "0.016", "0.020"),
    (2, "gamma", "h"): ("0.035", "0.022", "0.017", "0.022"),
    (2, "alpha", "m"): ("0.084", "0.025", "0.027", DIVERGENT),
    (2, "alpha", "h"): ("0.085", "0.024", "0.020", DIVERGENT),
    (2, "alpha", "100m"): ("0.007", "0.019", "0.0011", DIVERGENT),
    (2, "alpha", "0.01m"): ("0.021", "0.012", "0.0014", DIVERGENT),
    (4, "gamma", "m"): (None, None, "0.024", "0.025"),
    (4, "gamma", "h"): (None, None, "0.028", "0.028"),
    (4, "alpha", "m"): (None, None, "0.014", "0.016"),
    (4, "alpha", "h"): (None, None, "0.014", "0.017"),
    (4, "alpha", "100m"): (None, None, "0.0016", "0.0016"),
    (4, "alpha", "0.01m"): (None, None, "0.0048", "0.014"),
    (6, "gamma", "m"): (None, None, "0.029", "0.030"),
    (6, "gamma", "h"): (None, None, "0.033", "0.032"),
    (6, "alpha", "m"): (None, None, "0.018", "0.021"),
    (6, "alpha", "h"): (None, None, "0.018", "0.021"),
    (6, "alpha", "100m"): (None, None, "0.0022", "0.0019"),
    (6, "alpha", "0.01m"): (None, None, "0.018", "0.015"),
    (8, "gamma", "m"): (None, None, "0.030", "0.029"),
    (8, "gamma", "h"): (None, None, "0.033", "0.033"),
    (8, "alpha", "m"): (None, None, "0.022", "0.022"),
    (8, "alpha", "h"): (None, None, "0.022", "0.024"),
    (8, "alpha", "100m"): (None, None, "0.0025", "0.0025"),
    (8, "alpha", "0.01m"): (None, None, "0.019", "0.016"),
}
