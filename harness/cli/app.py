# SPDX-License-Identifier: BSD-2-Clause
"""Entry point of `harness`: list of commands, exit status, and printing of errors.

Exit status 0: success, 1: the run or check failed, 2: wrong command line. Errors are on stderr, and
each line begins with "harness:". A command imports its modules when it runs, for a quick start.
"""

from __future__ import annotations

import logging
import os
import shlex
import sys
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib import import_module
from typing import Annotated, Any

import typer

from harness import __version__
from harness.cli.options import app
from harness.errors import HarnessError, exhausted, missing
from harness.files import signals
from harness.files.output import commanded
from harness.spelling import printable

MODULES = {
    "runs": "run",
    "studies": "compare bound campaign sensitivity worst study",
    "look": "list docs show check requirements draw plan plot report convert validate",
    "models": "new build export linearize processor serve",
}
HOMES = {name: module for module, names in MODULES.items() for name in names.split()}
"""Module of harness.cli that contains a command, by name of the command, in the order in which
--help lists the commands.
"""

INTERRUPTED = 130
"""Status that newer versions of typer return after Ctrl-C; `harness` then exits with 1."""


class _Printable(logging.Formatter):
    """Formatter of log messages that escapes characters which control a terminal."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"harness {__version__}")
        raise typer.Exit


class _Commands(Mapping[str, Any]):
    """Mapping of all commands by name, which imports the module of a command on access."""

    def __getitem__(self, name: str) -> Any:
        return _commands_with(HOMES[name])[name]

    def __iter__(self) -> Iterator[str]:
        return iter(HOMES)

    def __len__(self) -> int:
        return len(HOMES)


@app.callback()
def options(
    show_version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version"),
    ] = False,
) -> None:
    """Run systems of FMUs with fixed macro steps, and evaluate the results."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    _open_streams()
    with signals.as_interrupts():
        return _flushed(_main(arguments))


def _open_streams() -> None:
    """Prepare stdout and stderr for any text: a closed stream discards it, and characters that the
    encoding of the stream lacks are escaped.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115, PTH123
        stream = getattr(sys, name)
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")


def _flushed(status: int) -> int:
    """Flush stdout and return the given exit status, or 1 if the output cannot be written."""
    try:
        sys.stdout.flush()
    except OSError as error:
        return _output_lost(error)
    return status


def _output_lost(error: OSError) -> int:
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if isinstance(error, BrokenPipeError):  # the program that reads our output has ended
        return 1
    return _complain(f"standard output cannot be written ({error.strerror})", 1)


def _main(arguments: Sequence[str] | None) -> int:
    notes = logging.StreamHandler()
    notes.setFormatter(_Printable("harness: note: %(message)s"))
    logging.basicConfig(handlers=[notes], level=logging.WARNING)
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with commanded(shlex.join(["harness", *given])):
            status = group()(given or ["--help"], "harness", standalone_mode=False)
    except HarnessError as error:
        return _complain(exhausted(error.__cause__) or str(error), error.exit_status)
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", 1)
    except (Exception, SystemExit) as error:
        return _unexpected(error)
    if status == INTERRUPTED:
        return _complain("interrupted", 1)
    return status if isinstance(status, int) else 0


@cache
def group() -> Any:
    """Return the typer group of all commands. The group is cached, because typer would build a new
    one for every call.
    """
    found: Any = typer.main.get_command(app)
    found.commands = _Commands()
    return found


@cache
def _commands_with(module: str) -> Any:
    """Import the module harness.cli.MODULE, which registers its commands, and return all commands
    that are registered so far.
    """
    import_module(f"harness.cli.{module}")
    found: Any = typer.main.get_command(app)
    return found.commands


def _unexpected(error: Exception | SystemExit) -> int:
    """Report an error that is not a HarnessError, and return the exit status.

    Such an error is a wrong command line (errors of typer, whose classes depend on its version), an
    error of the operating system, a mistake in a mission of the user, or a bug of the harness.
    """
    if line := exhausted(error):
        warnings.simplefilter("ignore")  # libraries would print the same error again at exit
        sys.unraisablehook = lambda _: None
        threading.excepthook = lambda _: None
        return _complain(line, 1)
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):
        return _complain(error.format_message(), error.exit_code)
    if isinstance(error, ValueError) and "null byte" in str(error):  # raised when opening a path
        return _complain("a file name contains a NUL character; remove it", 2)
    library = missing(error) if isinstance(error, ModuleNotFoundError) else ""
    if os.environ.get("HARNESS_TRACEBACK") and not library:
        raise error
    from harness.mission.library import failure

    if line := library or failure(error):
        return _complain(line, 1)
    if isinstance(error, SystemExit):
        raise error
    if isinstance(error, OSError) and error.errno and error.filename is None:
        return _output_lost(error)
    hint = "internal error (HARNESS_TRACEBACK=1 prints the traceback)"
    return _complain(f"{hint}: {type(error).__name__}: {error}", 1)


def _complain(message: str, status: int) -> int:
    for line in message.splitlines():
        with suppress(OSError):  # stderr is closed
            print(printable(f"harness: {line}"), file=sys.stderr)
    return status
