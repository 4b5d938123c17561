"""Every error that gyrospark raises on purpose; each message names the value and the cure."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .runtime.trajectory import Trajectory

__all__ = [
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
    """A value that a caller passed is not usable; also a ``ValueError``."""


class InputWarning(UserWarning):
    """A value that a caller passed is taken as it is, and was perhaps meant otherwise."""


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
    """A signal asked a stored run or sweep to end; everything done is in its store.

    Attributes
    ----------
    signal : int
        Number of the signal.
    """

    def __init__(self, message: str, signal: int) -> None:
        super().__init__(message)
        self.signal = signal


class StepFailed(GyrosparkError):  # noqa: N818 (the contract's name)
    """A step found no solution.

    Attributes
    ----------
    step : int
        Number of the failed step, counted from 1.
    t : float
        Time at the start of the failed step, in seconds.
    reason : str
        ``"not converged"``, ``"singular matrix"`` or ``"not finite"``.
    trajectory : Trajectory
        Everything computed before the failed step.
    """

    def __init__(self, *, step: int, t: float, reason: str, trajectory: Trajectory) -> None:
        super().__init__(
            f"Step {step} at t = {t:.9g} s failed: {reason}. "
            "A smaller time step usually cures it; everything before it is in .trajectory."
        )
        self.step = step
        self.t = t
        self.reason = reason
        self.trajectory = trajectory

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle by arguments: worker processes hand failures over."""
        return _step_failed, (self.step, self.t, self.reason, self.trajectory)


def _step_failed(step: int, t: float, reason: str, trajectory: Trajectory) -> StepFailed:
    return StepFailed(step=step, t=t, reason=reason, trajectory=trajectory)
