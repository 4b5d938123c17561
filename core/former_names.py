"""Names of earlier versions: each is refused by a sentence with the present name."""

from __future__ import annotations

__all__ = ["FORMER_NAMES"]

_ERRORS = ("CompilerError", "InputWarning", "MissingDependencyError", "Stopped", "StorageError",
           "TableauError")
#: Classes of results → the function that returns them, and the module that has them.
_RESULTS = {
    "Built": ("build", "targets.artefact"),
    "Certificate": ("certify", "certificates.certificate"),
    "Citations": ("cite", "certificates.citations"),
    "Crossings": ("Trajectory.events", "runtime.results.crossings"),
    "DeviceEnsemble": ("Stepper.integrate_ensemble", "runtime.devices.ensemble"),
    "Fit": ("fit", "runtime.analysis.fit"),
    "Gradient": ("Trajectory.gradient", "runtime.derivatives.gradient"),
    "Lyapunov": ("lyapunov", "runtime.analysis.lyapunov"),
    "PeriodicOrbit": ("periodic_orbit", "runtime.analysis.periodic_orbit"),
    "Projection": ("consistent", "core.projection"),
    "Recording": ("open_recording", "storage.recording"),
    "Section": ("section", "runtime.events.poincare_section"),
}

_ROBOTS = ("mjcf", "sdf", "urdf")
#: Former name of ``gyrospark`` → the present one.
FORMER_NAMES = {
    **{name: f"gyrospark.errors.{name}" for name in _ERRORS},
    **{name: f"what gyrospark.{call} returns; its class is gyrospark.{home}.{name}"
       for name, (call, home) in _RESULTS.items()},
    **{f"load_{kind}": "gyrospark.load_model" for kind in _ROBOTS},
    **{f"read_{kind}": "gyrospark.Multibody.from_file" for kind in _ROBOTS},
    "gamma_h": "gyrospark.gamma(inertia, 'h')",
    "gamma_h_tilde": "gyrospark.gamma(inertia, 'ht')",
    "gamma_m": "gyrospark.gamma(inertia)",
    "gamma_m_tilde": "gyrospark.gamma(inertia, 'mt')",
    "momentum": "gyrospark.Start.of_body(attitude, omega, inertia).p",
    "rotation_matrix": "gyrospark.symbols.rotation_matrix",
    "state_from_rotation": "gyrospark.Start.of_body(attitude, omega, inertia)",
}
