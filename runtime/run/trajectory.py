"""A trajectory: what an integration returns, what can be asked of it, and its file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._version import __version__
from ...arguments import as_path
from ...errors import GyrosparkError, InputError
from ...exact import digits_of
from ...naming import choose, proposal, shown
from ...real import REALS
from ..body import quaternion
from ..build.manifest import BodyAt, bodies_of, sizes_of
from ..call.memory import without_padding
from ..call.reals import from_text
from ..show.endings import ENDINGS, ending_of
from .states import finished, save_csv

__all__ = ["Report", "Trajectory", "known_fields"]

Array = NDArray[Any]
_FORMAT = 2
#: Arrays of the stepper's own type; float128 is stored as bytes, a last axis of 16.
_QUADS = ("t", "q", "p", "multipliers", "energies", "g_errors", "f_errors", "work",
          "quantity_values")
_ARRAYS = ("t", "q", "p", "multipliers", "iterations", "energies", "g_errors", "f_errors", "work",
           "quantity_values")
#: Names of the columns of q, p and quantity_values, for other readers of the file.
_NAMES = ("coordinates", "momenta", "quantities")


@dataclass(frozen=True)
class Report:
    """Diagnostics over *every* step of an integration, stored or not.

    Energy errors are |H_k − H_0| with the scheme's own H (α or γ term included), |H_k − H_0 − W_k|
    where forces do the work W_k (``work`` at the end of the run); constraint
    errors |g(q_k)| and momentum-constraint errors |qᵀp| (for other systems the derived
    constraint on the momenta); means run over k = 0..N as in (87)-(91). ``iterations`` counts
    sweeps and Newton iterations together; ``newton_steps`` the steps of solver ``auto`` whose
    sweeps did not converge.
    """

    steps: int
    iterations: int
    iterations_max: int
    newton_steps: int
    energy_start: float
    energy_error_max: float
    energy_error_mean: float
    constraint_max: float
    constraint_mean: float
    momentum_constraint_max: float
    momentum_constraint_mean: float
    q: tuple[float, ...]
    p: tuple[float, ...]
    work: float = 0.0

    def __repr__(self) -> str:
        return (f"<Report of {self.steps:,} steps, {self.iterations_mean:.1f} iterations each\n"
                f"  largest errors: energy {self.energy_error_max:.2e}, constraint "
                f"{self.constraint_max:.2e}, momentum {self.momentum_constraint_max:.2e}\n"
                f"  mean errors: energy {self.energy_error_mean:.2e}, constraint "
                f"{self.constraint_mean:.2e}, momentum {self.momentum_constraint_mean:.2e}>")

    @classmethod
    def read(cls, record: Any, q: Array, p: Array, *, forced: bool) -> Report:
        """Return the report of a compiled running record and the final state."""
        states = int(record.steps) + 1
        return cls(
            int(record.steps),
            int(record.iterations),
            int(record.iterations_max),
            int(record.newton_steps),
            float(record.energy_start),
            float(record.energy_error_max),
            float(record.energy_error_sum) / states,
            float(record.constraint_max),
            float(record.constraint_sum) / states,
            float(record.hidden_max),
            float(record.hidden_sum) / states,
            tuple(float(x) for x in q),
            tuple(float(x) for x in p),
            float(record.work) if forced else 0.0,
        )

    @property
    def iterations_mean(self) -> float:
        """Iterations (sweeps, Newton) a step; 0 without steps."""
        return self.iterations / self.steps if self.steps else 0.0


@dataclass(frozen=True, eq=False)
class Trajectory:
    """States of a run, stored every ``every`` steps.

    Attributes
    ----------
    t : array, shape (N+1,)
        Times t_0 + k dt in seconds: of the stepper's own type where that has more digits than a
        double, else doubles.
    q, p : array, shape (N+1, n)
        Coordinates and momenta; a unit quaternion, scalar first, for a body.
    multipliers : array, shape (N, p+1), or (N, p+1, m) for m > 1 constraints
        Λ_0..Λ_p of the step that ends at each stored state (λ for IMS and EMS).
    iterations : array, shape (N,)
        Iterations of that step (sweeps or Newton's), the most of the ``every`` steps since the
        last state.
    energies : array, shape (N+1,)
        H of each state.
    g_errors, f_errors : array, shape (N+1,)
        Largest |g(q)| and largest momentum-constraint error (|qᵀp| for a body) of each state.
    work : array, shape (N+1,)
        Work W done by the system's forces since the start; 0 without forces.
    quantity_values : array, shape (N+1, number of quantities)
        The system's quantities of each state; see ``quantity``.
    dt, parameters : number, dict of str to number
        As the stepper had them: floats; NumPy's long doubles or mpmath numbers where it computes
        with more digits.
    report : Report
        Diagnostics over every step.
    """

    t: Array
    q: Array
    p: Array
    multipliers: Array
    iterations: Array
    dt: Any
    every: int
    parameters: dict[str, Any]
    report: Report
    manifest: dict[str, Any]
    energies: Array
    g_errors: Array
    f_errors: Array
    work: Array
    quantity_values: Array

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        report = self.report
        return (f"<Trajectory of {self.manifest['name']}: {len(self):,} states of {report.steps:,} "
                f"steps, t = {float(self.t[0]):.6g} to {float(self.t[-1]):.6g} s\n"
                f"  largest errors: energy {report.energy_error_max:.1e}, constraint "
                f"{report.constraint_max:.1e}, momentum {report.momentum_constraint_max:.1e}>")

    def energy(self) -> Array:
        """Return H of each stored state, shape (N+1,), in joules for SI input."""
        return self.energies

    def energy_error(self) -> Array:
        """Return H_k − H_0 − W_k of each stored state, W the work of the forces, shape (N+1,)."""
        error: Array = self.energies - self.energies[0] - self.work
        return error

    @property
    def coordinates(self) -> tuple[str, ...]:
        """The name of each coordinate, of a column of ``q``."""
        return tuple(self.manifest["system"]["coordinates"])

    @property
    def momenta(self) -> tuple[str, ...]:
        """The name of each momentum, of a column of ``p``."""
        return tuple(self.manifest["system"]["momenta"])

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names that ``quantity`` takes."""
        return tuple(self.manifest["system"].get("quantities", ()))

    def quantity(self, name: str) -> Array:
        """Return a quantity of the system at each stored state, shape (N+1,).

        Raises
        ------
        InputError
            If the system has no quantity of that name.
        """
        if not isinstance(name, str) or name not in self.quantities:
            raise InputError(
                f"System {self.manifest['system']['name']!r} has no quantity {shown(name)}; it has "
                f"{', '.join(self.quantities) or 'none: give System(..., quantities={...})'}"
                f"{proposal(name, self.quantities)}."
            )
        values: Array = self.quantity_values[:, self.quantities.index(name)]
        return values

    def constraint_errors(self) -> tuple[Array, Array]:
        """Return |g(q)| and |qᵀp| (or the system's own momentum constraint) of each state."""
        return self.g_errors, self.f_errors

    @property
    def bodies(self) -> tuple[str, ...]:
        """The names of the rigid bodies, which ``rotation`` and its like take."""
        return tuple(bodies_of(self.manifest))

    def angular_velocity(self, body: str | None = None) -> Array:
        """Return Ω = J⁻¹ ½ L(q) p in body axes (19), shape (N+1, 3), in rad/s.

        In a model whose space axes turn (``gs.models.satellite``) it is the angular velocity
        against axes that do not.

        Parameters
        ----------
        body : str, optional
            Which of several bodies.

        Raises
        ------
        InputError
            Where there is no body, or several and none is named.
        """
        at = self._body(body)
        return quaternion.angular_velocity(self.q[:, at.q], self.p[:, at.q],
                                           at.inertia_of(self.parameters))

    def axis(self, body: str | None = None) -> Array:
        """Return the body's third axis in space, (R13, R23, R33), shape (N+1, 3).

        ``body`` and what is raised are those of ``angular_velocity``.
        """
        return quaternion.axis(self.q[:, self._body(body).q])

    def rotation(self, body: str | None = None) -> Any:
        """Return the attitudes as ``scipy.spatial.transform.Rotation``, body to space.

        ``body`` and what is raised are those of ``angular_velocity``.
        """
        return quaternion.to_rotation(self.q[:, self._body(body).q])

    def _body(self, name: str | None) -> BodyAt:
        """Return where a body is in q and p."""
        bodies, system = bodies_of(self.manifest), self.manifest["system"]["name"]
        if not bodies:
            raise InputError(
                f"System {system!r} is not one rigid body; t, q, p, multipliers and energy() are "
                "defined for it. (That a gyrospark.System is one, rigid_body=True says.)")
        if name is None and len(bodies) > 1:
            one = next(iter(bodies))
            raise InputError(f"System {system!r} is not one rigid body but {len(bodies)}, "
                             f"{', '.join(bodies)}; say which, as in rotation(body={one!r}).")
        if name is None:
            return next(iter(bodies.values()))
        return bodies[choose(f"body of system {system!r}", name, bodies)]

    # ------------------------------------------------------------ file

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the states to a file, which appears complete or not at all; return its path.

        - .npz (also where the name has no ending): all arrays with all their digits, the names of
          their columns, parameters, report and manifest: what ``load`` reads.
        - .csv: a column a number, under the names of coordinates, momenta and quantities.
        - .nc: NetCDF-4 with attributes, for xarray, MATLAB, R (``pip install gyrospark[netcdf]``).

        Raises
        ------
        InputError
            For another ending.
        GyrosparkError
            If the file cannot be written.
        """
        target = as_path("path", path, "run.npz")
        if ending_of(target) == "":
            target = target.with_name(target.name + ".npz")
        if ending_of(target) not in ENDINGS:
            raise InputError(f"A trajectory cannot be written as {target.name!r}; end it in "
                             f"{', '.join(ENDINGS)}.")
        if ending_of(target) == ".nc":
            from ...storage.export import save_table  # costs time, and Zarr may not be installed

            return save_table(self, target)
        try:
            if ending_of(target) == ".csv":
                save_csv(self, target)
            else:
                self._save_npz(target)
        except OSError as error:
            raise GyrosparkError(
                f"The trajectory cannot be written to {str(target)!r}: {error.strerror or error}."
            ) from error
        return target

    def _save_npz(self, target: Path) -> None:
        about = {
            "format": _FORMAT,
            "dt": digits_of(self.dt),
            "every": self.every,
            "parameters": {name: digits_of(x) for name, x in self.parameters.items()},
            "report": asdict(self.report),
            "manifest": self.manifest,
        }
        with finished(target) as part, part.open("wb") as file:
            np.savez_compressed(
                file, allow_pickle=False, about=np.array(json.dumps(about)),
                **{name: np.array(getattr(self, name), dtype=str) for name in _NAMES},
                **{name: _storable(getattr(self, name)) for name in _ARRAYS})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Trajectory:
        """Read a file that ``save`` wrote; nothing in it is executed.

        Raises
        ------
        InputError
            If the file is missing, damaged or of another kind.
        """
        file_name = as_path("path", path, "run.npz")
        try:
            # Opened here because np.load leaves a damaged file open.
            with file_name.open("rb") as raw, np.load(raw, allow_pickle=False) as file:
                about = json.loads(str(file["about"]))
                if about["format"] != _FORMAT:
                    raise InputError(
                        f"{str(path)!r} was written by gyrospark {about['manifest']['generator']} "
                        f"in format {about['format']}; this is gyrospark {__version__}, which "
                        f"reads format {_FORMAT}.")
                arrays = {name: file[name] for name in _ARRAYS}
                names = {name: tuple(file[name].tolist()) for name in _NAMES if name in file}
            real = about["manifest"]["real"]
            if REALS[real].in_mpmath:
                in_double = {"t"} if arrays["t"].dtype.kind == "f" else set()  # of 0.1.0
                arrays |= {name: _from_bytes(arrays[name]) for name in {*_QUADS} - in_double}
            report = known_fields(Report, about["report"])
            report["q"], report["p"] = tuple(report["q"]), tuple(report["p"])
            loaded = cls(
                **arrays, dt=from_text(about["dt"], real), every=about["every"],
                parameters={k: from_text(x, real) for k, x in about["parameters"].items()},
                report=Report(**report), manifest=about["manifest"])
            loaded._refuse_unless_sound()
            if any(getattr(loaded, name) != found for name, found in names.items()):
                raise ValueError("a column has two names")
            return loaded
        except InputError:
            raise
        except OSError as error:
            raise InputError(f"{str(path)!r} cannot be read: {error.strerror or error}.") from error
        except Exception as error:  # a damaged zip file raises of ten kinds, zlib.error among them
            raise InputError(f"{str(path)!r} is not a trajectory file of gyrospark, or damaged."
                             ) from error

    def _refuse_unless_sound(self) -> None:
        """Raise for arrays, numbers and a manifest that no integration returns together."""
        sizes, report = sizes_of(self.manifest), asdict(self.report)
        rows, n = len(self.t), sizes["coordinates"]
        shapes = {
            "t": (rows,), "q": (rows, n), "p": (rows, n), "energies": (rows,),
            "g_errors": (rows,), "f_errors": (rows,), "iterations": (rows - 1,),
            "work": (rows,), "quantity_values": (rows, sizes["quantities"]),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} has another shape than {shape}")
        if self.multipliers.shape[:1] != (rows - 1,) or self.multipliers.ndim not in (2, 3):
            raise ValueError("multipliers have another shape than the steps")
        for name in _ARRAYS:
            if getattr(self, name).dtype.kind not in ("iu" if name == "iterations" else "fO"):
                raise ValueError(f"{name} has entries of another type")
        lists = [report.pop("q"), report.pop("p")]
        numbers = [*report.values(), *lists[0], *lists[1]]
        counts = [report["steps"], report["iterations"], self.every]
        if (not all(type(x) in (int, float) for x in numbers)
                or not all(type(x) is int for x in counts)
                or not all(abs(x) < 2**63 for x in numbers if type(x) is int)
                or self.parameters.keys() != self.manifest["system"]["parameters"].keys()):
            raise ValueError("a number is of another type")

    def plot(self, path: str | os.PathLike[str] | None = None) -> Any:
        """Draw axis trace, energy error and constraint errors; write them where a path is given.

        Returns a matplotlib figure, which Jupyter shows; see ``plots.draw``.
        """
        from ..show.plots import draw  # matplotlib is optional

        return draw(self, path)


def known_fields(kind: type, kept: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entries for a dataclass's fields: a later version may have written more."""
    return {field.name: kept[field.name] for field in fields(kind) if field.name in kept}


def _storable(array: Array) -> Array:
    """Return an array as a file can hold it: mpmath numbers as their bytes in binary128."""
    if array.dtype != object:
        return without_padding(array)
    from ..call.quad import to_bytes  # mpmath costs time, and only float128 needs it

    return to_bytes(array)


def _from_bytes(array: Array) -> Array:
    """Return the mpmath numbers that were stored as bytes."""
    from ..call.quad import from_bytes

    return from_bytes(array)
