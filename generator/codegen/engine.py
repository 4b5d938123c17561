"""The features of the engine that a stepper needs: what its generated file defines."""

from __future__ import annotations

from typing import Any

from ...core.real_types import Real
from ..schemes.lagrangian_midpoint import LagrangianEMS
from ..schemes.step_equations import MeanScheme, SparkScheme
from ..symmetry.frame_symmetries import Frame
from ..systems.lagrangian import LagrangianSystem
from ..systems.moving_frame import MovingSystem
from ..systems.system import System
from .profiles import ProfileName

__all__ = ["ENGINE_VERSION", "features"]

#: Of the interface between generated files and ``engine/gyrospark/engine.h``.
ENGINE_VERSION = 1


def features(
    scheme: SparkScheme | MeanScheme, system: System, real: Real, fast: dict[str, Any], *,
    structured: bool = False, frame: Frame | None = None, rotates: bool = False,
    profile: ProfileName = "full",
) -> list[str]:
    """Return the names of the features, without their prefix."""
    lagrangian = isinstance(system, LagrangianSystem)
    full = profile == "full"
    held = {
        "CONSTRAINED": system.m > 0,
        "SEVERAL_CONSTRAINTS": system.m > 1,
        "SPARK": isinstance(scheme, SparkScheme),
        "ELEMENTS": structured,
        "FORCES": bool(system.forces),
        "TIME_DEPENDENT": system.is_timed,
        "INPUTS": bool(system.inputs) and full,
        "LAGRANGIAN": lagrangian,
        "ENERGY_MOMENTUM": isinstance(scheme, LagrangianEMS),
        "INDEFINITE_MASS": isinstance(system, LagrangianSystem) and not system.is_definite,
        "FRAME": frame is not None,
        "FRAME_WORK": isinstance(scheme.system, MovingSystem) and bool(scheme.system.carried),
        "ROTATING_MULTIPLIERS": rotates,
        "FIXED_POINT": full and bool(fast["fast"]),
        "CONSTANT_SCHUR": bool(fast.get("constant_schur")),
        "SCALAR_SCHUR": bool(fast.get("correction") if full else fast["scalar"]),
        "FACTORS": bool(fast.get("eliminates")),
        "SEPARABLE": bool(fast.get("separable") if full else fast["proved"]["separable"]),
        "EVEN_ODD": bool(fast.get("half_tables")),
        "WIDE_REAL": real.wide,
        "COMPENSATED_LANES": bool(fast.get("compensated")),
        "PROFILE_RUN": profile == "run",
        "PROFILE_CONTROL": profile == "control",
    }
    return [name for name, is_held in held.items() if is_held]
