# SPDX-License-Identifier: BSD-2-Clause
"""`harness` itself: its groups of commands, its exit status, and how an error reaches the user.

Exit status 0: fine, 1: the run or check failed, 2: wrong use. Errors are one line each on stderr.
What a command needs is imported when it runs, so that the command line itself starts at once.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from harness.cli import look, models, runs
from harness.errors import HarnessError
from harness.spelling import printable

app = typer.Typer(pretty_exceptions_enable=False, rich_markup_mode=None, no_args_is_help=True)
for group in (runs, look, models):
    app.registered_commands += group.app.registered_commands

INTERRUPTED = 130
"""What newer versions of typer return after Ctrl-C."""


class _Printable(logging.Formatter):
    """Notes that cannot control a terminal, whoever they come from."""

    def format(self, record: logging.LogRecord) -> str:
        return printable(super().format(record))


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"harness {version('servicing-fmus')}")
        raise typer.Exit


@app.callback()
def options(
    show_version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="its number")
    ] = False,
) -> None:
    """Run systems of FMUs with fixed macro steps, and look at what comes of it."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    notes = logging.StreamHandler()
    notes.setFormatter(_Printable("harness: note: %(message)s"))
    logging.basicConfig(handlers=[notes], level=logging.WARNING)
    try:
        status = app(
            list(sys.argv[1:] if arguments is None else arguments) or ["--help"],
            "harness",
            standalone_mode=False,
        )
    except HarnessError as error:
        return _complain(str(error), error.exit_status)
    except (KeyboardInterrupt, typer.Abort):
        return _complain("interrupted", 1)
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except Exception as error:
        return _unexpected(error)
    if status == INTERRUPTED:
        return _complain("interrupted", 1)
    return status if isinstance(status, int) else 0


def _unexpected(error: Exception) -> int:
    """A wrong command line (typer's own errors, whose classes depend on its version), or a mistake
    of ours.
    """
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):
        return _complain(error.format_message(), error.exit_code)
    if os.environ.get("HARNESS_TRACEBACK"):
        raise error
    return _complain(
        f"internal error, HARNESS_TRACEBACK=1 shows where: {type(error).__name__}: {error}", 1
    )


def _complain(message: str, status: int) -> int:
    for line in message.splitlines():
        print(printable(f"harness: {line}"), file=sys.stderr)
    return status
