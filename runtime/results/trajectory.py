"""A trajectory: the result of an integration, its quantities, and its file."""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self, overload

import numpy as np
from numpy.typing import ArrayLike

from ...core.arguments import as_path, count_text, shown
from ...core.arrays import Array
from ...core.calls import explain_arguments
from ...core.errors import InputError
from ...core.event import Impact, impacts_as_json
from ...core.exact_numbers import digits_of
from ...core.file_formats import format_of
from ...core.manifest import Manifest
from ...core.records import dataclass, replace_fields
from ...core.start import Start
from ..compilation.body_columns import (
    PlacedAt,
    beam_named,
    bodies_of,
    body_named,
    joint_named,
    joints_of,
    placed_of,
)
from .beam_motion import BeamMotion
from .body_motion import BodyMotion, FrameName, PlacedMotion, total_momenta
from .crossings import Crossings, Impacts
from .diagnostics import Report
from .joint_motion import JointMotion
from .outputs import OUTPUTS, States, place_of_quantity, value_of
from .rotation_rate import fastest_rotation
from .start_of_row import start_of_row
from .table import save_table, table_of_run
from .trajectory_display import Shown

__all__ = ["Trajectory"]

_OUTPUTS = {output.attribute: output for output in OUTPUTS}


class Maker(Protocol):
    """A stepper, as a trajectory sees it."""

    def _at(self, trajectory: Trajectory, times: ArrayLike) -> Trajectory:
        """Return the states of a trajectory at times."""

    def energy(
        self, q: ArrayLike, p: ArrayLike, *, parameters: Any, t: Any, of_motion: bool,
    ) -> Array:
        """Return H of states, or the energy of their motion."""


@explain_arguments
@dataclass(frozen=True, eq=False)
class Trajectory(Shown):
    """States of a run, stored every ``every`` steps.

    The arrays of a run that has been integrated are computed when they are first asked for.

    Attributes
    ----------
    t : array, shape (N+1,)
        Times t_0 + k dt in seconds: of the stepper's own type where that has more digits than a
        double, else doubles.
    q, p : array, shape (N+1, n)
        Coordinates and momenta; a unit quaternion, scalar first, for a body.
    multipliers : array, shape (N, p+1), or (N, p+1, m) for m > 1 constraints
        Λ_0..Λ_p of the step that ends at each stored state (λ for IMS and EMS).
    reactions : array, shape (N, s, m')
        μ of each velocity constraint at the s stages of that step: the reactions are −A(q)ᵀμ. Else
        (N, 0, 0).
    iterations : array, shape (N,)
        Iterations of that step (fixed-point or Newton), the most of the ``every`` steps since the
        last state.
    energies : array, shape (N+1,)
        H of each state.
    g_errors, f_errors : array, shape (N+1,)
        Largest |g(q)| and largest momentum-constraint error (|qᵀp| for a body) of each state; with
        velocity constraints also of |A H_p + a|.
    work : array, shape (N+1,)
        Work W done by the system's forces since the start; 0 without forces.
    tau : array, shape (N+1,)
        τ of each state, where the system has a ``time_scale``; else (N+1, 0).
    time_momentum : array, shape (N+1,)
        −H − W of each state as the steps have it, the momentum of t in scaled time; else (N+1, 0).
    velocities : array, shape (N+1, n)
        Of each state, where the system is from its Lagrangian; else (N+1, 0).
    quantity_values : array, shape (N+1, number of quantities)
        The system's quantities of each state; see ``quantity``.
    dt, parameters : number, dict of str to number
        As the stepper had them: floats; NumPy's long doubles or mpmath numbers where it computes
        with more digits. In scaled time dt is Δτ.
    report : Report
        Diagnostics over every step.
    events : dict of str to Crossings
        Where the events that were asked for happened: ``events["height"].t``, ``.q``, ``.p``; of
        impacts with the momenta before.
    impacts : dict of str to Impacts
        The impacts of each gap: ``impacts["floor"].t``, ``.q``, ``.p_before``, ``.p``,
        ``.impulse``, ``.energy_lost``.
    """

    t: Array
    q: Array
    p: Array
    multipliers: Array
    reactions: Array
    iterations: Array
    dt: Any
    every: int
    parameters: dict[str, Any]
    report: Report
    manifest: Manifest
    energies: Array
    g_errors: Array
    f_errors: Array
    work: Array
    tau: Array
    time_momentum: Array
    velocities: Array
    quantity_values: Array
    #: Where its events happened, by their names; see ``gyrospark.Event``.
    events: dict[str, Crossings] = field(default_factory=dict, repr=False)
    #: The impacts of its gaps, by their names; see ``gyrospark.Impact``.
    impacts: dict[str, Impacts] = field(default_factory=dict, repr=False)
    #: The name of the event that ended the run, or of the gap that stays closed.
    _ended_by: str | None = field(default=None, repr=False)
    #: The event that ends a run at t_end in scaled time, by its name.
    _end_event: dict[str, Crossings] = field(default_factory=dict, repr=False)
    #: Derivatives of the stored states, where ``integrate(tangents=...)`` was asked for them.
    tangents: Any = field(default=None, repr=False)
    #: What inputs its steps had, where it is known: of what ``integrate`` returned.
    _inputs: Any = field(default=None, repr=False)
    #: The laws of its impacts, which runs from its states keep.
    _laws: tuple[Impact, ...] = field(default=(), repr=False)
    #: The arguments and events it was integrated with, where they are known.
    _origin: Any = field(default=None, repr=False)
    #: Where a longer run goes on, if the last row lies between two steps.
    _grid: Any = field(default=None, repr=False)
    #: What ``at`` makes its steps with, or a function that returns it, where it is known: of what
    #: ``integrate`` returned, and of stored runs.
    _stepper: Any = field(default=None, repr=False)
    #: What the arrays that are not there yet are computed from, or a function that returns it.
    _states: Any = field(default=None, repr=False)
    #: A function that returns the report, until it is there.
    _read: Callable[[], Report] | None = field(default=None, repr=False)

    @classmethod
    def of(cls, states: States | Callable[[], States], **others: Any) -> Self:
        """Return the trajectory of stored states; ``others`` are the fields beside its arrays.

        States, and a report by ``_read`` in place of ``report``, may be made when asked for.
        """
        trajectory = object.__new__(cls)
        trajectory.__dict__.update({"events": {}, "impacts": {}, "_end_event": {}, **others,
                                    "_states": states})
        return trajectory

    def of_states(self, states: States, **changes: Any) -> Trajectory:
        """Return a trajectory with other states, and other values of some fields."""
        stored = {name: x for name, x in self.__dict__.items() if name not in _OUTPUTS}
        return self.of(states, **stored | changes)

    if not TYPE_CHECKING:  # names that are no field stay errors to a type checker

        def __getattr__(self, name: str) -> Array:
            """Compute an output and store it; it shares no memory with other arrays."""
            attributes = self.__dict__
            if name == "report" and attributes.get("_read"):
                return attributes.setdefault(name, attributes["_read"]())
            states = attributes.get("_states")
            if states is None or name not in _OUTPUTS:
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
            if callable(states):
                states = attributes["_states"] = states()
            array = value_of(_OUTPUTS[name], states)
            # a caller may change what it gets, and must not change the states with it
            if array.base is not None or any(array is x for x in states.arrays):
                array = array.copy()
            return self.__dict__.setdefault(name, array)

    def __len__(self) -> int:
        return len(self.t)

    @overload
    def __getitem__(self, row: int) -> Start: ...

    @overload
    def __getitem__(self, row: slice) -> Trajectory: ...

    def __getitem__(self, row: Any) -> Start | Trajectory:
        """Return a stored state as the start of another run: ``step.integrate(run[-1], ...)``.

        A slice, ``run[::10]``, is a run of some of the states.

        A run from this start has the states of one longer run to round-off; a ``Simulation`` and a
        store continue to the bit. If inputs change, the start has those of the step that ended
        there. γ and α by a rule are computed again for other moments.

        Raises
        ------
        IndexError
            Beyond the rows.
        """
        if isinstance(row, slice):
            return self._rows(_row_range(row, len(self)))
        try:
            index = range(len(self))[operator.index(row)]
        except TypeError:
            raise InputError(f"run[{shown(row)}] is no row; give a whole number, or a slice such "
                             "as run[::10].") from None
        except IndexError:
            raise IndexError(f"run[{shown(row)}] is none of "
                             f"{count_text(len(self), 'stored state')}.") from None
        inputs: dict[str, Any] = {}
        if self._inputs is not None and len(self) > 1:
            # of the step that ends at the row, where the quotient is whole but for round-off; a run
            # at given times has none: they lie within steps
            step = math.ceil(float(self.elapsed[index] / self.dt) - 1e-6) - 1
            inputs = dict(zip(self._inputs.names,
                              self._inputs.at(max(step, 0)).tolist(), strict=True))
        # the momentum e of the time is −H but for the error of the steps; the next run continues
        # with this excess H + e
        clocked = self.manifest.system.clock is not None
        excess = self.energies[index] + self.time_momentum[index] if clocked else 0.0
        return start_of_row(self.q[index].copy(), self.p[index].copy(), self.t[index],
                            self.parameters, inputs, excess, self._laws)

    @property
    def grid_end(self) -> Start:
        """The state after the last whole step, from which a longer run continues.

        It is ``run[-1]``, unless ``t_end`` lies between two steps.

        Raises
        ------
        InputError
            For a run that was read from a file and ends between two steps, or at an event.
        """
        if self._grid is not None:
            return self._grid  # type: ignore[no-any-return]
        steps = [float(elapsed / self.dt) for elapsed in self.elapsed[-1:]]  # [] without states
        if not steps or abs(steps[0] - round(steps[0])) > 1e-6:
            raise InputError("The run ends between two steps, at an event or read from a file, "
                             "and its last whole step is not kept; go on from run[-1].")
        return self[-1]

    def _rows(self, row_range: range) -> Trajectory:
        """Return the run of some of the states, with the multipliers of the steps that end at them.

        Events and impacts are those between the first and the last of these states.
        """
        row_indices = np.asarray(row_range)
        arrays: dict[str, Array] = {}
        for output in OUTPUTS:
            # arrays of steps have no row for the start: the step to row k is k − 1
            indices = row_indices[1:] - 1 if output.of_steps else row_indices
            arrays[output.attribute] = getattr(self, output.attribute)[indices]
        if len(row_range) > 1:  # the most of all steps between two of the states
            arrays["iterations"] = np.maximum.reduceat(
                self.iterations[: row_indices[-1]], row_indices[:-1])
        ahead, start_time = (1 if self.dt > 0 else -1), self.t[row_range[0]]
        # a slice up to the end of the run has the events behind its last row too
        end_time = None if row_range[-1] + row_range.step >= len(self) else self.t[row_range[-1]]
        events = {name: crossings.within(start_time, end_time, ahead)
                  for name, crossings in self.events.items()}
        impacts = {name: hits.within(start_time, end_time, ahead)
                   for name, hits in self.impacts.items()}
        return replace_fields(self, **arrays, every=self.every * row_range.step, events=events,
                              impacts=impacts,
                              tangents=None, _inputs=None, _origin=None, _states=None,
                              _grid=self._grid if row_range[-1] == len(self) - 1 else None)

    def _blocks(self) -> Iterator[tuple[slice, Trajectory]]:
        """Yield (rows, block) for blocks of the run in memory."""
        yield slice(0, len(self)), self

    def _attributes(self) -> dict[str, Any]:
        """Return the attributes of the run in files, as JSON values."""
        return {
            "title": f"{self.manifest.name}: {count_text(self.report.steps, 'step')} of "
                     f"{float(self.dt):g} s",
            "run": {"parameters": {name: digits_of(x) for name, x in self.parameters.items()},
                    "dt": digits_of(self.dt), "every": self.every, "steps": self.report.steps,
                    **({"impacts": impacts_as_json(self._laws, self.parameters)}
                       if self._laws else {})},
            "report": asdict(self.report), "manifest": self.manifest.as_json()}

    def __iter__(self) -> Iterator[Start]:
        """Iterate over the stored states as starts."""
        return (self[row] for row in range(len(self)))

    @property
    def time_steps(self) -> Array:
        """The length of a step at each state, shape (N+1,): Δt, in scaled time about σ Δτ."""
        clock = self.manifest.system.clock
        steps: Array = (np.full(len(self), self.dt) if clock is None else
                        self.dt * self.quantity(clock.scale))
        return steps

    @property
    def rotation_max(self) -> float:
        """The largest rotation |Ω Δt| of a body in a step, in rad, of the stored states.

        0 where no body turns, and along a co-moving frame. A method of order r bears r/2 + 1/2 rad.
        """
        fastest = fastest_rotation(self)
        return 0.0 if fastest is None else fastest.radians

    @property
    def elapsed(self) -> Array:
        """Times since the start, which have more digits than t where that is late.

        An integrated run has its own; for states from a file, and for states between steps, they
        are differences of t. In scaled time they are those of τ.
        """
        times = self.tau if self.manifest.system.clock is not None else self.t
        stored_times = None if self._states is None else self._states.elapsed
        elapsed: Array = times - times[:1] if stored_times is None else stored_times.copy()
        return elapsed

    def __repr__(self) -> str:
        """Return the scheme, states, steps and times, and the largest errors on a second line."""
        report = self.report
        last_part = "" if self._grid is None else " and a part of one"
        # t_eval=[] stores no state
        times = f", t = {float(self.t[0]):.6g} to {float(self.t[-1]):.6g} s" if len(self) else ""
        return (f"<Trajectory of {self.manifest.name}: {count_text(len(self), 'state')} of "
                f"{count_text(report.steps, 'step')}{last_part}{times}\n"
                f"  largest errors: energy {report.energy_error_max:.1e}, constraint "
                f"{report.constraint_max:.1e}, momentum {report.momentum_constraint_max:.1e}>")

    def energy(self, *, of_motion: bool = False, stepper: Maker | None = None) -> Array:
        """Return H of each stored state, shape (N+1,), in joules for SI input.

        With ``of_motion`` it is the energy of the motion, H with p projected onto g_q H_p = 0; see
        ``Stepper.energy``. It differs for schemes that do not project p.

        Parameters
        ----------
        stepper : Stepper, optional
            The stepper that made the trajectory, for ``of_motion``; only needed if ``integrate``
            did not return it in this process.

        Raises
        ------
        InputError
            Where ``of_motion`` needs a stepper that is not known.
        """
        if not of_motion or not self.has_motion_energy:
            return self.energies
        return self._maker(stepper, "energy(of_motion=True, stepper=...)").energy(
            self.q, self.p, parameters=self.parameters, t=self.t, of_motion=True)

    def energy_error(self, *, of_motion: bool = False, stepper: Maker | None = None) -> Array:
        """Return H_k − H_0 − W_k + L_k of each stored state, W the work of the forces since the
        first of them, L the energy lost in impacts, shape (N+1,); arguments as for ``energy``."""
        H = self.energy(of_motion=of_motion, stepper=stepper)
        error: Array = H - H[:1] - (self.work - self.work[:1])
        for impacts in self.impacts.values() if len(self) else ():
            ahead = 1 if self.dt > 0 else -1
            lost = np.concatenate([np.zeros(1, H.dtype), np.cumsum(impacts.energy_lost)])
            count = np.searchsorted(ahead * impacts.t, ahead * self.t, side="right")
            count[0] -= (impacts.elapsed[: count[0]] == 0).sum()  # the start is before its impacts
            error = error + (lost[count] - lost[count[0]])
        return error

    @property
    def has_motion_energy(self) -> bool:
        """Whether the energy of the motion may differ from H: the scheme does not project p onto
        the constraint on the momenta."""
        return bool(self.manifest.system.constraints
                    and not self.manifest.scheme.keeps_momentum_constraint)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The name of each coordinate, of a column of ``q``."""
        return tuple(self.manifest.system.coordinates)

    @property
    def momenta(self) -> tuple[str, ...]:
        """The name of each momentum, of a column of ``p``."""
        return tuple(self.manifest.system.momenta)

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names of the system's quantities, arguments of ``quantity``."""
        return tuple(self.manifest.system.quantities)

    def quantity(self, name: str) -> Array:
        """Return a quantity of the system at each stored state, shape (N+1,).

        Raises
        ------
        InputError
            If the system has no quantity of that name.
        """
        quantity: Array = self.quantity_values[:, place_of_quantity(self.manifest, name)]
        return quantity

    def constraint_errors(self) -> tuple[Array, Array]:
        """Return |g(q)| and |qᵀp| (or the system's own momentum constraint) of each state."""
        return self.g_errors, self.f_errors

    # ------------------------------------------------------------ bodies and joints

    @property
    def bodies(self) -> tuple[str, ...]:
        """The names of the rigid bodies, which ``body`` takes."""
        return (*bodies_of(self.manifest), *placed_of(self.manifest))

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of the joints, which ``joint`` takes."""
        return tuple(name for name, columns in joints_of(self.manifest).items()
                     if columns.constraints)

    def body(self, name: str | None = None) -> BodyMotion:
        """Return the motion of one rigid body: attitude, angles, velocities, momenta.

        Parameters
        ----------
        name : str, optional
            Which of several bodies.

        Raises
        ------
        InputError
            Where there is no body, or several and none is named.

        Examples
        --------
        >>> run.body("bus").euler("ZYX", degrees=True)            # doctest: +SKIP
        >>> run.body("bus").angular_velocity(frame="space")       # doctest: +SKIP
        """
        body_name, columns = body_named(self.manifest, name)
        return (PlacedMotion(self, body_name, columns) if isinstance(columns, PlacedAt) else
                BodyMotion(self, body_name, columns))

    def joint(self, name: str | None = None) -> JointMotion:
        """Return one joint: its point, its angle, the force and the torque in it.

        Parameters
        ----------
        name : str, optional
            Which of several joints.

        Raises
        ------
        InputError
            Where there is no joint, or several and none is named.

        Examples
        --------
        >>> run.joint("hinge").angle(degrees=True)                # doctest: +SKIP
        >>> run.joint("hinge").force()                            # doctest: +SKIP
        """
        return JointMotion(self, *joint_named(self.manifest, name))

    def beam(self, name: str | None = None) -> BeamMotion:
        """Return one beam: its centre line, curvature, and the force and moment in its sections.

        Parameters
        ----------
        name : str, optional
            Which of several beams.

        Raises
        ------
        InputError
            Where there is no beam, or several and none is named.

        Examples
        --------
        >>> run.beam("cable").line()                              # doctest: +SKIP
        >>> run.beam("cable").tension()                           # doctest: +SKIP
        """
        return BeamMotion(self, *beam_named(self.manifest, name))

    def angular_velocity(self, body: str | None = None) -> Array:
        """Return Ω in body axes, shape (N+1, 3), in rad/s; see ``BodyMotion.angular_velocity``.

        Takes the same argument and raises the same errors as ``body``.
        """
        return self.body(body).angular_velocity()

    def total_momentum(self) -> Array:
        """Return Σ m ẋ of all bodies in space axes, shape (N+1, 3), in kg m/s.

        It is conserved where potentials depend on relative positions alone.

        Raises
        ------
        InputError
            Unless all coordinates belong to bodies with a quaternion and a position.
        """
        linear, _ = total_momenta(self)
        return linear

    def total_angular_momentum(self) -> Array:
        """Return Σ (l + x × m ẋ) about the origin of space, shape (N+1, 3), in kg m²/s.

        It is conserved where potentials depend on distances alone; raises as ``total_momentum``.
        """
        _, angular = total_momenta(self)
        return angular

    def axis(self, body: str | None = None) -> Array:
        """Return the body's third axis in space, (R13, R23, R33), shape (N+1, 3)."""
        return self.body(body).axis()

    def rotation(self, body: str | None = None) -> Any:
        """Return the attitudes as ``scipy.spatial.transform.Rotation``, body to space."""
        return self.body(body).rotation()

    @overload
    def at(self, times: float, *, stepper: Maker | None = None) -> Start: ...

    @overload
    def at(self, times: ArrayLike, *, stepper: Maker | None = None) -> Trajectory: ...

    def at(self, times: Any, *, stepper: Maker | None = None) -> Trajectory | Start:
        """Return the states at times between the steps.

        Each is a real step of a part of Δt from the state before (after whole steps, where the run
        did not store each): on its constraints to round-off, and as near to the motion as the
        states of the run. At a time of a stored state it is that state. The states do not continue
        each other: their order does not matter, and each costs a step. Multipliers and iterations
        are those of the steps that end there, without the first row's.

        Parameters
        ----------
        times : float, or array_like of shape (N,)
            In seconds, in any order, within the run. The state at one time comes as a ``Start``.
        stepper : Stepper, optional
            The stepper that made the trajectory; only needed if ``integrate`` did not return it in
            this process.

        Raises
        ------
        InputError
            Where the stepper is not known, for times outside of the run.
        """
        states = self._maker(stepper, "at(times, stepper=...)")._at(self, times)
        return states if np.ndim(times) else states[0]

    def _maker(self, stepper: Maker | None, call: str) -> Maker:
        """Return the stepper of the trajectory: the argument, or the one that integrated it."""
        maker: Maker | None = stepper
        if maker is None:
            maker = self._stepper() if callable(self._stepper) else self._stepper
        if maker is None:
            raise InputError(
                f"This trajectory of {self.manifest.name} does not know the stepper that made "
                f"it, for it was copied, pickled or read from a file, or belongs to an ensemble; "
                f"give {call}.")
        if not callable(getattr(maker, "_at", None)):
            raise InputError(f"stepper = {shown(maker)} is no stepper; give what gyrospark.stepper "
                             "returned.")
        return maker

    def gradient(self, cotangents: Any = None, *, stepper: Any = None, **options: Any) -> Any:
        """Return the gradient of a function of this run; see ``Stepper.gradient``.

        Parameters
        ----------
        cotangents : mapping
            Derivatives of the function by the stored states: {"q": ..., "p": ...}.
        stepper : Stepper, optional
            The stepper that made the trajectory; only needed if ``integrate`` did not return it in
            this process.
        options
            ``loss``, ``wrt``, ``memory`` and ``solver``.

        Raises
        ------
        InputError
            Where the stepper is not known, and as ``Stepper.gradient``.
        """
        maker: Any = self._maker(stepper, "gradient(..., stepper=...)")
        return maker.gradient(self, cotangents, **options)

    def hessian(self, cotangents: Any = None, *, stepper: Any = None, **options: Any) -> Any:
        """Return the second derivatives of a function of this run; see ``Stepper.hessian``.

        Parameters
        ----------
        cotangents, stepper
            As of ``gradient``.
        options
            ``loss``, ``slopes``, ``wrt``, ``memory`` and ``solver``.

        Raises
        ------
        InputError
            Where the stepper is not known, and as ``Stepper.hessian``.
        """
        maker: Any = self._maker(stepper, "hessian(..., stepper=...)")
        return maker.hessian(self, cotangents, **options)

    def made_by(self, stepper: Maker, origin: Any = None) -> Trajectory:
        """Return this trajectory with its stepper and the arguments of its run."""
        return replace_fields(self, _stepper=stepper, _origin=origin)

    def __getstate__(self) -> dict[str, Any]:
        """Pickle the arrays without the stepper."""
        # another process has no compiled code to compute them
        arrays = {name: getattr(self, name) for name in (*_OUTPUTS, "report")}
        return {**self.__dict__, **arrays, "_stepper": None, "_states": None, "_read": None}

    # ------------------------------------------------------------ file

    def save(
        self, path: str | os.PathLike[str], *, columns: str | Iterable[str] | None = None,
        euler: str | None = None, degrees: bool = False,
        angular_velocity: FrameName | None = None,
    ) -> Path:
        """Write the states to a file, which appears complete or not at all; return its path.

        - .npz: all arrays with all their digits, the names of their columns, parameters, report,
          events, tangents and manifest: for ``gyrospark.load`` and ``numpy.load``.
        - .zarr: the same as a store, without tangents: for ``gyrospark.load`` and
          ``xarray.open_zarr``.
        - .nc: NetCDF-4 with attributes, without tangents: for ``gyrospark.load``, xarray, MATLAB, R
          (h5netcdf).
        - .csv, .parquet: a column a number, under the names of coordinates, momenta and
          quantities, with the arguments of ``table``; events in a second file,
          ``run.events.csv``.

        Raises
        ------
        InputError
            For another ending, or none; for columns that are not there, or of another file than
            .csv and .parquet.
        MissingDependencyError
            Where the package of a format is not installed.
        GyrosparkError
            If the file cannot be written.

        Examples
        --------
        >>> run.save("run.csv", columns=["*_angle", "energy"], euler="ZYX")  # doctest: +SKIP
        """
        target = as_path("path", path, "run.npz")
        form = format_of(target, "A run", "states", "store")
        column_options = {"columns": columns, "euler": euler, "angular_velocity": angular_velocity}
        option_names = [name for name, argument in column_options.items() if argument is not None]
        if not form.tabular and (option_names or degrees):
            option = (option_names or ["degrees"])[0]
            cure = ("leave it out" if option == "columns" else
                    f"take run.dataset({option}=...), which xarray writes to .nc or .zarr")
            raise InputError(f"{option} is for files of columns, .csv and .parquet, which "
                             f"{target.name!r} is not; {cure}.")
        form.require_packages()
        if "trajectory" in form.writers:
            written_path: Path = form.function(form.writers["trajectory"])(self, target)
            return written_path
        return save_table(table_of_run(self, euler=euler, degrees=degrees,
                                       angular_velocity=angular_velocity), target, "The run",
                          columns)


def _row_range(row_slice: slice, count: int) -> range:
    """Return the rows that a slice of a run takes, in their order.

    Raises InputError for a step below 1 and a slice without rows.
    """
    try:
        row_range = range(count)[row_slice]
    except (TypeError, ValueError):
        row_range = range(0)
    if not row_range or row_range.step < 1:
        raise InputError(f"run[{shown(row_slice)}] is no part of {count_text(count, 'state')}; "
                         "give whole "
                         "numbers and a step of at least 1, as in run[100::10].")
    return row_range
