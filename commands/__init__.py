"""The command line: one command a file, each a thin face of the Python calls.

In: the words of the command line.
Out: text or JSON on stdout, files, an exit code.
Open first: ``generate``, the shortest command.

    generate, include, models, verify, run, sweep, export, reproduce, cache   the commands
    build, fit, lyapunov, reference   commands, too; models has ``examples`` in it
    options                   options that several of them share
    run/                      ``run``: command, starts, choices, outputs, report

Exit codes: 0 done, 1 a check failed or a step did not converge, 2 bad input or environment (one
sentence on stderr, no traceback), 130 interrupted.
"""

from __future__ import annotations

import contextlib
import io
import logging
import os
import sys
import warnings
from collections.abc import Iterator
from importlib import import_module
from typing import Any, NoReturn

import click

from .._version import __version__
from ..core.arguments import choose
from ..core.errors import CompilerError, GyrosparkError, InputWarning, StepFailed, Stopped
from ..core.former_names import FORMER_OPTIONS
from ..core.interrupts import Interrupts
from ..core.progress import terminal_messages

__all__ = ["exit_code_of", "main", "main_generate"]


#: Each command with its module, which is imported when the command is asked for.
_MODULES = {
    "generate": "generate", "include": "include", "models": "models", "examples": "models",
    "verify": "verify", "run": "run.command", "fit": "fit", "lyapunov": "lyapunov",
    "sweep": "sweep", "export": "export", "build": "build", "reproduce": "reproduce",
    "reference": "reference", "cache": "cache",
}


class Commands(click.Group):
    """The commands by name."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return sorted(_MODULES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command; refuse a name that none has, which completion may try."""
        if cmd_name not in _MODULES and ctx.resilient_parsing:
            return None
        choose("command", cmd_name, sorted(_MODULES))
        module = import_module(f".{_MODULES[cmd_name]}", __name__)
        command: click.Command = getattr(module, cmd_name)
        return command


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="gyrospark")
def gyrospark() -> None:
    """Compiled steppers for rigid-body motion on its constraint, generated from symbols.

    \b
    gyrospark run fast-top --scheme G-L --stages 3 --gamma m --dt 1e-3 --steps 320
    gyrospark run examples/satellite.toml --scheme G-L --stages 3
    gyrospark verify --scheme G-L --stages 3
    gyrospark generate --scheme G-L --stages 3 --rep gamma
    """


def main() -> NoReturn:
    """Entry point of ``gyrospark``."""
    _call(gyrospark, "gyrospark")


def main_generate() -> NoReturn:
    """Entry point of ``generate``, the same as ``gyrospark generate``."""
    from .generate import generate

    _call(generate, "generate")


def _call(command: click.Command, name: str) -> NoReturn:
    """Run a command; every expected error becomes one message and an exit code.

    A reader of a pipe that went away ends it without a message.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # γ and ᵀ on a terminal that knows ASCII only
            stream.reconfigure(errors="replace")
    try:
        with terminal_messages(), _printing_warnings(name):
            exit_code = command.main(prog_name=name, standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
        sys.exit(exit_code if isinstance(exit_code, int) else 0)
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message(), err=True)
        sys.exit(2)
    except click.ClickException as error:
        _fail(name, _one_line(_former_option(error) or error.format_message()), 2)
    except (click.Abort, KeyboardInterrupt):
        logging.getLogger("asyncio").disabled = True  # it would name the reads that Zarr had begun
        # Where text was being executed, as by lambdify, Python keeps that it was interrupted, and
        # ``python -m`` would end by the signal instead of with 130: other text takes that back.
        exec("")
        _fail(name, "Interrupted.", 130)
    except StepFailed as error:
        _fail(name, " ".join([f"{error.summary}.", *getattr(error, "__notes__", ())]), 1)
    except CompilerError as error:
        _fail(name, str(error), 2)  # with the compiler's own lines
    except GyrosparkError as error:
        _fail(name, _one_line(str(error)), 2)
    except MemoryError:
        _fail(name, "There is not enough memory for that many states; keep fewer of them with a "
                    "larger --every.", 2)
    except OSError as error:
        _forget_output()
        if isinstance(error, BrokenPipeError):  # the reader has gone: nobody to tell
            sys.exit(1)
        where = "standard output" if error.filename is None else repr(error.filename)
        _fail(name, f"Reading or writing {where} failed: {error.strerror or error}.", 2)


def exit_code_of(trouble: BaseException | None, interrupts: Interrupts, subject: str) -> int:
    """Return the exit code of a command whose report is printed, or raise the error of its work.

    ``Stopped`` is printed, not raised: click takes it for any KeyboardInterrupt. ``subject``,
    "run" or "sweep", is complete where a signal came during the report.
    """
    if trouble is None and interrupts.is_requested:
        trouble = Stopped(f"Stopped while the report was made: the {subject} is complete.",
                          interrupts.signal)
    if isinstance(trouble, Stopped):
        click.echo(f"gyrospark: {trouble}", err=True)
        return 128 + trouble.signal
    if trouble is not None:
        raise trouble
    return 0


def _former_option(error: click.ClickException) -> str | None:
    """Return a sentence with the present form of an option that a command had."""
    if not isinstance(error, click.NoSuchOption) or error.ctx is None:
        return None
    option = f"{error.ctx.command.name} {error.option_name}"
    cure = FORMER_OPTIONS.get(option)
    return f"gyrospark {option} is no option any more: {cure}." if cure else None


@contextlib.contextmanager
def _printing_warnings(name: str) -> Iterator[None]:
    """Print each warning about the input once, in one line on stderr."""
    printed: set[str] = set()

    def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
        """Print a warning about the input once, in one line; other ones as Python prints them."""
        if not issubclass(category, InputWarning):
            original(message, category, *where, **more)
        elif str(message) not in printed:
            printed.add(str(message))
            click.echo(f"{name}: warning: {_one_line(str(message))}", err=True)

    with warnings.catch_warnings():
        # ``catch_warnings`` restores the function at its end
        original, warnings.showwarning = warnings.showwarning, show
        warnings.simplefilter("always", InputWarning)
        yield


def _one_line(message: str) -> str:
    """Return a message with single spaces in place of line ends and indentation."""
    return " ".join(message.split())


def _forget_output() -> None:
    """Discard unwritten output, so that Python does not try to write it at exit."""
    with contextlib.suppress(OSError, AttributeError):  # stdout may be no file at all
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def _fail(name: str, message: str, code: int) -> NoReturn:
    """Print an error on stderr and leave the process with an exit code."""
    click.echo(f"{name}: {message}", err=True)
    sys.exit(code)
