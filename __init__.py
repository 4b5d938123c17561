"""gyrospark: compiled steppers for rigid-body motion on its constraint, generated from symbols.

>>> import gyrospark as gs
>>> step = gs.stepper("G-L", stages=3, rep="gamma")
>>> top = gs.problems.fast_top()
>>> parameters = top.parameters | {"gamma": gs.gamma_m(top.inertia)}
>>> trajectory = step.integrate(top.q0, top.p0, dt=1e-3, steps=320, parameters=parameters)

Importing this package imports no SymPy; generating a stepper does.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import __version__

if TYPE_CHECKING:
    from .certificate import Certificate, certify
    from .errors import (
        CompilerError,
        GyrosparkError,
        InputError,
        InputWarning,
        MissingDependencyError,
        StepFailed,
        Stopped,
        StorageError,
        TableauError,
    )
    from .facade import consistent, load_model, stepper, tableau
    from .generator import example_models as models
    from .generator import symbols
    from .generator.model import Model
    from .generator.multibody import Multibody
    from .generator.rigid_body import body_system, rotation_matrix
    from .generator.system import System
    from .projection import Projection
    from .runtime import problems
    from .runtime.ensemble import Ensemble
    from .runtime.gamma_choice import GammaChoice, choose_gamma
    from .runtime.inertia import gamma_fast, gamma_h, gamma_h_tilde, gamma_m, gamma_m_tilde
    from .runtime.quaternion import momentum, state_from_rotation
    from .runtime.stepper import Stepper
    from .runtime.trajectory import Trajectory
    from .storage.record import record
    from .storage.recording import Recording, open_recording
    from .sweeps.results import open_sweep
    from .sweeps.sweep import sweep

#: Public name → where it lives; resolved on first use.
_HOMES = {
    "Certificate": "certificate",
    "certify": "certificate",
    "CompilerError": "errors",
    "GyrosparkError": "errors",
    "InputError": "errors",
    "InputWarning": "errors",
    "MissingDependencyError": "errors",
    "StepFailed": "errors",
    "Stopped": "errors",
    "StorageError": "errors",
    "TableauError": "errors",
    "consistent": "facade",
    "stepper": "facade",
    "tableau": "facade",
    "Model": "generator.model",
    "Multibody": "generator.multibody",
    "body_system": "generator.rigid_body",
    "load_model": "facade",
    "rotation_matrix": "generator.rigid_body",
    "System": "generator.system",
    "Projection": "projection",
    "Ensemble": "runtime.ensemble",
    "GammaChoice": "runtime.gamma_choice",
    "choose_gamma": "runtime.gamma_choice",
    "gamma_fast": "runtime.inertia",
    "gamma_h": "runtime.inertia",
    "gamma_h_tilde": "runtime.inertia",
    "gamma_m": "runtime.inertia",
    "gamma_m_tilde": "runtime.inertia",
    "momentum": "runtime.quaternion",
    "state_from_rotation": "runtime.quaternion",
    "Stepper": "runtime.stepper",
    "Trajectory": "runtime.trajectory",
    "Recording": "storage.recording",
    "open_recording": "storage.recording",
    "record": "storage.record",
    "open_sweep": "sweeps.results",
    "sweep": "sweeps.sweep",
}

#: The same for modules.
_MODULES = {
    "models": "generator.example_models", "problems": "runtime.problems",
    "symbols": "generator.symbols",
}

__all__ = [
    "Certificate",
    "CompilerError",
    "Ensemble",
    "GammaChoice",
    "GyrosparkError",
    "InputError",
    "InputWarning",
    "MissingDependencyError",
    "Model",
    "Multibody",
    "Projection",
    "Recording",
    "StepFailed",
    "Stepper",
    "Stopped",
    "StorageError",
    "System",
    "TableauError",
    "Trajectory",
    "__version__",
    "body_system",
    "certify",
    "choose_gamma",
    "consistent",
    "gamma_fast",
    "gamma_h",
    "gamma_h_tilde",
    "gamma_m",
    "gamma_m_tilde",
    "load_model",
    "models",
    "momentum",
    "open_recording",
    "open_sweep",
    "problems",
    "record",
    "rotation_matrix",
    "state_from_rotation",
    "stepper",
    "sweep",
    "symbols",
    "tableau",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f".{_MODULES[name]}", __name__)
    if name in _HOMES:
        from .errors import MissingDependencyError

        try:
            return getattr(import_module(f".{_HOMES[name]}", __name__), name)
        except MissingDependencyError as error:
            return _missing(name, str(error))
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _missing(name: str, message: str) -> type:
    """Return what stands for a name whose extra is not installed: to call it is refused."""
    def refuse(cls: type, *arguments: object, **options: object) -> None:
        from .errors import MissingDependencyError

        raise MissingDependencyError(message)

    return type(name, (), {"__new__": refuse, "__doc__": message})


def __dir__() -> list[str]:
    return sorted(__all__)
