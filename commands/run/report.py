"""The report of ``gyrospark run``: a dictionary for scripts, text for people."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from ...core.arguments import count_text
from ...core.errors import StepFailed, Stopped
from ...core.exact_numbers import digits_of
from ...core.manifest import SystemManifest
from ...core.warnings import warn
from ...generator.parsing.text_file import is_robot

if TYPE_CHECKING:
    from ...runtime.results.trajectory import Trajectory
    from ...runtime.rigid_body.exact import ExactMotion
    from ...runtime.steppers.run_defaults import RunDefaults
    from ...runtime.steppers.stepper import Stepper
    from ...runtime.tuning.tune import Tuned
    from .outputs import RunOutcome

__all__ = ["about_tuning", "as_text", "axis_errors", "result_of", "warn_of_rest"]

#: Largest change of a coordinate, beside the largest of them, that is none: some round-off.
_AT_REST = 1e-13
#: Largest move of a start onto the constraints, in parts of its size, that is none: typed digits.
_MOVED = 1e-12
#: Numbers of ``Trajectory.report`` that a report has under the same names, in its order.
_REPORTED = ("energy_start", "energy_error_max", "energy_error_mean", "constraint_max",
             "constraint_mean", "momentum_constraint_max", "momentum_constraint_mean",
             "iterations_mean", "iterations_max", "newton_steps")


def about_tuning(tuned: Tuned) -> dict[str, Any]:
    """Return the report of ``gs.tune``; NaN for an error and a gain that were not measured."""
    return {"tuned": {"parameters": tuned.parameters, "dt": float(tuned.dt), "error": tuned.error,
                      "gain": tuned.gain, "reason": tuned.reason, "pilots": len(tuned.pilots)}}


def result_of(
    start: RunDefaults, step: Stepper, outcome: RunOutcome, t0: float = 0.0
) -> dict[str, Any]:
    """Return the report of a run that began at t0, as JSON values by name.

    ``outcome.last`` has the end of the run and the report of all its steps, ``outcome.trajectory``
    the states that are kept. Of a stored run ``last`` is one state, which has no events.
    """
    trajectory = outcome.last
    report, end = trajectory.report, _end_of(step, outcome, t0)
    result = {
        "problem": start.name,
        "stepper": step.name,
        "order": step.order,
        **({"warnings": step.warnings} if step.warnings else {}),
        "parameters": {name: float(x) for name, x in trajectory.parameters.items()},
        "steps": report.steps,
        "dt": float(trajectory.dt),
        **(_scaled_steps(trajectory, end.t - float(t0)) if step.binding.clocked else {}),
        "t_end": end.t,
        "q": end.q,
        "p": end.p,
        **{name: getattr(report, name) for name in _REPORTED},
        **({"energy_waits": report.energy_waits} if step.manifest.scheme.exact_energy else {}),
        # of this call: a resumed run has further steps from earlier ones
        "seconds": outcome.seconds,
        "ns_per_step": outcome.seconds / outcome.steps * 1e9 if outcome.steps else None,
    }
    return (result | _of_some_steppers(step, outcome, end) | _events(outcome.trajectory)
            | _start_move(outcome.trajectory, start) | _ending(outcome))


class _End(NamedTuple):
    """The end of a run: its time, state, work of the forces and quantities, in doubles."""

    t: float
    q: list[float]
    p: list[float]
    work: float
    quantities: dict[str, float]


def _end_of(step: Stepper, outcome: RunOutcome, t0: float) -> _End:
    """Return the end of a run that began at t0: its last row, or its last whole step.

    A run that failed or was stopped may have steps behind its last row. In scaled time their times
    are not known, and its end is the last row.
    """
    import numpy as np

    trajectory, binding = outcome.last, step.binding
    report, dt = trajectory.report, float(trajectory.dt)
    t = float(t0) + report.steps * dt
    if binding.clocked or (t - float(trajectory.t[-1])) / dt < 0.5:
        last_q, last_p = ([float(x) for x in rows[-1]] for rows in (trajectory.q, trajectory.p))
        return _End(
            float(trajectory.t[-1]), last_q, last_p, float(trajectory.work[-1]),
            {name: float(trajectory.quantity(name)[-1]) for name in trajectory.quantities})
    # a row of each, in the type of the compiled code
    time, q, p = (binding.to_real(np.array(numbers)) for numbers in ([t], [report.q], [report.p]))
    values = binding.quantities(binding.parameters(trajectory.parameters, t), time, q, p)
    return _End(t, list(report.q), list(report.p), report.work,
                {name: float(x) for name, x in zip(trajectory.quantities, values[0], strict=True)})


def _of_some_steppers(step: Stepper, outcome: RunOutcome, end: _End) -> dict[str, Any]:
    """Return the numbers of a run that only some steppers have, such as the work of forces."""
    from ...core.real_types import REALS
    from ...runtime.results.rotation_rate import fastest_rotation

    trajectory, result = outcome.last, dict[str, Any]()
    if trajectory.has_motion_energy:
        result |= _motion_energy(outcome.trajectory, step)
    if REALS[step.manifest.real].wide:
        result["all_digits"] = _all_digits(trajectory)
    if step.binding.has_forces:
        result["work"] = end.work
    rotation = fastest_rotation(outcome.trajectory)
    if rotation is not None:
        result["radians_per_step"] = rotation.radians
        result["fastest_body"] = rotation.body
    if end.quantities:
        result["quantities"] = end.quantities
    return result


def _motion_energy(trajectory: Trajectory, step: Stepper) -> dict[str, Any]:
    """Return the errors of H at the stored states with p projected onto g_q H_p = 0."""
    import numpy as np  # not for --help

    with np.errstate(all="ignore"):  # the numbers of a failed run may be infinite
        errors = abs(trajectory.energy_error(of_motion=True, stepper=step))
    return {"motion_energy_error_max": float(errors.max()),
            "motion_energy_error_mean": float(errors.mean())}


def _start_move(trajectory: Trajectory, start: RunDefaults) -> dict[str, Any]:
    """Return by how much the start was projected onto the constraints; {} for round-off."""
    import numpy as np

    displacement = max(float(np.abs(np.subtract(x, x0)).max()) for x, x0 in (
        (trajectory.q[0], start.q0), (trajectory.p[0], start.p0)))
    size = max(map(abs, (*start.q0, *start.p0)))
    return {"start_moved": displacement} if displacement > _MOVED * size else {}


def _events(trajectory: Trajectory) -> dict[str, Any]:
    """Return the crossings of a run's events, or its impacts with impulses and lost energies."""
    events, impacts = trajectory.events, trajectory.impacts
    if impacts:  # then ``events`` are the same crossings, without impulses
        return {"impacts": {name: {"t": [float(t) for t in hits.t],
                                   "impulse": [float(x) for x in hits.impulse],
                                   "energy_lost": [float(x) for x in hits.energy_lost]}
                            for name, hits in impacts.items()}}
    if events:
        return {"events": {name: {"t": [float(t) for t in crossings.t],
                                  "rising": crossings.rising.tolist()}
                           for name, crossings in events.items()}}
    return {}


def _ending(outcome: RunOutcome) -> dict[str, Any]:
    """Return why a run ended before its last step, where it was resumed and what it wrote."""
    ending: dict[str, Any] = {}
    steps = outcome.last.report.steps
    if outcome.ended_by is not None:
        ending["ended"] = {"event": outcome.ended_by, "t": float(outcome.last.t[-1])}
    if outcome.steps < steps:  # some steps of the store are from an earlier call
        ending["resumed_at"] = steps - outcome.steps
        ending["done_before"] = not outcome.steps and outcome.trouble is None
    if isinstance(outcome.trouble, StepFailed):
        ending["failed"] = {name: getattr(outcome.trouble, name) for name in
                            ("step", "t", "reason", "increment", "dt")}
    if isinstance(outcome.trouble, Stopped):
        ending["stopped"] = {"step": steps, "signal": outcome.trouble.signal}
    if outcome.out is not None:
        ending["out"] = outcome.out
    return ending


def warn_of_rest(trajectory: Trajectory, problem: str) -> None:
    """Warn where nothing moves: the start is an equilibrium, and no speed is given."""
    import numpy as np

    displacement, size = (np.abs(x.astype(float)).max() for x in (
        trajectory.q - trajectory.q[0], trajectory.q))
    if trajectory.p[0].any() or len(trajectory) < 2 or not displacement <= _AT_REST * size:
        return
    if is_robot(problem):
        cure = "--set JOINT=0.3, or --set JOINT.rate=1, of a joint of the file"
    else:
        cure = "another start, such as --set start.euler='[0.3, 0, 0]' of a body in a model file"
    warn(f"Nothing moves: {problem} starts at rest, where it is in equilibrium. Give it {cure}.")


def _all_digits(trajectory: Trajectory) -> dict[str, Any]:
    """Return numbers of a run and of its last stored state: as text where doubles lose digits."""
    return {
        "parameters": {name: digits_of(x) for name, x in trajectory.parameters.items()},
        "dt": digits_of(trajectory.dt), "t": digits_of(trajectory.t[-1]),
        "q": [digits_of(x) for x in trajectory.q[-1]],
        "p": [digits_of(x) for x in trajectory.p[-1]],
    }


def axis_errors(motion: ExactMotion, trajectory: Trajectory) -> dict[str, Any]:
    """Return the mean and largest errors of the unit axis over the stored states (87)."""
    # the closed form begins at 0, a run at any t0
    exact = motion.axis((trajectory.t - trajectory.t[0]).astype(float))
    error = abs(trajectory.axis() - exact)
    result: dict[str, Any] = {"axis_reference": "closed form"}
    for i, name in enumerate("xyz"):
        result[f"axis_{name}_error_mean"] = float(error[:, i].mean())
        result[f"axis_{name}_error_max"] = float(error[:, i].max())
    return result


def _constraint_lines(result: dict[str, Any], system: SystemManifest) -> list[str]:
    """Return the lines on g and on the hidden constraint, none for a system without constraints."""
    if not system.constraints:
        return []
    g, f = ("|qᵀq − 1|", "|qᵀp|") if system.rigid_body else ("|g(q)|", "|g_q H_p|")
    return [f"  constraint {g:12s} largest {result['constraint_max']:.2e}",
            f"  momentum   {f:12s} largest {result['momentum_constraint_max']:.2e}"]


def _resumed_lines(result: dict[str, Any]) -> list[str]:
    """Return the line on where a stored run was resumed; none for a run that began here."""
    if result.get("done_before"):
        return ["  done before: no step was left to take, and the numbers are the store's"]
    return [f"  gone on with at step {result['resumed_at']:,}"] if "resumed_at" in result else []


def as_text(result: dict[str, Any], system: SystemManifest) -> str:
    """Return the report as text: a line for each entry of ``result_of`` that there is.

    ``system`` is that part of the manifest.
    """
    cost = f", {result['ns_per_step'] / 1e3:.2f} µs a step" if result["ns_per_step"] else ""
    paths = [*([result["out"]] if "out" in result else []), *result.get("plot", []),
             *result.get("show", [])]
    return "\n".join([
        f"{result['problem']} with {result['stepper']} (order {result['order']})",
        *_resumed_lines(result),
        f"  {count_text(result['steps'], 'step')} of {_step_size(result)} to "
        f"t = {result['t_end']:g} s{cost}",
        *_constraint_lines(result, system),
        *_energy_lines(result),
        f"  iterations              mean {result['iterations_mean']:.2f}, "
        f"most {result['iterations_max']}",
        *_motion_lines(result),
        *_event_lines(result),
        *_tuning_lines(result),
        *_error_lines(result),
        *(f"  wrote {path}" for path in paths),
    ])


def _energy_lines(result: dict[str, Any]) -> list[str]:
    """Return the lines on the energy error of all steps and on the error of the motion."""
    balance = "|H − H₀ − W|" if "work" in result else "|H − H₀|"
    lines = [f"  energy     {balance:12s} largest {result['energy_error_max']:.2e}, "
             f"mean {result['energy_error_mean']:.3e}, H₀ = {result['energy_start']:.6g}"]
    if "motion_energy_error_max" in result:
        lines.append("  energy     of the motion, g_q H_p = 0 (stored states) largest "
                     f"{result['motion_energy_error_max']:.2e}, "
                     f"mean {result['motion_energy_error_mean']:.3e}")
    return lines


def _motion_lines(result: dict[str, Any]) -> list[str]:
    """Return the lines on the fastest rotation, the work and the quantities at the end."""
    lines = []
    if "energy_waits" in result:  # steps which no small θ makes exact: a later one makes up for it
        lines.append("  energy waits            in "
                     f"{count_text(result['energy_waits'], 'step')} without a small θ")
    if "radians_per_step" in result:
        lines.append(f"  fastest rotation        {result['radians_per_step']:.3g} rad a step, of "
                     f"{result['fastest_body']}")
    if "work" in result:
        lines.append(f"  work of the forces      {result['work']:.6g}")
    return lines + [f"  {name:<23} {quantity:.9g}"
                    for name, quantity in result.get("quantities", {}).items()]


def _event_lines(result: dict[str, Any]) -> list[str]:
    """Return a line for each event and impact, and the one on the event that ended the run."""
    lines = [_event_line("event", name, crossings)
             for name, crossings in result.get("events", {}).items()]
    lines += [_event_line("impact", name, hits) + f", {sum(hits['energy_lost']):.6g} J lost"
              for name, hits in result.get("impacts", {}).items()]
    if "ended" in result:
        lines.append("  ended                   by event {event} at t = {t:.12g} s".format(
            **result["ended"]))
    return lines


def _tuning_lines(result: dict[str, Any]) -> list[str]:
    """Return the line on the numbers that ``gs.tune`` chose; none where nothing was chosen."""
    if "tuned" not in result:
        return []
    tuned = result["tuned"]
    numbers = ", ".join(f"{name} = {x:.8g}"
                        for name, x in (tuned["parameters"] | {"dt": tuned["dt"]}).items())
    # in scaled time the reason begins with the step
    about = tuned["reason"] if "dtau" in result else f"{numbers}, {tuned['reason']}"
    return [f"  tuned                   {about}, in {tuned['pilots']} pilot runs"]


def _error_lines(result: dict[str, Any]) -> list[str]:
    """Return the lines on the error of a body's axis, where it is known, and on a failed step."""
    lines = []
    if "axis_reference" in result:
        lines.append(
            f"  axis error ({result['axis_reference']})  mean x {result['axis_x_error_mean']:.3e}, "
            f"z {result['axis_z_error_mean']:.3e}")
    if "failed" in result:
        failed = result["failed"]
        lines.append(f"  stopped: step {failed['step']} at t = {failed['t']:g} s "
                     f"{failed['reason']}")
    return lines


def _scaled_steps(trajectory: Trajectory, duration: float) -> dict[str, float]:
    """Return Δτ, and the mean, the least and the largest Δt, of a run in scaled time.

    A part of a step, to t_end, counts by its share of Δτ.
    """
    report, dtau = trajectory.report, float(trajectory.dt)
    count = float(trajectory.tau[-1]) / dtau
    return {"dtau": dtau, "dt": duration / count if count else 0.0,
            "dt_min": report.time_step_min, "dt_max": report.time_step_max}


def _step_size(result: dict[str, Any]) -> str:
    """Return the step as text: Δt in seconds; in scaled time Δτ, with the least and the largest Δt.
    """
    if "dtau" not in result:
        return f"{result['dt']:g} s"
    return f"dtau = {result['dtau']:g}, {result['dt_min']:.3g} to {result['dt_max']:.3g} s,"


def _event_line(kind: str, name: str, crossings: dict[str, Any]) -> str:
    """Return the line of an event or impact: its count and its first four times."""
    times = ", ".join(f"{t:.12g}" for t in crossings["t"][:4])
    ellipsis = ", …" if len(crossings["t"]) > 4 else ""
    label, count = f"{kind} {name}", count_text(len(crossings["t"]), "time")
    return f"  {label:<23} {count}" + (f": {times}{ellipsis} s" if times else "")
