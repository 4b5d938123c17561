"""Options of robots' files, by format; ``gyrospark.load_model`` describes them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, TypedDict

from numpy.typing import ArrayLike

from .robot_tree import Limits

__all__ = ["MjcfOptions", "RobotOptions", "SdfOptions", "UrdfOptions"]


class RobotOptions(TypedDict, total=False):
    """Options of all formats."""

    angles: Mapping[str, Any] | None
    rates: Mapping[str, Any] | None
    ignore: str | Iterable[str] | None
    gravity: ArrayLike | None
    limits: Limits


class SdfOptions(RobotOptions, total=False):
    """Options of SDF."""

    base: Literal["fixed", "floating"] | None
    position: ArrayLike | None
    quaternion: ArrayLike | None
    velocity: ArrayLike | None
    angular_velocity: ArrayLike | None


class UrdfOptions(SdfOptions, total=False):
    """Options of URDF."""

    loops: str | Path | None


class MjcfOptions(RobotOptions, total=False):
    """Options of MJCF."""

    keyframe: str | int | None
    loops: str | Path | None
