"""Linkages of rigid bodies on joints, redundant constraints left out by themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from .problem import Attempt, Published, Reference

if TYPE_CHECKING:
    from ..generator.multibody.model import Model
    from ..generator.multibody.multibody import Multibody
    from ..runtime.results.trajectory import Trajectory

__all__ = ["BENNETT", "BRICARD", "BRICARD_PUSHED", "FOUR_BAR", "FOUR_BARS", "PARALLELOGRAM",
           "SLIDER_CRANK", "four_bars"]

_AXES = {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}
#: Largest denominator of a number of these models, and the largest relative error of its double.
_DENOMINATOR, _ROUNDING = 10**5, Fraction(1, 2**46)


def _exact_model(build: Multibody, *without: str) -> Model:
    """Return the model with exact parameters, q0 and p0: 1/12, not 0.08333….

    ``without`` names constraints to leave out; other redundant ones are left out automatically.
    Raises ArithmeticError for a number that is no fraction with a denominator up to 10^5.
    """
    # the builder computes in doubles; fractions near them make a start for any precision
    model = build.model(without=without, redundant="leave out")

    def fraction(value: Any) -> Fraction:
        """Return the short fraction that a double is to rounding, or raise ArithmeticError."""
        double = Fraction(float(value))
        nearby = double.limit_denominator(_DENOMINATOR)
        if abs(nearby - double) > _ROUNDING * (1 + abs(double)):
            raise ArithmeticError(f"{value} in {model.name} is no fraction with a denominator up "
                                  f"to {_DENOMINATOR:,}.")
        return nearby

    parameters: dict[str, Any] = {name: fraction(x) for name, x in model.parameters.items()}
    q0, p0 = (np.array([fraction(x) for x in state]) for state in (model.q0, model.p0))
    return replace(model, parameters=parameters, q0=q0, p0=p0)


def _at(run: Trajectory, body: str) -> tuple[Any, Any]:
    """Return position and momentum of a body's centre at the end of a run, three numbers each."""
    first = run.coordinates.index(f"{body}_x")
    return run.q[-1, first : first + 3], run.p[-1, first : first + 3]


def rod_inertia(along: Sequence[Fraction]) -> tuple[tuple[Fraction, ...], ...]:
    """Return the inertia of a rod of 1 kg and square section, b = 0.1 m wide, in space axes.

    J = I₁ (1 − e eᵀ) + I₃ e eᵀ, a 3 × 3 matrix, with I₁ = (l² + b²)/12 across and I₃ = b²/6 along
    the rod. ``along`` is the vector l e from one end of the rod to the other, in m.
    """
    length_squared, width_squared = sum(x * x for x in along), Fraction("0.01")
    across, axial = (length_squared + width_squared) / 12, width_squared / 6

    def entry(i: int, j: int) -> Fraction:
        """Return J_ij = I₁ δ_ij − (I₁ − I₃) e_i e_j, with e eᵀ = along alongᵀ/l²: no root."""
        deviation = (across - axial) * along[i] * along[j] / length_squared
        return (across if i == j else 0) - deviation

    return tuple(tuple(entry(i, j) for j in range(3)) for i in range(3))


# ---------------------------------------------------------------- four-bars in a row


def four_bars(count: int) -> Model:
    """Return ``count`` four-bar linkages of rods in a row, upright, at 1 rad/s (IFToMM A02).

    Rods v0, v1, … of 1 m and 1 kg stand on the ground 1 m apart; rods c1, c2, … join their ends.
    """
    from ..generator.multibody.multibody import Multibody

    build = Multibody(f"a02_{count}", gravity=(0, -9.81, 0))
    # slender rods, 1/12 across; along the rod a moment that the plane motion does not use
    upright, lying = (1 / 12, 1e-3, 1 / 12), (1e-3, 1 / 12, 1 / 12)
    for i in range(count + 1):
        build.body(f"v{i}", mass=1, inertia=upright, position=(i, 0.5, 0), velocity=(0.5, 0, 0),
                   angular_velocity=(0, 0, -1.0))
        if i:
            build.body(f"c{i}", mass=1, inertia=lying, position=(i - 0.5, 1, 0), velocity=(1, 0, 0))
    for i in range(count + 1):
        build.revolute(f"g{i}", "ground", f"v{i}", axis=(0, 0, 1), at=(i, 0, 0))
    for i in range(1, count + 1):
        build.revolute(f"l{i}", f"v{i - 1}", f"c{i}", axis=(0, 0, 1), at=(i - 1, 1, 0))
        build.revolute(f"r{i}", f"c{i}", f"v{i}", axis=(0, 0, 1), at=(i, 1, 0))
    return build.model(redundant="leave out")


def _b0(run: Trajectory) -> Mapping[str, Any]:
    """Return x and y of the upper end B0 of the first rod, whose lower end is the origin."""
    centre, _ = _at(run, "v0")
    return {"positions": 2 * centre[:2]}


_A02 = "IFToMM library of multibody problems, A02"
FOUR_BAR = Reference(
    name="four-bar", title="Two four-bar linkages in a row, five bodies",
    source=f"{_A02} with N = 2: through its change points",
    form="bodies and joints", make=lambda: four_bars(2), seconds="10",
    groups={"positions": ("x_B0", "y_B0")}, read=_b0, invariants={"energy": "T + V"},
    attempts=(Attempt("G-L", 3, (1000, 2500, 5000)),),
    published=Published("EXUDYN, TestModels/fourBarMechanismIftomm.py, h = 1.25e-4 s",
                        {"x_B0": "0.3284573768"}))

FOUR_BARS = Reference(
    name="four-bars-40", title="Forty four-bar linkages in a row, 81 bodies",
    source=f"{_A02} with N = 40: 1 degree of freedom, 41 where the rods are level",
    form="bodies and joints", make=lambda: four_bars(40), seconds="10",
    groups={"positions": ("x_B0", "y_B0")}, read=_b0, invariants={"energy": "T + V"},
    attempts=(Attempt("G-L", 3, (1000, 2500)),))

PARALLELOGRAM = Reference(
    name="parallelogram", title="Parallelogram of rods, 104 passages of singular configurations",
    source=f"{_A02} with N = 1, for 100 s: the rods can fold where they are level",
    form="bodies and joints", make=lambda: four_bars(1), seconds="100",
    groups={"positions": ("x_B0", "y_B0")}, read=_b0, invariants={"energy": "T + V"},
    attempts=(Attempt("G-L", 4, (10000, 20000)), Attempt("G-L", 3, (20000, 50000))))


# ---------------------------------------------------------------- spatial loops


def _bricard(rate: float = 0.0) -> Model:
    """Return Bricard's loop: five rods along edges of a cube, and the ground as the sixth.

    Hinges begin to turn at ``rate``, with alternating signs.
    """
    from ..generator.multibody.multibody import Multibody

    points = [(0, 0, 0), (1, 0, 0), (1, -1, 0), (1, -1, 1), (0, -1, 1), (0, 0, 1)]
    build = Multibody("bricard", gravity=(0, -9.81, 0))
    names = ["ground", *(f"rod{i}" for i in range(5)), "ground"]
    # rods lie along the axes of space, so that their inertia is diagonal there
    for name, a, b in zip(names[1:], points, points[1:], strict=False):
        inertia = rod_inertia([Fraction(y - x) for x, y in zip(a, b, strict=True)])
        build.body(name, mass=1, inertia=[float(inertia[i][i]) for i in range(3)],
                   position=np.add(a, b) / 2)
    # Σ ±e_i = 0 and Σ ±e_i × x_i = 0: with alternating rates the loop stays closed
    for i, (axis, point) in enumerate(zip("yzxyzx", points, strict=True)):
        build.revolute(f"h{i}", names[i], names[i + 1], axis=_AXES[axis], at=point,
                       rate=rate * (-1) ** i)
    return _exact_model(build)


def _bricard_end(run: Trajectory) -> Mapping[str, Any]:
    """Return x and z of P1, and P3: the ends of the first and the third rod.

    y of P1 stays 0. From the centres x_i of rods: P1 = 2 x_0, and from the other end of the chain
    P4 = 2 x_4 − (0, 0, 1) and P3 = 2 x_3 − P4.
    """
    (first, _), (third, _), (fourth, _) = (_at(run, f"rod{i}") for i in (0, 3, 4))
    return {"positions": [*(2 * first[::2]), *(2 * third - 2 * fourth + [0, 0, 1])]}


BRICARD = Reference(
    name="bricard", title="Bricard's mechanism, five rods on six hinges",
    source="IFToMM library of multibody problems, A04: rods of 1 m and 1 kg, 0.1 m square",
    form="bodies and joints", make=_bricard, seconds="10",
    groups={"positions": ("x_P1", "z_P1", "x_P3", "y_P3", "z_P3")}, read=_bricard_end,
    invariants={"energy": "T + V"},
    attempts=(Attempt("G-L", 3, (250, 500, 1000)), Attempt("G-L", 4, (250, 500)),
              Attempt("G-L", 2, (500, 1000, 2000))))

BRICARD_PUSHED = replace(
    BRICARD, name="bricard-pushed", title="Bricard's mechanism, pushed",
    source=f"{BRICARD.source}; initial hinge rates of ±2 rad/s, so that it passes the turning "
           "point of the motion from rest", make=lambda: _bricard(2.0),
    attempts=(Attempt("G-L", 3, (500, 1000, 2000)), Attempt("G-L", 4, (250, 500, 1000))))


def _bennett() -> Model:
    """Return a skew rhombus with each hinge across its two links: three redundant constraints.

    Three of the five constraints of the last hinge, A, are left out. In exact arithmetic any two
    that are independent at the start would do. x and axis 2 are independent all the way; x and y,
    which differ most at the start, become almost dependent half way: 4000 steps of 3-G-L then have
    an error of 4e-11, all of it round-off, instead of 1e-15.
    """
    from ..generator.multibody.multibody import Multibody

    corners = {"A": (".8", "0", "-.3"), "B": ("0", ".8", ".3"), "C": ("-.8", "0", "-.3"),
               "D": ("0", "-.8", ".3")}
    axes = {"A": (0.6, 0, 0.8), "B": (0, 0.6, -0.8), "C": (-0.6, 0, 0.8), "D": (0, -0.6, -0.8)}
    points = {name: np.array([Fraction(x) for x in texts]) for name, texts in corners.items()}
    build = Multibody("bennett")  # the fourth rod, AB, is the ground
    for a, b in map(tuple, ("BC", "CD", "DA")):
        inertia = np.array(rod_inertia(points[b] - points[a]), dtype=float)
        build.body(a + b, mass=1, inertia=inertia,
                   position=((points[a] + points[b]) / 2).astype(float))
    for corner, a, b in (("B", "ground", "BC"), ("C", "BC", "CD"), ("D", "CD", "DA"),
                         ("A", "DA", "ground")):
        build.revolute(corner, a, b, axis=axes[corner], at=points[corner].astype(float))
    return _exact_model(build, "A: y", "A: z", "A: axis 1")


def _bennett_end(run: Trajectory) -> Mapping[str, Any]:
    """Return positions and velocities of C and D, the ends of the links that turn about B and A.

    From the centres x: C = 2 x_BC − B and D = 2 x_DA − A. Momenta are velocities, of 1 kg.
    """
    (bc, v_bc), (da, v_da) = _at(run, "BC"), _at(run, "DA")
    # 10 B and 10 A in whole numbers: 0.8 and 0.3 are no doubles
    C, D = ((20 * x - other_end) / 10 for x, other_end in ((bc, [0, 8, 3]), (da, [8, 0, -3])))
    return {"positions": [*C, *D], "velocities": [*(2 * v_bc), *(2 * v_da)]}


_CORNERS = tuple(f"{axis}_{corner}" for corner in "CD" for axis in "xyz")
BENNETT = Reference(
    name="bennett", title="Bennett's linkage, four hinges in space",
    source="rods of 1 kg, 0.1 m square, between (0.8, 0, −0.3), (0, 0.8, 0.3), (−0.8, 0, −0.3), "
           "(0, −0.8, 0.3), each hinge across its two rods, the first rod fixed, from rest",
    form="bodies and joints", make=_bennett, seconds="5",
    groups={"positions": _CORNERS, "velocities": tuple(f"{x}'" for x in _CORNERS)},
    read=_bennett_end, invariants={"energy": "T + V"},
    attempts=(Attempt("G-L", 4, (125, 150, 200)), Attempt("G-L", 3, (150, 250, 500, 1000))))


def _slider_crank() -> Model:
    """Return the spatial slider-crank as bodies and joints in exact numbers.

    The crank turns about x, its pin at (0, 0.1, 0.2); the rod, along (2, −1, −2)/3, leads to the
    slider on the x axis at 0.2 m. The velocities follow from the crank's 6 rad/s.
    """
    from ..generator.multibody.multibody import Multibody

    build = Multibody("slider_crank_3d")
    rod = np.array([2, -1, -2]) / 3
    # J = I₁ (1 − e eᵀ) + I₃ e eᵀ with I₁ = 0.004 across the rod e and I₃ = 0.0004 along it
    inertia = 0.004 * np.eye(3) - 0.0036 * np.outer(rod, rod)
    build.body("crank", mass=0.12, inertia=(1e-4, 1e-4, 1e-5), position=(0, 0.1, 0.16),
               angular_velocity=(6, 0, 0), velocity=(0, -0.24, 0))
    build.body("conrod", mass=0.5, inertia=inertia, position=(0.1, 0.05, 0.1),
               angular_velocity=(2.4, -1.2, 0), velocity=(0.12, -0.24, 0))
    build.body("slider", mass=2, inertia=(1e-4, 1e-4, 1e-4), position=(0.2, 0, 0),
               velocity=(0.24, 0, 0), angular_velocity=(0, 0, 0))
    build.revolute("bearing", "ground", "crank", axis=(1, 0, 0), at=(0, 0.1, 0.12))
    build.ball("pin", "crank", "conrod", at=(0, 0.1, 0.2))
    build.universal("cross", "conrod", "slider", axis_a=(1, 0, 0), axis_b=(0, 1, 0),
                    at=(0.2, 0, 0))
    build.prismatic("guide", "ground", "slider", axis=(1, 0, 0), at=(0, 0, 0))
    return _exact_model(build)


def _slider_crank_end(run: Trajectory) -> Mapping[str, Any]:
    """Return y and z of the crank's pin and x of the slider, and their velocities.

    From the crank's centre x: pin = 2 x − bearing, bearing = (0, 0.1, 0.12) m. Velocities are
    2 p/m of the crank, m = 0.12 kg, and p/m of the slider, m = 2 kg.
    """
    # whole numbers and 50/3 in place of 0.1 and 2/0.12: the former are exact in every type
    (crank, push), (slider, slide) = _at(run, "crank"), _at(run, "slider")
    pin = (200 * crank[1:] - [10, 12]) / 100
    return {"positions": [*pin, slider[0]], "velocities": [*(push[1:] * 50 / 3), slide[0] / 2]}


SLIDER_CRANK = Reference(
    name="slider-crank", title="Spatial slider-crank, rigid",
    source="IFToMM library of multibody problems: crank 0.08 m at 6 rad/s, rod 0.3 m with its "
           "slender axis in it; the cross at the slider has its arms along x in the rod and "
           "along y in the slider, as in EXUDYN",
    form="bodies and joints", make=_slider_crank, seconds="5",
    groups={"positions": ("y_B", "z_B", "x_C"), "velocities": ("y_B'", "z_B'", "x_C'")},
    read=_slider_crank_end, invariants={"energy": "T + V"},
    attempts=(Attempt("G-L", 4, (1000, 2000, 4000)), Attempt("G-L", 3, (1000, 2000, 4000))),
    published=Published("one of three submissions, by P. Masarati; their angles differ by 5 %",
                        {"x_C": "0.2517906"}))
