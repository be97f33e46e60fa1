"""The command line: `harness run | compare | list | check | export | draw | linearize | plot |
report | bench`.

Exit status 0: fine, 1: the run or check failed, 2: wrong use. Errors are one line each on stderr.
What a command needs is imported when it runs, so that the command line itself starts at once.
"""

from __future__ import annotations

import logging
import os
import sys
from collections.abc import Callable, Sequence
from enum import Enum
from pathlib import Path
from time import perf_counter
from typing import Annotated

import typer

from harness.errors import ComparisonError, HarnessError, ResultsError, RunError

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


class Format(Enum):
    """Files that figures can be written to."""

    PNG = "png"
    SVG = "svg"
    PDF = "pdf"


INTERRUPTED = 130
"""What newer versions of typer return after Ctrl-C."""

SystemArgument = Annotated[
    str, typer.Argument(metavar="SYSTEM", help="name of a system, or path of an .ssp")
]
ParamsOption = Annotated[
    str | None, typer.Option(metavar="SET_OR_FILE", help="parameter set, .toml or .ssv")
]
SetOption = Annotated[
    list[str] | None, typer.Option("--set", metavar="C.NAME=VALUE", help="one parameter")
]
SwapOption = Annotated[
    list[str] | None, typer.Option(metavar="C=FMU", help="another FMU (name or path)")
]
LatencyOption = Annotated[
    list[str] | None, typer.Option(metavar="C=N", help="publish N macro steps later")
]
StepOption = Annotated[float | None, typer.Option(help="macro step [s]")]
StopOption = Annotated[float | None, typer.Option(help="stop time [s]")]
AlgorithmOption = Annotated[str | None, typer.Option(help="gauss-seidel or jacobi")]
EveryOption = Annotated[int, typer.Option(help="record every N-th macro step")]
FormatOption = Annotated[Format, typer.Option("--format", help="of the figures")]
FileArgument = Annotated[
    Path, typer.Argument(metavar="FILE", help="results of `harness run`, .csv or .nc")
]


@app.command("run")
def run_command(  # noqa: PLR0913, PLR0917 - one argument per option
    system: SystemArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="results: .csv, .nc or .mat")
    ] = None,
    params: ParamsOption = None,
    set_: SetOption = None,
    swap: SwapOption = None,
    latency: LatencyOption = None,
    step: StepOption = None,
    stop: StopOption = None,
    algorithm: AlgorithmOption = None,
    executor: Annotated[str, typer.Option(help="c or python (the same bits, for debugging)")] = "c",
    every: EveryOption = 1,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="no progress bar, no summary")
    ] = False,
) -> None:
    """Fly a system and write the results.

    Default: results/SYSTEM.nc.
    """
    from harness.api import run
    from harness.results.files import ResultFile

    file = ResultFile(output or Path("results") / f"{Path(system).stem}.nc")
    began = perf_counter()
    try:
        result = run(
            system,
            params=params,
            set=set_ or (),
            swap=swap or (),
            latency=latency or (),
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
        typer.echo(
            f"{result.system}: {result.time[-1]:g} s in {seconds:.2f} s, {len(result.time)} rows in {file.path}"
        )


@app.command("compare")
def compare_command(  # noqa: PLR0913, PLR0917 - one argument per option
    system: SystemArgument,
    params: Annotated[str | None, typer.Option(metavar="A,B,..", help="parameter sets")] = None,
    swap: Annotated[
        list[str] | None, typer.Option(metavar="C=A,B,..", help="FMUs in the place of C")
    ] = None,
    latency: Annotated[
        list[str] | None, typer.Option(metavar="C=N,M,..", help="macro steps that C is late")
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="C.NAME=V,W,..", help="values of a parameter, or first:last:step"),
    ] = None,
    algorithm: Annotated[
        str | None, typer.Option(metavar="A,B", help="gauss-seidel,jacobi")
    ] = None,
    set_: SetOption = None,
    step: StepOption = None,
    stop: StopOption = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="folder (default: results/SYSTEM)")
    ] = None,
    every: Annotated[
        int | None, typer.Option(help="record every N-th macro step (default: 20 000 rows)")
    ] = None,
    ending: FormatOption = Format.PNG,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="no progress bar")] = False,
) -> None:
    """Fly variants side by side: one table, figures.

    Every combination of the values given is flown, in parallel. Results, table and figures go to
    one folder.
    """
    from harness.figures.plots import overlay
    from harness.master.progress import progress_bar
    from harness.studies.cases import cases
    from harness.studies.compare import compare, text

    varied = [("params", params), ("algorithm", algorithm)]
    for option, texts in (("swap", swap), ("latency", latency), ("set", vary)):
        varied += [(option, each) for each in texts or ()]
    flights = cases(
        {"set": set_ or (), "step": step, "stop": stop}, [(o, text) for o, text in varied if text]
    )
    folder = output or Path("results") / Path(system).stem
    with progress_bar(
        f"{len(flights)} flights", len(flights), not quiet and sys.stderr.isatty()
    ) as show:
        found = compare(system, flights, folder, every=every, progress=show)
    typer.echo(text(found))
    figures = overlay(found.results, folder, ending.value)
    typer.echo(f"\nresults, comparison.csv and {len(figures)} figures in {folder}")
    if found.failures:
        raise ComparisonError("\n".join(found.failures))


@app.command("list")
def list_command(
    system: Annotated[
        str | None, typer.Argument(metavar="[SYSTEM]", help="name of a system, or path of an .ssp")
    ] = None,
) -> None:
    """Show systems, parameter sets and FMUs."""
    from harness.studies import catalogue

    typer.echo(catalogue.text(system))


@app.command()
def check(
    name: Annotated[
        str, typer.Argument(metavar="SYSTEM_OR_FMU", help="name, or path of an .ssp or .fmu")
    ],
) -> None:
    """Find all that is wrong with a system or an FMU."""
    from harness.studies import catalogue

    typer.echo(catalogue.check(name))


@app.command("export")
def export_command(  # noqa: PLR0913, PLR0917 - one argument per option
    system: SystemArgument,
    target: Annotated[
        Path, typer.Argument(metavar="DIR_OR_FILE", help="folder, or file NAME.ssp or NAME.fmu")
    ],
    params: ParamsOption = None,
    set_: SetOption = None,
    swap: SwapOption = None,
    latency: LatencyOption = None,
    step: StepOption = None,
    stop: StopOption = None,
    algorithm: AlgorithmOption = None,
) -> None:
    """Write a system as one .ssp or one .fmu.

    With all changes, and everything inside.
    """
    from harness.exports.package import export

    typer.echo(
        export(
            system,
            target,
            params=params,
            set=set_ or (),
            swap=swap or (),
            latency=latency or (),
            step=step,
            stop=stop,
            algorithm=algorithm,
        )
    )


@app.command("draw")
def draw_command(
    system: SystemArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="picture (default: SYSTEM.svg)")
    ] = None,
) -> None:
    """Draw the block diagram of a system."""
    from harness.exports.draw import draw
    from harness.ssp.library import load

    with load(system) as found:
        path = output or Path(f"{found.name}.svg")
        draw(found, path)
    typer.echo(path)


@app.command("linearize")
def linearize_command(
    fmu: Annotated[str, typer.Argument(metavar="FMU", help="name of an FMU, or path of a .fmu")],
    output: Annotated[Path, typer.Option("--output", "-o", help="matrices, names and units: .npz")],
    at: Annotated[float, typer.Option(help="time of the operating point [s]")] = 0.0,
    step: Annotated[float, typer.Option(help="step of the linear model [s]")] = 0.1,
    set_: Annotated[
        list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="parameter or input")
    ] = None,
) -> None:
    """Write the linear model of one FMU about an operating point."""
    from harness.changes import pairs
    from harness.studies.linearize import linearize
    from harness.system.swap import find_fmu
    from harness.system.values import parse

    values = {name: parse(value) for name, value in pairs("--set", set_ or ())}
    model = linearize(find_fmu(fmu), at, step, values)
    _write(output, model.save)
    typer.echo(
        f"{output}: {len(model.states)} states, {len(model.inputs)} inputs, {len(model.outputs)} outputs"
    )


@app.command()
def plot(
    file: FileArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="folder for the figures")
    ] = None,
    ending: FormatOption = Format.PNG,
) -> None:
    """Draw the figures of a run.

    Default: beside the results.
    """
    from harness.figures.plots import plot as draw
    from harness.results.files import read

    for path in draw(read(file), output or file.parent, ending.value):
        typer.echo(path)


@app.command()
def report(file: FileArgument) -> None:
    """Judge a run by the claims of its paper."""
    from harness.claims.report import report as compare
    from harness.results.files import read

    text, passed = compare(read(file))
    typer.echo(text)
    if not passed:
        raise typer.Exit(1)


@app.command()
def bench(system: SystemArgument) -> None:
    """Measure the cost of a macro step.

    Ours and other masters' side by side.
    """
    from harness.bench.bench import bench as measure

    typer.echo(measure(system))


def _write(path: Path, save: Callable[[Path], None]) -> None:
    """Save something; ResultsError if the file cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        save(path)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written ({error.strerror})") from error


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit status."""
    logging.basicConfig(format="harness: note: %(message)s", level=logging.WARNING)
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
        print(f"harness: {line}", file=sys.stderr)
    return status


if __name__ == "__main__":
    sys.exit(main())
