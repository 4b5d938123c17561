"""Exceptions and warnings of gyrospark; each message names the value and the cure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray

    from ..runtime.results.trajectory import Trajectory
    from ..runtime.steppers.ensemble import Ensemble

__all__ = [
    "AbsentError",
    "ArgumentError",
    "CompilerError",
    "GyrosparkError",
    "InputError",
    "InputWarning",
    "MissingDependencyError",
    "StepFailed",
    "Stopped",
    "StorageError",
    "TableauError",
]


class GyrosparkError(Exception):
    """Base of all errors that gyrospark raises on purpose."""


class InputError(GyrosparkError, ValueError):
    """Unusable value of an argument; also a ``ValueError``."""


class AbsentError(InputError, AttributeError):
    """Missing attribute of an object that could have it; ``hasattr`` returns False."""


class ArgumentError(InputError, TypeError):
    """Unknown, missing or too many arguments of a function."""


class InputWarning(UserWarning):
    """Accepted but suspicious value of an argument."""


class TableauError(InputError):
    """A tableau, or the file it came from, is not usable."""


class CompilerError(GyrosparkError):
    """There is no C compiler, or it refused; carries the command and its stderr."""

    def __init__(self, message: str, *, command: list[str] | None = None, stderr: str = "") -> None:
        super().__init__(message)
        self.command = command or []
        self.stderr = stderr


class MissingDependencyError(GyrosparkError, ImportError):
    """An optional package is needed for this call and is not installed."""


class StorageError(GyrosparkError):
    """A store cannot be read or written: full, read-only, in use, damaged."""


class Stopped(KeyboardInterrupt):
    """A signal asked a run, an ensemble or a sweep to end; nothing that was computed is lost.

    It is in its store, or here, as the call would have returned it.

    Attributes
    ----------
    signal : int
        Number of the signal.
    trajectory : Trajectory or None
        The steps that ``Stepper.integrate`` has done.
    ensemble : Ensemble or None
        The steps that ``Stepper.integrate_ensemble`` has done; NaN after them.
    dataset : xarray.Dataset or None
        The cells that ``gyrospark.sweep`` has done; NaN in the others.
    """

    def __init__(
        self, message: str, signal: int, *, trajectory: Trajectory | None = None,
        ensemble: Ensemble | None = None, dataset: xarray.Dataset | None = None,
    ) -> None:
        super().__init__(message)
        self.signal = signal
        self.trajectory = trajectory
        self.ensemble = ensemble
        self.dataset = dataset

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle with the signal: by default exceptions are unpickled from ``args``, without it."""
        return type(self), (*self.args, self.signal), self.__dict__


class StepFailed(GyrosparkError):  # noqa: N818 (the contract's name)
    """A step found no solution.

    Attributes
    ----------
    step : int
        Number of the failed step, counted from 1.
    t : float
        Time at the start of the failed step, in seconds.
    reason : str
        ``"not converged"`` (iterations ran out while increments still shrank), ``"stagnated"``
        (increments stopped shrinking above what rounding explains), ``"diverged"``,
        ``"singular matrix"`` or ``"not finite"``.
    trajectory : Trajectory
        Everything computed before the failed step.
    increment : float or None
        Size of Newton's last increment relative to the state, where it was looked for.
    dt : float or None
        A time step that was tried from there and succeeds, where one was looked for and found.
    detail, cure : str
        The reason with its figures, and what helps.
    hint : str
        A property of the system that makes steps fail: forces that jump.
    """

    def __init__(
        self, *, step: int, t: float, reason: str, trajectory: Trajectory,
        increment: float | None = None, dt: float | None = None, detail: str = "",
        cure: str = "A smaller time step usually cures it",
    ) -> None:
        self.step = step
        self.t = t
        self.reason = reason
        self.trajectory = trajectory
        self.increment = increment
        self.dt = dt
        self.detail = detail or reason
        self.cure = cure
        super().__init__(f"{self.summary}; everything before it is in .trajectory.")

    @property
    def hint(self) -> str:
        """The property of the system that makes steps fail, if it has one."""
        jumps = self.trajectory.manifest.system.jumps
        return "" if not jumps else (
            f" Forces jump at {jumps}: a step to there may have no solution; write them smooth, as "
            "tanh(x/1e-3) for sign(x).")

    @property
    def summary(self) -> str:
        """The failed step, its time, the reason and the cure."""
        where = f"Step {self.step} at t = {self.t:.9g} s"
        return f"{where} failed: {self.detail}.{self.hint} {self.cure}"

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle all fields, for worker processes; by default it would be the message alone."""
        return _unpickle_step_failed, ({
            name: getattr(self, name) for name in
            ("step", "t", "reason", "trajectory", "increment", "dt", "detail", "cure")},)


def _unpickle_step_failed(arguments: dict[str, Any]) -> StepFailed:
    """Return the error of a pickle: pickles pass arguments by position, ``StepFailed`` by name."""
    return StepFailed(**arguments)
