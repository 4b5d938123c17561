"""The problems of the paper's section 5, and the free body, with exact motions where known.

    fast_top()            (80)          no closed form used
    regular_precession()  (83)-(86)     trigonometric
    free_body()           mgl = 0       Jacobi-elliptic

All are heavy tops with the parameters I1, I2, I3 (kg m²) and mgl (N m); a stepper needs gamma
or alpha beside them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_mapping, as_text, choose, few, shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.html import card, table
from ...core.inertia import (
    InertiaLike,
    as_inertia,
    as_moments,
    is_tensor,
    moments_of,
    real_array,
    unit_quaternions,
)
from ...core.records import dataclass
from ...core.registry import SYSTEMS
from ...core.start import Start
from ..bindings.array_checks import as_real
from .exact import ExactMotion, RegularPrecession, free_motion
from .gamma_rules import principal_moments
from .quaternion import euler_quaternion, momentum

__all__ = [
    "Problem",
    "cone_mass",
    "fast_top",
    "free_body",
    "regular_precession",
]


def __dir__() -> list[str]:
    return __all__


@dataclass(frozen=True, eq=False)
class Problem:
    """A system with its parameters and a state to start from.

    Attributes
    ----------
    name
        The name on the command line.
    parameters
        The values of the system's parameters by name, without gamma or alpha.
    q0, p0
        State at t = 0, shape (4,), read-only; p0 in kg m²/s.
    inertia
        Principal moments I₁, I₂, I₃ about the fixed point, in kg m².
    system
        Name of the generated system.
    exact
        The exact motion, or None where there is no closed form.
    description
        One sentence for people.

    Raises
    ------
    InputError
        Unless q0 and p0 are four finite numbers each, and the others of their kind.
    """

    name: str
    parameters: dict[str, float]
    q0: Array
    p0: Array
    inertia: tuple[float, float, float]
    system: str = "heavy_top"
    exact: ExactMotion | None = None
    description: str = ""

    def __repr__(self) -> str:
        parameters = ", ".join(f"{name} = {value:.6g}" for name, value in self.parameters.items())
        return f"<Problem {self.name} ({self.system}): {parameters}>"

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the numbers of the problem."""
        table_rows = [("about", self.description or self.name), ("system", self.system),
                      ("parameters",
                       few(f"{name} = {x:.6g}" for name, x in self.parameters.items())),
                      ("q₀", few(f"{x:.6g}" for x in self.q0)),
                      ("p₀", few(f"{x:.6g}" for x in self.p0)),
                      ("exact motion", "none known" if self.exact is None else "problem.exact")]
        return card(f"Problem {self.name}", table(table_rows))

    @property
    def start(self) -> Start:
        """Where a run of it starts; γ and α are by rule."""
        # mgl of the free body, which a system without gravity does not have
        zero_parameters = {name for name, value in self.parameters.items() if value == 0}
        return Start(self.q0, self.p0, self.parameters).of_model(
            dict.fromkeys(("gamma", "alpha"), self.inertia), rules={},
            spare=frozenset(zero_parameters))

    def __post_init__(self) -> None:
        """Check all fields, and convert numbers; q0 and p0 become read-only arrays."""
        for name in ("name", "description"):
            as_text(name, getattr(self, name))
        choose("system", self.system, SYSTEMS)
        if self.exact is not None and not hasattr(self.exact, "axis"):
            raise InputError(f"exact = {shown(self.exact)} is no motion; leave it out.")
        parameters = as_mapping("parameters", self.parameters, "{'mgl': 0.4}")
        object.__setattr__(self, "parameters", {
            name: as_real(f"Parameter {name}", number) for name, number in parameters.items()})
        object.__setattr__(self, "inertia", as_moments(self.inertia))
        for name, moment in zip(("I1", "I2", "I3"), self.inertia, strict=True):
            if self.parameters.get(name, moment) != moment:
                raise InputError(f"Parameter {name} = {self.parameters[name]} is not the moment "
                                 f"{moment} of inertia = {shown(self.inertia)}; give both one "
                                 "value.")
        # read-only, for a frozen problem is shared by its runs
        for letter in ("q0", "p0"):
            state = _vector(getattr(self, letter), 4, letter)
            state.setflags(write=False)
            object.__setattr__(self, letter, state)


def fast_top() -> Problem:
    """Return the fast spinning top (80): φ = ψ = 0, θ = π/6, Ω = (0, 0, 40π) rad/s."""
    mass, length, gravity = 1.0, 0.04, 9.81
    return _heavy_top(
        "fast-top",
        inertia=(0.002, 0.002, 0.0008),
        mgl=mass * gravity * length,
        q0=euler_quaternion(0.0, math.pi / 6, 0.0),
        omega=[0.0, 0.0, 40 * math.pi],
        exact=None,
        description="Fast spinning top in gravity, the paper's (80).",
    )


def cone_mass(density: float, radius: float, height: float) -> float:
    """Return the mass ρ π r² h/3 of a solid cone in kg, from kg/m³ and metres.

    Raises
    ------
    InputError
        Unless all three are finite and above 0.
    """
    density = _positive(density, "density", "kg/m³")
    radius, height = _positive(radius, "radius", "m"), _positive(height, "height", "m")
    return density * math.pi * radius**2 * height / 3


def regular_precession(
    radius_ratio: float = 0.5,
    *,
    rate: float = 30.0,
    height: float = 0.1,
    density: float = 2700.0,
    mass: float | None = None,
    gravity: float = 9.81,
) -> Problem:
    """Return a cone on its tip in regular precession, θ₀ = π/3, with its exact motion.

        I₁ = I₂ = (3/5) m (r²/4 + h²),  I₃ = (3/10) m r²  (83),  l = 3h/4
        ψ̇ = mgl/(I₃ φ̇) + (I₁ − I₃)/I₃ · φ̇ cos θ₀  (erratum 10),
        Ω₀ = (0, φ̇ sin θ₀, ψ̇ + φ̇ cos θ₀)  (86)

    The defaults are Table 6 as the paper really ran it (erratum 18): φ̇ = 30, not the printed
    10, and the printed mass m = ρπ²h/3 = 888.264 kg. ``radius_ratio=1.5`` is Table 7. The
    motion does not depend on the mass, the energy does; for the physically right cone pass
    ``mass=cone_mass(density, radius, height)``.

    Parameters
    ----------
    radius_ratio
        r/h.
    rate
        Precession rate φ̇, not 0, in rad/s.
    height, density
        h in m and ρ in kg/m³.
    mass
        m in kg; None takes the printed ρπ²h/3.
    gravity
        g in m/s², along −z.

    Raises
    ------
    InputError
        If a value is not finite, the rate is 0, or a size, density or mass is not above 0.
    """
    h = _positive(height, "height", "m")
    r = _positive(radius_ratio, "radius_ratio", "m/m") * h
    literal_mass = _positive(density, "density", "kg/m³") * math.pi**2 * h / 3
    m = literal_mass if mass is None else _positive(mass, "mass", "kg")
    rate = _finite(rate, "rate", "rad/s")
    if rate == 0:
        raise InputError("The precession rate is 0 rad/s and ψ̇ would be infinite; choose another.")
    theta = math.pi / 3
    # moments beyond a double are refused here; I₁ = I₂, so that the last two are I₁ and I₃
    I1, I3 = principal_moments((3 * m * (r * r / 4 + h * h) / 5,) * 2 + (3 * m * r * r / 10,))[1:]
    mgl = m * _finite(gravity, "gravity", "m/s²") * 3 * h / 4
    # the spin with which the cone neither rises nor falls: θ̈ = 0 at θ₀
    spin = mgl / (I3 * rate) + (I1 - I3) / I3 * rate * math.cos(theta)
    return _heavy_top(
        "regular-precession",
        inertia=(I1, I1, I3),
        mgl=mgl,
        q0=euler_quaternion(0.0, theta, 0.0),
        omega=[0.0, rate * math.sin(theta), spin + rate * math.cos(theta)],
        exact=RegularPrecession(rate=rate, spin=spin, nutation=theta),
        description=f"Cone in regular precession at {rate:g} rad/s, r = {r / h:g} h.",
    )


def free_body(
    inertia: InertiaLike = (0.002, 0.0013, 0.0008),
    angular_velocity: ArrayLike = (30.0, -40.0, 100.0),
    attitude: ArrayLike = (1.0, 0.0, 0.0, 0.0),
) -> Problem:
    """Return a body without forces, a heavy top with mgl = 0, with its exact motion.

    Parameters
    ----------
    inertia
        Principal moments in any order, in kg m².
    angular_velocity
        Ω at t = 0 in body axes, in rad/s.
    attitude
        q at t = 0, scalar first; brought to unit length.

    Raises
    ------
    InputError
        Unless the moments are finite, above 0 and those of a body, and the others finite, the
        attitude not 0.
    """
    moments = as_inertia(inertia)
    if is_tensor(moments):
        raise InputError(f"The inertia {shown(inertia)} is a tensor; the free body turns in closed "
                         "form about its principal axes: give I1, I2 and I3, or take Multibody.")
    I1, I2, I3 = moments_of(moments)
    omega = _vector(angular_velocity, 3, "angular_velocity").tolist()
    q0 = unit_quaternions(attitude, "attitude")
    if q0.ndim != 1:
        raise InputError(f"The attitude is {shown(attitude)}; give 4 numbers, scalar first.")
    return _heavy_top(
        "free-body",
        inertia=(I1, I2, I3),
        mgl=0.0,
        q0=q0,
        omega=omega,
        exact=free_motion((I1, I2, I3), omega, q0.tolist()),
        description="Rigid body without forces.",
    )


def _heavy_top(
    name: str, *, inertia: tuple[float, float, float], mgl: float, q0: Array, omega: list[float],
    exact: ExactMotion | None, description: str
) -> Problem:
    """Return a heavy top that starts at the attitude q0, (4,), with Ω = ``omega``, (3,), in rad/s.

    ``inertia`` are the moments in kg m², ``mgl`` the mass times g times the distance of the centre
    of mass from the fixed point, in N m; ``exact`` is the motion in closed form, or None.
    """
    parameters = dict(zip(("I1", "I2", "I3"), inertia, strict=True)) | {"mgl": mgl}
    p0 = momentum(q0, omega, inertia)
    return Problem(name, parameters, q0, p0, inertia, exact=exact, description=description)


def _finite(value: float, quantity: str, unit: str) -> float:
    """Return a finite number; raise InputError, which names quantity and unit, for anything else.
    """
    array = real_array(value)
    if array is None or array.ndim:
        raise InputError(f"The {quantity} {shown(value)} is no number; give it in {unit}.")
    number = float(array)
    if not math.isfinite(number):
        raise InputError(f"The {quantity} is {number!r}; it must be a finite number in {unit}.")
    return number


def _positive(value: float, quantity: str, unit: str) -> float:
    """Return a finite number above 0; raise InputError, as ``_finite``, for anything else."""
    number = _finite(value, quantity, unit)
    if number <= 0:
        raise InputError(f"The {quantity} is {number!r}; it must be above 0, in {unit}.")
    return number


def _vector(components: ArrayLike, length: int, name: str) -> Array:
    """Return an array (length,) of finite numbers; raise InputError, with ``name``, for others."""
    vector = real_array(components)
    if vector is None:
        raise InputError(f"{name} = {shown(components)} is not {length} numbers.")
    if vector.shape != (length,) or not np.isfinite(vector).all():
        raise InputError(f"{name} = {shown(components)} must be {length} finite numbers.")
    return vector
