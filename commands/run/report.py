"""The report of ``gyrospark run``: a dictionary for scripts, text for people."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

from ...core.errors import StepFailed, Stopped
from ...core.exact_numbers import digits_of
from ...core.registry import AIMS
from ...core.warnings import warn
from ...generator.parsing.text_file import is_robot

if TYPE_CHECKING:
    from ...runtime.results.trajectory import Trajectory
    from ...runtime.rigid_body.problems import Problem
    from ...runtime.steppers.run_defaults import RunDefaults
    from ...runtime.steppers.stepper import Stepper
    from ...runtime.tuning.gamma_choice import GammaChoice
    from .outputs import RunOutcome

__all__ = ["about_choice", "as_text", "axis_errors", "json_text", "result_of", "warn_of_rest"]

#: Largest change of a coordinate, beside the largest of them, that is none: some round-off.
_AT_REST = 1e-13


def json_text(result: dict[str, Any]) -> str:
    """Return the result as JSON, which knows no NaN and no infinity: they become null."""
    finite = {key: None if isinstance(value, float) and not math.isfinite(value) else value
              for key, value in result.items()}
    return json.dumps(finite, indent=2, allow_nan=False)


def about_choice(choice: GammaChoice) -> dict[str, Any]:
    """Return the report of a choice of γ."""
    name = "alpha" if "alpha" in next(iter(choice.values)) else "gamma"
    return {
        **choice.values,
        f"{name}_chosen": choice.values,
        f"{name}_expected_gain": choice.expected_gain,
        f"{name}_measured_gain": choice.measured_gain,
        f"{name}_aim": choice.aim,
        **{f"{name}_{aim}_gain": gain for aim, gain in choice.gains.items()},
        f"{name}_reason": choice.reason,
    }


def result_of(
    start: RunDefaults, step: Stepper, done: RunOutcome, t0: float = 0.0
) -> dict[str, Any]:
    """Return the report of a run that began at t0."""
    import numpy as np  # not for --help

    from ...core.real_types import REALS
    from ...runtime.results.rotation_rate import fastest_rotation

    trajectory = done.last
    report = trajectory.report
    end = float(t0) + report.steps * float(trajectory.dt)
    result: dict[str, Any] = {
        "problem": start.name,
        "stepper": step.name,
        "order": step.order,
        **({"warnings": step.warnings} if step.warnings else {}),
        "parameters": {name: float(x) for name, x in trajectory.parameters.items()},
        "steps": report.steps,
        "dt": float(trajectory.dt),
        "t_end": end,
        "q": list(report.q),
        "p": list(report.p),
        "energy_start": report.energy_start,
        "energy_error_max": report.energy_error_max,
        "energy_error_mean": report.energy_error_mean,
        "constraint_max": report.constraint_max,
        "constraint_mean": report.constraint_mean,
        "momentum_constraint_max": report.momentum_constraint_max,
        "momentum_constraint_mean": report.momentum_constraint_mean,
        "iterations_mean": report.iterations_mean,
        "iterations_max": report.iterations_max,
        "newton_steps": report.newton_steps,
        **({"energy_waits": report.energy_waits} if step.manifest["scheme"].get("exact_energy")
           else {}),
        "seconds": done.seconds,
        "ns_per_step": done.seconds / done.steps * 1e9 if done.steps else None,
    }
    if trajectory.has_motion_energy:
        with np.errstate(all="ignore"):  # the numbers of a failed run may be infinite
            of_motion = abs(done.trajectory.energy_error(of_motion=True, stepper=step))
        result["motion_energy_error_max"] = float(of_motion.max())
        result["motion_energy_error_mean"] = float(of_motion.mean())
    if REALS[step.manifest["real"]].wide:
        result["all_digits"] = _all_digits(trajectory)
    if step.binding.has_forces:
        result["work"] = report.work
    turning = fastest_rotation(done.trajectory)
    if turning is not None:
        result["radians_per_step"] = turning.radians
        result["fastest_body"] = turning.body
    if trajectory.quantities:
        result["quantities"] = {name: float(trajectory.quantity(name)[-1])
                                for name in trajectory.quantities}
    events = done.trajectory.events  # of a stored run the last state alone knows of none
    if events:
        result["events"] = {name: {"t": [float(t) for t in found.t],
                                   "rising": found.rising.tolist()}
                            for name, found in events.items()}
    if done.ended_by is not None:
        result["ended"] = {"event": done.ended_by, "t": float(events[done.ended_by].t[0])}
    if done.steps < report.steps:
        result["resumed_at"] = report.steps - done.steps
        result["done_before"] = not done.steps and done.trouble is None
    if isinstance(done.trouble, StepFailed):
        failure = done.trouble
        result["failed"] = {name: getattr(failure, name) for name in
                            ("step", "t", "reason", "increment", "dt")}
    if isinstance(done.trouble, Stopped):
        result["stopped"] = {"step": report.steps, "signal": done.trouble.signal}
    if done.out is not None:
        result["out"] = done.out
    return result


def warn_of_rest(trajectory: Trajectory, problem: str) -> None:
    """Warn where nothing moves: the start is an equilibrium, and no speed is given."""
    import numpy as np

    moved, size = (np.abs(x.astype(float)).max() for x in (
        trajectory.q - trajectory.q[0], trajectory.q))
    if trajectory.p[0].any() or len(trajectory) < 2 or not moved <= _AT_REST * size:
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


def axis_errors(problem: Problem, step: Stepper, trajectory: Trajectory) -> dict[str, Any]:
    """Return the mean and largest errors of the unit axis over the stored states (87)."""
    from ...certificates.reference_motion import reference_axis

    exact, source = reference_axis(problem, trajectory)
    error = abs(trajectory.axis() - exact[: len(trajectory)])  # fewer after a failed step
    result: dict[str, Any] = {"axis_reference": source}
    for i, name in enumerate("xyz"):
        result[f"axis_{name}_error_mean"] = float(error[:, i].mean())
        result[f"axis_{name}_error_max"] = float(error[:, i].max())
    return result


def _constraint_lines(result: dict[str, Any], system: dict[str, Any]) -> list[str]:
    """Return the lines on g and on the constraint that it puts on the momenta."""
    if not system["constraints"]:
        return []
    g, f = ("|qᵀq − 1|", "|qᵀp|") if system["rigid_body"] else ("|g(q)|", "|g_q H_p|")
    return [f"  constraint {g:12s} largest {result['constraint_max']:.2e}",
            f"  momentum   {f:12s} largest {result['momentum_constraint_max']:.2e}"]


def _resumed_lines(result: dict[str, Any]) -> list[str]:
    """Return the line on where a stored run was gone on with."""
    if result.get("done_before"):
        return ["  done before: no step was left to take, and the numbers are the store's"]
    return [f"  gone on with at step {result['resumed_at']:,}"] if "resumed_at" in result else []


def as_text(result: dict[str, Any], system: dict[str, Any]) -> str:
    """Return the report as text; ``system`` is that part of the manifest."""
    balance = "|H − H₀ − W|" if "work" in result else "|H − H₀|"
    lines = [
        f"{result['problem']} with {result['stepper']} (order {result['order']})",
        *_resumed_lines(result),
        f"  {result['steps']:,} steps of {result['dt']:g} s to t = {result['t_end']:g} s" + (
            f", {result['ns_per_step'] / 1e3:.2f} µs a step" if result["ns_per_step"] else ""),
        *_constraint_lines(result, system),
        f"  energy     {balance:12s} largest {result['energy_error_max']:.2e}, "
        f"mean {result['energy_error_mean']:.3e}, H₀ = {result['energy_start']:.6g}",
        f"  iterations              mean {result['iterations_mean']:.2f}, "
        f"most {result['iterations_max']}",
    ]
    if "motion_energy_error_max" in result:
        lines.insert(-1, f"  energy     of the motion, g_q H_p = 0 (stored states) largest "
                     f"{result['motion_energy_error_max']:.2e}, "
                     f"mean {result['motion_energy_error_mean']:.3e}")
    if "energy_waits" in result:
        lines.append("  energy waits            in "
                     f"{result['energy_waits']:,} steps without a small θ")
    if "radians_per_step" in result:
        lines.append(f"  fastest rotation        {result['radians_per_step']:.3g} rad a step, of "
                     f"{result['fastest_body']}")
    if "dt_error" in result:
        lines.append(f"  dt chosen               error of the motion {result['dt_error']:.2e}, "
                     f"measured in {len(result['dt_pilots'])} pilots")
    if "work" in result:
        lines.append(f"  work of the forces      {result['work']:.6g}")
    lines += [f"  {name:<23} {value:.9g}" for name, value in result.get("quantities", {}).items()]
    lines += [_event_line(name, found) for name, found in result.get("events", {}).items()]
    if "ended" in result:
        lines.append("  ended                   by event {event} at t = {t:.12g} s".format(
            **result["ended"]))
    if "start_moved" in result:
        lines.append("  start                   moved onto the constraints by "
                     f"{result['start_moved']:.2e}")
    lines += [_choice_line(result, name) for name in ("gamma", "alpha")
              if f"{name}_reason" in result]
    if "frame" in result:
        lines.append(_frame_line(result))
    if "axis_reference" in result:
        lines.append(
            f"  axis error ({result['axis_reference']})  mean x {result['axis_x_error_mean']:.3e}, "
            f"z {result['axis_z_error_mean']:.3e}"
        )
    if "failed" in result:
        failed = result["failed"]
        lines.append(f"  stopped: step {failed['step']} at t = {failed['t']:g} s "
                     f"{failed['reason']}")
    written = ("out", "plot", "picture", "view", "animate")
    lines += [f"  wrote {result[key]}" for key in written if key in result]
    return "\n".join(lines)


def _frame_line(result: dict[str, Any]) -> str:
    """Return the line on the co-moving frame."""
    rates = ", ".join(f"{name} = {rate:.8g}" for name, rate in result["frame"].items())
    chosen = f", {result['frame_reason']}" if "frame_reason" in result else ""
    if "frame_measured_gain" in result:
        chosen += (f"; error {result['frame_measured_gain']:.3g} times smaller than without "
                   f"(expected {result['frame_expected_gain']:.3g})")
    gamma = f", gamma = {result['gamma']:.6g}" if chosen and "gamma" in result else ""
    return f"  co-moving frame         {rates} rad/s{gamma}{chosen}"


def _event_line(name: str, found: dict[str, Any]) -> str:
    times = ", ".join(f"{t:.12g}" for t in found["t"][:4])
    more = ", …" if len(found["t"]) > 4 else ""
    return f"  event {name:<17} {len(found['t']):,} times" + (f": {times}{more} s" if times else "")


def _choice_line(result: dict[str, Any], name: str) -> str:
    sign = {"gamma": "γ", "alpha": "α"}[name]
    reason, expected, aim = (result[f"{name}_{end}"]
                             for end in ("reason", "expected_gain", "aim"))
    values = ", ".join(f"{value:.6g}" for value in result[f"{name}_chosen"].values())
    told = ", ".join(f"{what} {result[f'{name}_{what}_gain']:.3g}"
                     + (f" (expected {expected:.3g})" if what == aim else "")
                     for what in AIMS.values())
    return f"  {sign} chosen                {values} kg m², {reason}; gain over {sign}_m: {told}"
