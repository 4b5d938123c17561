"""Motions known in closed form, by what defines them: the public names of ``gyrospark.exact``."""

from __future__ import annotations

from typing import cast

from numpy.typing import ArrayLike

from ...core.inertia import InertiaLike
from ..bindings.array_checks import as_real
from . import problems
from .closed_forms import ExactMotion, RegularPrecession

__all__ = ["free_body", "regular_precession"]


def free_body(
    inertia: InertiaLike, angular_velocity: ArrayLike, attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0)
) -> ExactMotion:
    """Return the motion of a rigid body without forces, I Ω̇ = (I Ω) × Ω, in closed form.

    Jacobi's elliptic functions, computed with 40 digits and rounded once (Landau and Lifshitz,
    Mechanics, §37; Whittaker, Analytical Dynamics, §69).

    Parameters
    ----------
    inertia
        Principal moments in any order, in kg m².
    angular_velocity
        Ω at t = 0 in body axes, in rad/s.
    attitude
        The unit quaternion at t = 0, scalar first, body to space.

    Returns
    -------
    ExactMotion
        ``.attitude(t)`` is q, shape (N, 4); ``.angular_velocity(t)`` Ω in body axes, shape (N, 3);
        ``.axis(t)`` the body's third axis in space, shape (N, 3); t in seconds.

    Raises
    ------
    InputError
        Unless the moments are those of a body, and the others finite, the attitude not 0.

    Examples
    --------
    >>> import gyrospark as gs
    >>> motion = gs.exact.free_body((0.003, 0.002, 0.0015), (0.01, 5.0, 0.01))
    >>> motion.attitude([0.0, 1.0]).shape
    (2, 4)
    """
    return cast("ExactMotion", problems.free_body(inertia, angular_velocity, attitude).exact)


def regular_precession(rate: float, spin: float, nutation: float) -> ExactMotion:
    """Return the motion of a symmetric top in regular precession: φ = φ̇ t, ψ = ψ̇ t, θ = θ₀.

    Parameters
    ----------
    rate, spin
        φ̇ and ψ̇ in rad/s.
    nutation
        θ₀ in rad.

    Returns
    -------
    ExactMotion
        As of ``free_body``. For the spin that a top's weight asks for see
        ``gyrospark.problems.regular_precession``.

    Raises
    ------
    InputError
        Unless all are finite numbers.
    """
    values = {"rate": rate, "spin": spin, "nutation": nutation}
    return RegularPrecession(**{
        name: float(as_real(name, value)) for name, value in values.items()})
