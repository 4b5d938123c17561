"""``build``: a stepper as an artefact of another program, one subcommand for each target."""

from __future__ import annotations

from typing import Any

import click

from ..core.arguments import join_or
from ..core.errors import InputError
from ..core.interrupts import catch_termination
from ..core.lazy_imports import imported_for_good
from ..core.real_types import REALS
from ..core.registry import MEANS, MODELS, PROBLEMS, entry_named
from ..core.start import Rule
from ..generator.schemes.named_schemes import SCHEMES
from ..generator.spec import is_model_file
from ..generator.tableaux.compositions import COMPOSITIONS
from ..runtime.rigid_body.gamma_rules import is_inertia_parameter
from ..targets import TARGETS, Target
from ..targets.build import Changed, target_named
from ..targets.build import build as build_artefact
from ..targets.native import DifferentBitsError
from ..targets.tools import TOOLS
from .options import DEFAULT, PATH, check_no_file, completing, optional, real_number, whole_number
from .run.starts import arguments_of, refuse_repeated_keys, settings_of

__all__ = ["build"]

_HELP = {"help_option_names": ["-h", "--help"]}


class Targets(click.Group):
    """A subcommand for each target, made when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the targets."""
        return list(TARGETS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        """Return the command of a target, with the options of that target alone."""
        return _command(target_named(cmd_name))


def _list(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Print the targets for --list, and end the command."""
    if value:
        click.echo("\n".join(map(_line, TARGETS.values())))
        context.exit()


def _line(target: Target) -> str:
    """Return a target, its description, and missing tools with their cure."""
    missing_tools = [f"to {action} it: {TOOLS[name].cure}"
                     for action, names in (("build", target.needs), ("check", target.checks))
                     for name in names if TOOLS[name].find() is None]
    return f"{target.name:<9}{target.about}" + "".join(f"\n{'':9}{line}" for line in missing_tools)


@click.group(cls=Targets, no_args_is_help=True, context_settings=_HELP,
             subcommand_metavar="TARGET MODEL [OPTIONS]")
@click.option("--list", is_flag=True, is_eager=True, expose_value=False, callback=_list,
              help="What the targets are, what is missing for each, and the cure.")
def build() -> None:
    """Write a stepper as an artefact that another program takes: TARGET is what is written.

    \b
    gyrospark build cpp fast-top --dt 1e-3
    gyrospark build cpp examples/control_c/satellite.toml --scheme G-L --stages 2
    gyrospark build --list
    """


def _command(target: Target) -> click.Command:
    """Return the command of one target, with the options of the target."""
    of_several = ", or several with commas" if target.several else ""
    parameters: list[click.Parameter] = [
        click.Argument(["model"], metavar="MODEL",
                       shell_complete=completing([*PROBLEMS, *MODELS])),
        _option("--scheme", "NAME", f"{join_or(SCHEMES)}{of_several} (default: {DEFAULT}).",
                SCHEMES),
        _option("--stages", "S", "Stages of a scheme that has a choice of them."),
        _option("--order", "N", "Order of splitting: 2, 4, 6, 8 or 10."),
        _option("--composition", "NAME", "Composition of splitting by name, instead of --order.",
                COMPOSITIONS),
        _option("--rep", "NAME", "Inertia: gamma (default) or alpha."),
        _option("--real", "TYPE", f"float or double (default: {target.real}).", REALS),
        _option("--dt", "DT", "Time step in seconds (default: the model file's)."),
        click.Option(["--set", "settings"], metavar="KEY=VALUE", multiple=True,
                     help="Argument of a problem or model, or a key of a model file, as in run."),
        click.Option(["--parameter", "values"], metavar="NAME=VALUE", multiple=True,
                     help="Value of a parameter at the start, gamma=m among them."),
        click.Option(["--out"], type=PATH, metavar="PATH",
                     help=f"The {'file' if target.suffix else 'folder'} (default: the stepper's "
                          f"name{target.suffix and ' with ' + target.suffix})."),
    ]
    if target.platforms:
        parameters.append(_option("--for", "NAMES", f"Platforms, with commas: "
                                  f"{join_or(target.platforms)}.", target.platforms))
    parameters.append(click.Option(["--check"], is_flag=True,
                                   help="Load it again, and compare its bits with those of C."))

    def write(**options: Any) -> int:
        """Write the artefact that the options describe; return the exit code."""
        return _write(target, **options)
    return click.Command(target.name, params=parameters, callback=write, no_args_is_help=True,
                         context_settings=_HELP, short_help=target.about,
                         help=f"Write a stepper of MODEL as {target.about}.\n\nMODEL is one of "
                              f"{join_or(PROBLEMS)}, {join_or(MODELS)}, or a model file (.toml, "
                              ".urdf, .xml, .sdf).")


def _option(name: str, metavar: str, about: str, names: Any = ()) -> click.Option:
    """Return an option that takes one text, which the shell completes to one of ``names``."""
    return click.Option([name], metavar=metavar, help=about,
                        shell_complete=completing(names) if names else None)


def _write(
    target: Target, model: str, settings: tuple[str, ...], values: tuple[str, ...],
    stages: str | None, order: str | None, dt: str | None, check: bool, **scheme_options: Any,
) -> int:
    """Write the artefact and print its files; return the exit code, 1 if its bits differ from C."""
    if scheme_options["out"] is not None and not target.suffix:
        check_no_file("--out", scheme_options["out"])
    pairs = [_name_and_value(text) for text in values]
    names = [name for name, _ in pairs]
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"--parameter {name}=… is given {names.count(name)} times; give it "
                             "once.")
    # a cluster's or a supervisor's SIGTERM must leave no half-written artefact behind
    with imported_for_good("sympy"), catch_termination():
        artefact = build_artefact(
            target.name, _model(model, settings),
            stages=optional(whole_number, "--stages", stages),
            order=optional(whole_number, "--order", order),
            dt=optional(real_number, "--dt", dt),
            parameters=dict(pairs),
            # a word of Python, which no parameter of a function can have as its name
            platforms=scheme_options.pop("for", None),
            **scheme_options)
    click.echo(f"{artefact.path}: {target.about}, of {artefact.stepper.name}")
    for name in artefact.files:
        click.echo(f"  {name}")
    try:
        if check:
            click.echo(f"  {artefact.check()}")
    except DifferentBitsError as error:
        click.echo(f"gyrospark: {error}", err=True)
        return 1
    return 0


def _model(name: str, settings: tuple[str, ...]) -> Any:
    """Return the name of a model as it is; with settings, the problem or model that they make."""
    refuse_repeated_keys(settings)
    if is_model_file(name):
        return Changed(name, settings_of(settings)) if settings else name
    entry = entry_named(name)
    if not settings:
        return entry.name
    arguments = arguments_of(entry, settings)
    return entry.make(**arguments) if entry.kind == "problem" else Changed(entry.name, arguments)


def _name_and_value(text: str) -> tuple[str, Any]:
    """Return name and value of ``--parameter``; γ and α may have a rule's name."""
    name, sign, number_text = text.partition("=")
    if not sign:
        raise InputError(f"--parameter {text!r} has no value; write NAME=VALUE, such as gamma=m.")
    name, number_text = name.strip(), number_text.strip()
    if is_inertia_parameter(name) and number_text in MEANS:
        return name, Rule(number_text)
    return name, real_number(f"--parameter {name}", number_text)
