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
    from . import exact, references
    from .certificates.certificate import Certificate, certify
    from .certificates.citations import Citations, cite
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
    from .event import Event
    from .facade import consistent, load_model, stepper, tableau
    from .generator.bodies import example_models as models
    from .generator.bodies import symbols
    from .generator.bodies.model import Model
    from .generator.bodies.multibody import Multibody
    from .generator.bodies.rigid_body import body_system, rotation_matrix
    from .generator.model_files.robots import load_urdf, read_urdf
    from .generator.systems.system import System
    from .projection import Projection
    from .runtime.body import problems
    from .runtime.body.inertia import gamma_fast, gamma_h, gamma_h_tilde, gamma_m, gamma_m_tilde
    from .runtime.body.quaternion import momentum, state_from_rotation
    from .runtime.choice.frame_choice import choose_frame
    from .runtime.choice.frame_search import FrameChoice
    from .runtime.choice.gamma_choice import GammaChoice, choose_gamma
    from .runtime.events.found import Crossings
    from .runtime.output.trajectory import Trajectory
    from .runtime.run.ensemble import Ensemble
    from .runtime.run.section import Section, section
    from .runtime.run.simulation import Simulation
    from .runtime.run.stepper import Stepper
    from .storage.record import record
    from .storage.recording import Recording, open_recording
    from .sweeps.results import open_sweep
    from .sweeps.sweep import sweep

#: Public name → where it lives; resolved on first use.
_HOMES = {
    "Certificate": "certificates.certificate",
    "certify": "certificates.certificate",
    "Citations": "certificates.citations",
    "cite": "certificates.citations",
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
    "Model": "generator.bodies.model",
    "Multibody": "generator.bodies.multibody",
    "body_system": "generator.bodies.rigid_body",
    "load_model": "facade",
    "rotation_matrix": "generator.bodies.rigid_body",
    "System": "generator.systems.system",
    "load_urdf": "generator.model_files.robots",
    "read_urdf": "generator.model_files.robots",
    "from_mechanics": "generator.mechanics.methods",
    "Projection": "projection",
    "Crossings": "runtime.events.found",
    "Ensemble": "runtime.run.ensemble",
    "Event": "event",
    "FrameChoice": "runtime.choice.frame_search",
    "choose_frame": "runtime.choice.frame_choice",
    "GammaChoice": "runtime.choice.gamma_choice",
    "choose_gamma": "runtime.choice.gamma_choice",
    "gamma_fast": "runtime.body.inertia",
    "gamma_h": "runtime.body.inertia",
    "gamma_h_tilde": "runtime.body.inertia",
    "gamma_m": "runtime.body.inertia",
    "gamma_m_tilde": "runtime.body.inertia",
    "momentum": "runtime.body.quaternion",
    "state_from_rotation": "runtime.body.quaternion",
    "Section": "runtime.run.section",
    "section": "runtime.run.section",
    "Simulation": "runtime.run.simulation",
    "Stepper": "runtime.run.stepper",
    "Trajectory": "runtime.output.trajectory",
    "Recording": "storage.recording",
    "open_recording": "storage.recording",
    "record": "storage.record",
    "open_sweep": "sweeps.results",
    "sweep": "sweeps.sweep",
}

#: The same for modules.
_MODULES = {
    "exact": "exact", "models": "generator.bodies.example_models",
    "problems": "runtime.body.problems", "references": "references",
    "symbols": "generator.bodies.symbols",
}

__all__ = [
    "Certificate",
    "Citations",
    "CompilerError",
    "Crossings",
    "Ensemble",
    "Event",
    "FrameChoice",
    "GammaChoice",
    "GyrosparkError",
    "InputError",
    "InputWarning",
    "MissingDependencyError",
    "Model",
    "Multibody",
    "Projection",
    "Recording",
    "Section",
    "Simulation",
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
    "choose_frame",
    "choose_gamma",
    "cite",
    "consistent",
    "exact",
    "from_mechanics",
    "gamma_fast",
    "gamma_h",
    "gamma_h_tilde",
    "gamma_m",
    "gamma_m_tilde",
    "load_model",
    "load_urdf",
    "models",
    "momentum",
    "open_recording",
    "open_sweep",
    "problems",
    "read_urdf",
    "record",
    "references",
    "rotation_matrix",
    "section",
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


def _missing(name: str, message: str) -> Any:
    """Return what stands for a name whose extra is not installed: to call it is refused.

    Its documentation is read from its file, which cannot be imported.
    """
    import ast
    from pathlib import Path

    def refuse(*arguments: object, **options: object) -> Any:
        from .errors import MissingDependencyError

        raise MissingDependencyError(message)

    path = Path(__file__).parent.joinpath(*_HOMES[name].split(".")).with_suffix(".py")
    node = next(one for one in ast.parse(path.read_text(encoding="utf-8")).body
                if isinstance(one, (ast.ClassDef, ast.FunctionDef)) and one.name == name)
    about = f"{message}\n\n{ast.get_docstring(node)}"
    if isinstance(node, ast.ClassDef):
        return type(name, (), {"__new__": refuse, "__doc__": about})
    refuse.__name__ = refuse.__qualname__ = name
    refuse.__doc__ = f"{name}({ast.unparse(node.args)})\n\n{about}"
    return refuse


def __dir__() -> list[str]:
    return sorted(__all__)
