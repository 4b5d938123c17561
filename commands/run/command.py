"""``gyrospark run``: integrate a problem and report what happened to its invariants."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import click

from ...core.arguments import join_or
from ...core.errors import GyrosparkError, StepFailed
from ...core.interrupts import catch_signals
from ...core.registry import MODELS, PROBLEMS, RULES
from ...core.strict_json import json_text
from ...core.warnings import capture_warnings, warn
from ...runtime.bindings.binding import SOLVERS
from ...runtime.plotting.scene import check_bodies
from .. import exit_code_of
from ..options import (
    DEFAULT,
    PATH,
    Grouped,
    completing,
    json_option,
    method_options,
    solver_from,
    whole_number,
)
from .choices import check_span, numbers_of_run, with_options
from .outputs import check_targets, events_of, integrate_to, stored_location
from .report import (
    about_tuning,
    as_text,
    axis_errors,
    result_of,
    warn_of_rest,
)
from .starts import start_of, stepper_and_start

if TYPE_CHECKING:
    from ...runtime.results.trajectory import Trajectory

__all__ = ["run"]


class RunCommand(Grouped):
    """``gyrospark run``."""

    groups: ClassVar = {
        "What runs": ("settings", "scheme", "stages", "order", "composition", "rep", "tableau",
                      "real", "energy"),
        "Steps": ("dt", "dtau", "step_error", "steps", "t_end", "solver", "events"),
        "Inertia and frame": ("gamma", "alpha", "frame"),
        "What is written": ("out", "every", "resume", "plot", "show", "as_json"),
    }


@click.command(cls=RunCommand, no_args_is_help=True,
               context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("problem", metavar="PROBLEM", shell_complete=completing([*PROBLEMS, *MODELS]))
@method_options
@click.option("--gamma", metavar=f"{{{','.join(RULES)},NUMBER}}",
              shell_complete=completing(RULES),
              help="γ: γ_m, γ_h, γ̃_m, γ̃_h of the body, or a number in kg m² (default m); auto: "
                   "smallest error of the motion in short pilot runs, γ_m if any axis would get "
                   "worse; auto-energy: smallest energy error.")
@click.option("--alpha", metavar=f"{{{','.join(RULES)},NUMBER}}", shell_complete=completing(RULES),
              help="The same for --rep alpha.")
@click.option("--frame", metavar="{auto,start,NAME=RATE,...}", multiple=True,
              help="Integrate in a co-moving frame along the system's symmetries: auto searches "
                   "for its rates in short pilot runs (with --gamma auto for both at once), start "
                   "takes the least squares of the start; or rates in rad/s, omega_body=75.4.")
@click.option("--dt", metavar="DT", help="Time step in seconds (default: the model file's).")
@click.option("--dtau", metavar="DTAU",
              help="In place of --dt, of a system with time_scale: step of the scaled time; with "
                   "--step-error the largest that is tried.")
@click.option("--step-error", metavar="E",
              help="In place of --dt: search the step for which the motion's error up to --t-end "
                   "is at most E, attitudes in rad, points in parts of their reach.")
@click.option("--steps", metavar="N", help="Number of steps (default: the model file's).")
@click.option("--t-end", metavar="T",
              help="Time of the last state in seconds, in place of --steps.")
@click.option("--every", metavar="K", default="1", show_default=True,
              help="Keep every K-th state, and the last.")
@click.option("--solver", metavar="NAME[,KEY=VALUE,...]", default="auto", show_default=True,
              shell_complete=completing(SOLVERS),
              help="auto (fixed point, Newton as fallback), fixed-point, newton; with tolerance "
                   "and max_iterations: newton,tolerance=1e-12,max_iterations=20.")
@click.option("--set", "settings", metavar="KEY=VALUE", multiple=True,
              help="t=0.5, the time of the start in seconds. Argument of the problem, e.g. "
                   "radius_ratio=1.5 or inertia=2,1.3,0.8; of a model file a parameter, k=3, or a "
                   "key, start.euler='[0, \"30 deg\", 0]'; of a robot where it starts, "
                   "elbow='30 deg', elbow.rate=1, base=floating, and what of its file to do "
                   "without, ignore=limits,collision or ignore=all.")
@click.option("--event", "events", metavar="TEXT", multiple=True,
              help='Where a quantity, coordinate or momentum crosses a level: "height=0", '
                   '"height=0 down", "x=pi/2 up stop" (the run ends there); with a name '
                   '"landing: height=0". Beside [events] of a model file.')
@click.option("--out", type=PATH, metavar="FILE",
              help="Write the states: .zarr (streamed, for runs of any length), or at the end "
                   ".npz, .csv, .nc, .parquet.")
@click.option("--resume", is_flag=True,
              help="Go on with the run in --out NAME.zarr, to the same bits; also to more "
                   "--steps. Begin it if there is none.")
@click.option("--plot", type=PATH, metavar="FILE",
              help="Draw axis trace, energy and constraint errors (.png, .svg, .pdf).")
@click.option("--show", type=PATH, metavar="FILE", multiple=True,
              help="Show the bodies: a page that moves (.html), a picture at the time of their "
                   "largest extent (.png), a film (.gif; .mp4 with ffmpeg), or a 3-D model that "
                   "moves, for Blender and other viewers (.glb).")
@json_option
def run(
    problem: str, gamma: str | None, alpha: str | None, frame: tuple[str, ...], dt: str | None,
    dtau: str | None, step_error: str | None, steps: str | None, t_end: str | None,
    every: str, solver: str, settings: tuple[str, ...], events: tuple[str, ...], out: Path | None,
    resume: bool, plot: Path | None, show: tuple[Path, ...], as_json: bool, **choice: Any,
) -> int:
    """Integrate PROBLEM: one of the paper's, (PROBLEMS); one of gs.models, (MODELS); a model file
    (.toml); or a robot (.urdf, .xml, .sdf). The default scheme is (DEFAULT).

    \b
    gyrospark run double_pendulum --show pendulum.html
    gyrospark run double_top --show tops.png
    gyrospark run fast-top --scheme G-L --stages 3 --gamma m --dt 1e-3 --steps 320
    gyrospark run fast-top --scheme G-L --stages 2 --gamma auto --dt 1e-3 --t-end 10
    gyrospark run fast-top --scheme G-L --stages 4 --step-error 1e-9 --t-end 2
    gyrospark run fast-top --scheme G-L --stages 3 --frame auto --dt 1e-2 --steps 1000
    gyrospark run fast-top --scheme EMS --rep alpha --dt 1e-3 --steps 100000 --plot top.png
    gyrospark run regular-precession --scheme G-L --stages 2 --gamma ht --dt 0.005 --steps 80 \\
        --set radius_ratio=0.5 --json
    gyrospark run fast-top --scheme G-L --stages 4 --dt 1e-3 --steps 1000000000 --every 1000 \\
        --out night.zarr --resume
    gyrospark run examples/satellite.toml --scheme G-L --stages 3
    gyrospark run double_pendulum --dt 1e-3 --steps 5000 --event "b_y=0.2 up"
    gyrospark run examples/crane.urdf --set ignore=all --set "luffing=45 deg"
    gyrospark run examples/pendulum.toml --scheme EMS --dt 1e-3 --steps 1000 --json
    gyrospark run free-body --scheme LIIIA-B --stages 4 --dt 1e-3 --steps 1000 \\
        --set inertia=0.002,0.0013,0.0008 --set angular_velocity=30,-40,100
    gyrospark run free-body --dt 0.01 --t-end 20 --set inertia=1,2,3 \\
        --set angular_velocity=0.01,5,0.01 --show flip.gif
    """
    # files and options that are refused before anything is derived
    check_targets(out, plot, show, resume=resume)
    times = {"dt": dt, "dtau": dtau, "step_error": step_error, "steps": steps, "t_end": t_end}
    check_span(problem, times)
    # the stepper: ``choice`` has the options of ``method_options``, such as scheme and stages; with
    # "symmetries" it has the rates of frames as parameters
    choice["frame"] = "symmetries" if frame else None
    paper_problem, step, problem_defaults, t0 = stepper_and_start(
        problem, settings, choice, scaled=True)
    if show:
        check_bodies(step.manifest)
    if not as_json:  # properties of the stepper, before a step is taken
        for line in map(": ".join, step.manifest.warnings):
            click.echo(line)
    # the numbers of the run: the problem's, then the options', then those that are searched
    defaults, search = with_options(step, problem_defaults, gamma, alpha, frame)
    state = start_of(step, defaults, t0)
    method = solver_from(solver)
    state, step_size, length, tuning = numbers_of_run(step, state, defaults, t0, times, search)
    arguments: dict[str, Any] = {
        "dtau" if step.binding.clocked else "dt": step_size, **length,
        "every": whole_number("--every", every), "solver": method,
        **events_of(events, problem_defaults.events, step),
    }
    with catch_signals() as interrupts:  # up to the report, which is made in any case
        try:
            with capture_warnings() as captured:
                outcome = integrate_to(step, state, out, arguments, resume=resume)
            _pass_warnings_on(captured, outcome.trouble)
            result = result_of(problem_defaults, step, outcome, t0)
            if tuning is not None:
                result |= about_tuning(tuning)
            if paper_problem is not None and paper_problem.exact is not None:
                result |= axis_errors(paper_problem.exact, outcome.trajectory)
            pictures = {"plot": () if plot is None else (plot,), "show": show}
            error_of_picture = _draw(outcome.trajectory, pictures, result)
            warn_of_rest(outcome.trajectory, problem)
            click.echo(json_text(result) if as_json else as_text(result, step.manifest.system))
        except KeyboardInterrupt:  # the second signal
            click.echo(f"gyrospark: Interrupted. {stored_location(out)}".rstrip(), err=True)
            return 130  # 128 + 2, as shells have it for SIGINT
    return exit_code_of(outcome.trouble or error_of_picture, interrupts, "run")


def _pass_warnings_on(messages: Iterable[str], trouble: BaseException | None) -> None:
    """Warn of the messages of a run, each once; after a failed step add them to its error.

    ``trouble`` is the error that ended the run, or None.
    """
    if not isinstance(trouble, StepFailed):
        for message in dict.fromkeys(messages):
            warn(message)
        return
    # a failure is one line on stderr, to which the command line joins the notes of the error
    for note in ("Everything before it is reported and saved.", *dict.fromkeys(messages)):
        trouble.add_note(note)


def _draw(
    trajectory: Trajectory, pictures: Mapping[str, Sequence[Path]], result: dict[str, Any]
) -> GyrosparkError | None:
    """Draw by the methods "plot" and "show", and add the files to the report of the run.

    Return the first error: a picture that fails must not keep the numbers from being printed.
    """
    first_error: GyrosparkError | None = None
    for method, targets in pictures.items():
        for target in targets:
            try:
                getattr(trajectory, method)(target)
                result[method] = [*result.get(method, []), str(target)]
            except GyrosparkError as error:
                first_error = first_error or error
    return first_error


run.help = (run.help or "").replace("(PROBLEMS)", join_or(PROBLEMS)).replace(
    "(MODELS)", join_or(MODELS)).replace("(DEFAULT)", DEFAULT)
