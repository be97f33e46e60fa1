"""`harness run` and `harness compare`."""

from __future__ import annotations

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
from harness.errors import ComparisonError, RunError

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
    in_process: Annotated[
        bool, typer.Option("--in-process", help="foreign FMUs in this process too, for debugging")
    ] = False,
    quiet: QuietOption = False,
    changes: Any = None,
) -> None:
    """Run a system and write the results.

    Default: results/SYSTEM.nc.
    """
    from harness.changes import apply
    from harness.master.isolated import simulate
    from harness.results.files import ResultFile
    from harness.signals import held
    from harness.ssp.library import load

    file = ResultFile(output or Path("results") / f"{Path(system).stem}.nc")
    began = perf_counter()
    with load(system) as found:
        changed = apply(found, **changes)
        file.accept(changed)
        with held():  # from here on nothing that was recorded is lost
            try:
                result = simulate(
                    changed,
                    executor=executor,
                    every=every,
                    progress=not quiet and sys.stderr.isatty(),
                    in_process=in_process,
                )
            except RunError as error:
                if error.partial is not None:
                    kept = file.keep(error.partial)
                    error.append(f"{len(error.partial.time)} rows kept in {kept}")
                raise
            seconds = perf_counter() - began
            file.write(result)
            if not quiet:
                typer.echo(
                    f"{result.system}: {result.time[-1]:g} s in {seconds:.2f} s, "
                    f"{len(result.time)} rows in {file.path}"
                )


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
        found = compare(system, variants, folder, every=every, progress=show)
    typer.echo(table.text(found.measures, found.labels))
    figures = overlay(found.results, folder, ending.value)
    typer.echo(f"\nresults, comparison.csv and {len(figures)} figures in {folder}")
    if found.failures:
        raise ComparisonError("\n".join(found.failures))
