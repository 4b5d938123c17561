"""Models to start from, as ``gyrospark.models``: every function returns a ``Model``.

    lagrange_top            a symmetric top in gravity                    n =  4, m =  1
    satellite               attitude in a gravity gradient, orbiting      n =  4, m =  1
    double_pendulum         two bars in a plane, free to leave it         n = 11, m =  5
    double_top              a top on a top                                n = 11, m =  5
    gimbal                  outer ring, inner ring, rotor                 n = 12, m =  9
    four_bar                crank, coupler, rocker: a closed loop         n = 21, m = 20
    delta_robot             three arms, six rods, a platform: five loops  n = 70, m = 61
    stewart_platform        a platform on six legs that slide             n = 91, m = 79
    chain(N)                N rods on ball joints                         n = 7N, m = 4N

Lengths in m, masses in kg, angles in rad, unless stated otherwise.
"""

from __future__ import annotations

import math
from functools import partial

import numpy as np
import sympy as sp

from ...core.arguments import as_integer, shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.inertia import REPS, RepName, quaternion_product, warn_of_degrees
from ...core.registry import function_of
from .body import Body, Frame
from .initial_poses import finite, rotation
from .model import Model
from .multibody import Multibody

__all__ = [
    "chain", "delta_robot", "double_pendulum", "double_top", "four_bar", "gimbal", "lagrange_top",
    "satellite", "stewart_platform",
]

#: Rods of a chain at most, whose derivation takes minutes.
MOST_RODS = 1000
#: Chains from this length on take so long that their numbers are cached.
_MANY_RODS = 50


def __dir__() -> list[str]:
    return __all__


def lagrange_top(*, rep: RepName = "gamma") -> Model:
    """Return a symmetric top in gravity that nutates: cos θ moves between two bounds."""
    build = Multibody("lagrange_top", dt=0.002, steps=1000,
                      description="Symmetric top in gravity, released with its axis at rest.")
    build.top("a", mass=0.5, inertia=(0.004, 0.004, 0.001), centre=(0, 0, 0.08), rep=rep,
              quaternion=turn((1, 0, 0), 0.6), angular_velocity=(0, 0, 60))
    return build.model()


def satellite(
    *, rep: RepName = "gamma", rate: float = 0.0011,
    inertia: tuple[float, float, float] = (30.0, 32.0, 6.0),
) -> Model:
    """Return a satellite's attitude in orbit axes: z points up, y along the orbit's normal.

    x points along the velocity. ``inertia`` has the principal moments in kg m², with which the
    momenta of the start are computed.

    H = T − n l_y + (3/2) n² z·J z, with the orbit's rate n and l_y, z in space and body axes: the
    gravity gradient turns the axis of least inertia upright, and the orbit axes turn at n. H is
    the constant of Jacobi. Time in s, n in rad/s.
    """
    build = Multibody("satellite", gravity=(0, 0, 0), dt=2.0, steps=3000,
                      description="Attitude of a satellite in the gravity gradient of a circular "
                                  "orbit, in orbit axes.")
    body = build.top(
        "a", mass=100.0, inertia=inertia, centre=(0, 0, 0), rep=rep,
        quaternion=quaternion_product(turn((1, 0, 0), 0.15), turn((0, 1, 0), 0.3)),
        angular_velocity=(0, rate, 2e-4),
    )
    n = build.parameter("n", rate, positive=True)
    vertical = body.rotation[2, :]
    gradient = sum((moment * z**2 for moment, z in zip(body.inertia, vertical, strict=True)),
                   sp.Integer(0))
    build.potential(-n * body.angular_momentum[1] + sp.Rational(3, 2) * n**2 * gradient)
    return build.model()


def double_pendulum(*, rep: RepName = "gamma", angles: tuple[float, float] = (1.2, 2.0)) -> Model:
    """Return two uniform bars that hang on each other; they stay in the plane x = 0.

    ``angles`` are those of the bars against the downward vertical, in rad.
    """
    start_angles = finite("angles", angles, shape=(2,)).tolist()
    warn_of_degrees("angles", start_angles, cure=f"numpy.radians({start_angles})")
    build = Multibody("double_pendulum", dt=0.005, steps=1000,
                      description="Two bars in a plane: a compound double pendulum.")
    upper = build.top(
        "a", mass=1.0, inertia=(1 / 3, 1 / 3, 0.01), centre=(0, 0, -0.5), rep=rep,
        quaternion=turn((1, 0, 0), start_angles[0]), angular_velocity=(0.5, 0, 0),
    )
    lower = build.body(
        "b", mass=0.5, inertia=(0.5 * 0.8**2 / 12, 0.5 * 0.8**2 / 12, 0.005), rep=rep,
        quaternion=turn((1, 0, 0), start_angles[1]), angular_velocity=(-1.0, 0, 0),
    )
    build.ball("joint", upper, lower, on_a=(0, 0, -1), on_b=(0, 0, 0.4))
    return build.model()


def double_top(*, rep: RepName = "gamma") -> Model:
    """Return a top on top of another one, joined by a ball joint."""
    build = Multibody("double_top", dt=0.001, steps=2000, description="A top on a top.")
    a = build.top(
        "a", mass=1.0, inertia=(0.1, 0.12, 0.03), centre=(0, 0, 0.25), rep=rep,
        quaternion=turn((1, 0, 0), 0.3), angular_velocity=(0.2, 0, 40),
    )
    b = build.body(
        "b", mass=0.4, inertia=(0.012, 0.01, 0.006), rep=rep,
        quaternion=turn((0, 1, 0), 0.4), angular_velocity=(0, 0.3, 70),
    )
    build.ball("joint", a, b, on_a=(0, 0, 0.5), on_b=(0, 0, -0.15))
    return build.model()


def gimbal(*, rep: RepName = "gamma") -> Model:
    """Return a gyroscope in a gimbal: outer ring about z, inner ring about x, rotor about z.

    All three turn about one point; the rotor's centre of mass lies above it on its axis.
    """
    build = Multibody("gimbal", dt=0.001, steps=2000,
                      description="Unbalanced rotor in two gimbal rings.")
    at_start = turn((1, 0, 0), 0.7)
    outer = build.top("outer", mass=0.3, inertia=(0.004, 0.0022, 0.0022), centre=(0, 0, 0),
                      rep=rep)
    inner = build.top("inner", mass=0.2, inertia=(0.0011, 0.002, 0.0011), centre=(0, 0, 0),
                      rep=rep, quaternion=at_start)
    rotor = build.top("rotor", mass=0.5, inertia=(0.0008, 0.0008, 0.0015), centre=(0, 0, 0.02),
                      rep=rep, quaternion=at_start)
    axis = rotation(at_start)[:, 2]
    build.align("frame", build.ground, outer, axis=(0, 0, 1), rate=0.5)
    build.align("ring", outer, inner, axis=(1, 0, 0), rate=-0.3)
    build.align("spindle", inner, rotor, axis_in_space=axis, rate=150.0)
    return build.model()


def four_bar(*, rep: RepName = "gamma", rate: float = 3.0) -> Model:
    """Return a closed four-bar linkage in the plane z = 0 whose crank starts at ``rate``.

    Four hinges in space take 20 freedoms from 18 although one remains: three of their equations
    follow from the others, and the last hinge is made without them.
    """
    build = Multibody("four_bar", gravity=(0, -9.81, 0), dt=0.002, steps=2000,
                      description="Planar four-bar linkage: crank, coupler, rocker.")
    rate = float(finite("rate", rate, shape=()))
    points = np.array([[0, 0, 0], [0, 0.4, 0], [0.9, 0.8, 0], [1.0, 0, 0]], dtype=float)
    rates = _loop_rates(points, rate)
    names = ("crank", "coupler", "rocker")
    bars = [_bar(build, name, points[i], points[i + 1], rep) for i, name in enumerate(names)]
    frames: list[Frame] = [build.ground, *bars, build.ground]
    previous = 0.0
    for i, (point, bar_rate) in enumerate(zip(points, [*rates, 0.0], strict=True)):
        build.revolute(f"hinge{i}", frames[i], frames[i + 1], axis=(0, 0, 1), at=point,
                       rate=bar_rate - previous)
        previous = bar_rate
    return build.model(without=("hinge3: z", "hinge3: axis 1", "hinge3: axis 2"))


def delta_robot(*, rep: RepName = "gamma") -> Model:
    """Return a delta robot on springs: three arms and six rods carry a platform that never turns.

    The platform starts at rest beside the middle. Each rod is on two ball joints and free to turn
    about itself: 9 freedoms, of which six are such turns.
    """
    build = Multibody("delta_robot", dt=0.002, steps=2000,
                      description="Delta robot whose arms hang on springs.")
    base_radius, arm, rod, platform_radius, half_gap = 0.2, 0.3, 0.6, 0.06, 0.05  # m
    middle = np.array([0.06, -0.03, -0.55])
    platform = build.body("platform", mass=0.6, inertia=(0.0011, 0.0011, 0.002), rep=rep,
                          position=middle)
    for k in range(3):
        azimuth = 2 * math.pi * k / 3
        radial, tangential = (np.array([math.cos(azimuth), math.sin(azimuth), 0.0]),
                              np.array([-math.sin(azimuth), math.cos(azimuth), 0.0]))
        shoulder, wrist = base_radius * radial, middle + platform_radius * radial
        # The elbow is where the arm's circle about the shoulder meets the rods' sphere: the law of
        # cosines in the arm's plane, from which the wrist is ``off`` away.
        d = wrist - shoulder
        x, z, off = d @ radial, d[2], d @ tangential
        distance = math.hypot(x, z)
        cosine = (arm**2 + distance**2 - rod**2 + off**2) / (2 * arm * distance)
        elevation = math.atan2(z, x) + math.acos(cosine)
        elbow = shoulder + arm * (
            math.cos(elevation) * radial + np.array([0, 0, math.sin(elevation)]))
        upper = build._uniform_rod(f"arm{k}", shoulder, elbow, mass=0.3, rep=rep)
        build.revolute(f"shoulder{k}", build.ground, upper, axis_in_space=tangential, at=shoulder)
        build.spring(f"spring{k}", build.ground, upper, stiffness=40.0, length=0.2,
                     on_a=(base_radius + arm) * radial + (0, 0, 0.3), on_b=(arm / 2, 0, 0))
        for name, offset in (("left", half_gap * tangential), ("right", -half_gap * tangential)):
            lower = build._uniform_rod(
                f"rod{k}_{name}", elbow + offset, wrist + offset, mass=0.08, rep=rep)
            build.ball(f"elbow{k}_{name}", upper, lower, at=elbow + offset)
            build.ball(f"wrist{k}_{name}", lower, platform, at=wrist + offset)
    return build.model()


def stewart_platform(*, rep: RepName = "gamma") -> Model:
    """Return a platform on six sprung legs, each a tube with a rod that slides in it.

    The platform starts at rest, tilted, beside the middle. Each leg is on two ball joints and free
    to turn about itself: 12 freedoms, of which six are such turns.
    """
    build = Multibody("stewart_platform", dt=0.002, steps=2000,
                      description="Stewart platform on six sprung legs.")
    middle, attitude = np.array([0.04, 0.02, 0.6]), turn((0.6, 0.8, 0.0), 0.15)
    platform = build.body("platform", mass=5.0, inertia=(0.08, 0.08, 0.15), rep=rep,
                          position=middle, quaternion=attitude)
    frame = rotation(attitude)
    for k in range(6):
        # legs in pairs: feet 0.4 rad apart about 0°, 120°, 240°, heads likewise 60° further on
        side = 1 if k % 2 else -1
        foot, head = (radius * np.array([math.cos(angle), math.sin(angle), 0.0])
                      for radius, angle in (
                          (0.5, 2 * math.pi * (k // 2) / 3 + 0.2 * side),
                          (0.3, 2 * math.pi * (k // 2) / 3 + (math.pi / 3 - 0.2) * side)))
        top = middle + frame @ head
        along = (top - foot) / np.linalg.norm(top - foot)
        tube = build._uniform_rod(f"tube{k}", foot, foot + 0.35 * along, mass=0.5, rep=rep)
        rod = build._uniform_rod(f"rod{k}", top - 0.35 * along, top, mass=0.3, rep=rep)
        build.ball(f"foot{k}", build.ground, tube, at=foot)
        build.prismatic(f"slide{k}", tube, rod, axis_on_body=(1, 0, 0), at=foot)
        build.ball(f"head{k}", rod, platform, at=top)
        build.spring(f"spring{k}", build.ground, platform, stiffness=4000.0, length=0.68,
                     on_a=foot, on_b=head)
    return build.model()


def chain(count: int = 8, *, rep: RepName = "gamma") -> Model:
    """Return a chain of equal rods on ball joints that hangs from a fixed point.

    Every rod is a body with 7 coordinates, so that all joints and rods have one form. The numbers
    of a long chain are cached, and its system is made when it is first asked for.
    """
    rods = as_integer(count)
    if rods is None or not 1 <= rods <= MOST_RODS:
        raise InputError(f"A chain of {shown(count)} rods cannot be built; give a whole number "
                         f"from 1 to {MOST_RODS}.")
    # an unknown representation is refused by ``build_chain``, and has no key in the cache
    if rods < _MANY_RODS or rep not in REPS:
        return build_chain(rods, rep)
    model: Model = function_of("api", "cached_model")(
        "chain", {"count": rods, "rep": rep}, partial(build_chain, rods, rep))
    return model


def build_chain(rods: int, rep: RepName = "gamma") -> Model:
    """Build the model that ``chain`` returns, without its cache."""
    build = Multibody(f"chain_{rods}", dt=0.002, steps=1000,
                      description=f"{rods} rods on ball joints.")
    parent: Frame = build.ground
    for i in range(rods):
        rod = build.body(
            f"b{i}", mass=0.2, inertia=(0.0017, 0.0015, 0.0002), rep=rep,
            quaternion=quaternion_product(
                turn((1, 0, 0), 0.4 * (-1) ** i), turn((0, 1, 0), 0.05 * i)),
            angular_velocity=(0.2, -0.1, 5.0),
        )
        # the first rod hangs from the origin of space, any other from the end of the one before
        build.ball(f"j{i}", parent, rod, on_a=(0, 0, -0.15) if i else (0.0, 0.0, 0.0),
                   on_b=(0, 0, 0.15))
        parent = rod
    return build.model()


def turn(axis: tuple[float, float, float], angle: float) -> Array:
    """Return the unit quaternion of a rotation by an angle in rad about a unit axis."""
    half = angle / 2
    return np.array([math.cos(half), *(math.sin(half) * x for x in axis)])


def _bar(build: Multibody, name: str, start: Array, end: Array, rep: RepName) -> Body:
    """Add a uniform bar between two points of the plane z = 0, 1 kg/m and a square of 3 cm."""
    along = end - start
    length = float(np.linalg.norm(along))
    e = along / length
    across = length * (length**2 + 0.03**2) / 12
    return build.body(
        name, mass=length, inertia=(length * 0.03**2 / 6, across, across), rep=rep,
        position=(start + end) / 2,
        rotation=np.array([[e[0], -e[1], 0], [e[1], e[0], 0], [0, 0, 1]]),
    )


def _loop_rates(points: Array, rate: float) -> tuple[float, float, float]:
    """Return the bars' angular velocities about z: ω₁ d₁ + ω₂ d₂ + ω₃ d₃ = 0 for their vectors d.

    ``points`` are the four ends of the three bars in m, shape (4, 2) or (4, 3). The velocities
    ω e_z × d of the bars' ends add up to 0 around the closed loop; ω₁ = ``rate`` in rad/s.
    """
    d1, d2, d3 = np.diff(points[:, :2], axis=0)
    second, third = np.linalg.solve(np.stack([d2, d3], axis=1), -rate * d1)
    return rate, float(second), float(third)
