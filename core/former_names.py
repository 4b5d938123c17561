"""Names of earlier versions: each is refused by a sentence with the present name."""

from __future__ import annotations

from collections.abc import Collection

__all__ = ["FORMER_MEMBERS", "FORMER_NAMES", "FORMER_OPTIONS", "former_argument"]

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
    "Recording": ("load", "storage.recording"),
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
    "FrameChoice": "what gyrospark.tune(..., frame='auto') returns",
    "GammaChoice": "what gyrospark.tune(..., gamma='auto') returns",
    **{name: f"what gyrospark.{call} has; its class is gyrospark.runtime.results.{home}.{name}"
       for name, call, home in (("BodyMotion", "Trajectory.body", "body_motion"),
                                ("JointMotion", "Trajectory.joint", "joint_motion"),
                                ("Report", "Trajectory.report", "diagnostics"),
                                ("TangentRows", "Trajectory.tangents", "tangent_rows"))},
    "choose_frame": "gyrospark.tune(step, start, dt=..., frame='auto')",
    "choose_gamma": "gyrospark.tune(step, start, dt=..., gamma='auto')",
    "gamma_fast": "gyrospark.gamma(inertia): the number of iterations hardly depends on γ",
    "gamma_h": "gyrospark.gamma(inertia, 'h')",
    "gamma_h_tilde": "gyrospark.gamma(inertia, 'ht')",
    "gamma_m": "gyrospark.gamma(inertia)",
    "gamma_m_tilde": "gyrospark.gamma(inertia, 'mt')",
    "molecules": "gone: bodies and points with potentials of gyrospark.Multibody stay",
    "open_recording": 'gyrospark.load("night.zarr")',
    "open_sweep": "gyrospark.load_sweep(path)",
    "record": 'step.integrate(start, ..., out="night.zarr"), and gyrospark.resume("night.zarr")',
    "momentum": "gyrospark.Start.of_body(attitude, omega, inertia).p",
    "rotation_matrix": "gyrospark.symbols.rotation_matrix",
    "state_from_rotation": "gyrospark.Start.of_body(attitude, omega, inertia)",
}

#: Class → its former attribute → the present form.
FORMER_MEMBERS: dict[str, dict[str, str]] = {
    "Trajectory": {
        "to_csv": 'run.save("run.csv", columns=..., euler=...)',
        "to_dataframe": "run.table(columns, euler=...)",
        "to_xarray": "run.dataset()",
        "view": 'run.show("run.html")',
        "picture": 'run.show("run.png")',
        "animate": 'run.show("run.gif")',
        "export": 'run.show("run.glb")',
        "load": 'gyrospark.load("run.npz")',
    },
    "Ensemble": {"to_xarray": "many.dataset()"},
    "Stepper": {
        "at": "run.at(times)",
        "remarks": "step.warnings",
        **dict.fromkeys(("run", "run_arguments", "resolved", "provenance"),
                        "private; step.integrate has its work"),
    },
    "Recording": {"trajectory": "the run itself, run[first::thin]", "export": "run.save(path)"},
}

#: Former arguments of the functions that take a start, and the present form.
_OF_STARTS = {
    "q": "give q and p first, without names",
    "p": "give q and p first, without names",
    "q0": "give q and p first, without names",
    "p0": "give q and p first, without names",
    "t0": "a start has the time: gs.Start(q, p, t=0.5)",
    "tolerance": 'a solver has it: solver=gs.Solver("newton", tolerance=1e-12)',
    "max_iterations": 'a solver has it: solver=gs.Solver("auto", max_iterations=20)',
    "hold": "the inputs have it: inputs=gs.Inputs(rows, hold=4)",
}

#: Former arguments of other functions, "function.argument".
_ARGUMENTS = {
    "integrate.error": "gs.tune(step, start, step_error=1e-9, t_end=1).dt is the step for it",
    "integrate.round": "t_end may lie between two steps",
    "fit.step": "the stepper goes first, without a name",
    "sweep.duration": "t_end, the time of the end of every cell, is in its place",
    "sweep.tolerance": _OF_STARTS["tolerance"],
    "sweep.max_iterations": _OF_STARTS["max_iterations"],
}

_SHOW = "--show FILE writes by its ending: .html, .png, .gif, .mp4, .glb"
_SOLVER = "a solver has it: --solver newton,tolerance=1e-12,max_iterations=20"
_TABLE = "gyrospark export RUN.zarr TABLE.csv --euler ZYX --degrees writes angles"
_SYSTEM = "the problem is the system; give a name or a file in its place"
_TIME = "the time of the start is --set t=0.5"
#: Command and former option → the present form.
FORMER_OPTIONS = {
    "fit --system": _SYSTEM,
    "fit --t": _TIME,
    "fit --t0": _TIME,
    "lyapunov --system": _SYSTEM,
    "lyapunov --t": _TIME,
    "lyapunov --t0": _TIME,
    "run --animate": _SHOW,
    "run --degrees": _TABLE,
    "run --error": "--step-error E, without --dt, searches the time step",
    "run --euler": _TABLE,
    "run --max-iterations": _SOLVER,
    "run --picture": _SHOW,
    "run --reference": "a run with more stages is a reference",
    "run --round": "--t-end may lie between two steps",
    "run --seed": "nothing used it",
    "run --system": _SYSTEM,
    "run --t": _TIME,
    "run --t0": _TIME,
    "run --tolerance": _SOLVER,
    "run --view": _SHOW,
}


def former_argument(function: str, argument: str, parameters: Collection[str]) -> str | None:
    """Return the present form of a former argument of a function; None if it never had one.

    ``parameters`` are the present parameters of the function.
    """
    cure = _ARGUMENTS.get(f"{function}.{argument}")
    if cure is None and not {"start", "starts"}.isdisjoint(parameters):
        cure = _OF_STARTS.get(argument)
    return cure
