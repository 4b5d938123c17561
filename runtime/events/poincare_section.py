"""A Poincaré section: the crossings of a level of a quantity by motions from many starts."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import check_stepper, choose, count_text, shown
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.event import Event
from ...core.exact_numbers import Number, Numbers
from ...core.html import card, table
from ...core.progress import Progress
from ...core.records import dataclass
from ...core.solver import Solver, SolverName
from ...core.start import HasStart, Start
from ..integration.run_arguments import step_argument
from ..integration.starts import merged_starts, steps_of_all

if TYPE_CHECKING:
    from ..derivatives.tangent_space import Tangents
    from ..steppers.stepper import Stepper

__all__ = ["Section", "section"]

#: Steps of scaled time from one stored state to the next: no states but the points are wanted.
_SELDOM = 1 << 20


@explain_arguments
@dataclass(frozen=True, eq=False)
class Section:
    """The points of a section, trajectory after trajectory.

    Attributes
    ----------
    event : Event
        The crossed level.
    t, q, p : arrays, shapes (K,), (K, n), (K, n)
        Time and state of each crossing.
    trajectory : array of int, shape (K,)
        Index of the start of each point.
    failures : dict of int to StepFailed
        Trajectories that ended early; their points until then are here.
    tangents : list of TangentRows or None
        If requested: for each start, the derivatives of its points and their times along the
        section; None if its trajectory failed.
    """

    event: Event
    t: Array
    q: Array
    p: Array
    trajectory: Array
    failures: dict[int, Any]
    _stepper: Stepper = field(repr=False)
    _parameters: list[dict[str, Any]] = field(repr=False)
    tangents: list[Any] = field(default_factory=list, repr=False)

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        return (f"<Section of {self._stepper.name}: {count_text(len(self), 'point')} of "
                f"{count_text(len(self._parameters), 'trajectory')} at {self.event.quantity} = "
                f"{float(self.event.level):g}>")

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the event, and the numbers of points and trajectories."""
        return card(f"Section of {self._stepper.name}", table([
            ("event", f"{self.event.quantity} = {float(self.event.level):g}"),
            ("points", f"{len(self):,}"), ("trajectories", f"{len(self._parameters):,}")]))

    def values(self, name: str) -> Array:
        """Return a coordinate, a momentum or a quantity at each point, shape (K,).

        Raises
        ------
        InputError
            If the system has none of that name.
        """
        system = self._stepper.manifest.system
        quantities = list(system.quantities)
        name = choose("quantity of a section", name,
                      [*quantities, *system.coordinates, *system.momenta])
        if name in quantities:
            return self._quantity(quantities.index(name))
        states, names = (self.q, system.coordinates) if name in system.coordinates else (
            self.p, system.momenta)
        column: Array = states[:, list(names).index(name)]
        return column

    def _quantity(self, column: int) -> Array:
        """Return a quantity at each point, with the parameters of the point's trajectory."""
        binding = self._stepper.binding
        quantity, t, q, p = (np.empty_like(self.q[:, 0]), self.t.astype(binding.dtype), self.q,
                             self.p)
        if binding.clocked:  # C has the time among q; quantities do not depend on its momentum
            q, p = np.column_stack([q, t]), np.column_stack([p, 0 * t])
        bounds = np.searchsorted(self.trajectory, np.arange(len(self._parameters) + 1))
        for parameters, start, end in zip(self._parameters, bounds[:-1], bounds[1:], strict=True):
            points = slice(start, end)
            quantity[points] = binding.quantities(binding.parameters(parameters), t[points],
                                                  q[points], p[points])[:, column]
        return quantity

    def plot(self, x: str, y: str, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw the points by two of their values, a colour for each trajectory.

        Returns a matplotlib figure, which Jupyter shows, and writes it where a path is given.
        """
        from ..plotting.trajectory_plots import draw_section  # matplotlib is optional

        return draw_section(self, x, y, path)


def section(
    stepper: Stepper, starts: HasStart | Sequence[HasStart] | ArrayLike,
    p: ArrayLike | None = None, /, *, event: Event,
    dt: Number | ArrayLike | None = None, dtau: Number | ArrayLike | None = None,
    t_end: Number | None = None, steps: int | None = None,
    parameters: Mapping[str, Numbers] | Sequence[Mapping[str, Number]] | None = None,
    tangents: Tangents | None = None, solver: SolverName | Solver = "auto",
    workers: int | None = None, progress: Progress = None,
) -> Section:
    """Return the Poincaré section of the motions from starts, or from rows of q and p.

    Parameters
    ----------
    event : Event
        The level to cross, and in which direction: ``gs.Event("x", direction=1)``.

    Other arguments as for ``Stepper.integrate_ensemble``. Only the points are stored.

    Raises
    ------
    InputError
        As ``integrate_ensemble``; if ``event`` is no event; for ``tangents`` if a point only
        touches the level.
    """
    check_stepper(stepper)
    if not isinstance(event, Event):
        raise InputError(f'event = {shown(event)} is no event; give gs.Event("x", direction=1).')
    state = merged_starts(stepper, starts, p, parameters)
    step = step_argument(stepper.binding, dt, dtau)
    if stepper.binding.clocked and steps is None:
        span: dict[str, Any] = {"t_end": t_end, "every": _SELDOM}
    else:  # one stored state at the end: events are located in every step, stored or not
        count, _ = steps_of_all(steps, t_end, state.t, step)
        span = {"steps": count, "every": max(count, 1)}
    begin = Start(state.q, state.p, t=state.t)
    begin._excess = state.excess
    ensemble = stepper.integrate_ensemble(
        begin, dt=dt, dtau=dtau, **span,
        parameters=state.parameters, solver=solver, workers=workers, events=event,
        tangents=tangents, progress=progress)
    crossings = [ensemble.events[event.name][i] for i in range(len(ensemble))]
    return Section(
        event, t=np.concatenate([crossing.t for crossing in crossings]),
        q=np.concatenate([crossing.q for crossing in crossings]),
        p=np.concatenate([crossing.p for crossing in crossings]),
        trajectory=np.repeat(np.arange(len(crossings)), [*map(len, crossings)]),
        failures=ensemble.failures, _stepper=stepper,
        _parameters=[member.parameters for member in ensemble.members],
        tangents=[None if tangents_of_run is None else tangents_of_run.events[event.name]
                  for tangents_of_run in ensemble.tangents])
