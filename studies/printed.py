"""The numbers of Tables 4, 6 and 7 exactly as printed, and the misprints among them.

Tables 2, 3 and 5 lost their numbers in our copy of the paper. Numbers stay text here, because
how many digits were printed is part of what was printed.
"""

from __future__ import annotations

from dataclasses import dataclass

from .case_runner import Quantity

__all__ = ["COLUMNS", "MISPRINTS", "TABLE_4", "TABLE_6", "TABLE_7", "Misprint", "Printed"]

#: (quantity, representation, rule of γ or α) → one entry a column.
Printed = dict[tuple[Quantity, str, str], tuple[str, ...]]

COLUMNS = ("IMS", "EMS", "3-LIIIA-B", "2-G-L")

TABLE_4: Printed = {
    ("H", "gamma", "m"): ("2.35E-06", "1.12E-14", "5.46E-10", "4.94E-10"),
    ("H", "gamma", "h"): ("4.70E-06", "8.49E-15", "5.46E-10", "2.72E-10"),
    ("H", "gamma", "100m"): ("9.32E-06", "1.49E-14", "3.79E-10", "1.61E-09"),
    ("z", "gamma", "m"): ("1.48E-05", "1.55E-05", "7.41E-09", "4.86E-09"),
    ("z", "gamma", "h"): ("2.76E-05", "5.09E-05", "7.41E-09", "1.96E-09"),
    ("z", "gamma", "100m"): ("1.77E-04", "2.18E-04", "5.41E-09", "1.96E-08"),
    ("x", "gamma", "m"): ("2.07E-04", "2.16E-04", "1.21E-08", "9.83E-09"),
    ("x", "gamma", "h"): ("2.20E-04", "2.20E-04", "1.22E-08", "8.16E-09"),
    ("x", "gamma", "100m"): ("3.23E-04", "3.23E-04", "8.87E-09", "3.25E-08"),
}

TABLE_6: Printed = {
    ("H", "gamma", "m"): ("1.69E-02", "9.03E-12", "2.15E-06", "1.34E-06"),
    ("H", "gamma", "h"): ("5.09E-01", "3.91E-12", "3.06E-06", "1.08E-06"),
    ("H", "gamma", "ht"): ("5.57E-12", "4.17E-12", "1.69E-06", "2.56E-06"),
    ("H", "alpha", "m"): ("1.07E-01", "2.94E-12", "2.15E-06", "7.00E-06"),
    ("z", "gamma", "m"): ("1.74E-03", "3.24E-03", "1.96E-05", "1.55E-05"),
    ("z", "gamma", "h"): ("9.20E-03", "1.44E-02", "2.33E-05", "1.38E-05"),
    ("z", "gamma", "ht"): ("5.61E-16", "7.81E-16", "1.73E-05", "2.14E-05"),
    ("z", "alpha", "m"): ("4.39E-03", "8.88E-03", "1.96E-05", "3.53E-05"),
    ("x", "gamma", "m"): ("4.35E-02", "8.19E-03", "5.80E-04", "5.42E-04"),
    ("x", "gamma", "h"): ("2.11E-01", "4.51E-01", "6.82E-04", "2.91E-04"),
    ("x", "gamma", "ht"): ("9.05E-02", "1.01E-01", "5.18E-04", "7.09E-04"),
    ("x", "alpha", "m"): ("2.03E-01", "3.18E-01", "5.80E-04", "1.11E-03"),
}

TABLE_7: Printed = {
    ("H", "gamma", "m"): ("3.15E-05", "3.03E-12", "7.32E-11", "3.48E-12"),
    ("H", "gamma", "h"): ("4.99E-05", "2.58E-12", "7.49E-11", "2.47E-12"),
    ("H", "alpha", "m"): ("2.92E-03", "1.46E-12", "7.10E-11", "7.72E-09"),
    ("z", "gamma", "m"): ("5.94E-05", "2.16E-05", "9.03E-08", "2.15E-08"),
    ("z", "gamma", "h"): ("7.49E-05", "2.72E-05", "9.04E-08", "5.65E-10"),
    ("z", "alpha", "m"): ("5.72E-04", "2.14E-04", "9.03E-08", "9.32E-07"),
    ("x", "gamma", "m"): ("1.01E-02", "1.36E-02", "1.91E-05", "6.84E-06"),
    ("x", "gamma", "h"): ("8.74E-03", "1.31E-02", "1.91E-05", "8.64E-06"),
    ("x", "alpha", "m"): ("6.70E-02", "3.51E-02", "1.91E-05", "6.74E-05"),
}


@dataclass(frozen=True)
class Misprint:
    """The correct value of a misprinted cell, from an independent source (errata.md)."""

    erratum: int
    right: str
    why: str


#: (table, quantity, rule, column) → the misprint; all are of γ-type rows.
MISPRINTS: dict[tuple[int, Quantity, str, str], Misprint] = {
    (4, "x", "h", "EMS"): Misprint(19, "2.387E-04", "the IMS column is printed again"),
    (4, "x", "100m", "EMS"): Misprint(19, "3.768E-04", "the IMS column is printed again"),
    (4, "H", "100m", "3-LIIIA-B"): Misprint(19, "3.754E-10", "a digit is wrong"),
    (6, "x", "ht", "IMS"): Misprint(19, "9.157E-02", "a digit is missing"),
}
