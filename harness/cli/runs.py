# SPDX-License-Identifier: BSD-2-Clause
"""`harness run`, `harness compare` and `harness campaign`."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer

from harness.cli.options import (
    Format,
    FormatOption,
    Look,
    QuietOption,
    StrictOption,
    StyleOption,
    SystemArgument,
    completed_systems,
    figures_of,
    insist,
    size_of,
    takes_changes,
)
from harness.errors import ComparisonError, RunError, UsageError
from harness.spelling import printable

app = typer.Typer()


OutputOption = Annotated[
    Path | None, typer.Option("--output", "-o", help="results: .nc, .csv, .mat or .parquet")
]
ExecutorOption = Annotated[
    str | None, typer.Option(help="c or python (the same bits, for debugging)")
]
RecordOption = Annotated[int | None, typer.Option(help="record every N-th macro step")]
LikeOption = Annotated[
    str | None,
    typer.Option(
        metavar="RESULT",
        help="as this result (.nc, .csv, .mat) was run, or OUT.zarr#N of a campaign",
    ),
]
SystemOption = Annotated[
    str | None,
    typer.Argument(
        metavar="[SYSTEM]",
        help="name of a system, or path of an .ssp (--like knows its own)",
        autocompletion=completed_systems,
    ),
]
WatchOption = Annotated[
    bool, typer.Option("--watch", help="show where the run is: range, errors, speed, phase")
]
StartOption = Annotated[
    list[str] | None,
    typer.Option(metavar="C=FILE", help="start of a body: OEM of CCSDS or two-line elements"),
]
EpochOption = Annotated[
    str | None, typer.Option(metavar="DATE", help="UTC at which --start takes its files")
]
InProcessOption = Annotated[
    bool, typer.Option("--in-process", help="foreign FMUs in this process too, for debugging")
]
RealtimeOption = Annotated[
    float | None, typer.Option(metavar="FACTOR", help="keep pace with a clock (1: real time)")
]
LateOption = Annotated[
    str | None,
    typer.Option(metavar="wait|hold|stop", help="if a component elsewhere does not keep pace"),
]
Several = list[str] | None
"""Values of an option that may be given several times."""
ParamsOption = Annotated[str | None, typer.Option(metavar="A,B,..", help="parameter sets")]
SwapOption = Annotated[Several, typer.Option(metavar="C=A,B,..", help="FMUs in the place of C")]
LatencyOption = Annotated[
    Several, typer.Option(metavar="C=N,M,..", help="macro steps that C is late")
]
VaryOption = Annotated[
    Several,
    typer.Option(metavar="C.NAME=V,W,..", help="values of a parameter, or first:last:step"),
]
AlgorithmsOption = Annotated[str | None, typer.Option(metavar="A,B", help="gauss-seidel,jacobi")]
FolderOption = Annotated[
    Path | None, typer.Option("--output", "-o", help="folder (default: results/SYSTEM)")
]
ThinOption = Annotated[
    int | None, typer.Option(help="record every N-th macro step (default: 20 000 rows)")
]
BandOption = Annotated[
    Several,
    typer.Option(metavar="position=M, attitude=DEG", help="bands in which an error has settled"),
]
KeepOutOption = Annotated[float, typer.Option(help="radius about the target [m]")]
FiguresOption = Annotated[bool, typer.Option("--figures/--no-figures", help="draw them")]
DatasetOption = Annotated[
    Path | None, typer.Option("--output", "-o", help="dataset (default: results/NAME.zarr)")
]
WorkersOption = Annotated[
    int | None, typer.Option(help="processes, or jobs (default: processors; 0: no other)")
]
ResumeOption = Annotated[bool, typer.Option("--resume", help="go on after an interruption")]


@app.command("run")
@takes_changes(
    "params", "set", "swap", "map", "on", "latency", "step", "stop", "algorithm", "require"
)
def run_command(  # noqa: PLR0913, PLR0917 - one argument per option
    system: SystemOption = None,
    output: OutputOption = None,
    executor: ExecutorOption = None,
    every: RecordOption = None,
    like: LikeOption = None,
    in_process: InProcessOption = False,
    start: StartOption = None,
    epoch: EpochOption = None,
    strict: StrictOption = False,
    watch: WatchOption = False,
    realtime: RealtimeOption = None,
    late: LateOption = None,
    quiet: QuietOption = False,
    changes: Any = None,
) -> None:
    """Run a system and write the results.

    Default: results/SYSTEM.nc. With --like RESULT the exit status is 1 if the bits differ.
    """
    from harness.master.pacer import Pacer
    from harness.results.files import ResultFile

    wanted = _wanted(system, like, _started(system, start, epoch, changes))
    name = f"{Path(wanted.system).stem or 'run'}{'' if wanted.model is None else '_again'}"
    file = ResultFile(output or Path("results") / f"{name}.nc")
    how: dict[str, Any] = {
        "progress": not quiet and sys.stderr.isatty(),
        "executor": executor or wanted.executor,
        "every": wanted.every if every is None else every,
        "in_process": in_process,
    }
    if watch:
        from harness.cli.watch import watched

        how["progress"] = watched
    if realtime is not None:
        how["pacer"] = Pacer(realtime)
    result = _run(wanted.system, wanted.changes, file, how, quiet, late)
    if wanted.model is not None:
        _say_whether_equal(wanted.model, result)
    elif like is not None:
        from harness.figures.plots import plot

        for path in plot(result, figures_of(file.path)):
            typer.echo(path)
    insist(result, changes.get("require", ()), strict)


def _started(
    system: str | None, start: list[str] | None, epoch: str | None, changes: Any
) -> dict[str, Any]:
    """The changes with start values from files below those of --set."""
    if not start:
        if epoch is not None:
            raise UsageError("--epoch: there are no files of --start")
        return dict(changes)
    from harness.exchange.start import start_values
    from harness.master.changes import pairs
    from harness.ssp.library import load

    if system is None:
        raise UsageError("--start: SYSTEM is missing")
    with load(system) as found:
        begun = start_values(found, dict(pairs("--start", start)), epoch, **changes)
    for note in begun.notes:
        typer.echo(printable(f"note: {note}"))
    return {**changes, "set": {**begun.values, **dict(pairs("--set", changes.get("set", ())))}}


def _wanted(system: str | None, like: str | None, changes: Any) -> Any:
    """What the command line asks for."""
    from harness.studies.again import Again, again

    if like is not None:
        return again(like, system, changes)
    if system is None:
        raise UsageError("SYSTEM is missing (harness list shows them), or --like RESULT")
    return Again(system, changes)


def _say_whether_equal(model: Any, result: Any) -> None:
    from harness.studies.again import agreement

    equal, line = agreement(model, result)
    typer.echo(line)
    if not equal:
        raise typer.Exit(1)


def _run(  # noqa: PLR0913, PLR0917 - what the command line says
    system: str, changes: Any, file: Any, how: dict[str, Any], quiet: bool, late: str | None
) -> Any:
    """Run, write, and say what there is to say; nothing that was recorded is lost."""
    from harness.files.signals import held
    from harness.master.isolated import simulate
    from harness.master.pacer import timely
    from harness.ssp.library import load
    from harness.system.graph import say_warnings

    began = perf_counter()
    with load(system) as found:
        pacer = how.get("pacer")
        changed = timely(found, changes, None if pacer is None else pacer.factor, late)
        say_warnings(changed)
        file.accept(changed)
        with held():  # from here on
            try:
                result = simulate(changed, **how)
            except RunError as error:
                if error.partial is not None:
                    error.append(_kept(file, error.partial))
                raise
            seconds = perf_counter() - began
            file.write(result)
            if not quiet:
                _report(result, seconds, file.path)
    return result


def _kept(file: Any, partial: Any) -> str:
    """Write what a run that ended early has recorded; an interruption after the last step has cost
    nothing.
    """
    if partial.complete:
        file.write(partial)
        return f"all {len(partial.time)} rows are in {file.path}"
    return f"{len(partial.time)} rows kept in {file.keep(partial)}"


def _report(result: Any, seconds: float, path: Path) -> None:
    from harness.results.notes import notes
    from harness.results.requirements import findings

    typer.echo(
        f"{printable(result.system)}: {result.time[-1]:g} s in {seconds:.2f} s, "
        f"{len(result.time)} rows in {path}{size_of(path)}"
    )
    if result.provenance is not None and result.provenance.timing:
        typer.echo(f"pace: {result.provenance.timing}")
    for note in notes(result):
        typer.echo(printable(f"note: {note}"))
    for finding in findings(result):
        typer.echo(f"requirement {printable(str(finding))}")


@app.command("compare")
@takes_changes("set", "map", "step", "stop", "require")
def compare_command(  # noqa: PLR0913, PLR0917 - one argument per option
    system: SystemArgument,
    params: ParamsOption = None,
    swap: SwapOption = None,
    latency: LatencyOption = None,
    vary: VaryOption = None,
    algorithm: AlgorithmsOption = None,
    output: FolderOption = None,
    every: ThinOption = None,
    band: BandOption = None,
    keep_out: KeepOutOption = 0.0,
    ending: FormatOption = Format.PNG,
    style: StyleOption = Look.SCREEN,
    figures: FiguresOption = True,
    strict: StrictOption = False,
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

    given = {"swap": swap, "latency": latency, "set": vary}
    variants = combinations(changes, _varied(params, algorithm, given))
    folder = output or Path("results") / Path(system).stem
    shown = not quiet and sys.stderr.isatty()
    with progress_bar(f"{len(variants)} runs", len(variants), shown) as show:
        found = compare(
            system, variants, folder, limits=_limits(band, keep_out), every=every, progress=show
        )
    typer.echo(printable(found.text()))
    drawn = _overlaid(found.results, folder, ending, style) if figures else ""
    typer.echo(f"\nresults{',' if figures else ' and'} comparison.csv{drawn} in {folder}")
    if found.failures:
        raise ComparisonError("\n".join(found.failures))
    for result in found.results.values():
        insist(result, changes.get("require", ()), strict)


def _overlaid(results: Any, folder: Path, ending: Format, style: Look) -> str:
    """Draw the figures of a comparison; how many, as the end of a list."""
    from harness.figures.plots import overlay
    from harness.figures.style import style_of

    drawn = overlay(results, folder, ending.value, style_of(style.value))
    return f" and {len(drawn)} figures"


def _varied(
    params: str | None, algorithm: str | None, given: Mapping[str, Several]
) -> list[tuple[str, str]]:
    """Options with the values given, as combinations() takes them."""
    varied = [("params", params), ("algorithm", algorithm)]
    for option, texts in given.items():
        varied += [(option, each) for each in texts or ()]
    return [(option, text) for option, text in varied if text]


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
    output: DatasetOption = None,
    workers: WorkersOption = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="of a Dask cluster")
    ] = None,
    slurm: Annotated[bool, typer.Option("--slurm", help="jobs of SLURM do the work")] = False,
    resume: ResumeOption = False,
    ending: FormatOption = Format.PNG,
    style: StyleOption = Look.SCREEN,
    figures: FiguresOption = True,
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
    typer.echo(printable(found.summary()))
    place = figures_of(folder)
    drawn = pictures(found.store, place, ending.value, style.value) if figures else []
    typer.echo(f"\ndataset {folder}" + (f", {len(drawn)} figures in {place}" if drawn else ""))


@app.command("study")
def study_command(  # noqa: PLR0913, PLR0917 - one argument per option
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="a campaign of the project; without it, their names"),
    ] = None,
    output: DatasetOption = None,
    workers: WorkersOption = None,
    resume: ResumeOption = False,
    ending: FormatOption = Format.PNG,
    style: StyleOption = Look.SCREEN,
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
    campaign_command(known[name], output, workers, None, False, resume, ending, style, True, quiet)
