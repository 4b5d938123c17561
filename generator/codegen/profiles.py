"""Profiles: amounts of C that are generated for a stepper."""

from __future__ import annotations

from typing import Literal

__all__ = ["PROFILES", "ProfileName"]

#: The names of profiles, the keys of ``PROFILES``, for editors and type checkers.
ProfileName = Literal["control", "run", "full"]

#: Each profile with its content and its user.
PROFILES: dict[ProfileName, str] = {
    "control": "one trajectory, a bounded number of iterations a step: for a controller",
    "run": "one trajectory, steps and whole runs, with Newton's method as fallback: for C programs",
    "full": "batches, lanes, what a step solves: for Python",
}
