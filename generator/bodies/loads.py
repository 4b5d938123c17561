"""What acts on bodies: potentials, forces, torques, motors and drives; and what is computed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from ...arguments import as_flag, as_text
from ...errors import InputError
from ...naming import shown
from ..algebra.derivatives import derivative
from ..algebra.evaluation import evaluate
from ..systems.given import as_expression
from .bodies import Body, Moving, cross, dot, three_expressions
from .joints import Align, Drive, Revolute, angle_parts, direction, unit_vector
from .linkage import Linkage
from .poses import finite, three_or_none

__all__ = ["Loads"]


class Loads(Linkage):
    """Bodies, what joins them, and what acts on them."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.time = sp.Symbol("t", real=True)
        self.angle, self.rate = sp.symbols("angle rate", real=True)
        self._values: dict[str, float] = {}
        self._potential: list[sp.Expr] = []
        self._forces: dict[sp.Symbol, sp.Expr] = {}
        self._quantities: dict[str, sp.Expr] = {}

    def potential(self, expression: Any) -> None:
        """Add to H: an expression in the bodies' symbols and ``parameter``s.

        It may contain momenta, as −n·l does for axes that turn at n.
        """
        self._potential.append(as_expression(expression))

    def parameter(self, name: str, value: float, *, positive: bool = False) -> sp.Symbol:
        """Return a symbol for potentials, forces and quantities, with its value."""
        self._claim(name)
        domain = {"positive": True} if as_flag("positive", positive) else {"real": True}
        self._values[name] = float(finite(f"parameter {name!r}", value, ()))
        self._symbols[name] = sp.Symbol(name, **domain)
        return self._symbols[name]

    def force(
        self, body: Body | str, force: Sequence[Any], *, on_body: ArrayLike | None = None
    ) -> None:
        """Let a force (in space axes, N) act at a point of a body, or of the body of that name.

        By default it acts at the body's origin. Its components are expressions of the bodies'
        symbols, momenta, ``time`` and parameters.
        """
        pushed = self._body(body, "A force")
        F = three_expressions(f"force on {pushed.name!r}", force)
        r = three_or_none(f"point of the force on {pushed.name!r}", on_body)
        self._push(pushed.p_x, F)
        if r is not None:
            in_body = [dot(row, F) for row in pushed.rotation.T.tolist()]
            self.torque(pushed, cross(r.tolist(), in_body))

    def torque(self, body: Body | str, torque: Sequence[Any]) -> None:
        """Let a torque (in body axes, N m) act on a body, as expressions like a force's.

        For a top it is taken about the fixed point.
        """
        turned = self._body(body, "A torque")
        self._push(turned.p, turned.torque_force(
            three_expressions(f"torque on {turned.name!r}", torque)))

    def moving_point(self, name: str, path: Sequence[Any]) -> Moving:
        """Return a point of the ground that moves, for joints, rods and springs to hold on to.

        Parameters
        ----------
        name : str
            Joints may name it.
        path : three expressions
            Where in space it is, m: of ``time`` and parameters. At t = 0 bodies that follow from
            it begin there, with its velocity.
        """
        self._claim(name)
        where = [self._law(f"path of {name!r}", e) for e in three_expressions(
            f"path of {name!r}", path)]
        for e in where:
            self._begin(f"path of {name!r}", e)
        made = Moving(name, (where[0], where[1], where[2]))
        self._moving.append(made)
        return made

    def drive(self, name: str, joint: Align | Revolute | str, *, angle: Any) -> Drive:
        """Have the angle of a hinge be a law of t: one constraint, ``name: angle``.

        Parameters
        ----------
        joint : what ``revolute`` or ``align`` returned, or its name
        angle : expression of ``time`` and parameters
            φ of b against a about the axis, rad: f(0) is where the bodies start, and f'(0) the
            rate that the joint hands on. Its multiplier is the torque, N m.

        Raises
        ------
        InputError
            If the law has no finite value or rate at t = 0, or the joint starts at another rate.
        """
        hinge, law = self._hinge_of(name, joint), self._law(f"angle of {name!r}", angle)
        begin, rate = self._begin(f"angle of {name!r}", law)
        if hinge.rate not in (0.0, rate):
            raise InputError(f"The drive {name!r} begins at {rate:.6g} rad/s and its joint at "
                             f"{hinge.rate:.6g}: no start satisfies both; leave out the joint's "
                             "rate.")
        hinge.rate = rate
        return self._join(Drive(name, hinge.a, hinge.b, hinge.axis, law, begin))

    def motor(self, name: str, joint: Align | Revolute | str, *, torque: Any) -> None:
        """Let a motor turn b against a at a hinge, and a back: a torque about its axis, N m.

        ``torque`` is an expression of ``time``, parameters, and of ``angle`` and ``rate``, which
        stand for the angle of b against a since the start (rad, from −π to π) and its rate:
        ``build.motor("servo", hinge, torque=k*(target - build.angle) - c*build.rate)``.
        """
        hinge = self._hinge_of(name, joint)
        self._claim(name)
        law = self._law(f"torque of {name!r}", torque, self.angle, self.rate)
        R_a, R_b = (self._bodies[frame].pose().R if isinstance(frame, Body) else np.eye(3)
                    for frame in (hinge.a, hinge.b))
        axes = [unit_vector(f"{name}_axis_{end}", direction(R.T @ hinge.axis), self._values)
                for end, R in (("a", R_a), ("b", R_b))]
        ends = [(frame, axis, sign) for frame, axis, sign in zip(
            (hinge.a, hinge.b), axes, (-1, 1), strict=True) if isinstance(frame, Body)]
        rate = sum((sign * dot(axis, body.angular_velocity) for body, axis, sign in ends),
                   sp.Integer(0))
        meant: dict[sp.Expr, sp.Expr] = {self.rate: rate}
        if law.has(self.angle):
            along, across = angle_parts(hinge, R_a, R_b, 0.0, self._values, name)
            meant[self.angle] = sp.atan2(across, along)
        push = law.xreplace(meant)
        for body, axis, sign in ends:
            self.torque(body, [sign * push * x for x in axis])

    def quantity(self, name: str, expression: Any) -> None:
        """Have an expression computed along trajectories under a name."""
        self._quantities[as_text("name of a quantity", name)] = as_expression(expression)

    def _hinge_of(self, name: str, joint: Any) -> Align:
        """Return the axis in common of a joint of this builder."""
        known = {link.name: link for link in self._links if isinstance(link, (Align, Revolute))}
        found = known.get(joint) if isinstance(joint, str) else next(
            (link for link in known.values() if link is joint), None)
        if found is None:
            raise InputError(f"{name!r} holds on to {shown(joint)}, which is no hinge of Multibody "
                             f"{self.name!r}; pass what revolute(...) or align(...) returned, or a "
                             f"name: {', '.join(known) or 'there is none yet'}.")
        return found.hinge if isinstance(found, Revolute) else found

    def _law(self, what: str, given: Any, *more: sp.Symbol) -> sp.Expr:
        """Return an expression of time, parameters and these."""
        law = as_expression(given)
        strange = law.free_symbols - {self.time, *self._symbols.values(), *more}
        if strange:
            allowed = ", ".join(["time, parameters", *map(str, more)])
            raise InputError(f"The {what} contains {min(map(str, strange))!r}; it may contain "
                             f"{allowed}.")
        return law

    def _begin(self, what: str, law: sp.Expr) -> tuple[float, float]:
        """Return the value and the rate of a law at t = 0."""
        at = {symbol: self._values[name] for name, symbol in self._symbols.items()}
        with np.errstate(all="ignore"):
            value, rate = map(float, evaluate([law, derivative(law, self.time)],
                                              at | {self.time: 0.0}))
        if not (math.isfinite(value) and math.isfinite(rate)):
            raise InputError(f"The {what} has no finite value and rate at t = 0, so that no start "
                             "satisfies it; write a law that begins smoothly.")
        return value, rate

    def _push(self, momenta: Sequence[sp.Symbol], force: Sequence[sp.Expr]) -> None:
        for symbol, e in zip(momenta, force, strict=bool(momenta)):
            self._forces[symbol] = self._forces.get(symbol, sp.Integer(0)) + e
