"""Points: on the sphere (Neumann), on an ellipsoid, on a wire that turns, of a mass that grows."""

from __future__ import annotations

from collections.abc import Mapping
from decimal import Context, Decimal
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from .problem import Attempt, Reference

if TYPE_CHECKING:
    from ..generator.multibody.model import Model
    from ..runtime.results.trajectory import Trajectory

__all__ = ["BEAD", "ELLIPSOID", "GROWING_MASS", "NEUMANN"]

_POSITIONS, _VELOCITIES = ("x", "y", "z"), ("x'", "y'", "z'")
_ATTEMPTS = (Attempt("G-L", 4, (100, 250, 500, 1000)), Attempt("G-L", 3, (250, 1000, 4000)),
             Attempt("LIIIA-B", 3, (500, 2000)), Attempt("EMS", None, (1000, 4000)))


def _end(run: Trajectory) -> Mapping[str, Any]:
    """Return positions and velocities of the last state; of mass 1, momenta are velocities."""
    return {"positions": run.q[-1], "velocities": run.p[-1]}


def _neumann() -> Model:
    """Return H = |p|²/2 + (x² + 2y² + 4z²)/2 on |q| = 1, with Uhlenbeck's integrals

    F_i = q_i² + Σ_(j≠i) (q_i p_j − q_j p_i)²/(a_i − a_j),  a = (1, 2, 4).
    """
    import sympy as sp

    from ..generator.multibody.model import Model
    from ..generator.systems.system import System

    q, p, stiff = sp.symbols("x y z", real=True), sp.symbols("px py pz", real=True), (1, 2, 4)
    integrals = {}
    for i in range(3):
        turns = sum((q[i] * p[j] - q[j] * p[i]) ** 2 / sp.Integer(stiff[i] - stiff[j])
                    for j in range(3) if j != i)
        integrals[f"F{i + 1}"] = q[i] ** 2 + turns
    H = sum(x**2 for x in p) / 2 + sum(a * x**2 for a, x in zip(stiff, q, strict=True)) / 2
    system = System(q, p, (), H, (sum(x**2 for x in q) - 1,), name="neumann", quantities=integrals)
    # short decimals with |q| = |p| = 1 and q·p = 0, exactly
    q0, p0 = (np.array([Fraction(x) for x in texts.split()])
              for texts in ("0.6 0.64 0.48", "0.8 -0.48 -0.36"))
    return Model(system, {}, q0, p0)


def _ellipsoid() -> Model:
    """Return H = |p|²/2 on x² + y²/2 + z²/4 = 1, with Joachimsthal's integral.

    J = Σ q_i²/b_i² · Σ p_i²/b_i,  b = (1, 2, 4).

    It starts at (0.6, 0.64 √2, 0.96) along the x axis: the tangential part of (1, 0, 0), of
    length 1.
    """
    import sympy as sp

    from ..generator.multibody.model import Model
    from ..generator.systems.system import System

    q, p, squares = sp.symbols("x y z", real=True), sp.symbols("px py pz", real=True), (1, 2, 4)
    integral = sum(x**2 / sp.Integer(b) ** 2 for x, b in zip(q, squares, strict=True)) * sum(
        x**2 / sp.Integer(b) for x, b in zip(p, squares, strict=True))
    surface = sum(x**2 / sp.Integer(b) for x, b in zip(q, squares, strict=True)) - 1
    system = System(q, p, (), sum(x**2 for x in p) / 2, (surface,), name="ellipsoid",
                    quantities={"J": integral})
    position = [Fraction("0.6"), Fraction("0.64") * _root(2), Fraction("0.96")]
    normal = [x / b for x, b in zip(position, squares, strict=True)]
    normal_squared = sum(x * x for x in normal)
    # e_x − (e_x·n) n/|n|², of length √(1 − n_x²/|n|²)
    tangent = [(i == 0) - normal[0] * x / normal_squared for i, x in enumerate(normal)]
    length = _root(1 - normal[0] ** 2 / normal_squared)
    return Model(system, {}, np.array(position), np.array([x / length for x in tangent]))


def _root(x: Fraction | int) -> Fraction:
    """Return √x as a fraction, correct to 50 digits."""
    digits = Context(prec=50)
    top, bottom = Fraction(x).as_integer_ratio()
    return Fraction(digits.sqrt(digits.divide(Decimal(top), Decimal(bottom))))


def _bead() -> Model:
    """Return a bead of 1 kg, H = |p|²/2 + g y, on a wire that turns at 2 rad/s.

    The wire is the constraint x sin 2t − y cos 2t = 0. At the start the bead is at 1 m and moves
    with the wire: (x', y') = (0, 2) m/s.
    """
    import sympy as sp

    from ..generator.multibody.model import Model
    from ..generator.systems.system import System

    (x, y), p, t = sp.symbols("x y", real=True), sp.symbols("px py", real=True), sp.Symbol("t")
    g = sp.Symbol("g", positive=True)
    system = System((x, y), p, (g,), sum(u**2 for u in p) / 2 + g * y,
                    (x * sp.sin(2 * t) - y * sp.cos(2 * t),), name="bead", time=t)
    parameters: dict[str, Any] = {"g": Fraction("9.81")}
    return Model(system, parameters, np.array([1, 0]), np.array([0, 2]))


def _growing_mass() -> Model:
    """Return the oscillator L = e^(2ct) (v² − k² x²)/2 with c = 1/4 1/s and k = 1 1/s.

    Mass and stiffness grow alike, so x'' + 2c x' + k² x = 0. It starts from rest at x = 1 m.
    """
    import sympy as sp

    from ..generator.multibody.model import Model
    from ..generator.systems.system import System

    x, v, t = sp.symbols("x x_t t", real=True)
    c, k = sp.symbols("c k", positive=True)
    system = System.from_lagrangian(sp.exp(2 * c * t) * (v**2 - k**2 * x**2) / 2, [x], [v], [c, k],
                                    time=t, name="growing_mass")
    parameters: dict[str, Any] = {"c": Fraction("0.25"), "k": Fraction(1)}
    return Model(system, parameters, np.array([1]), np.array([0]))


NEUMANN = Reference(
    name="neumann", title="Neumann's oscillator on a sphere",
    source="H = |p|²/2 + (x² + 2y² + 4z²)/2, q = (0.6, 0.64, 0.48), p = (0.8, −0.48, −0.36)",
    form="Python", make=_neumann, seconds="10",
    groups={"positions": _POSITIONS, "velocities": _VELOCITIES}, read=_end,
    invariants={"energy": "H", **{
        f"F{i}": f"q{i}² + Σ (q{i} p_j − q_j p{i})²/(a{i} − a_j)" for i in (1, 2, 3)}},
    no_bodies="the potential of the point is not gravity",
    attempts=_ATTEMPTS)

ELLIPSOID = Reference(
    name="ellipsoid", title="Geodesic of an ellipsoid with three axes",
    source="x² + y²/2 + z²/4 = 1, from (0.6, 0.64 √2, 0.96) along the x axis at speed 1",
    form="Python", make=_ellipsoid, seconds="10",
    groups={"positions": _POSITIONS, "velocities": _VELOCITIES}, read=_end,
    invariants={"energy": "|p|²/2", "J": "(Σ q²/b²)(Σ p²/b)"},
    no_bodies="no joint constrains a point to an ellipsoid",
    attempts=_ATTEMPTS)

BEAD = Reference(
    name="bead", title="Bead on a rotating wire in a vertical plane",
    source="closed form: r = cosh wt + (g/2w²)(sin wt − sinh wt), w = 2 rad/s, r(0) = 1 m",
    form="Python", make=_bead, seconds="1.5",
    groups={"positions": ("x", "y"), "velocities": ("x'", "y'")}, read=_end,
    invariants={"energy balance": "H − ∫ λ·g_t dt"},
    no_bodies="the wire has a prescribed rotation",
    attempts=(Attempt("G-L", 4, (10, 25, 50, 100)), Attempt("G-L", 3, (25, 100, 400)),
              Attempt("EMS", None, (400, 1600))))

GROWING_MASS = Reference(
    name="growing-mass", title="Oscillator with growing mass and stiffness",
    source="Caldirola and Kanai: L = e^(2ct) (x'² − k² x²)/2, c = 1/4 1/s, k = 1 1/s, from rest at "
           "1 m; x = e^(−ct) (cos Ωt + (c/Ω) sin Ωt), Ω² = k² − c²",
    form="Lagrangian", make=_growing_mass, seconds="10",
    groups={"positions": ("x",), "velocities": ("x'",)},
    read=lambda run: {"positions": run.q[-1], "velocities": run.velocities[-1]},
    invariants={"energy balance": "H − ∫ H_t dt"},
    no_bodies="no body has a time-dependent mass",
    attempts=(Attempt("G-L", 4, (10, 25, 50, 100)), Attempt("G-L", 3, (25, 100, 400)),
              Attempt("EMS", None, (400, 1600))))
