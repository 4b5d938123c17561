"""gyrospark: compiled steppers for rigid-body motion on its constraint, generated from symbols.

>>> import gyrospark as gs
>>> step = gs.stepper("G-L", stages=3, rep="gamma")
>>> top = gs.problems.fast_top()
>>> trajectory = step.integrate(top, dt=1e-3, steps=320)

Importing this package imports no SymPy; generating a stepper does.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import __version__

if TYPE_CHECKING:
    from . import exact, references
    from .api import consistent, load_model, stepper, tableau
    from .certificates.certificate import Certificate, certify
    from .certificates.citations import Citations, cite
    from .core.errors import (
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
    from .core.event import Event
    from .core.projection import Projection
    from .core.shapes import Shape
    from .core.solver import Solver
    from .core.start import Start
    from .generator.models.robots import (
        load_mjcf,
        load_sdf,
        load_urdf,
        read_mjcf,
        read_sdf,
        read_urdf,
    )
    from .generator.multibody import body_symbols as symbols
    from .generator.multibody import example_models as models
    from .generator.multibody.model import Model
    from .generator.multibody.multibody import Multibody
    from .generator.multibody.rigid_body import body_system, rotation_matrix
    from .generator.systems.system import System
    from .runtime.analysis.fit import Fit, fit
    from .runtime.analysis.lyapunov import Lyapunov, lyapunov
    from .runtime.analysis.periodic_orbit import PeriodicOrbit, periodic_orbit
    from .runtime.bindings.inputs import Inputs
    from .runtime.derivatives.gradient import Gradient
    from .runtime.derivatives.tangent_space import Tangents
    from .runtime.devices.ensemble import DeviceEnsemble
    from .runtime.events.poincare_section import Section, section
    from .runtime.results.crossings import Crossings
    from .runtime.results.trajectory import Trajectory
    from .runtime.rigid_body import problems
    from .runtime.rigid_body.gamma_rules import (
        gamma_fast,
        gamma_h,
        gamma_h_tilde,
        gamma_m,
        gamma_m_tilde,
    )
    from .runtime.rigid_body.quaternion import momentum, state_from_rotation
    from .runtime.steppers.ensemble import Ensemble
    from .runtime.steppers.simulation import Simulation
    from .runtime.steppers.stepper import Stepper
    from .runtime.tuning.frame_choice import choose_frame
    from .runtime.tuning.frame_search import FrameChoice
    from .runtime.tuning.gamma_choice import GammaChoice, choose_gamma
    from .storage.record import record
    from .storage.recording import Recording, open_recording
    from .sweeps.results import open_sweep
    from .sweeps.run_sweep import sweep
    from .targets.artefact import Built
    from .targets.build import build
    from .targets.web.page import playground

#: Public name → where it lives; resolved on first use.
_HOMES = {
    "Certificate": "certificates.certificate",
    "certify": "certificates.certificate",
    "Citations": "certificates.citations",
    "cite": "certificates.citations",
    "CompilerError": "core.errors",
    "GyrosparkError": "core.errors",
    "InputError": "core.errors",
    "InputWarning": "core.errors",
    "MissingDependencyError": "core.errors",
    "StepFailed": "core.errors",
    "Stopped": "core.errors",
    "StorageError": "core.errors",
    "TableauError": "core.errors",
    "consistent": "api",
    "stepper": "api",
    "tableau": "api",
    "Model": "generator.multibody.model",
    "Multibody": "generator.multibody.multibody",
    "body_system": "generator.multibody.rigid_body",
    "load_model": "api",
    "molecules": "generator.multibody.molecules",
    "rotation_matrix": "generator.multibody.rigid_body",
    "System": "generator.systems.system",
    "load_mjcf": "generator.models.robots",
    "load_sdf": "generator.models.robots",
    "load_urdf": "generator.models.robots",
    "read_mjcf": "generator.models.robots",
    "read_sdf": "generator.models.robots",
    "read_urdf": "generator.models.robots",
    "from_mechanics": "generator.systems.sympy_mechanics",
    "Projection": "core.projection",
    "Crossings": "runtime.results.crossings",
    "DeviceEnsemble": "runtime.devices.ensemble",
    "Ensemble": "runtime.steppers.ensemble",
    "Event": "core.event",
    "Shape": "core.shapes",
    "Solver": "core.solver",
    "Start": "core.start",
    "FrameChoice": "runtime.tuning.frame_search",
    "choose_frame": "runtime.tuning.frame_choice",
    "GammaChoice": "runtime.tuning.gamma_choice",
    "choose_gamma": "runtime.tuning.gamma_choice",
    "gamma_fast": "runtime.rigid_body.gamma_rules",
    "gamma_h": "runtime.rigid_body.gamma_rules",
    "gamma_h_tilde": "runtime.rigid_body.gamma_rules",
    "gamma_m": "runtime.rigid_body.gamma_rules",
    "gamma_m_tilde": "runtime.rigid_body.gamma_rules",
    "momentum": "runtime.rigid_body.quaternion",
    "state_from_rotation": "runtime.rigid_body.quaternion",
    "Section": "runtime.events.poincare_section",
    "section": "runtime.events.poincare_section",
    "Simulation": "runtime.steppers.simulation",
    "Fit": "runtime.analysis.fit",
    "fit": "runtime.analysis.fit",
    "Lyapunov": "runtime.analysis.lyapunov",
    "lyapunov": "runtime.analysis.lyapunov",
    "PeriodicOrbit": "runtime.analysis.periodic_orbit",
    "periodic_orbit": "runtime.analysis.periodic_orbit",
    "Gradient": "runtime.derivatives.gradient",
    "Inputs": "runtime.bindings.inputs",
    "Tangents": "runtime.derivatives.tangent_space",
    "Stepper": "runtime.steppers.stepper",
    "Trajectory": "runtime.results.trajectory",
    "Recording": "storage.recording",
    "open_recording": "storage.recording",
    "record": "storage.record",
    "open_sweep": "sweeps.results",
    "sweep": "sweeps.run_sweep",
    "Built": "targets.artefact",
    "build": "targets.build",
    "playground": "targets.web.page",
}

#: The same for modules.
_MODULES = {
    "exact": "exact", "models": "generator.multibody.example_models",
    "problems": "runtime.rigid_body.problems", "references": "references",
    "symbols": "generator.multibody.body_symbols",
}

__all__ = [
    "Built",
    "Certificate",
    "Citations",
    "CompilerError",
    "Crossings",
    "DeviceEnsemble",
    "Ensemble",
    "Event",
    "Fit",
    "FrameChoice",
    "GammaChoice",
    "Gradient",
    "GyrosparkError",
    "InputError",
    "InputWarning",
    "Inputs",
    "Lyapunov",
    "MissingDependencyError",
    "Model",
    "Multibody",
    "PeriodicOrbit",
    "Projection",
    "Recording",
    "Section",
    "Shape",
    "Simulation",
    "Solver",
    "Start",
    "StepFailed",
    "Stepper",
    "Stopped",
    "StorageError",
    "System",
    "TableauError",
    "Tangents",
    "Trajectory",
    "__version__",
    "body_system",
    "build",
    "certify",
    "choose_frame",
    "choose_gamma",
    "cite",
    "consistent",
    "exact",
    "fit",
    "from_mechanics",
    "gamma_fast",
    "gamma_h",
    "gamma_h_tilde",
    "gamma_m",
    "gamma_m_tilde",
    "load_mjcf",
    "load_model",
    "load_sdf",
    "load_urdf",
    "lyapunov",
    "models",
    "molecules",
    "momentum",
    "open_recording",
    "open_sweep",
    "periodic_orbit",
    "playground",
    "problems",
    "read_mjcf",
    "read_sdf",
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
    from .core.arguments import proposal
    from .core.calls import explain_module, explain_names
    from .core.errors import MissingDependencyError

    if name in _MODULES:
        return explain_module(import_module(f".{_MODULES[name]}", __name__))
    if name not in _HOMES:
        raise AttributeError(
            f"module {__name__!r} has no attribute {name!r}{proposal(name, __all__)}")
    try:
        home = import_module(f".{_HOMES[name]}", __name__)
        explain_names(home, [name])
        return getattr(home, name)
    except MissingDependencyError as error:
        return _missing(name, str(error))


def _missing(name: str, message: str) -> Any:
    """Return what stands for a name whose extra is not installed: to call it is refused.

    Its documentation is read from its file, which cannot be imported.
    """
    import ast
    from pathlib import Path

    def refuse(*arguments: object, **options: object) -> Any:
        from .core.errors import MissingDependencyError

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
