"""Every way into the package, as a function of bytes.

An entrance turns bytes into an input by ``Choices``, hands it over, and returns "accepted" or what
kind of refusal it met; whatever else happens is a failure. Command lines have bad words in
``tests/commands/test_cli.py``, Python calls absurd arguments in
``tests/api/test_hostile_calls.py``, the C has in ``tests/native/test_c_random_input.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from . import checkpoints, file_texts, files, formulas

__all__ = ["ENTRANCES", "Entrance"]


@dataclass(frozen=True)
class Entrance:
    """A way in: its check, the time limit of one input, its share of all inputs."""

    name: str
    about: str
    check: Callable[[bytes], str]
    seconds: float
    share: float


ENTRANCES = {entrance.name: entrance for entrance in (
    Entrance("checkpoint", "checkpoints of stored runs, forged", checkpoints.check,
             300, 0.1),
    Entrance("trajectory", "trajectory files (.npz), and what is asked of them", files.check,
             20, 0.1),
    Entrance("formula", "formulas of model files, numbers, entries of tableaux",
             formulas.check, 10, 0.5),
    Entrance("model", "model files (TOML)", file_texts.MODEL.check, 20, 0.1),
    Entrance("study", "study files of sweeps (TOML)", file_texts.STUDY.check, 30, 0.05),
    Entrance("tableau", "tableau files (JSON)", file_texts.TABLEAU.check, 20, 0.1),
)}
