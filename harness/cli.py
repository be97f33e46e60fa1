"""The command line: `harness run | list | check | plot | report | bench`.

Exit status 0: fine, 1: the run or check failed, 2: wrong use. Errors are one line each on stderr. What a command
needs is imported when it runs, so that the command line itself starts at once.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from harness.errors import HarnessError, RunError

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)

SystemArgument = Annotated[str, typer.Argument(metavar="SYSTEM", help="name of a system, or path of an .ssp")]
FileArgument = Annotated[Path, typer.Argument(metavar="FILE", help="results of `harness run`, .csv or .nc")]


@app.command("run")
def run_command(  # noqa: PLR0913, PLR0917 - one argument per option
    system: SystemArgument,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="results: .csv, .nc or .mat")] = None,
    params: Annotated[str | None, typer.Option(metavar="SET_OR_FILE", help="parameter set, .toml or .ssv")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="C.NAME=VALUE", help="one parameter")] = None,
    swap: Annotated[list[str] | None, typer.Option(metavar="C=FMU", help="another FMU (name or path)")] = None,
    step: Annotated[float | None, typer.Option(help="macro step [s]")] = None,
    stop: Annotated[float | None, typer.Option(help="stop time [s]")] = None,
    algorithm: Annotated[str | None, typer.Option(help="gauss-seidel or jacobi")] = None,
    executor: Annotated[str, typer.Option(help="c or python (the same bits, for debugging)")] = "c",
    every: Annotated[int, typer.Option(help="record every N-th macro step")] = 1,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="no progress bar, no summary")] = False,
) -> None:
    """Fly a system and write what comes out (default: results/SYSTEM.nc)."""
    from harness.result_files import ResultFile
    from harness.run import run

    file = ResultFile(output or Path("results") / f"{Path(system).stem}.nc")
    began = perf_counter()
    try:
        result = run(
            system,
            params=params,
            set=set_ or (),
            swap=swap or (),
            step=step,
            stop=stop,
            algorithm=algorithm,
            executor=executor,
            every=every,
            progress=not quiet and sys.stderr.isatty(),
        )
    except RunError as error:
        if error.partial is not None:
            file.write(error.partial)
            error.append(f"{len(error.partial.time)} rows kept in {file.path}")
        raise
    seconds = perf_counter() - began
    file.write(result)
    if not quiet:
        typer.echo(f"{result.system}: {result.time[-1]:g} s in {seconds:.2f} s, {len(result.time)} rows in {file.path}")


@app.command("list")
def list_command() -> None:
    """Show the systems with their components and parameter sets, and the FMUs."""
    from harness import catalogue

    typer.echo(catalogue.text())


@app.command()
def check(
    name: Annotated[str, typer.Argument(metavar="SYSTEM_OR_FMU", help="name, or path of an .ssp or .fmu")],
) -> None:
    """Look for everything that is wrong with a system or an FMU."""
    from harness import catalogue

    typer.echo(catalogue.check(name))


@app.command()
def plot(
    file: FileArgument,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="folder for the figures")] = None,
) -> None:
    """Draw the figures of a run (default: beside the results)."""
    from harness.plots import plot as draw
    from harness.result_files import read

    for path in draw(read(file), output or file.parent):
        typer.echo(path)


@app.command()
def report(file: FileArgument) -> None:
    """Compare a run with the claims of the paper behind it."""
    from harness.report import report as compare
    from harness.result_files import read

    text, passed = compare(read(file))
    typer.echo(text)
    if not passed:
        raise typer.Exit(1)


@app.command()
def bench(system: SystemArgument) -> None:
    """Measure the time of a macro step, ours and other masters' side by side."""
    from harness.bench import bench as measure

    typer.echo(measure(system))


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    logging.basicConfig(format="harness: note: %(message)s", level=logging.WARNING)
    try:
        status = app(
            list(sys.argv[1:] if arguments is None else arguments) or ["--help"], "harness", standalone_mode=False
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
    return status if isinstance(status, int) else 0


def _unexpected(error: Exception) -> int:
    """A wrong command line (typer's own errors, whose classes depend on its version), or a mistake of ours."""
    if hasattr(error, "format_message") and hasattr(error, "exit_code"):
        return _complain(error.format_message(), error.exit_code)
    if os.environ.get("HARNESS_TRACEBACK"):
        raise error
    return _complain(f"internal error, HARNESS_TRACEBACK=1 shows where: {type(error).__name__}: {error}", 1)


def _complain(message: str, status: int) -> int:
    for line in message.splitlines():
        print(f"harness: {line}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
