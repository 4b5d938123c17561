"""A system in scaled time: dt = σ(q, p, t) dτ makes steps adapt, and keeps them symplectic.

    H̃(q, t, p, e) = σ (H(q, p, t) + e),   F̃ = (σ F, −σ F·H_p),   0 = g(q, t)

t is the last coordinate, and e its momentum with e = −H at the start. On H + e = 0 the motion is
that of H in the time t with t' = σ, and the multipliers are σ times those of H. Constant steps Δτ
are steps Δt = ∫σ dτ of a method that is symplectic in (q, t, p, e) (Hairer, Lubich and Wanner,
Geometric Numerical Integration, VIII.2; E. Hairer, Appl. Numer. Math. 25 (1997) 219-227; S. Reich,
SIAM J. Numer. Anal. 36 (1999) 1549-1570).

e is −H − W, W the work of forces and of explicit time dependence: it is constant without both.
Named scales σ are in ``scales.py``.
"""

from __future__ import annotations

from dataclasses import field, fields

import sympy as sp

from ...core.arguments import few
from ...core.errors import InputError
from ...core.incompatibilities import refuse_together
from ...core.records import dataclass
from .expression_arguments import refuse_other_assumptions
from .lagrangian import LagrangianSystem
from .moving_frame import TransformedSystem
from .system import System

__all__ = ["ScaledSystem", "refuse_unscalable", "scale_time", "shown_count"]


@dataclass(frozen=True)
class ScaledSystem(TransformedSystem):
    """The system in τ, with t among its coordinates; ``energy`` is H(q, p, t).

    Parameters
    ----------
    scale : Expr
        σ(q, p, t) = dt/dτ.
    scale_name : str
        Name of the quantity σ of trajectories.
    """

    scale: sp.Expr = field(default=sp.Integer(1), kw_only=True)
    scale_name: str = field(default="", kw_only=True)

    @property
    def defining(self) -> dict[str, sp.Expr]:
        """H, σ, and the other expressions on which derived C depends, besides g and F."""
        return {**super().defining, "scale": self.scale}

    @property
    def conserved_function(self) -> sp.Expr:
        """H + e, which is 0 along the motion."""
        return self.energy + self.p[-1]


def scale_time(system: System) -> System:
    """Return the system in scaled time, dt = σ dτ; a system without a ``time_scale`` unchanged.

    t becomes a coordinate with the momentum e, and σ (H + e) the Hamiltonian, which is 0 at the
    start: e = −H. Forces become σ F, and e changes by their power, −σ F·H_p.
    """
    scale = system.time_scale
    if scale is None:
        return system
    reserved = {str(s) for s in (*system.q, *system.p, *system.parameters)} | {*system.quantities}
    t = system.time or _symbol("t", reserved)
    e = _symbol("p_t", reserved | {str(t)})
    name = str(_symbol("time_scale", reserved | {str(t), str(e)}))
    # without forces the sum is empty
    power = sp.Add(*(F * v for F, v in zip(system.forces, system.H_p, strict=False)))
    forces = (*(scale * F for F in system.forces), -scale * power) if system.forces else ()
    # e is not constant where H, σ or g depends on t: forces of 0 make the step record the work
    if not forces and any(t in x.free_symbols for x in (system.H, scale, *system.constraints)):
        forces = (sp.Integer(0),) * (system.n + 1)
    parts = {field.name: getattr(system, field.name) for field in fields(System)}
    return ScaledSystem(**parts | {
        "q": (*system.q, t), "p": (*system.p, e), "H": scale * (system.H + e), "forces": forces,
        "time": None, "time_scale": None, "energy": system.H, "scale": scale,
        "scale_name": name, "quantities": {**system.quantities, name: scale}})


def shown_count(system: System) -> int:
    """Return how many coordinates users see: all but the time of a system in scaled time."""
    return system.n - isinstance(system, ScaledSystem)


def _symbol(name: str, reserved: set[str]) -> sp.Symbol:
    """Return a real symbol; "_" is appended to a name that is reserved."""
    while name in reserved:
        name += "_"
    return sp.Symbol(name, real=True)


def refuse_unscalable(system: System) -> None:
    """Refuse a time scale that is no positive function of q, p, t and parameters, and systems
    without equations in scaled time.

    Raises
    ------
    InputError
        Naming the symbol or the part of the system, and the cure.
    """
    scale = system.time_scale
    assert scale is not None
    about = f"time_scale of system {system.name!r}"
    refuse_together(
        scaled=about,
        velocity_constraints=system.velocity_count > 0
        and f"velocity constraints, {few(system.velocity_constraint_names)}",
        inputs=bool(system.inputs) and f"inputs, {few(system.inputs)}",
        lagrangian=isinstance(system, LagrangianSystem) and "a Lagrangian in place of H")
    allowed = {*system.q, *system.p, *system.parameters, *filter(None, (system.time,))}
    unknown = scale.free_symbols - allowed
    if unknown:
        refuse_other_assumptions("time_scale", system.name, unknown, allowed)
        raise InputError(f"{about} contains the unknown symbol {min(map(str, unknown))!r}; declare "
                         "it in q, p, parameters or as time.")
    if scale.is_nonpositive:
        raise InputError(f"{about} is {scale}, which is never positive; dt = time_scale dtau must "
                         "go forwards: give a positive function, such as r**1.5.")
