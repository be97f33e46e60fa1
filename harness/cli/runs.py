"""`harness run` and `harness compare`."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer

from harness.cli.options import (
    EveryOption,
    Format,
    FormatOption,
    QuietOption,
    SystemArgument,
    takes_changes,
)
from harness.errors import ComparisonError, RunError, UsageError
from harness.spelling import printable

app = typer.Typer()


@app.command("run")
@takes_changes("params", "set", "swap", "latency", "step", "stop", "algorithm")
def run_command(  # noqa: PLR0913, PLR0917 - one argument per option
    system: SystemArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="results: .csv, .nc or .mat")
    ] = None,
    executor: Annotated[str, typer.Option(help="c or python (the same bits, for debugging)")] = "c",
    every: EveryOption = 1,
    quiet: QuietOption = False,
    changes: Any = None,
) -> None:
    """Run a system and write the results.

    Default: results/SYSTEM.nc.
    """
    from harness.api import run
    from harness.results.files import ResultFile
    from harness.results.notes import notes

    file = ResultFile(output or Path("results") / f"{Path(system).stem}.nc")
    began = perf_counter()
    try:
        result = run(
            system,
            executor=executor,
            every=every,
            progress=not quiet and sys.stderr.isatty(),
            **changes,
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
            f"{printable(result.system)}: {result.time[-1]:g} s in {seconds:.2f} s, "
            f"{len(result.time)} rows in {file.path}"
        )
        for note in notes(result):
            typer.echo(f"note: {note}")


@app.command("compare")
@takes_changes("set", "step", "stop")
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
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="folder (default: results/SYSTEM)")
    ] = None,
    every: Annotated[
        int | None, typer.Option(help="record every N-th macro step (default: 20 000 rows)")
    ] = None,
    band: Annotated[
        list[str] | None,
        typer.Option(
            metavar="position=M, attitude=DEG", help="bands in which an error has settled"
        ),
    ] = None,
    keep_out: Annotated[float, typer.Option(help="radius about the target [m]")] = 0.0,
    ending: FormatOption = Format.PNG,
    quiet: QuietOption = False,
    changes: Any = None,
) -> None:
    """Run variants side by side: one table, figures.

    Every combination of the values given is run, in parallel. Results, table and figures go to one
    folder.
    """
    from harness.figures.plots import overlay
    from harness.master.progress import progress_bar
    from harness.studies import table
    from harness.studies.compare import compare
    from harness.studies.variants import combinations

    varied = [("params", params), ("algorithm", algorithm)]
    for option, texts in (("swap", swap), ("latency", latency), ("set", vary)):
        varied += [(option, each) for each in texts or ()]
    variants = combinations(changes, [(option, text) for option, text in varied if text])
    folder = output or Path("results") / Path(system).stem
    shown = not quiet and sys.stderr.isatty()
    with progress_bar(f"{len(variants)} runs", len(variants), shown) as show:
        found = compare(
            system, variants, folder, limits=_limits(band, keep_out), every=every, progress=show
        )
    typer.echo(table.text(found.measures, found.labels))
    typer.echo("\n" + "\n".join(found.limits.notes()))
    figures = overlay(found.results, folder, ending.value)
    typer.echo(f"\nresults, comparison.csv and {len(figures)} figures in {folder}")
    if found.failures:
        raise ComparisonError("\n".join(found.failures))


def _limits(bands: list[str] | None, keep_out: float) -> Any:
    """Limits of a comparison from the options --band and --keep-out; UsageError."""
    from harness.changes import pairs
    from harness.studies.measures import Limits

    given = {}
    for name, value in pairs("--band", bands or ()):
        if name not in ("position", "attitude") or not _positive(value):
            raise UsageError(
                f"--band {name}={value}: expected position=METRES or attitude=DEGREES, above 0"
            )
        given[name] = float(value)
    if not 0 <= keep_out < math.inf:
        raise UsageError(f"--keep-out {keep_out:g}: expected a radius in metres, 0 or more")
    return Limits(keep_out=keep_out, **given)


def _positive(text: str) -> bool:
    try:
        return 0 < float(text) < math.inf
    except ValueError:
        return False
