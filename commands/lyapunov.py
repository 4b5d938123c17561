"""``gyrospark lyapunov``: Lyapunov exponents of a problem or a model."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.arguments import count_text, join_or
from ..core.registry import MODELS, PROBLEMS
from ..core.strict_json import json_text
from .options import (
    PATH,
    check_picture,
    completing,
    json_option,
    method_options,
    optional,
    whole_number,
)
from .run.choices import steps_for
from .run.starts import start_of, stepper_and_start

if TYPE_CHECKING:
    from ..runtime.analysis.lyapunov import Lyapunov

__all__ = ["lyapunov"]


@click.command(no_args_is_help=True, context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("problem", metavar="PROBLEM", shell_complete=completing([*PROBLEMS, *MODELS]))
@method_options
@click.option("--dt", metavar="DT", help="Time step in seconds (default: the model file's).")
@click.option("--steps", metavar="N", help="Number of steps (default: the model file's).")
@click.option("--t-end", metavar="T",
              help="Time of the last state in seconds, in place of --steps.")
@click.option("--every", metavar="R", default="10", show_default=True,
              help="Steps between two QR decompositions.")
@click.option("--count", metavar="K", help="How many exponents, the largest first (default: all).")
@click.option("--set", "settings", metavar="KEY=VALUE", multiple=True,
              help="As of gyrospark run: the time of the start, t=0.5; an argument of the "
                   "problem, or of a model file a parameter or a key.")
@click.option("--plot", type=PATH, metavar="FILE",
              help="Draw the running exponents and MEGNO (.png, .svg, .pdf).")
@json_option
def lyapunov(
    problem: str, dt: str | None, steps: str | None, t_end: str | None, every: str,
    count: str | None, settings: tuple[str, ...], plot: Path | None, as_json: bool, **choice: Any,
) -> int:
    """Compute the Lyapunov exponents of PROBLEM: one of the paper's, (PROBLEMS); one of gs.models,
    (MODELS); or a model file (.toml, .urdf, .xml, .sdf). Statistical errors, MEGNO (2 where a
    motion is regular, λ t/2 where it is chaotic) and the largest finite-time exponent are reported
    beside them.

    \b
    gyrospark lyapunov examples/double_pendulum.toml --dt 0.01 --t-end 60 --plot exponents.png
    gyrospark lyapunov examples/pendulum.toml --scheme G-L --stages 2 --dt 0.01 --steps 20000
    gyrospark lyapunov double_pendulum --t-end 20 --count 2
    gyrospark lyapunov fast-top --dt 1e-3 --steps 5000 --json
    """
    from ..runtime.analysis.lyapunov import lyapunov as exponents_of

    if plot is not None:
        check_picture(plot)
    # options are read before the stepper is made
    between = whole_number("--every", every)
    exponent_count = optional(whole_number, "--count", count)
    _, step, start, t0 = stepper_and_start(problem, settings, choice)
    state = start_of(step, start, t0)
    size, number = steps_for(start, t0, {"dt": dt, "steps": steps, "t_end": t_end})
    spectrum = exponents_of(step, state, dt=size, steps=number, every=between,
                            count=exponent_count)
    report = _result(spectrum)
    if plot is not None:
        spectrum.plot(plot)
        report["plot"] = str(plot)
    click.echo(json_text(report) if as_json else _text(report))
    return 0


lyapunov.help = (lyapunov.help or "").replace("(PROBLEMS)", join_or(PROBLEMS)).replace(
    "(MODELS)", join_or(MODELS))


def _result(spectrum: Lyapunov) -> dict[str, Any]:
    """Return the numbers of the report; None for those that --count or a short run leaves out."""
    def number(value: float) -> float | None:
        """Return a number for JSON, which has no NaN: None in its place."""
        return None if math.isnan(value) else float(value)

    return {
        "stepper": spectrum.name, "dt": float(spectrum.dt), "steps": spectrum.steps,
        "every": spectrum.every,
        "time": float(spectrum.times[-1]), "exponents": [float(x) for x in spectrum.exponents],
        "errors": [number(x) for x in spectrum.errors], "megno": spectrum.megno,
        "ftle": spectrum.ftle,
        "pairing": number(spectrum.pairing), "volume_rate": number(spectrum.volume_rate),
        "symplectic_defect": spectrum.symplectic_defect,
    }


def _text(report: dict[str, Any]) -> str:
    """Return the report for people: exponents with errors, MEGNO, symplectic defect, pairing."""
    lines = [f"{report['stepper']}: {count_text(report['steps'], 'step')} of {report['dt']:g} s, "
             f"QR every {report['every']}"]
    lines += [f"  λ{i:<3} {exponent:12.6f} ± {'?' if error is None else f'{error:.2g}'} /s"
              for i, (exponent, error) in enumerate(zip(report["exponents"], report["errors"],
                                                        strict=True), 1)]
    lines += [f"  MEGNO                     {report['megno']:.6g}",
              f"  finite-time exponent      {report['ftle']:.6g} /s",
              f"  symplectic defect         {report['symplectic_defect']:.1e}"]
    if report["pairing"] is not None:
        lines += [f"  pairs sum to              {report['pairing']:.1e} /s",
                  f"  rate of phase volume      {report['volume_rate']:.1e} /s"]
    if "plot" in report:
        lines.append(f"  picture                   {report['plot']}")
    return "\n".join(lines)
