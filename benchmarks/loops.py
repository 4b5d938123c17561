"""Closed loops with one degree of freedom, by quadrature: t(s) = ∫ √(m/2(E − V)) dθ.

Each loop returns its ``Place`` at a coordinate θ: the points that are compared, their velocities
per θ', the mass m = 2T/θ'² and the potential V. They use nothing of the engine.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mpmath as mp

from .exact_motions_mp import Numbers

__all__ = ["bennett", "bricard", "four_bars", "slider_crank"]

Vector = Sequence[Any]
_G = "9.81"


@dataclass(frozen=True)
class Place:
    """A loop at one value of its coordinate; velocities are per rate of it."""

    mass: Any
    potential: Any
    points: Sequence[Vector]
    velocities: Sequence[Vector]


def four_bars(c: Any, t: Any) -> Numbers:
    """Return sin φ and cos φ of φ'' = c sin φ, φ = 0, φ' = 1: φ grows all the time."""
    phi = _reached(lambda phi: 1 / mp.sqrt(1 + 2 * c * (1 - mp.cos(phi))), t)
    return {"positions": [mp.sin(phi), mp.cos(phi)]}


def slider_crank(t: Any) -> Numbers:
    """Return the spatial slider-crank by its crank's angle, which grows all the time."""
    begin = _slider_crank(mp.mpf(0))
    energy = begin.mass * 18 + begin.potential

    def rate(angle: Any) -> Any:
        state = _slider_crank(angle)
        return mp.sqrt(2 * (energy - state.potential) / state.mass)

    angle = _reached(lambda a: 1 / rate(a), t)
    state, speed = _slider_crank(angle), rate(angle)
    (_, y, z), (x, _, _) = state.points
    (_, vy, vz), (vx, _, _) = state.velocities
    return {"positions": [y, z, x], "velocities": [speed * v for v in (vy, vz, vx)]}


def _slider_crank(angle: Any) -> Place:
    """Return the slider-crank at an angle of its crank.

    The conrod's vector X, x at the start, stays perpendicular to y and at its angle to the rod.
    """
    length, arm = mp.mpf("0.3"), mp.mpf("0.08")
    out, up = [0, -mp.sin(angle), mp.cos(angle)], [0, -mp.cos(angle), -mp.sin(angle)]
    crank = [mp.mpf(0), mp.mpf("0.1"), mp.mpf("0.12")]
    B = [c + arm * x for c, x in zip(crank, out, strict=True)]
    vB = [arm * x for x in up]
    x = mp.sqrt(length**2 - _dot(B, B))
    C, vC = [x, mp.mpf(0), mp.mpf(0)], [-_dot(B, vB) / x, mp.mpf(0), mp.mpf(0)]
    d, rate = (_times(1 / length, _minus(*ends)) for ends in ((C, B), (vC, vB)))
    turn = mp.atan2(d[2], d[0]) + mp.acos(mp.mpf(2) / 3 / mp.hypot(d[0], d[2]))
    X = [mp.cos(turn), mp.mpf(0), mp.sin(turn)]
    across = _cross(d, rate)
    spin = -_cross(across, X)[1] / _cross(d, X)[1]
    centre = _times(mp.mpf(1) / 2, _plus(vB, vC))
    mass = (mp.mpf("1e-4") + mp.mpf("0.12") * (arm / 2) ** 2 + _dot(centre, centre) / 2
            + mp.mpf("4e-3") * _dot(across, across) + mp.mpf("4e-4") * spin**2 + 2 * vC[0] ** 2)
    height = mp.mpf("0.12") * (crank[2] + B[2]) / 2 + B[2] / 4
    return Place(mass, mp.mpf(_G) * height, [B, C], [vB, vC])


def bricard(t: Any, rate: str = "0") -> Numbers:
    """Return Bricard's mechanism of IFToMM A04 by the angle of its first hinge, 0 at the start.

    From rest it is between 0 and π; with a rate it passes both to the same height, short of −π/6,
    where the other hinges would turn back.
    """
    begin, near = _bricard(mp.mpf(0)), mp.mpf(0)
    if lift := begin.mass * mp.mpf(rate) ** 2 / 2:
        near = mp.findroot(lambda a: _bricard(a).potential - begin.potential - lift,
                           (_NEAR, 0), solver="ridder")
    state, _ = _swing(_bricard, mp.pi - near, t, near)
    (x, _, z), third = state.points
    return {"positions": [x, z, *third]}


#: A little more than −π/6.
_NEAR = -0.52


def _bricard(theta: Any) -> Place:
    """Return Bricard's mechanism with turns θ, φ, θ, φ, θ, φ and (1 + sin θ)(1 + sin φ) = 1.

    Sections are 0.1 m square.
    """
    phi = mp.asin(1 / (1 + mp.sin(theta)) - 1)
    slope = -mp.cos(theta) * (1 + mp.sin(phi)) / (1 + mp.sin(theta)) / mp.cos(phi)
    x, y, z = ([mp.mpf(i == k) for i in range(3)] for k in range(3))
    first = [(y, 1), (z, slope), (x, 1)]  # hinges 0, 1, 2 with their rates
    last = [(x, -slope), (z, -1)]  # hinges 5 and 4, backwards
    rods = [*_chain(first, [theta, phi, theta], [0, 0, 0], [x, _times(-1, y), z]),
            *_chain(last, [-phi, -theta], [0, 0, 1], [_times(-1, y), x])]
    mass, potential = _energies(rods, mp.mpf("1.01") / 12, mp.mpf("0.01") / 6, y)
    ends = [rods[0], rods[4]]
    return Place(mass, potential, [rod.end for rod in ends], [rod.end_rate for rod in ends])


def bennett(t: Any) -> Numbers:
    """Return Bennett's linkage of four equal links by the angle of its hinge at A, from rest."""
    start = _bennett(mp.mpf(0)).potential
    far = mp.findroot(lambda a: (_bennett(a).potential - start) / a, _FAR)
    state, rate = _swing(_bennett, far, t)
    return {"positions": [x for point in state.points for x in point],
            "velocities": [rate * v for velocity in state.velocities for v in velocity]}


#: About where Bennett's linkage turns back.
_FAR = 3.6


def _bennett(theta: Any) -> Place:
    """Return Bennett's linkage: tan ½A tan ½B = 16/25 of the angles at A and B.

    Both are 2 atan 4/5 at the start.
    """
    A, B, C, D = ([mp.mpf(x) for x in point.split()] for point in (
        "0.8 0 -0.3", "0 0.8 0.3", "-0.8 0 -0.3", "0 -0.8 0.3"))
    k = mp.mpf(16) / 25
    half = mp.tan(mp.atan(mp.mpf(4) / 5) + theta / 2)
    phi = 2 * (mp.atan(k / half) - mp.atan(mp.mpf(4) / 5))
    slope = -k * (1 + half**2) / (half**2 + k**2)
    at_a, at_b, at_d = ([mp.mpf(x) for x in axis.split()] for axis in (
        "0.6 0 0.8", "0 0.6 -0.8", "0 -0.6 -0.8"))
    DA, = _chain([(at_a, 1)], [theta], A, [_minus(D, A)])
    BC, = _chain([(at_b, slope)], [phi], B, [_minus(C, B)])
    axis, along = _turned(at_a, theta, at_d), _minus(BC.end, DA.end)
    lever = _cross(axis, along)
    past = _minus(_minus(BC.end_rate, DA.end_rate), _cross(DA.turn, along))
    turn = _plus(DA.turn, _times(_dot(past, lever) / _dot(lever, lever), axis))
    rods = [DA, BC, LoopRod(DA.end, along, DA.end_rate, turn)]
    mass, potential = _energies(rods, mp.mpf("1.65") / 12, mp.mpf("0.01") / 6,
                                [mp.mpf(0), mp.mpf(0), mp.mpf(1)])
    return Place(mass, potential, [BC.end, DA.end], [BC.end_rate, DA.end_rate])


# ---------------------------------------------------------------- time


def _swing(loop: Callable[[Any], Place], far: Any, t: Any, near: Any = 0) -> tuple[Place, Any]:
    """Return the state at t of a loop that starts at 0, and its rate.

    The loop turns back at ``near`` and ``far``.
    θ = near + ½ (far − near) (1 − cos s): dt/ds has no singularity where it turns back.
    """
    near, half = mp.mpf(near), (far - near) / 2
    energy = loop(near).potential

    def state_at(s: Any) -> Place:
        return loop(near + half * (1 - mp.cos(s)))

    def speed(s: Any) -> Any:
        state = state_at(s)
        return abs(half * mp.sin(s)) * mp.sqrt(state.mass / 2 / (energy - state.potential))

    s = _reached(speed, t, mp.acos(1 + near / half))
    return state_at(s), half * mp.sin(s) / speed(s)


def _reached(slope: Callable[[Any], Any], t: Any, s: Any = 0, piece: float = 0.25) -> Any:
    """Return where ∫ slope from s on is t, for slope > 0: by pieces, and Newton in the last.

    Pieces end at multiples of π/4: at multiples of π a slope may have a limit and no value.
    """
    step, remaining = mp.pi * piece, t
    number = mp.floor(s / step) + 1
    while (increment := mp.quadgl(slope, [s, number * step])) <= remaining:
        s, remaining, number = number * step, remaining - increment, number + 1
    for _ in range(60):
        ds = remaining / slope(s + step * mp.mpf("1e-9"))
        remaining -= mp.quadgl(slope, [s, s + ds])
        s += ds
        if abs(remaining) < mp.mpf(10) ** (8 - mp.mp.dps):
            break
    return s


# ---------------------------------------------------------------- rods


@dataclass(frozen=True)
class LoopRod:
    """A rod of 1 kg from a point along a vector; rates are per rate of the coordinate."""

    begin: Vector
    along: Vector
    begin_rate: Vector
    turn: Vector

    @property
    def end(self) -> Vector:
        """Its end point."""
        return _plus(self.begin, self.along)

    @property
    def end_rate(self) -> Vector:
        """The velocity of its end."""
        return _plus(self.begin_rate, _cross(self.turn, self.along))


def _chain(hinges: Sequence[tuple[Vector, Any]], angles: Sequence[Any], begin: Vector,
           along: Sequence[Vector]) -> list[LoopRod]:
    """Return rods from hinge to hinge, with axes and directions at the start."""
    rods: list[LoopRod] = []
    point: Vector = begin
    rate: Vector = [mp.mpf(0)] * 3
    turn: Vector = rate
    for k, (axis, speed) in enumerate(hinges):
        space_axis: Vector = axis
        for j in reversed(range(k)):
            space_axis = _turned(hinges[j][0], angles[j], space_axis)
        turn = _plus(turn, _times(speed, space_axis))
        vector = along[k]
        for j in reversed(range(k + 1)):
            vector = _turned(hinges[j][0], angles[j], vector)
        rods.append(LoopRod(point, vector, rate, turn))
        point, rate = rods[-1].end, rods[-1].end_rate
    return rods


def _energies(
    rods: Sequence[LoopRod], across: Any, own_inertia: Any, up: Vector
) -> tuple[Any, Any]:
    """Return 2T/θ'² and V of rods of 1 kg with moments across and about their axis."""
    mass, height = mp.mpf(0), mp.mpf(0)
    for rod in rods:
        v = _times(mp.mpf(1) / 2, _plus(rod.begin_rate, rod.end_rate))
        spin = _dot(rod.turn, rod.along) ** 2 / _dot(rod.along, rod.along)
        mass += _dot(v, v) + across * (_dot(rod.turn, rod.turn) - spin) + own_inertia * spin
        height += _dot(up, _plus(rod.begin, rod.end)) / 2
    return mass, mp.mpf(_G) * height


def _turned(axis: Vector, angle: Any, v: Vector) -> Vector:
    """Return a vector turned about a unit axis, by Rodrigues' formula."""
    c, s = mp.cos(angle), mp.sin(angle)
    return [c * x + s * y + (1 - c) * _dot(axis, v) * n
            for x, y, n in zip(v, _cross(axis, v), axis, strict=True)]


def _plus(a: Vector, b: Vector) -> Vector:
    return [x + y for x, y in zip(a, b, strict=True)]


def _minus(a: Vector, b: Vector) -> Vector:
    return [x - y for x, y in zip(a, b, strict=True)]


def _times(k: Any, v: Vector) -> Vector:
    return [k * x for x in v]


def _dot(a: Vector, b: Vector) -> Any:
    return sum(x * y for x, y in zip(a, b, strict=True))


def _cross(a: Vector, b: Vector) -> Vector:
    (a1, a2, a3), (b1, b2, b3) = a, b
    return [a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1]
