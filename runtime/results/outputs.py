"""The arrays of a run, one record each: trajectories, .npz, stores, .csv, .nc, pictures follow.

An output is a number, or an array of them, for each stored state. To add one: a record in
``OUTPUTS``, a field of that name in ``Trajectory``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from ...core.arguments import proposal, shown
from ...core.arrays import Array
from ...core.errors import InputError
from ...core.manifest import Manifest, SystemManifest
from ...core.records import dataclass
from ..bindings.binding import Binding
from ..bindings.run_memory import ParameterStruct

__all__ = ["OUTPUTS", "QUANTITY", "Output", "States", "absent", "array_from_files",
           "arrays_in_files", "defect_sizes", "description_of", "description_of_column",
           "flat_multipliers", "full_states", "labels_of", "names_in_files", "place_of_quantity",
           "value_of"]

#: Dimensions of one state's entry: (name, length) of each.
Inner = tuple[tuple[str, int], ...]

#: What the names of a system's own quantities begin with.
QUANTITY = "quantity_"


@dataclass(frozen=True)
class States:
    """Stored states of a run, and the compiled code that evaluates their outputs.

    Attributes
    ----------
    binding, manifest
        The stepper's.
    parameters
        The struct of parameters of the compiled code.
    t, q, p, work : array, shapes (N+1,), (N+1, n), (N+1, n), (N+1,)
        In scaled time t is τ, and the last columns of q and p are the time and its momentum.
    multipliers, iterations : array, shapes (N, ·) and (N,)
        They belong to the step that ends at a state: the start has none.
    elapsed : array, optional
        Times since the start, which have more digits than t if the start is late.
    """

    binding: Binding
    manifest: Manifest
    parameters: ParameterStruct
    t: Array
    q: Array
    p: Array
    multipliers: Array
    iterations: Array
    work: Array
    elapsed: Array | None = None

    @property
    def arrays(self) -> tuple[Array, ...]:
        """The stored arrays."""
        return self.t, self.q, self.p, self.multipliers, self.iterations, self.work

    @property  # nothing cached: its lock would be held for ever in a forked child
    def energies(self) -> Array:
        """H of each state."""
        return self.binding.hamiltonian(self.parameters, self.q, self.p, self._times)

    @property
    def times(self) -> Array:
        """The time of each state: in scaled time a coordinate."""
        if not self.binding.clocked:
            return self.t
        time: Array = self.q[:, -1]
        return time if time.dtype == object else time.astype(self.binding.number_type)

    @property
    def _times(self) -> Array:
        """t in the type of the compiled code's numbers."""
        return self.t.astype(self.binding.dtype)

    @property
    def defects(self) -> DefectSizes:
        """The largest |g| and the largest momentum-constraint error of each state."""
        return defect_sizes(self.binding, self.parameters, self.q, self.p, self._times)

    @property
    def step_multipliers(self) -> Array:
        """The multipliers, (…, p+1) or (…, p+1, m) for m > 1 constraints."""
        m, count = self.binding.m, self.binding.multipliers - self.binding.reactions
        multipliers = self.multipliers[:, :count]
        return multipliers.reshape(len(multipliers), count // m, m) if m > 1 else multipliers

    @property
    def reactions(self) -> Array:
        """The multipliers of velocity constraints at the stages, (…, s, m')."""
        constraint_count, count = self.binding.rows, self.binding.reactions
        return self.multipliers[:, -count:].reshape(-1, count // constraint_count, constraint_count)

    @property
    def velocities(self) -> Array:
        """H_p of each state, of a system from its Lagrangian."""
        return self.binding.velocities(self.parameters, self.q, self.p, self._times)

    @property
    def quantities(self) -> Array:
        """The system's quantities, a column each."""
        return self.binding.quantities(self.parameters, self._times, self.q, self.p)


def _scalar(manifest: Manifest) -> Inner | None:
    """Return no dimensions: a number a state."""
    return ()


def _coordinates(manifest: Manifest) -> Inner | None:
    """Return the dimension of coordinates."""
    return (("coordinate", len(manifest.system.coordinates)),)


def _multipliers(manifest: Manifest) -> Inner | None:
    """Return the dimensions (node, constraint) of multipliers, or (node,) for one constraint.

    Compositions of exact flows have none.
    """
    m, nodes = len(manifest.system.constraints), manifest.scheme.multipliers
    along = [("constraint", m)] if m > 1 else []
    return (("node", nodes), *along) if m and nodes else None


def _reactions(manifest: Manifest) -> Inner | None:
    """Return the dimensions (stage, velocity constraint) of reactions."""
    names = manifest.system.velocity_constraint_names
    return (("stage", manifest.scheme.reactions),
            ("velocity_constraint", len(names))) if names else None


def _with_forces(manifest: Manifest) -> Inner | None:
    """Return no dimensions, a number a state, for a system with forces."""
    return () if manifest.system.forces else None


def _scaled_time_dimensions(manifest: Manifest) -> Inner | None:
    """Return no dimensions, a number a state, for a system in scaled time."""
    return () if manifest.system.clock is not None else None


def _with_lagrangian(manifest: Manifest) -> Inner | None:
    """Return the dimension of coordinates for a system from its Lagrangian."""
    return _coordinates(manifest) if manifest.system.velocity_names else None


@dataclass(frozen=True)
class Output:
    """One array of a run.

    Attributes
    ----------
    name : str
        Name in stores and files.
    attribute : str
        Name of the attribute of ``Trajectory``.
    long_name : str
        Description for readers of files.
    compute : callable
        From ``States`` to the array.
    inner : callable
        From a manifest to the dimensions of one state's entry; None where the system has no such
        output. A trajectory then has an array of ``absent`` entries.
    units, body_units : str
        Units of every system, and of a system of one rigid body in SI units.
    labels : str
        The entry of the manifest's system with names along the last dimension.
    split : bool
        Whether each number is an array of its own in files, ``quantity_<name>``.
    dtype : str
        NumPy's code in stores; "" for the type of the stepper's numbers.
    of_steps : bool
        Whether it belongs to the step that ends at a state: the start has none.
    absent : tuple of int
        The shape of one state's entry where the system has no such output; with a 0, unless it is a
        number.
    panel : str
        Title of its panel in pictures; "" where it has none.
    """

    name: str
    attribute: str
    long_name: str
    compute: Callable[[States], Array]
    inner: Callable[[Manifest], Inner | None] = _scalar
    units: str = ""
    body_units: str = ""
    labels: str = ""
    split: bool = False
    dtype: str = ""
    of_steps: bool = False
    absent: tuple[int, ...] = ()
    panel: str = ""

    @property
    def is_integer(self) -> bool:
        """Whether its entries are whole numbers."""
        return self.dtype.startswith("i")


#: In the order of columns in files.
OUTPUTS = (
    Output("time", "t", "time", lambda at: at.times, units="s", dtype="f8"),
    Output("q", "q", "coordinates", lambda at: at.q[:, : at.binding.shown], _coordinates,
           body_units="1", labels="coordinates"),
    Output("p", "p", "momenta", lambda at: at.p[:, : at.binding.shown], _coordinates,
           body_units="kg m2 s-1", labels="momenta"),
    Output("energy", "energies", "Hamiltonian of the stepper's own form", lambda at: at.energies,
           body_units="J"),
    Output("g_error", "g_errors", "largest |g(q)|", lambda at: at.defects.g),
    Output("f_error", "f_errors", "largest |g_q H_p|; |q.p| of a body", lambda at: at.defects.f),
    Output("iterations", "iterations", "most iterations of a step since the last state",
           lambda at: at.iterations, dtype="i4", of_steps=True),
    Output("multipliers", "multipliers", "multipliers of the step that ends here",
           lambda at: at.step_multipliers, _multipliers, of_steps=True, absent=(0,)),
    Output("reactions", "reactions", "multipliers of velocity constraints, at the stages of the "
           "step that ends here", lambda at: at.reactions, _reactions, of_steps=True,
           absent=(0, 0)),
    Output("work", "work", "work of the forces since the start", lambda at: at.work,
           _with_forces),
    Output("velocities", "velocities", "velocities", lambda at: at.velocities, _with_lagrangian,
           labels="velocity_names", absent=(0,)),
    Output("tau", "tau", "scaled time, of which each step has the same length", lambda at: at.t,
           _scaled_time_dimensions, dtype="f8", absent=(0,)),
    Output("time_momentum", "time_momentum", "-H - W, the momentum of the time in scaled time",
           lambda at: at.p[:, -1], _scaled_time_dimensions, absent=(0,)),
    Output("quantities", "quantity_values", "quantity {} of the system", lambda at: at.quantities,
           labels="quantities", split=True),
)


def value_of(output: Output, states: States) -> Array:
    """Return an output of stored states, in the type of the output or of the stepper.

    An output that the system does not have is an empty array, with a row for each state or step.
    """
    binding = states.binding
    if output.inner(states.manifest) is None:
        return binding.new(max(len(states.q) - output.of_steps, 0), *output.absent)
    array = output.compute(states)
    return array if output.dtype or array.dtype == binding.dtype else binding.to_real(array)


def names_in_files(output: Output, manifest: Manifest) -> list[str]:
    """Return the names of an output in files; an empty list if the stepper has no such output."""
    if output.split:
        return [QUANTITY + name for name in getattr(manifest.system, output.labels)]
    return [] if output.inner(manifest) is None else [output.name]


def arrays_in_files(output: Output, manifest: Manifest, array: Array) -> dict[str, Array]:
    """Return an output's array by name in files: one array, or one for each label."""
    names = names_in_files(output, manifest)
    if output.split:
        return {name: array[:, i] for i, name in enumerate(names)}
    return dict.fromkeys(names, array)


def array_from_files(output: Output, arrays: Iterable[Array], row_count: int, dtype: Any) -> Array:
    """Return an output's array from its arrays in a file, the inverse of ``arrays_in_files``."""
    arrays_in_file = list(arrays)
    if output.split and arrays_in_file:
        return np.stack(arrays_in_file, axis=1)
    return arrays_in_file[0] if arrays_in_file else absent(output, row_count, dtype)


def absent(output: Output, row_count: int, dtype: Any) -> Array:
    """Return the empty array of an output that the system does not have."""
    return np.zeros((max(row_count - output.of_steps, 0),
                     *((0,) if output.split else output.absent)), dtype=dtype)


#: Fields of ``Crossings`` and ``Impacts``: meaning, unit. States have the units of the run's.
_EVENT_COLUMNS = {
    "t": ("times of {}", "s"), "q": ("coordinates at {}", ""), "p": ("momenta at {}", ""),
    "steps": ("whole steps before {}", ""),
    "rising": ("1 where the quantity rises along the run", ""),
    "elapsed": ("times of {} since the start", "s"),
    "p_after": ("momenta after {}", ""), "impulse": ("impulses of {}", ""),
    "energy_lost": ("energy lost in {}", "J"), "work": ("work of the forces before {}", "J")}


def description_of(output: Output, manifest: Manifest, name: str) -> dict[str, Any]:
    """Return the attributes of the array of this name: long name, units, names of its columns."""
    units = output.units or (output.body_units if manifest.system.rigid_body else "")
    long_name = output.long_name.format(name.removeprefix(QUANTITY))
    names = getattr(manifest.system, output.labels) if output.labels and not output.split else ()
    return {"long_name": long_name, **({"units": units} if units else {}),
            **({"components": list(names)} if names else {})}


def description_of_column(manifest: Manifest, event: str, column: str) -> dict[str, Any]:
    """Return the attributes of a column of an event: long name, units, names of its columns."""
    text, units = _EVENT_COLUMNS[column]
    # "p_after" has the units and the components of the output "p"
    attributes = next((description_of(output, manifest, column) for output in OUTPUTS
                       if output.name == column.removesuffix("_after")), {})
    return attributes | {"long_name": text.format(event)} | ({"units": units} if units else {})


def labels_of(system: SystemManifest) -> dict[str, tuple[list[str], str]]:
    """Return the labels of each dimension that has some, and their meaning.

    A momentum has the label of its coordinate.
    """
    labels = {"coordinate": (list(system.coordinates), "name of the coordinate")}
    names = list(system.constraint_names)
    if len(names) > 1:
        labels["constraint"] = names, "name of the constraint"
    if system.velocity_constraint_names:
        labels["velocity_constraint"] = (list(system.velocity_constraint_names),
                                         "name of the velocity constraint")
    return labels


def full_states(trajectory: Any) -> tuple[Array, Array]:
    """Return q and p of each state as compiled code has them: in scaled time with t and −H − W."""
    if trajectory.manifest.system.clock is None:
        return trajectory.q, trajectory.p
    columns = (trajectory.t.astype(trajectory.q.dtype), trajectory.time_momentum)
    q, p = (np.concatenate([x, column[:, None]], axis=1)
            for x, column in zip((trajectory.q, trajectory.p), columns, strict=True))
    return q, p


def flat_multipliers(trajectory: Any) -> Array:
    """Return multipliers and reactions of each step in one row, as compiled code writes them.

    The shape is (N, nodes · m + stages · m').
    """
    # the width is computed because reshape cannot infer it for N = 0
    parts = [x.reshape(len(x), int(np.prod(x.shape[1:])))
             for x in (trajectory.multipliers, trajectory.reactions)]
    return np.concatenate(parts, axis=1)


class DefectSizes(NamedTuple):
    """The largest |g| and the largest momentum-constraint error of each state."""

    g: Array
    f: Array


def defect_sizes(
    binding: Binding, parameters: ParameterStruct, q: Array, p: Array, t: Array | None = None
) -> DefectSizes:
    """Return the largest |g| and the largest momentum-constraint error of each row, (rows,) each.

    q and p have the shape (rows, n); ``t`` are times of the rows, or None for that of
    ``parameters``.
    """
    g, f = binding.defects(parameters, q, p, t)
    return DefectSizes(np.abs(g).max(axis=1, initial=0), np.abs(f).max(axis=1, initial=0))


def place_of_quantity(manifest: Manifest, name: Any) -> int:
    """Return the column of a quantity of the system.

    Raises InputError if the system has no quantity of that name.
    """
    system = manifest.system
    names = tuple(system.quantities)
    if not isinstance(name, str) or name not in names:
        raise InputError(f"System {system.name!r} has no quantity {shown(name)}; it has "
                         f"{', '.join(names) or 'none: give System(..., quantities={...}), '}"
                         f"{'' if names else 'or quantity(name, expression) of a Multibody'}"
                         f"{proposal(name, names)}.")
    return names.index(name)
