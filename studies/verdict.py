"""Ours beside the paper's number: *agrees*, *round-off*, *misprint*, *differs*.

    agrees      ours, rounded to as many digits as the paper printed, is what it printed
    round-off   both lie below ε · N_t · size (``Engine.floor``), so their digits mean nothing
    misprint    an erratum gives another value, and ours agrees with that one
    differs     none of these; the note says by how much, and why if we know

The rules are tried in this order and hold for whole tables; nothing is tuned to a cell.
"""

from __future__ import annotations

import math
from decimal import ROUND_HALF_EVEN, Decimal

from .printed import Misprint
from .study_result import Cell, Verdict

__all__ = ["CONSERVED_EXACTLY", "ROUND_OFF", "compare_value", "same_digits", "units_between"]

#: Notes of cells that were not printed and whose digits mean nothing.
ROUND_OFF, CONSERVED_EXACTLY = "round-off", "conserved"


def same_digits(ours: float, printed: str) -> bool:
    """Return whether ours, rounded to the printed digits, is the printed number."""
    return math.isfinite(ours) and units_between(ours, printed) == 0


def units_between(ours: float, printed: str) -> int:
    """Return how many units of the last printed digit lie between ours, rounded, and the printed.

    Both are exact decimals: ``Decimal(ours)`` has all digits of the double.
    """
    number = Decimal(printed)
    unit = Decimal((0, (1,), int(number.as_tuple().exponent)))
    return int(abs((Decimal(ours) / unit).quantize(Decimal(1), ROUND_HALF_EVEN) - number / unit))


def compare_value(
    row: str,
    column: str,
    ours: float,
    printed: str | None,
    floor: float = 0.0,
    misprint: Misprint | None = None,
    reason: str = "",
) -> Cell:
    """Return the cell with its verdict.

    Parameters
    ----------
    printed
        The paper's number as text, with all its digits; None where our copy lost it.
    floor
        Below it a number is round-off.
    misprint
        The erratum of this cell.
    reason
        Why the cell differs, if it does and we know; the note of a cell that was not printed.
    """
    if printed is None:
        return Cell(row, column, paper=None, ours=ours, verdict="not printed", note=reason)
    verdict, note = _verdict(ours, printed, floor, misprint, reason)
    return Cell(row, column, float(printed), ours, verdict, note)


def _verdict(
    ours: float, printed: str, floor: float, misprint: Misprint | None, reason: str
) -> tuple[Verdict, str]:
    """Return the verdict on a printed number and its note, as ``compare_value`` has them."""
    if same_digits(ours, printed):
        return "agrees", ""
    if max(abs(ours), abs(float(printed))) <= floor:
        return "round-off", f"both below {floor:.1e} = ε · N_t · size"
    if misprint is not None and same_digits(ours, misprint.right):
        return "misprint", (f"erratum {misprint.erratum}: {misprint.why}; "
                            f"right is {misprint.right}")
    if not math.isfinite(ours):
        return "differs", "ours is no finite number"
    # up to nine units in the last digit are reported in units; more than one needs a reason
    units = units_between(ours, printed)
    if units > 1 and (units > 9 or not reason):
        return "differs", reason
    distance = f"{units} unit{'s' if units > 1 else ''} in the last printed digit"
    return "differs", f"{distance}; {reason}" if reason else distance
