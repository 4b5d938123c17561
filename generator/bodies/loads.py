"""What acts on bodies: potentials, forces and torques, and what is computed along the way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp
from numpy.typing import ArrayLike

from ...arguments import as_flag, as_text
from ..systems.given import as_expression
from .bodies import Body, cross, dot, three_expressions
from .linkage import Linkage
from .poses import finite, three_or_none

__all__ = ["Loads"]


class Loads(Linkage):
    """Bodies, what joins them, and what acts on them."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.time = sp.Symbol("t", real=True)
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

    def quantity(self, name: str, expression: Any) -> None:
        """Have an expression computed along trajectories under a name."""
        self._quantities[as_text("name of a quantity", name)] = as_expression(expression)

    def _push(self, momenta: Sequence[sp.Symbol], force: Sequence[sp.Expr]) -> None:
        for symbol, e in zip(momenta, force, strict=bool(momenta)):
            self._forces[symbol] = self._forces.get(symbol, sp.Integer(0)) + e
