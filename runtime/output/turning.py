"""How far the fastest body turns in a step, and how far a method can bear."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..build.places import bodies_of

if TYPE_CHECKING:
    from .trajectory import Trajectory

__all__ = ["Turning", "fastest_turning"]

#: Up to which order a turn of how many rad a step is borne. Measured on the fast top, the regular
#: precession and a free body with three moments, by IMS, EMS, G-L and LIIIA-B: the error of the
#: attitude, in parts of the angle turned. Of order 2 it is 3 to 5 % at 1.25 rad (the paper's runs
#: with Δt = 0.01 s; 1 − 4 arctan(θ/4)/θ for the midpoint), and from 1.5 rad on the motion is lost
#: within three turns. Order 4 is there at 2.5 rad, with 0.5 to 2 %. Higher orders are right to
#: 5e-4 or better up to 3 rad; beyond it steps of every order find no solution for one motion or
#: another, and states half a turn apart do not tell which way a body turns.
_BORNE = {3: 1.5, 5: 2.5}
_MOST = 3.0


@dataclass(frozen=True)
class Turning:
    """The fastest rotation among the stored states of a run.

    Attributes
    ----------
    body : str
    radians : float
        |Ω Δt|: how far it turns in a step.
    borne : float
        How far a method of this order can bear.
    """

    body: str
    radians: float
    borne: float


def fastest_turning(trajectory: Trajectory) -> Turning | None:
    """Return |Ω Δt| of the body that turns fastest; None where no body turns, or none is known.

    A co-moving frame needs no resolving of the rotation along it: with one there is no answer.
    """
    manifest, dt = trajectory.manifest, float(trajectory.dt)
    rates = [one["name"] for one in manifest.get("frame", {}).get("symmetries", ())]
    if any(trajectory.parameters.get(name, 0) != 0 for name in rates):
        return None
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is left out
        found = {name: float(np.linalg.norm(trajectory.angular_velocity(name), axis=1).max())
                 for name in bodies_of(manifest)}
    finite = {name: rate * abs(dt) for name, rate in found.items() if math.isfinite(rate * dt)}
    if not finite:
        return None
    body = max(finite, key=finite.__getitem__)
    order = manifest["scheme"]["order"]
    borne = next((radians for most, radians in _BORNE.items() if order <= most), _MOST)
    return Turning(body, finite[body], borne)
