"""Models of ``sympy.physics.mechanics``: a serial arm and a tree of links on pin joints.

Links are alike, each on the end of the one before, about that one's x, y and z in turn. The same
``System`` is given to ``gs.from_mechanics`` and to PyDy; both start at rest. Errors are, as beside
other bodies, the largest distance of a centre of mass to a long-double reference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import sympy as sp
from sympy.physics import mechanics as me

from gyrospark._version import __version__
from gyrospark.api import stepper
from gyrospark.generator.systems.sympy_mechanics import from_mechanics
from gyrospark.runtime.steppers.stepper import Stepper

from .joined_bodies import T_END, BodyRow, Contest, Run
from .peer_linkages import Array
from .peers import pydy_mechanics
from .peers.optional import Unavailable, version

__all__ = ["Links", "arm", "compare_mechanics", "links", "tree"]

#: m, l (half the length of a link), I, g in SI units.
VALUES = {"m": 1.0, "l": 0.2, "I": 0.02, "g": 9.81}
#: Stages → time steps.
_OURS = {2: (5e-3, 2e-3, 1e-3), 3: (1e-2, 5e-3, 2e-3, 1e-3), 4: (1e-2, 5e-3, 2e-3)}
#: Stages and time step of the reference.
_REFERENCE = (6, 1e-3)


@dataclass(frozen=True)
class Links:
    """Links by the number of the one each hangs on; None is the ground."""

    name: str
    parents: tuple[int | None, ...]

    @property
    def start(self) -> Array:
        """Angles at t = 0, all different: from 0.3 to 0.6 rad."""
        return np.linspace(0.3, 0.6, len(self.parents))

    def system(self) -> Any:
        """Return the ``System`` of SymPy."""
        space, origin = me.ReferenceFrame("N"), me.Point("O")
        origin.set_vel(space, 0)
        mass, length, inertia, gravity = sp.symbols(list(VALUES), positive=True)
        found, ground = me.System(space, origin), me.RigidBody("ground", origin, space)
        made: list[Any] = []
        for i, parent in enumerate(self.parents):
            before = ground if parent is None else made[parent]
            axes, centre = me.ReferenceFrame(f"A{i}"), me.Point(f"C{i}")
            made.append(me.RigidBody(f"link{i}", centre, axes, mass, (
                me.inertia(axes, inertia, inertia, inertia / 10), centre)))
            found.add_joints(me.PinJoint(
                f"joint{i}", before, made[i], *me.dynamicsymbols(f"q{i} u{i}"),
                parent_point=origin if parent is None else before.masscenter.locatenew(
                    f"P{i}", length * before.frame.z),
                child_point=centre.locatenew(f"Q{i}", -length * axes.z),
                joint_axis=(before.frame.x, before.frame.y, before.frame.z)[i % 3]))
            found.add_loads(me.Force(centre, -mass * gravity * space.z))
        return found

    def centres(self, q: Any) -> Array:
        """Return the centres of mass at the angles q, shape (links, 3)."""
        R: dict[int | None, Array] = {None: np.eye(3)}
        ends: dict[int | None, Array] = {None: np.zeros(3)}
        found = []
        for i, (parent, angle) in enumerate(zip(self.parents, np.asarray(q, float), strict=True)):
            R[i] = R[parent] @ _turned(i % 3, float(angle))
            half = VALUES["l"] * R[i][:, 2]
            found.append(ends[parent] + half)
            ends[i] = ends[parent] + 2 * half
        return np.array(found)


def arm(count: int) -> Links:
    """Return so many links in a row."""
    return Links(f"arm of {count}", tuple(i - 1 if i else None for i in range(count)))


def tree(count: int) -> Links:
    """Return so many links, two on each as far as they go."""
    return Links(f"tree of {count}", tuple((i - 1) // 2 if i else None for i in range(count)))


def links(*, quick: bool = False) -> list[Links]:
    """Return the arm of 7 and the tree of 30; in a quick run an arm of 2."""
    return [arm(2)] if quick else [arm(7), tree(30)]


def compare_mechanics(
    chosen: Sequence[Links], peers: Sequence[str], rounds: int, least: float, *,
    quick: bool = False, watch: Callable[[str], None] = lambda name: None,
) -> list[BodyRow]:
    """Return the rows of gyrospark and PyDy on every model, both timed in turn."""
    found = []
    for model in chosen:
        watch(f"{model.name}: derive")
        system = from_mechanics(model.system(), name=model.name.replace(" ", "_"))
        contest = Contest(model.name, *_reference(model, system))
        if "gyrospark" in peers:
            for row, run in _ours(model, system, quick=quick):
                watch(f"{model.name}: {row.name}")
                contest.enter(row, run)
        if "pydy" in peers:
            watch(f"{model.name}: pydy")
            _enter_pydy(contest, model, quick=quick)
        watch(f"{model.name}: {len(contest.runs)} runs in turn, {rounds} rounds")
        found += contest.timed(rounds, least)
    return found


def _reference(model: Links, system: Any) -> tuple[Array, float]:
    stages, dt = _REFERENCE
    step = stepper("G-L", stages, system=system, real="long-double")
    ends = [_integrate(model, step, h) for h in (dt, dt / 2)]
    return ends[1], float(np.linalg.norm(ends[1] - ends[0], axis=1).max())


def _ours(model: Links, system: Any, *, quick: bool) -> Iterator[tuple[BodyRow, Run]]:
    for stages, dts in ({2: (5e-3, 2e-3)} if quick else _OURS).items():
        step = stepper("G-L", stages, system=system)
        for dt in dts:
            yield (BodyRow(model.name, "gyrospark", __version__, f"G-L s={stages}", dt,
                           2 * stages), partial(_integrate, model, step, dt))


def _integrate(model: Links, step: Stepper, dt: float) -> Array:
    start, steps = model.start, round(T_END / dt)
    rest = np.zeros_like(start)  # momenta, too
    end = step.integrate(start, rest, dt=dt, steps=steps, every=steps, parameters=VALUES)
    return model.centres(end.q[-1])


def _enter_pydy(contest: Contest, model: Links, *, quick: bool) -> None:
    row = BodyRow(model.name, "pydy", version("pydy"), "")
    try:
        machine = pydy_mechanics.PydyMechanics(model.system(), VALUES)
    except Unavailable as reason:
        contest.rows.append(replace(row, note=str(reason)))
        return
    except Exception as error:  # such as code that does not compile: its row
        contest.rows.append(replace(row, note=f"failed: {error!r}", failed=True))
        return
    note = f"derived and compiled in {machine.cost:.0f} s of CPU"
    for tolerance in pydy_mechanics.TOLERANCES[-1:] if quick else pydy_mechanics.TOLERANCES:
        contest.enter(replace(row, method=f"DOP853 tol {tolerance:g}", note=note),
                      partial(_run, model, machine, tolerance))


def _run(model: Links, machine: pydy_mechanics.PydyMechanics, tolerance: float) -> Array:
    return model.centres(machine.run(tolerance, model.start, T_END))


def _turned(axis: int, angle: float) -> Array:
    """Return the rotation about one of the three axes."""
    c, s = np.cos(angle), np.sin(angle)
    R = np.eye(3)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    R[j, j], R[j, k], R[k, j], R[k, k] = c, -s, s, c
    return R
