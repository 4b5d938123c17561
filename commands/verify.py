"""``gyrospark verify``: prove or refute what a stepper and its tableau claim."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError
from ..generator.spec import PAPER_SPECS, REALS, REPS, SCHEMES, SYSTEMS, Spec
from .options import spec_from, stepper_options

if TYPE_CHECKING:
    from ..verification import Verdict

__all__ = ["verify"]


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("target", required=False, metavar="[NAME or FILE]")
@stepper_options
@click.option("--json", "as_json", is_flag=True, help="Print one JSON document and nothing else.")
def verify(target: str | None, as_json: bool, **choice: Any) -> int:
    """Check every condition of a tableau exactly, its order, and the compiled coefficients.

    NAME is a stepper such as heavy_top_gl3_gamma, FILE a tableau as JSON; without either and
    without --scheme, every stepper of the paper is checked. Exit code 1 if anything fails.

    \b
    gyrospark verify --scheme G-L --stages 3
    gyrospark verify heavy_top_ems_gamma
    gyrospark verify examples/tableaux/gauss_lobatto_2.json --json
    """
    specs = _specs(target, choice)
    from ..verification import verify_stepper

    verdicts = [verify_stepper(spec) for spec in specs]
    holds = all(verdict.holds for verdict in verdicts)
    if as_json:
        click.echo(json.dumps({"holds": holds, "verified": [v.as_dict() for v in verdicts]},
                              indent=2))
    else:
        _print(verdicts, details=len(verdicts) == 1)
    return 0 if holds else 1


def _specs(target: str | None, choice: dict[str, Any]) -> list[Spec]:
    if target is None:
        return [spec_from(**choice)] if any(choice.values()) else list(PAPER_SPECS)
    if any(choice[key] for key in ("scheme", "stages", "tableau")):
        raise InputError(f"{target!r} is given besides --scheme, --stages or --tableau; give one.")
    if target.endswith(".json") or Path(target).is_file():
        return [Spec.checked(None, None, choice["rep"], choice["system"], choice["real"],
                             Path(target))]
    return [spec_of_name(target)]


def spec_of_name(name: str) -> Spec:
    """Return the spec whose name this is."""
    methods = {scheme.lower().replace("-", ""): scheme for scheme in SCHEMES}
    reals = {real.replace("-", "_"): real for real in REALS}
    pattern = (
        rf"({'|'.join(SYSTEMS)})_({'|'.join(methods)})(\d*)_({'|'.join(REPS)})"
        rf"(?:_({'|'.join(reals)}))?"
    )
    match = re.fullmatch(pattern, name)
    if match is None:
        raise InputError(
            f"Unknown stepper {name!r}; names look like heavy_top_gl3_gamma or "
            "heavy_top_ims_alpha. For a file, give its path ending in .json."
        )
    system, method, stages, rep, real = match.groups()
    return Spec.checked(methods[method], int(stages) if stages else None, rep, system,
                        reals[real] if real else None)


def _print(verdicts: list[Verdict], *, details: bool) -> None:
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
        click.echo(f"{verdict.name}: order {verdict.order}, {len(verdict.conditions)} conditions: "
                   f"{result}")
