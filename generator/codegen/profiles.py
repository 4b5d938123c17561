"""Profiles: how much of a stepper is written."""

from __future__ import annotations

from typing import Literal

__all__ = ["PROFILES", "ProfileName"]

#: What ``profile`` may be; the keys of ``PROFILES``, for editors and type checkers.
ProfileName = Literal["control", "run", "full"]

#: Each with the one it is for.
PROFILES: dict[ProfileName, str] = {
    "control": "one trajectory, a bounded number of iterations a step: for a controller",
    "run": "one trajectory, steps and whole runs, with Newton's method as fallback: for C programs",
    "full": "batches, lanes, what a step solves: for Python",
}
