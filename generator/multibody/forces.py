"""What acts on bodies and joints, and what is computed along the way.

    motor      a torque about the axis of a joint, or a force along it
    spring     V = ½ k (c − c₀)² of the angle or travel c of a joint, and a damper −k_d ċ

Measures of joints are symbols until the model is made.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from ...core.arguments import as_flag, as_text, listed, proposal, shown, whole
from ...core.errors import InputError
from ..symbolic.derivatives import derivative
from ..symbolic.numeric_evaluation import evaluate
from ..systems.expression_arguments import as_expression
from .body import Body, Moving, Particle, Push, three_expressions
from .connections import Linkage
from .initial_poses import finite, three_or_none
from .joints import Connection, Poses, Store, named_number
from .sliding_joints import Coupling, Drive, Gear, hinge_of

__all__ = ["Loads", "Machine"]

#: Coordinate of a joint → its rate.
RATE_OF = {"angle": "rate", "travel": "speed"}


@dataclass(eq=False, repr=False)
class Motor(Connection):
    """A torque, or a force, on the coordinate of a joint; ``effort`` an expression."""

    what: str = field(kw_only=True)
    effort: sp.Expr = field(kw_only=True)

    def forces(self, poses: Poses, store: Store) -> Iterator[Push]:
        """Yield what it does to both bodies."""
        yield from self.joints[0].push(self.what, self.effort, poses, store)


@dataclass(eq=False, repr=False)
class JointSpring(Connection):
    """V = ½ k (c − c₀)² of the coordinate of a joint, and a damper."""

    what: str = field(kw_only=True)
    coordinate: sp.Symbol = field(kw_only=True)
    rate: sp.Symbol = field(kw_only=True)
    stiffness: float = 0.0
    damping: float = 0.0
    rest: float = 0.0

    def energy(self, store: Store) -> sp.Expr:
        """Return V; values of its parameters go into ``store``."""
        k = named_number(f"{self.name}_stiffness", self.stiffness, store)
        rest = named_number(f"{self.name}_rest", self.rest, store)
        return k * (self.coordinate - rest) ** 2 / 2

    def forces(self, poses: Poses, store: Store) -> Iterator[Push]:
        """Yield what the damper does to both bodies."""
        if self.damping:
            c = named_number(f"{self.name}_damping", self.damping, store)
            yield from self.joints[0].push(self.what, -c * self.rate, poses, store)


class Loads(Linkage):
    """Bodies, what joins them, and what acts on them."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.time = sp.Symbol("t", real=True)
        self._values: dict[str, float] = {}
        self._potential: list[sp.Expr] = []
        self._pushes: list[Push] = []
        self._quantities: dict[str, sp.Expr] = {}
        self._inputs: list[sp.Symbol] = []

    def potential(self, expression: Any) -> None:
        """Add to H: an expression in symbols of the bodies and of ``parameter``.

        It may contain momenta, as −n·l does for axes that turn at n.
        """
        self._potential.append(as_expression(expression))

    def parameter(self, name: str, value: float, *, positive: bool = False) -> sp.Symbol:
        """Return a symbol for potentials, forces and quantities, with its value."""
        self._claim(name)
        domain = {"positive": True} if as_flag("positive", positive) else {"real": True}
        number = float(finite(f"parameter {name!r}", value, ()))
        if positive and number <= 0:
            raise InputError(f"The parameter {name!r} is {number:g} and declared positive=True; "
                             "leave that out where 0 or less is meant.")
        self._values[name] = number
        self._symbols[name] = sp.Symbol(name, **domain)
        return self._symbols[name]

    def input(self, name: str, value: float = 0.0) -> sp.Symbol:
        """Return a symbol for forces, torques and motors that a run may give anew in each step.

        What a controller says is one; ``value`` is what it has where a run gives none.
        """
        self._inputs.append(self.parameter(name, value))
        return self._inputs[-1]

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
        self._pushes += pushed.pushed([0, 0, 0] if r is None else r.tolist(), F)

    def torque(self, body: Body | str, torque: Sequence[Any]) -> None:
        """Let a torque (in body axes, N m) act on a body, as expressions like a force's.

        For a top it is taken about the fixed point.
        """
        turned = self._body(body, "A torque")
        if isinstance(turned, Particle):
            raise InputError(f"A torque on {turned.name!r}, a point mass, turns nothing; give a "
                             "force, or a body.")
        self._pushes += turned.turned(three_expressions(f"torque on {turned.name!r}", torque))

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
        x, y, z = (self._law(f"path of {name!r}", e) for e in three_expressions(
            f"path of {name!r}", path))
        made = Moving(name, (x, y, z), three_expressions(
            f"velocity of {name!r}", [derivative(e, self.time) for e in (x, y, z)]))
        self.beginning(made)
        self._moving.append(made)
        return made

    def beginning(self, point: Moving) -> list[tuple[float, float]]:
        """Return place and velocity of a point that moves, at t = 0 and axis by axis."""
        return [self._begin(f"path of {point.name!r}", e) for e in point.path]

    def _law(self, what: str, given: Any) -> sp.Expr:
        """Return an expression of time and parameters."""
        law = as_expression(given)
        strange = law.free_symbols - {self.time} - {
            symbol for name, symbol in self._symbols.items() if name in self._values}
        if strange:
            raise InputError(f"The {what} contains {min(map(str, strange))!r}; it may contain time "
                             "and parameters.")
        return law

    def _begin(self, what: str, law: sp.Expr) -> tuple[float, float]:
        """Return the value and the rate of a law at t = 0."""
        at = {symbol: self._values[name] for name, symbol in self._symbols.items()
              if name in self._values}
        with np.errstate(all="ignore"):
            value, rate = map(float, evaluate([law, derivative(law, self.time)],
                                              at | {self.time: 0.0}))
        if not (math.isfinite(value) and math.isfinite(rate)):
            raise InputError(f"The {what} has no finite value and rate at t = 0, so that no start "
                             "satisfies it; write a law that begins smoothly.")
        return value, rate

    def quantity(self, name: str, expression: Any) -> None:
        """Have an expression computed along trajectories under a name."""
        self._quantities[as_text("name of a quantity", name)] = as_expression(expression)


class Machine(Loads):
    """Bodies, what joins them, and what acts on them and on their joints."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        #: What stands for a measure of a joint → the joint, and which measure.
        self._measures: dict[sp.Symbol, tuple[Connection, str]] = {}

    def angle(self, joint: Connection | str) -> sp.Symbol:
        """Return what stands for the angle of a joint in forces, potentials and quantities, in rad.

        It is followed for two turns to either side of the start.
        """
        return self._measure(joint, "angle")

    def rate(self, joint: Connection | str) -> sp.Symbol:
        """Return what stands for the rate of a joint's angle, in rad/s."""
        return self._measure(joint, "rate")

    def travel(self, joint: Connection | str) -> sp.Symbol:
        """Return what stands for the travel along a joint's axis, in m."""
        return self._measure(joint, "travel")

    def speed(self, joint: Connection | str) -> sp.Symbol:
        """Return what stands for the speed along a joint's axis, in m/s."""
        return self._measure(joint, "speed")

    def measured(self, taken: Collection[str] = ()) -> dict[str, dict[str, sp.Symbol]]:
        """Return measure → name → symbol of all measures of all joints, but for names taken."""
        found: dict[str, dict[str, sp.Symbol]] = {}
        for link in self._links:
            for what in link.MEASURES:
                if f"{link.name}_{what}" not in taken:
                    found.setdefault(what, {})[f"{link.name}_{what}"] = self._measure(link, what)
        return found

    def gear(
        self, name: str, first: Connection | str, second: Connection | str, *,
        teeth: tuple[int, int],
    ) -> Gear:
        """Let two joints turn as gears in mesh: one constraint, ``name: mesh``.

        z₁ θ₁ + z₂ θ₂ stays what it is at the start, for any number of turns. ``teeth`` are z₁ and
        z₂; for a ring gear, whose teeth are inside, with a minus.
        """
        counts = [whole(z) for z in np.ravel(np.asarray(teeth, dtype=object)).tolist()]
        if len(counts) != 2 or not all(counts):
            raise InputError(f"The teeth of {name!r} are {shown(teeth)}; give two whole numbers "
                             "other than 0.")
        z1, z2 = (int(z or 0) // math.gcd(*(int(z or 0) for z in counts)) for z in counts)
        one, two = (self._turning(name, joint) for joint in (first, second))
        return self._join(Gear(name, one.b, two.b, joints=(one, two), teeth=(z1, z2)))

    def couple(
        self, name: str, first: Connection | str, second: Connection | str, *,
        ratio: float = 1.0, offset: float = 0.0,
    ) -> Coupling:
        """Let the second joint's coordinate be ratio × the first's + offset: one constraint.

        Coordinates are the angle of a joint that turns and the travel of one that slides (rad, m).
        Angles in a ratio of small whole numbers are coupled over any number of turns, others as
        far as ``angle`` is followed.
        """
        one, two = (self._joint(joint, f"{name!r}") for joint in (first, second))
        return self._join(Coupling(
            name, one.b, two.b, joints=(one, two), what=(_coordinate(one), _coordinate(two)),
            ratio=float(finite(f"ratio of {name!r}", ratio, ())),
            offset=float(finite(f"offset of {name!r}", offset, ()))))

    def drive(self, name: str, joint: Connection | str, *, angle: Any) -> Drive:
        """Have the angle of a hinge be a law of t: one constraint, ``name: angle``.

        Parameters
        ----------
        joint : what ``revolute`` or ``align`` returned, or its name
        angle : expression of ``time`` and parameters
            φ of the second body against the first about the axis, rad: f(0) is the joint's angle
            where the bodies start, and f'(0) the rate that the joint hands on. Its multiplier is
            the torque about the axis that the drive exerts on the second body, as a motor's, and
            back on the first, N m; ``trajectory.joint(name).torque()`` has it in space axes.

        Raises
        ------
        InputError
            If the law has no finite value or rate at t = 0, or the joint starts at another rate
            or angle.
        """
        driven, law = self._turning(name, joint), self._law(f"angle of {name!r}", angle)
        begin, rate = self._begin(f"angle of {name!r}", law)
        hinge = hinge_of(driven)
        if hinge.rate not in (0.0, rate):
            raise InputError(f"The drive {name!r} begins at {rate:.6g} rad/s and its joint at "
                             f"{hinge.rate:.6g}: no start satisfies both; leave out the joint's "
                             "rate.")
        if hinge.angle not in (0.0, begin):
            raise InputError(f"The drive {name!r} begins at {begin:.6g} rad and its joint at "
                             f"{hinge.angle:.6g}: these are one angle; leave out the joint's.")
        hinge.rate, hinge.angle = rate, begin
        return self._join(Drive(name, driven.a, driven.b, joints=(driven,), law=law, begin=begin))

    def motor(
        self, name: str, joint: Connection | str, *, torque: Any = None, force: Any = None
    ) -> Motor:
        """Drive a joint by a torque about its axis (N m), or a force along it (N).

        A number, or an expression of ``time``, parameters, symbols of bodies, and ``angle(joint)``,
        ``rate(joint)``, …. It acts on the joint's second body and back on its first.
        """
        what, effort = ("travel", force) if torque is None else ("angle", torque)
        if effort is None or (torque is not None and force is not None):
            raise InputError(f"Motor {name!r} needs a torque or a force, one of them.")
        driven = self._joint(joint, f"Motor {name!r}")
        self._refuse_measure(driven, what)
        return self._join(Motor(name, driven.a, driven.b, joints=(driven,), what=what,
                                effort=as_expression(effort)))

    def joint_spring(
        self, name: str, joint: Connection | str, *, stiffness: float = 0.0,
        damping: float = 0.0, rest: float = 0.0,
    ) -> JointSpring:
        """Add V = ½ k (c − rest)² of a joint's coordinate c, its angle or travel, and a damper.

        In N m/rad and N m s/rad about an axis, N/m and N s/m along one.
        """
        held = self._joint(joint, f"Spring {name!r}")
        what = _coordinate(held)
        return self._join(JointSpring(
            name, held.a, held.b, joints=(held,), what=what,
            coordinate=self._measure(held, what), rate=self._measure(held, RATE_OF[what]),
            stiffness=float(finite(f"stiffness of {name!r}", stiffness, ())),
            damping=float(finite(f"damping of {name!r}", damping, ())),
            rest=float(finite(f"rest of {name!r}", rest, ()))))

    def _measure(self, joint: Connection | str, what: str) -> sp.Symbol:
        """Return the symbol of a measure."""
        measured = self._joint(joint, f"The {what}")
        self._refuse_measure(measured, what)
        symbol = sp.Symbol(f"{measured.name}_{what}", real=True)
        if symbol not in self._measures:
            self._claim(str(symbol))
            self._symbols[str(symbol)] = symbol
            self._measures[symbol] = measured, what
        return symbol

    def _refuse_measure(self, joint: Connection, what: str) -> None:
        if what not in joint.MEASURES:
            raise InputError(f"Joint {joint.name!r} has no {what}; it has "
                             f"{listed(joint.MEASURES) if joint.MEASURES else 'no coordinate'}.")

    def _joint(self, joint: Any, what: str) -> Connection:
        """Return a joint of this builder: itself, or that of a name."""
        names = {link.name: link for link in self._links}
        if isinstance(joint, str) and joint in names:
            return names[joint]
        if isinstance(joint, Connection) and joint in self._links:
            return joint
        raise InputError(f"{what} holds on to {shown(joint)}, which is no joint of Multibody "
                         f"{self.name!r}; pass a joint, or a name: "
                         f"{', '.join(names) or 'there is none yet'}{proposal(joint, names)}.")

    def _turning(self, name: str, joint: Connection | str) -> Connection:
        found = self._joint(joint, f"Gear {name!r}")
        self._refuse_measure(found, "angle")
        return found


def _coordinate(joint: Connection) -> str:
    """Return which measure of a joint is its coordinate: its travel where it slides."""
    if not joint.MEASURES:
        raise InputError(f"Joint {joint.name!r} has no coordinate, neither an angle nor a travel.")
    return "travel" if "travel" in joint.MEASURES else "angle"
