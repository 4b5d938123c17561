"""``gyrospark verify``: prove or refute what a stepper and its tableau claim."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..core.arguments import count_text
from ..core.errors import InputError
from ..core.inertia import REPS, RepName
from ..core.progress import log_task
from ..core.real_types import REALS
from ..core.registry import SYSTEMS, entry_named
from ..generator.schemes.named_schemes import SCHEMES
from ..generator.spec import PAPER_SPECS, Spec, is_model_file
from ..generator.tableaux.compositions import COMPOSITIONS, Composition, composition_named
from ..generator.tableaux.compositions import composition as composition_of
from .options import (
    PATH,
    check_picture,
    frame_option,
    is_given,
    json_option,
    optional,
    real_number,
    spec_from,
    stepper_options,
    whole_number,
)

if TYPE_CHECKING:
    from ..certificates.certificate import Certificate
    from ..certificates.verification import Verification
    from ..generator.multibody.model import Model
    from ..runtime.rigid_body.problems import Problem

__all__ = ["verify"]

#: The scheme whose steps are compositions of exact flows.
SPLITTING = "splitting"


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("target", required=False, metavar="[NAME or FILE]")
@click.option("--model", metavar="PROBLEM or FILE",
              help="Check what a run of this model keeps: a problem such as fast-top, one of "
                   "gs.models, or a model file.")
@stepper_options
@frame_option
@click.option("--dt", metavar="DT", help="With --model: time step in seconds (default: its own).")
@click.option("--dtau", metavar="DTAU", help="In place of --dt, of a model with time_scale.")
@click.option("--steps", metavar="N",
              help="With --model: number of steps (default: its own, or 1000).")
@click.option("--plot", type=PATH, metavar="FILE",
              help="With --model: draw the error over the step and over the CPU time (.png, .svg, "
                   ".pdf).")
@json_option
def verify(
    target: str | None,
    model: str | None, frame: str | None, dt: str | None, dtau: str | None,
    steps: str | None, plot: Path | None,
    as_json: bool, **choice: Any,
) -> int:
    """Check every condition of a tableau exactly, its order, and the compiled coefficients.

    A tableau in decimals is checked to the digits that it has, and told so.

    NAME is a stepper such as heavy_top_gl3_gamma, FILE a tableau as JSON; without either and
    without --scheme, every stepper of the paper is checked. With --model, a run of a problem or
    of a model file is checked instead (3-G-L without --scheme): the loop invariant, reversal,
    constraints, energy, the momentum maps that SymPy finds, and the order. Exit code 1 if
    anything fails.

    With --scheme splitting, compositions of exact flows are checked: every order condition, with
    its residual in interval arithmetic.

    \b
    gyrospark verify --scheme G-L --stages 3
    gyrospark verify --scheme splitting --order 8
    gyrospark verify --scheme EMS --system examples/pendulum.toml
    gyrospark verify heavy_top_ems_gamma
    gyrospark verify examples/tableaux/gauss_lobatto_2.json --json
    gyrospark verify --model fast-top --scheme EMS --dt 1e-3 --steps 1000 --plot order.png
    """
    if model is not None:
        return _certify(model, target, dt, dtau, steps, plot, choice, frame=frame, as_json=as_json)
    for option, argument in (("--dt", dt), ("--dtau", dtau), ("--steps", steps), ("--plot", plot),
                             ("--frame", frame)):
        if argument is not None:
            raise InputError(f"{option} belongs to --model; name the model, or leave it out.")
    from ..certificates.verification import verify_composition, verify_stepper

    verdicts = []
    for composition in _compositions(target, choice):
        with log_task(f"verifying {composition.name}"):
            verdicts.append(verify_composition(composition))
    for spec in [] if verdicts else _specs(target, choice):
        with log_task(f"verifying {spec.tableau or spec.name}"):
            verdicts.append(verify_stepper(spec))
    holds = all(verdict.holds for verdict in verdicts)
    if as_json:
        click.echo(json.dumps({"holds": holds, "verified": [v.as_dict() for v in verdicts]},
                              indent=2))
    else:
        _print(verdicts, details=len(verdicts) == 1)
    return 0 if holds else 1


def _compositions(target: str | None, choice: dict[str, Any]) -> list[Composition]:
    """Return the compositions to verify; none where a stepper or a tableau is."""
    composed = {"scheme", "order", "composition"}
    names_composition = any(choice[key] is not None for key in composed) and (
        choice["scheme"] in (None, SPLITTING))
    # with a system, a representation or the like it is a stepper of that composition
    has_other_options = any(is_given(option) for key, option in choice.items()
                            if key not in composed)
    if target is not None or not names_composition or has_other_options:
        return []
    if choice["composition"] is None and choice["order"] is None:
        return list(COMPOSITIONS.values())
    spec = spec_from(**choice)  # which says what may not be given together
    if spec.composition:
        return [composition_named(spec.composition)]
    # an order has a composition of flows alone, and maybe another one with force gradients
    # h³ [V, [T, V]], for H = T + V
    compositions = [composition_of(spec.order or 0, gradients) for gradients in (False, True)]
    return list(dict.fromkeys(compositions))


def _specs(target: str | None, choice: dict[str, Any]) -> list[Spec]:
    """Return the specifications that the target or the options name; the paper's without either."""
    if target is None and not any(map(is_given, choice.values())):
        return list(PAPER_SPECS)
    if target is None:
        return [spec_from(**choice)]
    if is_model_file(target):
        raise InputError(f"{target!r} is a model file, no stepper and no tableau; give it as "
                         "--model (a certificate) or --system (the tableau's conditions), with "
                         "--scheme.")
    for key in ("scheme", "stages", "order", "composition", "tableau", "energy"):
        if is_given(choice[key]):
            raise InputError(f"{target!r} is given besides --{key}, which names another stepper; "
                             "give one.")
    # a file is a tableau, anything else the name of a stepper
    if target.endswith(".json") or Path(target).is_file():
        return [Spec.from_arguments(rep=choice["rep"], system=choice["system"],
                                    real=choice["real"], tableau=Path(target))]
    for key in ("rep", "system", "real"):
        if is_given(choice[key]):
            raise InputError(f"--{key} {choice[key]!r} is given besides {target!r}, which says it "
                             "too; give one.")
    return [spec_of_name(target)]


def spec_of_name(name: str) -> Spec:
    """Return the spec of a stepper's name, such as heavy_top_gl3_gamma."""
    methods = {scheme.key: scheme.name for scheme in SCHEMES.values()}
    reals = {real.replace("-", "_"): real for real in REALS}
    # SYSTEM_METHODstages_REP[_REAL], as heavy_top_gl3_gamma_float128
    pattern = (
        rf"({'|'.join(SYSTEMS)})_({'|'.join(methods)})(\d*)_({'|'.join(REPS)})"
        rf"(?:_({'|'.join(reals)}))?"
    )
    match = re.fullmatch(pattern, name)
    if match is None:
        raise InputError(f"Unknown stepper {name!r}; names look like heavy_top_gl3_gamma or "
                         "heavy_top_ims_alpha. For a file, give its path ending in .json.")
    system, method, stages, rep, real = match.groups()
    number = int(stages) if stages else None
    composed = SCHEMES[methods[method]].composed
    return Spec.from_arguments(methods[method], None if composed else number, rep, system,
                               reals[real] if real else None, order=number if composed else None)


# ---------------------------------------------------------------- a model


def _certify(
    name: str, target: str | None, dt: str | None, dtau: str | None, steps: str | None,
    plot: Path | None, choice: dict[str, Any], *, frame: str | None, as_json: bool,
) -> int:
    """Print the certificate of a model; 0 if no guarantee is missed."""
    _refuse_beside_model(target, choice)
    if plot is not None:
        check_picture(plot)
    count = optional(whole_number, "--stages", choice["stages"])
    # the spec of splitting has an order or a composition also where none is chosen
    spec = spec_from(**choice)
    from ..certificates.certificate import certify
    from ..runtime.rigid_body.problems import Problem
    step_size = optional(real_number, "--dt", dt)
    with log_task(f"checking what {name} keeps"):
        model = _model(name, choice["rep"])
        # a model has its representation already; a problem has numbers alone
        rep = choice["rep"] if isinstance(model, Problem) else None
        if plot is not None and dtau is not None:
            raise InputError("--plot draws errors over dt, which steps of --dtau do not have; "
                             "leave --plot out.")
        certificate = certify(
            model, choice["scheme"], count, tableau=choice["tableau"], rep=rep,
            allow_invalid=True,  # as without a model: what fails is said, not refused
            frame=frame, energy=choice["energy"],
            dt=step_size, dtau=optional(real_number, "--dtau", dtau),
            steps=optional(whole_number, "--steps", steps),
            order=None if spec.composition else spec.order, composition=spec.composition or None,
        )
    picture_report = {}
    if plot is not None:
        with log_task(f"measuring how exact {certificate.stepper} is"):
            picture_report = _draw(model, certificate, {**choice, "frame": frame}, spec, rep, plot)
    if as_json:
        click.echo(json.dumps(certificate.as_dict() | picture_report, indent=2, allow_nan=False))
    else:
        _print_certificate(certificate)
        if picture_report:
            click.echo(f"wrote {picture_report['plot']}")
    return 0 if certificate.holds else 1


def _refuse_beside_model(target: str | None, choice: dict[str, Any]) -> None:
    """Refuse a stepper's name, --system and --real beside --model: the model determines them."""
    if target is not None:
        raise InputError(f"{target!r} is given besides --model; name a scheme with --scheme and "
                         "--stages or --tableau.")
    for option in ("system", "real"):
        if choice[option] is not None:
            raise InputError(f"--{option} does not go with --model: the model brings its system, "
                             "and is checked in double.")


def _draw(
    model: Model | Problem, certificate: Certificate, choice: dict[str, Any], spec: Spec,
    rep: RepName | None, plot: Path,
) -> dict[str, Any]:
    """Draw the error over the step and over the CPU time of a run to ``plot``.

    Return its path and the numbers, for JSON. The step and the number of steps are the
    certificate's.
    """
    from ..certificates.accuracy_over_time import accuracy, draw
    from ..certificates.certificate import compile_model

    problem, step = compile_model(model, rep, {
        "scheme": choice["scheme"], "stages": spec.stages, "tableau": choice["tableau"],
        # a tableau that fails its conditions is drawn too: the certificate says so
        "allow_invalid": True, "energy": choice["energy"], "frame": choice["frame"],
        "order": None if spec.composition else spec.order,
        "composition": spec.composition or None})
    study = accuracy(step, problem.q0, problem.p0, dt=certificate.dt, steps=certificate.steps,
                     parameters=certificate.parameters)
    draw(certificate.model, study, plot)
    return {"plot": str(plot), "accuracy": asdict(study)}


def _model(name: str, rep: str | None) -> Model | Problem:
    """Return the problem or model of a name, or the model of a file; ``rep`` is gamma, alpha or
    None."""
    if not Path(name).suffix and not Path(name).is_file():
        entry = entry_named(name, "model")
        options = {"rep": rep} if rep is not None and entry.kind == "model" else {}
        problem: Model | Problem = entry.make(**options)
        return problem
    from ..generator.models.model_file import parse_model
    from ..generator.parsing.text_file import model_text

    return parse_model(model_text(name), name, rep)


def _print_certificate(certificate: Certificate) -> None:
    """Print a certificate as a table: quantity, measured, expected, verdict."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title=f"{certificate.model} with {certificate.stepper}: "
                        f"{count_text(certificate.steps, 'step')} of {certificate.step_text}",
                  title_justify="left")
    for heading in ("quantity", "found", "should be", ""):
        table.add_column(heading, overflow="fold")
    for line in certificate.lines:
        table.add_row(line.quantity, line.found, line.expected, line.verdict)
    console = Console()
    console.print(table)
    for line in certificate.lines:
        # the reasons behind the table, in full width
        if line.why and not line.holds:
            console.print(f"{line.quantity}: {line.why}", highlight=False, markup=False)
    failed = [line.quantity for line in certificate.lines if line.holds is False]
    count = sum(line.holds is not None for line in certificate.lines)
    result = "holds" if not failed else f"FAILS: {', '.join(failed)}"
    click.echo(f"{certificate.model}: {count_text(count, 'guarantee')} of {certificate.stepper}: "
               f"{result}")


def _print(verdicts: list[Verification], *, details: bool) -> None:
    """Print a line for each stepper, with ``details`` a table of its conditions before it."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    for verdict in verdicts:
        if details:
            table = Table(title=verdict.title, title_justify="left")
            for heading in ("condition", "equation", "found", "residual", ""):
                table.add_column(heading, overflow="fold")
            for line in verdict.conditions:
                mark = "holds" if line.holds else "FAILS"
                table.add_row(line.name, line.equation, line.found, line.residual, mark)
            console.print(table)
        failed = [line.name for line in verdict.conditions if not line.holds]
        result = "holds" if not failed else f"FAILS: {', '.join(failed)}"
        click.echo(f"{verdict.name}: order {verdict.order}, "
                   f"{count_text(len(verdict.conditions), 'condition')}: "
                   f"{result}")
