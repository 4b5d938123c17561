"""All reference problems by name."""

from __future__ import annotations

from ..core.arguments import choose
from .governor import FLYBALL_GOVERNOR, FLYBALL_GOVERNOR_STIFF
from .linkages import (
    BENNETT,
    BRICARD,
    BRICARD_PUSHED,
    FOUR_BAR,
    FOUR_BARS,
    PARALLELOGRAM,
    SLIDER_CRANK,
)
from .mechanisms import ANDREWS, CAR_AXIS
from .pendulums import SIMPLE_PENDULUM, SPHERICAL_PENDULUM
from .problem import Reference
from .rigid_bodies import DZHANIBEKOV, FREE_BODY, GORYACHEV_CHAPLYGIN, HEAVY_TOP, KOVALEVSKAYA
from .surfaces import BEAD, ELLIPSOID, GROWING_MASS, NEUMANN

__all__ = ["REFERENCES", "names", "reference"]

REFERENCES = {problem.name: problem for problem in (
    CAR_AXIS, ANDREWS, SIMPLE_PENDULUM, SPHERICAL_PENDULUM, FOUR_BAR,
    FOUR_BARS, PARALLELOGRAM, BRICARD, BRICARD_PUSHED, BENNETT, SLIDER_CRANK,
    FLYBALL_GOVERNOR, FLYBALL_GOVERNOR_STIFF, DZHANIBEKOV, FREE_BODY, HEAVY_TOP, KOVALEVSKAYA,
    GORYACHEV_CHAPLYGIN, NEUMANN, ELLIPSOID, BEAD, GROWING_MASS)}


def names() -> tuple[str, ...]:
    """Return the names of all problems."""
    return tuple(REFERENCES)


def reference(name: str) -> Reference:
    """Return the problem of a name.

    Raises
    ------
    InputError
        For another name, with those there are.
    """
    return REFERENCES[choose("reference problem", name, REFERENCES)]
