"""The command line: one command a file, each a thin face of the Python calls.

Exit codes: 0 done, 1 a check failed or a step did not converge, 2 bad input or environment (one
sentence on stderr, no traceback), 130 interrupted.
"""

from __future__ import annotations

import sys
from typing import NoReturn

import click

from .._version import __version__
from ..errors import GyrosparkError, StepFailed
from .cache import cache
from .generate import generate
from .run import run
from .verify import verify

__all__ = ["main", "main_generate"]


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="gyrospark")
def gyrospark() -> None:
    """Compiled steppers for rigid-body motion on its constraint, generated from symbols.

    \b
    gyrospark run fast-top --scheme G-L --stages 3 --gamma m --dt 1e-3 --steps 320
    gyrospark verify --scheme G-L --stages 3
    gyrospark generate --scheme G-L --stages 3 --rep gamma
    """


for command in (generate, verify, run, cache):
    gyrospark.add_command(command)


def main() -> NoReturn:
    """Entry point of ``gyrospark``."""
    _call(gyrospark, "gyrospark")


def main_generate() -> NoReturn:
    """Entry point of ``generate``, the same as ``gyrospark generate``."""
    _call(generate, "generate")


def _call(command: click.Command, name: str) -> NoReturn:
    """Run a command; every expected error becomes one message and an exit code."""
    try:
        result = command.main(prog_name=name, standalone_mode=False)
        sys.exit(result if isinstance(result, int) else 0)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        sys.exit(2)
    except click.ClickException as error:
        _fail(name, " ".join(error.format_message().split()), 2)
    except (click.Abort, KeyboardInterrupt):
        _fail(name, "Interrupted.", 130)
    except StepFailed as error:
        _fail(name, str(error), 1)
    except GyrosparkError as error:
        _fail(name, str(error), 2)
    except BrokenPipeError:
        sys.stderr.close()  # the reader has gone; so does what is left to say
        sys.exit(1)


def _fail(name: str, message: str, code: int) -> NoReturn:
    click.echo(f"{name}: {message}", err=True)
    sys.exit(code)
