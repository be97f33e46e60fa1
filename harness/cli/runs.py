# SPDX-License-Identifier: BSD-2-Clause
"""`harness run`, `harness compare` and `harness campaign`."""

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
    like: Annotated[
        str | None,
        typer.Option(metavar="OUT.zarr#N", help="as run N of a campaign, with figures"),
    ] = None,
    in_process: Annotated[
        bool, typer.Option("--in-process", help="foreign FMUs in this process too, for debugging")
    ] = False,
    quiet: QuietOption = False,
    changes: Any = None,
) -> None:
    """Run a system and write the results.

    Default: results/SYSTEM.nc.
    """
    from harness.files.signals import held
    from harness.master.changes import apply
    from harness.master.isolated import simulate
    from harness.results.files import ResultFile
    from harness.results.notes import notes
    from harness.ssp.library import load
    from harness.system.graph import say_warnings

    if like is not None:
        from harness.studies.campaign.campaign import like as run_of

        changes = {**run_of(like, system), **changes}

    file = ResultFile(output or Path("results") / f"{Path(system).stem}.nc")
    began = perf_counter()
    with load(system) as found:
        changed = apply(found, **changes)
        say_warnings(changed)
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
                    f"{printable(result.system)}: {result.time[-1]:g} s in {seconds:.2f} s, "
                    f"{len(result.time)} rows in {file.path}"
                )
                for note in notes(result):
                    typer.echo(f"note: {note}")
    if like is not None:
        from harness.figures.plots import plot

        for path in plot(result, file.path.parent):
            typer.echo(path)


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
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="draw them")] = True,
    quiet: QuietOption = False,
    changes: Any = None,
) -> None:
    """Run variants side by side: one table, figures.

    Every combination of the values given is run, in parallel. Results, table and figures go to one
    folder.
    """
    from harness.master.progress import progress_bar
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
    typer.echo(found.text())
    drawn = ""
    if figures:
        from harness.figures.plots import overlay

        drawn = f" and {len(overlay(found.results, folder, ending.value))} figures"
    typer.echo(f"\nresults{',' if figures else ' and'} comparison.csv{drawn} in {folder}")
    if found.failures:
        raise ComparisonError("\n".join(found.failures))


def _limits(bands: list[str] | None, keep_out: float) -> Any:
    """Limits of a comparison from the options --band and --keep-out; UsageError."""
    from harness.master.changes import pairs
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


@app.command("campaign")
def campaign_command(  # noqa: PLR0913, PLR0917 - one argument per option
    definition: Annotated[
        Path, typer.Argument(metavar="CAMPAIGN.toml", help="system, factors, metrics")
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="dataset (default: results/CAMPAIGN.zarr)")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="processes, or jobs (default: processors; 0: no other)")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="of a Dask cluster")
    ] = None,
    slurm: Annotated[bool, typer.Option("--slurm", help="jobs of SLURM do the work")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="go on after an interruption")] = False,
    ending: FormatOption = Format.PNG,
    figures: Annotated[bool, typer.Option("--figures/--no-figures", help="draw them")] = True,
    quiet: QuietOption = False,
) -> None:
    """Run a system by the thousand.

    Factors vary as the file says; metrics, failures and histories go to one Zarr dataset.
    """
    from harness.cli.campaigns import counting, pictures
    from harness.studies.campaign.campaign import campaign

    folder = output or Path("results") / f"{definition.stem}.zarr"
    shown = not quiet and sys.stderr.isatty()
    with counting(definition.stem, shown) as show:
        found = campaign(
            definition,
            folder,
            workers=workers,
            scheduler=scheduler,
            slurm=slurm,
            resume=resume,
            progress=show,
            said=(lambda text: None) if quiet else (lambda text: typer.echo(text, err=True)),
        )
    typer.echo(found.summary())
    drawn = pictures(found.store, folder.parent, ending.value) if figures else []
    typer.echo(f"\ndataset {folder}, {len(drawn)} figures in {folder.parent}")


@app.command("study")
def study_command(  # noqa: PLR0913, PLR0917 - one argument per option
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="a campaign of the project; without it, their names"),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="dataset (default: results/NAME.zarr)")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(help="processes (default: processors; 0: no other)")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="go on after an interruption")] = False,
    ending: FormatOption = Format.PNG,
    quiet: QuietOption = False,
) -> None:
    """Run a campaign of the project.

    Studies of the papers, as the maps of the space robot.
    """
    from harness.errors import UsageError
    from harness.files import paths
    from harness.spelling import did_you_mean

    known = paths.campaigns()
    if name is None:
        typer.echo("\n".join(known))
        return
    if name not in known:
        raise UsageError(f"{name}: there is no such study{did_you_mean(name, known)}")
    campaign_command(
        known[name], output, workers, None, False, resume, ending, figures=True, quiet=quiet
    )
