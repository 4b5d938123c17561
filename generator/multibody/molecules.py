"""Many equal rigid molecules with a potential between every two of them.

    H = Σ_i [T(q_i, p_i) + V₁(q_i, x_i)] + Σ_{i<j} V₂(q_i, x_i, q_j, x_j)

The potentials are functions of molecules: of their points x + R(q) r, such as the sites of charges,
and of vectors R(q) r, such as dipoles. All pairs interact: there are no neighbour lists, no cells
and no periodic images.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike, NDArray

from ...core.arguments import as_mapping, shown, whole
from ...core.errors import InputError
from ...core.inertia import RepName
from ..systems.expression_arguments import as_expression
from ..systems.molecular_system import MolecularSystem, PairPotential, SpaceVector
from ..systems.system import System
from .body import Frame, Vector
from .initial_poses import finite
from .model import Model
from .multibody import Multibody
from .rigid_body import expressions

__all__ = ["MOST_MOLECULES", "Molecule", "molecules"]

Array = NDArray[Any]

#: All pairs are evaluated: beyond this a kick takes seconds.
MOST_MOLECULES = 10_000
#: The name of a molecule among the coordinates, m_q0_17 being one of molecule 17.
_NAME = "m"


class Molecule(Frame):
    """One of the two molecules of a pair potential; made by ``gyrospark.molecules``."""

    def __init__(self, which: int, vectors: dict[Any, SpaceVector]) -> None:
        self._which = which
        self._vectors = vectors

    def __repr__(self) -> str:
        return f"<Molecule {'ab'[self._which]}>"

    @property
    def x(self) -> Vector:
        """The position of its centre of mass in space."""
        return self.point((0, 0, 0))

    def point(self, r: Sequence[object]) -> Vector:
        """Return x + R(q) r, the position in space of a point, such as a site of a charge."""
        return self._vector(r, is_point=True)

    def direction(self, v: Sequence[object]) -> Vector:
        """Return R(q) v: the components in space of a vector in body axes, such as a dipole."""
        return self._vector(v, is_point=False)

    @cached_property
    def rotation(self) -> sp.Matrix:
        """R(q), 3 × 3, from body to space axes."""
        columns = [self.direction(e) for e in np.eye(3, dtype=int).tolist()]
        return sp.Matrix(columns).T

    def _vector(self, r: Sequence[object], *, is_point: bool) -> Vector:
        """Return the symbols of a vector, the same for each molecule that carries it."""
        entries = tuple(expressions("vector", r, 3))
        key = (is_point, entries)
        if key not in self._vectors:
            k = len(self._vectors)
            first, second = (tuple(sp.Symbol(f"_{which}{k}{axis}", real=True) for axis in "xyz")
                             for which in "ab")
            self._vectors[key] = SpaceVector(entries, is_point, first, second)
        own = self._vectors[key]
        x, y, z = (own.first, own.second)[self._which]
        return x, y, z


def molecules(
    name: str, count: int, *, mass: float, inertia: ArrayLike,
    pair_potential: Callable[..., Any], positions: ArrayLike,
    quaternions: ArrayLike | None = None, velocities: ArrayLike | None = None,
    angular_velocities: ArrayLike | None = None, potential: Callable[..., Any] | None = None,
    parameters: Mapping[str, float] | None = None, rep: RepName = "gamma",
    dt: float | None = None, steps: int | None = None, description: str = "",
) -> Model:
    """Return the model of many equal rigid molecules, for scheme splitting.

    H = Σ_i [T(q_i, p_i) + potential(i)] + Σ_{i<j} pair_potential(i, j). One molecule and one pair
    are derived, whatever the count; the C loops over molecules and pairs, and each step of scheme
    splitting evaluates each pair once a kick. Units are any consistent ones.

    Parameters
    ----------
    name : str
        A C identifier.
    count : int
        Number of molecules, 2 to 10,000.
    mass : float
        Of a molecule.
    inertia : three floats
        Its principal moments about the centre of mass; body axes are principal axes.
    pair_potential : callable
        Called once with two molecules, and with the symbols of those parameters that it names;
        returns an expression of ``a.point(r)``, ``a.direction(v)``, ``a.x``, ``a.rotation``, and
        the same of b. Its value must not change when a and b are swapped.
    positions, velocities : array_like, shape (count, 3)
        Of the centres of mass in space; velocities are 0 by default.
    quaternions : array_like, shape (count, 4), optional
        Attitudes from body to space axes, scalar first, of any length but 0; by default both axes
        agree.
    angular_velocities : array_like, shape (count, 3), optional
        In body axes; 0 by default.
    potential : callable, optional
        Called once with one molecule, a ``Body``, and parameters as above: the potential of each
        molecule alone, such as that of a wall or a field.
    parameters : mapping of str to float, optional
        The values of these symbols.
    rep : {"gamma", "alpha"}
        Inertia representation; states and their motion are the same in both.
    dt, steps, description
        As for ``Multibody``.

    Returns
    -------
    Model
        7 count coordinates: of each molecule its quaternion and its position, in turn; those of
        molecule 17 are called m_q0_17, …, m_x_17, ….

    Raises
    ------
    InputError
        For numbers that no molecules can have, a potential that is no expression of these things,
        and one that changes when its molecules are swapped.

    Examples
    --------
    >>> import numpy as np, sympy as sp, gyrospark as gs
    >>> def charges(a, b, k):
    ...     ends = [(+1, (0, 0, 0.5)), (-1, (0, 0, -0.5))]
    ...     return sum(k * s * t / sp.sqrt(sum((x - y)**2 for x, y in zip(a.point(r), b.point(u))))
    ...                for s, r in ends for t, u in ends)
    >>> box = gs.molecules("dipoles", 3, mass=1, inertia=(1, 1, 0.2), pair_potential=charges,
    ...                    parameters={"k": 2.0}, positions=3 * np.eye(3))
    >>> box.system
    <MolecularSystem dipoles: 3 molecules>
    """
    copies = whole(count)
    if copies is None or not 2 <= copies <= MOST_MOLECULES:
        raise InputError(f"count = {shown(count)} is no number of molecules; give a whole number "
                         f"from 2 to {MOST_MOLECULES}.")
    build = Multibody(name, gravity=(0, 0, 0), dt=dt, steps=steps, description=description)
    body = build.body(_NAME, mass=mass, inertia=inertia, rep=rep)
    if body.inverse:
        raise InputError(f"The inertia of molecules {name!r} is a tensor; give three principal "
                         "moments, in principal axes.")
    values = as_mapping(
        "parameters", {} if parameters is None else parameters, "{'k': 332.06}")
    symbols = {key: build.parameter(key, value) for key, value in values.items()}
    if potential is not None:
        build.potential(_called("potential", potential, (body,), symbols))
    own = build.model()
    if own.system.time is not None:
        raise InputError(f"The potential of molecules {name!r} depends on time; write it in places "
                         "and attitudes alone.")
    vectors: dict[Any, SpaceVector] = {}
    V = as_expression(_called("pair_potential", pair_potential,
                              (Molecule(0, vectors), Molecule(1, vectors)), symbols))
    pair = PairPotential(V, tuple(vectors.values()))
    unknown = V.free_symbols - {*symbols.values(), *pair.first, *pair.second}
    if unknown or not vectors:
        what = min(map(str, unknown), default="no point of a molecule")
        raise InputError(f"The pair potential of {name!r} contains {what}; write it in points and "
                         "vectors of its two molecules and in parameters.")
    pair.refuse_asymmetric(name)
    used = [*own.system.parameters, *(x for x in symbols.values() if x in V.free_symbols
                                      and x not in own.system.parameters)]
    for key, x in symbols.items():
        if x not in used:
            raise InputError(f"Parameter {key!r} of {name!r} is in no potential; leave it out.")
    fields = {key: getattr(own.system, key) for key in System.__dataclass_fields__}
    system = MolecularSystem(**fields | {"parameters": tuple(used), "pair": pair,
                                         "copies": copies})
    moments = np.array([own.parameters[str(x)] for x in body.inertia], dtype=float)
    q0, p0 = _states(copies, own.parameters[str(body.mass)], moments, positions, quaternions,
                     velocities, angular_velocities)
    store = dict(own.parameters) | {key: float(x) for key, x in values.items()}
    return replace(own, system=system, parameters=store, q0=q0, p0=p0)


def _called(what: str, function: Any, arguments: tuple[Any, ...], symbols: Mapping[str, sp.Symbol]
            ) -> Any:
    """Return what a potential is, called with molecules and with the parameters that it names."""
    if not callable(function):
        raise InputError(f"{what} = {shown(function)} is no function of molecules.")
    try:
        signature = inspect.signature(function)
        takes_all = any(one.kind is one.VAR_KEYWORD for one in signature.parameters.values())
        named = {key: x for key, x in symbols.items() if takes_all or key in signature.parameters}
        signature.bind(*arguments, **named)
    except (TypeError, ValueError) as error:
        raise InputError(f"{what} cannot be called with {len(arguments)} molecules and the "
                         f"parameters {', '.join(symbols) or '(none)'}: {error}.") from None
    return function(*arguments, **named)


def _states(
    count: int, mass: float, moments: Array, positions: Any, quaternions: Any, velocities: Any,
    angular_velocities: Any,
) -> tuple[Array, Array]:
    """Return q and p of all molecules: p = 2 L(q)ᵀ J ω of each quaternion."""
    def rows(what: str, given: Any, width: int) -> Array:
        return finite(what, np.zeros((count, width)) if given is None else given, (count, width))

    x, v = rows("positions", positions, 3), rows("velocities", velocities, 3)
    turned = np.tile([1.0, 0, 0, 0], (count, 1)) if quaternions is None else quaternions
    q = rows("quaternions", turned, 4)
    length = np.linalg.norm(q, axis=1, keepdims=True)
    if not length.all():
        raise InputError(f"Quaternion {int(np.argmin(length))} of the molecules is 0; give its "
                         "attitude.")
    q = q / length
    m = moments * rows("angular_velocities", angular_velocities, 3)
    turning = 2 * np.column_stack([-(q[:, 1:] * m).sum(axis=1),
                                   q[:, :1] * m + np.cross(q[:, 1:], m)])
    return np.hstack([q, x]).ravel(), np.hstack([turning, mass * v]).ravel()
