"""``gyrospark run``: integrate a problem and report what happened to its invariants."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, ClassVar

import click

from ...core.arguments import choose, listed
from ...core.errors import GyrosparkError, StepFailed, Stopped
from ...core.interrupts import catch_signals
from ...core.real_types import REALS
from ...core.registry import MODELS, PROBLEMS, RULES
from ...core.solver import Solver
from ...core.warnings import capture_warnings, warn
from ...runtime.bindings.binding import SOLVERS
from ...runtime.plotting.scene import check_bodies
from ..options import (
    DEFAULT,
    Grouped,
    completing,
    euler_options,
    json_option,
    real_number,
    start_time,
    stepper_options,
    whole_number,
    with_default_scheme,
)
from .choices import steps_of, tuned, with_options
from .outputs import Angles, check_targets, events_of, integrate_to, stored_location
from .report import (
    about_tuning,
    as_text,
    axis_errors,
    json_text,
    result_of,
    warn_of_rest,
)
from .starts import start_of, started

__all__ = ["progress_bar", "run"]

#: Below this many steps a run is over before a bar would be seen.
_BAR_FROM = 20_000


class RunCommand(Grouped):
    """``gyrospark run``."""

    groups: ClassVar = {
        "What runs": ("settings", "system", "scheme", "stages", "order", "composition",
                      "rep", "tableau", "real", "energy"),
        "Steps": ("dt", "error", "steps", "t_end", "t0"),
        "Inertia and frame": ("gamma", "alpha", "frames"),
        "What is looked for": ("watched_for", "reference"),
        "What is written": ("out", "every", "euler", "degrees", "resume", "seed", "plot", "page",
                            "film", "as_json"),
        "How a step is solved": ("solver", "tolerance", "max_iterations"),
    }


@click.command(cls=RunCommand, no_args_is_help=True,
               context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("problem", metavar="PROBLEM", shell_complete=completing([*PROBLEMS, *MODELS]))
@stepper_options
@click.option("--gamma", metavar=f"{{{','.join(RULES)},NUMBER}}",
              shell_complete=completing(RULES),
              help="γ: γ_m, γ_h, γ̃_m, γ̃_h of the body, or a number in kg m² (default m); auto: "
                   "smallest error of the motion in short pilot runs, γ_m if any axis would get "
                   "worse; auto-energy: smallest energy error.")
@click.option("--alpha", metavar=f"{{{','.join(RULES)},NUMBER}}", shell_complete=completing(RULES),
              help="The same for --rep alpha.")
@click.option("--frame", "frames", metavar="{auto,start,NAME=RATE,...}", multiple=True,
              help="Integrate in a co-moving frame along the system's symmetries: auto searches "
                   "for its rates in short pilot runs (with --gamma auto for both at once), start "
                   "takes the least squares of the start; or rates in rad/s, omega_body=75.4.")
@click.option("--dt", metavar="{DT,auto}",
              help="Time step in seconds (default: the model file's); auto: for --error and "
                   "--t-end, by pilot runs of ever halved steps.")
@click.option("--error", metavar="E",
              help="Of --dt auto: the largest error of the motion on the way to --t-end, attitudes "
                   "in rad, points in parts of their reach.")
@click.option("--t0", metavar="T", default="0", show_default=True,
              help="Time at the start in seconds, for forces that depend on it.")
@click.option("--steps", metavar="N", help="Number of steps (default: the model file's).")
@click.option("--t-end", metavar="T",
              help="Time of the last state in seconds, in place of --steps.")
@click.option("--every", metavar="K", default="1", show_default=True,
              help="Keep every K-th state, and the last.")
@click.option("--solver", default="auto", show_default=True, shell_complete=completing(SOLVERS),
              help="auto (fixed point, Newton as fallback), fixed-point, newton, python.")
@click.option("--tolerance", metavar="TOL", help="Of the Newton increment (default: round-off).")
@click.option("--max-iterations", metavar="N", default="50", show_default=True,
              help="Iterations of one step.")
@click.option("--set", "settings", metavar="KEY=VALUE", multiple=True,
              help="Argument of the problem, e.g. radius_ratio=1.5 or inertia=2,1.3,0.8; of a "
                   "model file a parameter, k=3, or a key, start.euler='[0, \"30 deg\", 0]'; of "
                   "a robot where it starts, elbow='30 deg', elbow.rate=1, base=floating, and what "
                   "of its file to do without, ignore=limits,collision or ignore=all.")
@click.option("--event", "watched_for", metavar="TEXT", multiple=True,
              help='Where a quantity, coordinate or momentum crosses a level: "height=0", '
                   '"height=0 down", "x=1.5 up stop" (the run ends there); with a name '
                   '"landing: height=0". Beside [events] of a model file.')
@click.option("--reference", is_flag=True,
              help="Integrate a reference for the axis errors if there is no closed form.")
@click.option("--out", type=click.Path(path_type=Path), metavar="FILE",
              help="Write the states: .zarr (streamed, for runs of any length), .npz, .csv, .nc.")
@euler_options
@click.option("--resume", is_flag=True,
              help="Go on with the run in --out NAME.zarr (.csv, .nc), to the same bits; also to "
                   "more --steps. Begin it if there is none.")
@click.option("--seed", metavar="N",
              help="Kept with a stored run: of the random numbers that made its start.")
@click.option("--plot", type=click.Path(path_type=Path), metavar="FILE",
              help="Draw axis trace, energy and constraint errors (.png, .svg, .pdf).")
@click.option("--picture", type=click.Path(path_type=Path), metavar="FILE",
              help="Draw the bodies in space at the time of their largest extent (.png).")
@click.option("--view", "page", type=click.Path(path_type=Path), metavar="FILE",
              help="Write a page that moves, of bodies, joints and energy (.html), or a 3-D model "
                   "that moves, for Blender and other viewers (.glb).")
@click.option("--animate", "film", type=click.Path(path_type=Path), metavar="FILE",
              help="Write a film of bodies and energy, six seconds long (.gif; .mp4 with ffmpeg).")
@json_option
def run(
    problem: str, gamma: str | None, alpha: str | None, frames: tuple[str, ...],
    dt: str | None, error: str | None, t0: str, steps: str | None, t_end: str | None,
    every: str, solver: str, tolerance: str | None, max_iterations: str,
    settings: tuple[str, ...], watched_for: tuple[str, ...], reference: bool, out: Path | None,
    euler: str | None, degrees: bool,
    resume: bool, seed: str | None, plot: Path | None, picture: Path | None, page: Path | None,
    film: Path | None, as_json: bool,
    **choice: Any,
) -> int:
    """Integrate PROBLEM: one of the paper's, (PROBLEMS); one of gs.models, (MODELS); a model file
    (.toml); or a robot (.urdf, .xml, .sdf). Without a scheme by (DEFAULT).

    \b
    gyrospark run double_pendulum --view pendulum.html
    gyrospark run double_top --picture tops.png
    gyrospark run fast-top --scheme G-L --stages 3 --gamma m --dt 1e-3 --steps 320
    gyrospark run fast-top --scheme G-L --stages 2 --gamma auto --dt 1e-3 --t-end 10
    gyrospark run fast-top --scheme G-L --stages 4 --dt auto --error 1e-9 --t-end 2
    gyrospark run fast-top --scheme G-L --stages 3 --frame auto --dt 1e-2 --steps 1000
    gyrospark run fast-top --scheme EMS --rep alpha --dt 1e-3 --steps 100000 --plot top.png
    gyrospark run regular-precession --scheme G-L --stages 2 --gamma ht --dt 0.005 --steps 80 \\
        --set radius_ratio=0.5 --json
    gyrospark run fast-top --scheme G-L --stages 4 --dt 1e-3 --steps 1000000000 --every 1000 \\
        --out night.zarr --resume
    gyrospark run examples/satellite.toml --scheme G-L --stages 3
    gyrospark run double_pendulum --dt 1e-3 --steps 5000 --event "px1=0 up"
    gyrospark run examples/crane.urdf --set ignore=all --set "luffing=45 deg"
    gyrospark run examples/pendulum.toml --scheme EMS --dt 1e-3 --steps 1000 --json
    gyrospark run free-body --scheme LIIIA-B --stages 4 --dt 1e-3 --steps 1000 \\
        --set inertia=0.002,0.0013,0.0008 --set angular_velocity=30,-40,100
    gyrospark run free-body --dt 0.01 --t-end 20 --set inertia=1,2,3 \\
        --set angular_velocity=0.01,5,0.01 --animate flip.gif
    """
    check_targets(out, plot, picture, page, film, resume=resume)
    angles = Angles.checked(euler, out, degrees=degrees)
    choice, note = with_default_scheme(choice)
    choice["frame"] = "symmetries" if frames else None
    chosen, step, start = started(problem, settings, choice, reference=reference)
    if page is not None or picture is not None:
        check_bodies(step.manifest)
    angles.check_bodies(step.manifest)
    if not as_json:  # before a step is taken
        for line in (*note, *map(": ".join, step.manifest.warnings)):
            click.echo(line)
    defaults, search = with_options(step, start, gamma, alpha, frames)
    # The problem's start is on the constraints to double only, a file's to its own digits.
    begin = start_time(t0)
    state, moved = start_of(step, defaults, begin,
                            project=chosen is None or REALS[step.manifest.real].wide)
    method = Solver(choose("solver", solver, SOLVERS),
                    None if tolerance is None else real_number("--tolerance", tolerance),
                    whole_number("--max-iterations", max_iterations))
    state, size, span, found = tuned(
        step, state, defaults, begin,
        {"dt": dt, "error": error, "steps": steps, "t_end": t_end}, search)
    arguments: dict[str, Any] = {
        "dt": size, **span, "every": whole_number("--every", every),
        "solver": method, **events_of(watched_for, start.events, step),
    }
    drawn = None if seed is None else whole_number("--seed", seed)
    with catch_signals() as interrupts:  # up to the report, which is made in any case
        try:
            count = steps_of(span, begin, size)
            with progress_bar(count, quiet=as_json) as progress, capture_warnings() as captured:
                done = integrate_to(step, state, out, arguments,
                                    resume=resume, seed=drawn, progress=progress, angles=angles)
            trouble = done.trouble
            if isinstance(trouble, StepFailed):
                trouble.add_note("Everything before it is reported and saved.")
            for message in dict.fromkeys(captured):
                if isinstance(trouble, StepFailed):
                    trouble.add_note(message)  # a failure is one line on stderr
                else:
                    warn(message)
            result = result_of(start, step, done, begin)
            if moved:
                result["start_moved"] = moved
            if found is not None:
                result |= about_tuning(found)
            if chosen is not None and (reference or chosen.exact is not None):
                with suppress(Stopped):  # a reference is a run as well
                    result |= axis_errors(chosen, step, done.trajectory)
            for key, target in (("plot", plot), ("picture", picture), ("view", page),
                                ("animate", film)):
                if target is None:
                    continue
                try:
                    (done.trajectory.plot if key == "plot" else done.trajectory.show)(target)
                    result[key] = str(target)
                except GyrosparkError as error:  # the numbers are still printed
                    trouble = trouble or error
            warn_of_rest(done.trajectory, problem)
            click.echo(json_text(result) if as_json else as_text(result, step.manifest.system))
        except KeyboardInterrupt:  # the second signal
            click.echo(f"gyrospark: Interrupted. {stored_location(out)}".rstrip(), err=True)
            return 130
    if trouble is None and interrupts.requested:
        trouble = Stopped("Stopped while the report was made: the run is complete.",
                          interrupts.signal)
    if isinstance(trouble, Stopped):  # to click a KeyboardInterrupt is one like another
        click.echo(f"gyrospark: {trouble}", err=True)
        return 128 + trouble.signal
    if trouble is not None:
        raise trouble
    return 0


run.help = (run.help or "").replace("(PROBLEMS)", listed(PROBLEMS)).replace(
    "(MODELS)", listed(MODELS)).replace("(DEFAULT)", DEFAULT)


@contextmanager
def progress_bar(
    steps: int, *, quiet: bool, least: int = _BAR_FROM
) -> Iterator[Callable[[int], None] | None]:
    """Yield a callback that moves a progress bar; None without a terminal, or for few steps."""
    if quiet or steps < least or sys.stderr is None or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.completed:,} of {task.total:,} steps"), BarColumn(),
               TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("steps", total=steps)
        yield lambda done: bar.update(task, completed=done)


