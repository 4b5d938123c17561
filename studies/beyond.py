"""Open questions of the paper, each answered with a proof or a measured law.

``equivalence``   LIIIA-B-α = LIIIA-B-γ (erratum 23)
``odd_stages``    1/γ for even s, γ for odd s (24); proofs in ``odd_proof``, formulas in
                  ``energy_law``, the expansion of one step in ``one_step``
``zeros``         the γ that zeroes the error (25)
``one_stage``     1-G-L-α (22)
``gamma_auto``    γ chosen by pilot runs
``frames``        Tables 4, 6, 7 in co-moving frames
"""

from __future__ import annotations

from collections.abc import Callable

from . import equivalence, frames, gamma_auto, odd_stages, one_stage, zeros
from .case_runner import Engine
from .study_result import Finding

__all__ = ["FINDINGS"]

FINDINGS: dict[str, Callable[[Engine], Finding]] = {
    "alpha-equals-gamma": equivalence.study,
    "odd-stages": odd_stages.study,
    "zero-of-the-error": zeros.study,
    "one-stage-alpha": one_stage.study,
    "gamma-auto": gamma_auto.study,
    "frames": frames.study,
}
