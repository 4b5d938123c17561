"""Every way into the package, as a function of bytes.

An entrance turns bytes into an input by ``Choices``, hands it over, and returns "accepted" or what
kind of refusal it met; whatever else happens is a failure. Any engine can feed it: seeded random
bytes, hypothesis, atheris.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from . import (
    c_calls,
    checkpoints,
    command_line,
    files,
    formulas,
    model_texts,
    python_calls,
    studies,
    tableaux,
)

__all__ = ["ENTRANCES", "Entrance"]


@dataclass(frozen=True)
class Entrance:
    """A way in: what is checked, how long one input may take, its share of all inputs."""

    name: str
    about: str
    check: Callable[[bytes], str]
    seconds: float
    share: float
    #: Whether coverage of Python code can guide the search.
    guided: bool = False


ENTRANCES = {entrance.name: entrance for entrance in (
    Entrance("command", "the command line, every command and option",
             command_line.check, 300, 0.025),
    Entrance("store", "stored runs (Zarr), exported or gone on with", command_line.check_store,
             30, 0.002),
    Entrance("checkpoint", "checkpoints of stored runs, and stores, forged", checkpoints.check,
             300, 0.05),
    Entrance("trajectory", "trajectory files (.npz), and what is asked of them",
             files.check_trajectory, 20, 0.03),
    Entrance("source", "sources kept in the cache (JSON)", files.check_source, 10, 0.02),
    Entrance("manifest", "manifests of steppers (JSON)", files.check_manifest, 20, 0.02),
    Entrance("python", "arrays and options through the Python calls",
             python_calls.check, 20, 0.1),
    Entrance("c", "numbers through the C functions, on guarded memory", c_calls.check, 20, 0.4),
    Entrance("formula", "formulas of model files, numbers, entries of tableaux",
             formulas.check, 10, 0.3, guided=True),
    Entrance("model", "model files (TOML)", model_texts.check, 20, 0.03, guided=True),
    Entrance("study", "study files of sweeps (TOML)", studies.check, 30, 0.02, guided=True),
    Entrance("tableau", "tableau files (JSON)", tableaux.check, 20, 0.03, guided=True),
)}
