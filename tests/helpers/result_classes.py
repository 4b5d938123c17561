"""Public classes without a name in ``gyrospark``: methods and functions return their objects."""

from __future__ import annotations

import importlib

__all__ = ["RESULT_CLASSES", "result_class"]

RESULT_CLASSES = tuple(f"gyrospark.{name}" for name in (
    "certificates.certificate.Certificate",
    "certificates.citations.Citations",
    "core.projection.Projection",
    "runtime.analysis.fit.Fit",
    "runtime.analysis.lyapunov.Lyapunov",
    "runtime.analysis.periodic_orbit.PeriodicOrbit",
    "runtime.derivatives.gradient.Gradient",
    "runtime.devices.ensemble.DeviceEnsemble",
    "runtime.events.poincare_section.Section",
    "runtime.results.beam_motion.BeamMotion",
    "runtime.results.body_motion.BodyMotion",
    "runtime.results.crossings.Crossings", "runtime.results.crossings.Impacts",
    "runtime.results.diagnostics.Report",
    "runtime.results.joint_motion.JointMotion",
    "runtime.results.tangent_rows.TangentRows",
    "runtime.tuning.tune.Tuned",
    "storage.recording.Recording",
    "targets.artefact.Built",
))


def result_class(path: str) -> type:
    """Return the class of a path such as ``gyrospark.runtime.analysis.fit.Fit``."""
    module, _, name = path.rpartition(".")
    return getattr(importlib.import_module(module), name)
