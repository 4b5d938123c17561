"""A step as a composition of exact flows.

    T(a₀h) K(b₁h, c₁h³) T(a₁h) ⋯ K(b_s h, c_s h³) T(a_s h)

T: free rotations and translations; K: kicks by V, its force gradient and forces. The rotations R of
an asymmetric body that do not commute with T are in the middle of the kick,
K(b h/2) R(b h) K(b h/2), and the composition is a composition of symmetric maps S of order 2. If
the bodies are symmetric at the parameters of a run, R is the identity, and the run uses the
composition with force gradients. Source: docs/theory/splitting.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import sympy as sp

from ...core.errors import InputError
from ...core.records import dataclass
from ..kernels.kernel import Constants
from ..kernels.statements import Kernel
from ..splitting.decomposition import split
from ..splitting.parts import AxisRotation, Kick, Splitting
from ..systems.jacobians import jacobian
from ..systems.system import System
from ..tableaux.compositions import COMPOSITIONS, Composition, composition, composition_named
from .step_equations import common_kernels

__all__ = ["SplittingScheme", "splitting_scheme"]

#: The time of a kick, an argument of its kernels.
_TIME = sp.Symbol("_time", real=True)
#: Kernels of functions of a state; the other ``common_kernels`` are for Newton's method.
_STATE_KERNELS = ("hamiltonian", "constraint", "constraint_jacobian", "hidden_constraint",
                  "hidden_matrix")


@dataclass(frozen=True)
class SplittingScheme:
    """The flows of a system and the compositions of a step.

    Attributes
    ----------
    system : System
        The system in constants of the run in place of subexpressions of the parameters.
    splitting : Splitting
        The splitting of the system in the user's parameters.
    symmetric : Splitting
        The splitting for symmetric bodies, which has the force gradient.
    constants : Constants
        The constants of the run.
    compositions : tuple of Composition
        The composition for any bodies; then, if it differs, the composition for symmetric bodies.
    """

    system: System
    splitting: Splitting
    symmetric: Splitting
    constants: Constants
    compositions: tuple[Composition, ...]
    #: There is nothing to solve.
    tableau = None
    unknowns_are_state = False
    size = 0
    multipliers = 0
    reactions = 0

    @property
    def order(self) -> int:
        """Order of a step, which is the order of the composition, as its flows are exact."""
        return min(composition.order for composition in self.compositions)

    @property
    def gradients(self) -> bool:
        """Whether kicks have a force gradient."""
        return any(composition.has_gradients for composition in self.compositions)

    @property
    def work_has_order_2(self) -> bool:
        """Whether the work of the drag has order 2.

        The work on rotations that do not commute with free motions is integrated over each free
        motion by the trapezoidal rule.
        """
        return any(body.drag != 0 and body.further for body in self.splitting.bodies)

    @property
    def name(self) -> str:
        """Names of the compositions, in words."""
        first, *symmetric = self.compositions
        text = first.name
        return f"{text}, {symmetric[0].name} for symmetric bodies" if symmetric else text

    @cached_property
    def axes(self) -> list[tuple[int, AxisRotation]]:
        """The axis rotations that commute with the free rotation, with the indices of bodies."""
        return [(i, axis) for i, body in enumerate(self.splitting.bodies) for axis in body.axes]

    @cached_property
    def further(self) -> list[tuple[int, AxisRotation]]:
        """The axis rotations that do not commute with it, with the indices of bodies."""
        return [(i, axis) for i, body in enumerate(self.splitting.bodies) for axis in body.further]

    @cached_property
    def free(self) -> tuple[int, ...]:
        """Indices in q of the coordinates of points."""
        translation = self.splitting.translation
        return () if translation is None else translation.coordinates

    @cached_property
    def momenta(self) -> list[sp.Symbol]:
        """y: the angular momenta of bodies in space axes, then the momenta of points."""
        return [*(s for body in self.splitting.bodies for s in body.l),
                *(self.splitting.system.p[i] for i in self.free)]

    @cached_property
    def drag(self) -> list[sp.Expr]:
        """k of dl/dt = −k l for each body, then for each coordinate of points."""
        translation = self.splitting.translation
        return [*(body.drag for body in self.splitting.bodies),
                *(() if translation is None else
                  (translation.drag.get(i, sp.S.Zero) for i in self.free))]

    @property
    def has_drag(self) -> bool:
        """Whether a drag k is not 0."""
        return any(k != 0 for k in self.drag)

    @cached_property
    def kick(self) -> list[sp.Expr]:
        """dy/dt of the kicks."""
        return _flat(self.splitting.kick)

    @cached_property
    def kicked_entries(self) -> list[int]:
        """Entries of y that a kick changes."""
        changes = self.kick if not self.gradients else [
            a if a != 0 else b for a, b in zip(self.kick, _flat(self.symmetric.gradient),
                                               strict=True)]
        return [i for i, e in enumerate(changes) if e != 0]

    def kernels(self) -> list[Kernel]:
        """Return the kernels of the rates and axes of rotations, which are called once a run."""
        rates = {
            "sphere": self._hoist([body.a for body in self.splitting.bodies]),
            "axis_rate": self._hoist([axis.d for _, axis in self.axes]),
            "axis_offset": self._hoist([axis.c for _, axis in self.axes]),
            "further_rate": self._hoist([axis.d for _, axis in self.further]),
            "further_offset": self._hoist([axis.c for _, axis in self.further]),
            "drag": self._hoist(self.drag)}
        # C has no arrays of length 0: without axes there is one of zeros
        no_axis = [[sp.S.Zero] * 3]
        directions = {
            "axis": [self._hoist(axis.axis) for _, axis in self.axes] or no_axis,
            "further_axis": [self._hoist(axis.axis) for _, axis in self.further] or no_axis}
        kernels = [
            Kernel("flow_rates", "rates of rotations, and k of drags, of a run", inputs={},
                   outputs=rates),
            Kernel("axis_directions", "unit vectors of the axes of rotations, in body axes",
                   inputs={}, outputs=directions)]
        if self.splitting.space:
            kernels.append(Kernel(
                "space_rates", "angular velocities of axes of space", inputs={},
                outputs={"omega": [self._hoist(space.omega) for space in self.splitting.space]}))
        return kernels

    def state_kernels(self) -> list[Kernel]:
        """Return the kernels of H and of the constraints at a state."""
        return [k for k in common_kernels(self.system) if k.name in _STATE_KERNELS]

    def flow_kernels(self, *, work: bool = True) -> list[Kernel]:
        """Return the kernels of a step; with ``work``, also the kernels of the forces' work."""
        state, time = self._state, {"t": [_TIME]}
        velocity, offset = self._point_velocity()
        kernels = [
            self._kick_kernel(),
            Kernel("free_velocity", "M^-1 p and the velocity at p = 0 of points",
                   {"y": self.momenta}, {"velocity": self._hoist(velocity),
                                         "offset": self._hoist(offset)})]
        if work and self.system.forces:
            power, = self._hoist([self._force_power()])
            kernels.append(Kernel("force_power", "power of forces and of explicit time in a kick",
                                  state | time, {"power": power}))
        if work and self.has_drag:
            # drags act in free motions, whose energy without them would be constant
            T, power = self._hoist([self._kinetic_energy(further=False), self._drag_power()])
            kernels.append(Kernel("drift_energy", "the part of H that free motions conserve", state,
                                  {"T": T}))
            kernels.append(Kernel("drag_power", "power of drags on the rest of T", state,
                                  {"power": power}))
        return kernels

    @property
    def _state(self) -> dict[str, list[sp.Symbol]]:
        """The inputs q and y of a kernel of a state."""
        return {"q": list(self.splitting.system.q), "y": self.momenta}

    def _kick_kernel(self) -> Kernel:
        """Return the kernel of dy/dt + w G of a kick, for the entries of y in ``kicked_entries``.

        G is the force gradient; its weight w is an input, 0 for a kick without the gradient.
        """
        weight = sp.Symbol("_gradient", real=True)
        rate = [self.kick[i] for i in self.kicked_entries]
        if self.gradients:
            gradient = _flat(self.symmetric.gradient)
            rate = [sp.factor_terms(e + weight * gradient[i])
                    for e, i in zip(rate, self.kicked_entries, strict=True)]
        return Kernel("kick_rate", "dy/dt of a kick, with the force gradient times its weight",
                      self._state | {"t": [_TIME], "gradient": [weight]},
                      {"rate": self._hoist(rate)})

    def _point_velocity(self) -> tuple[list[sp.Expr], list[sp.Expr]]:
        """Return M⁻¹ p and v of each coordinate of points."""
        translation, p = self.splitting.translation, self.splitting.system.p
        if translation is None:
            return [], []
        velocities = dict.fromkeys(self.free, sp.S.Zero)
        for (i, j), e in translation.inverse_mass.items():
            velocities[i] += e * p[j]
        return list(velocities.values()), [translation.velocity.get(i, sp.S.Zero)
                                           for i in self.free]

    def _hoist(self, expressions: Sequence[sp.Expr]) -> list[sp.Expr]:
        """Return expressions in constants of the run; [0] if empty, as C has no empty arrays."""
        clock = self.splitting.system.time
        return [self.constants.since_start(e).xreplace({clock: _TIME})
                for e in expressions] or [sp.S.Zero]

    def _kinetic_energy(self, *, further: bool = True) -> sp.Expr:
        """T = Σ (½ a |m|² + Σ (½ d (e·m)² + c e·m)) + ½ p·M⁻¹p + v·p − ω·J, in q and y.

        ``further``: whether T has the rotations that do not commute with free motions.
        """
        splitting, system = self.splitting, self.splitting.system
        T: sp.Expr = sp.S.Zero
        for body in splitting.bodies:
            m = body_momentum([system.q[i] for i in body.q], body.l)
            T += body.a * sum(x**2 for x in m) / 2
            for axis in (*body.axes, *(body.further if further else ())):
                # e·m of the axis e, in body axes
                e_m = sum(e * x for e, x in zip(axis.axis, m, strict=True))
                T += axis.d * e_m**2 / 2 + axis.c * e_m
        if splitting.translation is not None:
            p, inverse_mass = system.p, splitting.translation.inverse_mass
            # M⁻¹ has both entries of each pair: ½ of their sum
            T += sum(e * p[i] * p[j] for (i, j), e in inverse_mass.items()) / 2
            T += sum(v * p[i] for i, v in splitting.translation.velocity.items())
        for space in splitting.space:
            omega, zero = sp.Matrix(space.omega), sp.S.Zero
            T -= sum(omega.dot(sp.Matrix(splitting.bodies[b].l)) for b in space.bodies)
            for point in space.points:  # an index −1: the point has no such coordinate
                r, y = (sp.Matrix([zero if i < 0 else x[i] for i in point])
                        for x in (system.q, system.p))
                T -= omega.dot(r.cross(y))
        return T

    def _drag_power(self) -> sp.Expr:
        """The power of drags k on ``further`` rotations: −Σ k l·∂/∂l of ½ d (e·m)² + c e·m."""
        power: sp.Expr = sp.S.Zero
        for body in self.splitting.bodies:
            m = body_momentum([self.splitting.system.q[i] for i in body.q], body.l)
            for axis in body.further:
                e_m = sum(e * x for e, x in zip(axis.axis, m, strict=True))
                power -= body.drag * (axis.d * e_m**2 + axis.c * e_m)
        return power

    def _force_power(self) -> sp.Expr:
        """F·(∂T/∂y) + ∂V/∂t, the power of applied forces and of explicit time."""
        splitting, time = self.splitting, self.splitting.system.time
        slopes, = jacobian([self._kinetic_energy()], self.momenta)
        power = sum((e * x for e, x in zip(_flat(splitting.applied), slopes, strict=True)),
                    sp.S.Zero)
        return power if time is None else power + sp.diff(splitting.V, time)


def body_momentum(q: Sequence[sp.Symbol], l: Sequence[sp.Symbol]) -> list[sp.Expr]:  # noqa: E741
    """Return m = R(q)ᵀ l for |q| = 1, three entries."""
    a, x = q[0], list(q[1:])
    m = []
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3  # (i, j, k) is a cyclic permutation of the axes
        m.append(l[i] * (a**2 + x[i]**2 - x[j]**2 - x[k]**2)
                 + 2 * l[j] * (x[i] * x[j] + a * x[k]) + 2 * l[k] * (x[i] * x[k] - a * x[j]))
    return m


def _flat(kick: Kick) -> list[sp.Expr]:
    """Return a kick as one list dy/dt: torques, then forces."""
    return [*(e for torque in kick.torques for e in torque), *kick.forces]


def _has_strang_steps(composition: Composition) -> bool:
    """Whether it is composed of Strang steps, which are symmetric and have order 2."""
    return composition.name == "Strang" or composition.base == "Strang"


def _is_local(splitting: Splitting) -> bool:
    """Whether each term of V depends on one body alone, and not on time.

    Then the force gradient costs few operations; a term between two bodies costs more than another
    kick. With forces or explicit time the gradient would need further terms in the work.
    """
    return not splitting.time_dependent and all(
        len(template.bodies) == 1 and not template.coordinates for template in splitting.templates)


def splitting_scheme(
    system: System, reduced: System, constants: Constants, order: int, named: str = "",
) -> SplittingScheme:
    """Return the scheme of an order, or of the composition ``named``, which determines its order.

    It has one composition where T is one exact flow for all parameters. Else it has two where
    equal moments make T exact: a run selects by its parameters.

    Parameters
    ----------
    system : System
        The system in the user's parameters.
    reduced : System
        The system in constants of the run, which are computed once.
    constants : Constants
        Their definitions.
    order : int
    named : str
        Name of a composition; empty for the default of the order.

    Raises
    ------
    InputError
        If H has no splitting, or the system does not permit the order or the composition.
    """
    splitting = split(system)
    requested = composition_named(named) if named else composition(order)
    _refuse_composition(requested, system, splitting, named)
    # at parameters with equal moments, rotation is one exact flow, and more compositions serve
    symmetric = split(system, symmetric=True)
    # force gradients only for the default of an order, without forces: their work has order 2
    takes_gradients = (not named and not system.forces and symmetric.has_gradient
                       and _is_local(symmetric))
    of_exact_flows = composition(order, gradients=True) if takes_gradients else requested
    # A step K(h/2) R K(h/2) of an asymmetric body is symmetric; other compositions need an exact R.
    of_strang_steps = requested if named else _strang_composition(order)
    if splitting.is_exact:  # T is one exact flow for all parameters
        compositions = (of_exact_flows,)
    elif symmetric.is_exact and of_exact_flows is not of_strang_steps:
        # a run selects one of both by ``symmetric.conditions`` at its parameters
        return SplittingScheme(reduced, splitting, symmetric, constants,
                               compositions=(of_strang_steps, of_exact_flows))
    else:
        compositions = (of_strang_steps,)
    return SplittingScheme(reduced, splitting, symmetric=splitting, constants=constants,
                           compositions=compositions)


def _refuse_composition(
    requested: Composition, system: System, splitting: Splitting, named: str
) -> None:
    """Refuse a composition that does not suit the flows of a system.

    ``named`` is its name if the user gave it, and empty for the default of an order.
    """
    if splitting.highest_order is not None and requested.order > splitting.highest_order:
        raise InputError(f"order = {requested.order} is not reached where forces depend on momenta "
                         "other than by isotropic drag; choose order 2, or scheme G-L.")
    if requested.has_gradients and system.forces:
        raise InputError(f"Composition {requested.name} has force gradients, with which the work "
                         f"of the forces of system {system.name!r} has order 2 only; give an order "
                         "instead.")
    if named and not splitting.is_exact and not _has_strang_steps(requested):
        raise InputError(f"Composition {named} is for bodies whose rotation is one exact flow, and "
                         f"system {system.name!r} has others; give an order instead, or choose a "
                         "composition of Strang steps such as KL8.")


def _strang_composition(order: int) -> Composition:
    """Return the stored composition of Strang steps; there is one for each even order up to 10."""
    return next(stored for stored in COMPOSITIONS.values()
                if stored.order == order and _has_strang_steps(stored))
