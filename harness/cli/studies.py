# SPDX-License-Identifier: BSD-2-Clause
"""Many runs of a system: `harness compare`, `harness campaign` and `harness study`."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import (
    Format,
    FormatOption,
    Look,
    PatienceOption,
    QuietOption,
    StrictOption,
    StyleOption,
    SystemArgument,
    figures_of,
    takes_changes,
)
from harness.errors import ComparisonError, RequirementError, UsageError
from harness.spelling import printable

app = typer.Typer()

Several = list[str] | None
"""Values of an option that may be given several times."""
ParamsOption = Annotated[
    str | None, typer.Option(metavar="A,B,..", help="Compare these parameter sets")
]
SwapOption = Annotated[
    Several, typer.Option(metavar="C=A,B,..", help="Compare these FMUs as component C")
]
LatencyOption = Annotated[
    Several,
    typer.Option(metavar="C=N,M,..", help="Compare these delays of component C, in macro steps"),
]
VaryOption = Annotated[
    Several,
    typer.Option(
        metavar="C.NAME=V,W,..", help="Compare these values of a parameter, or first:last:step"
    ),
]
AlgorithmsOption = Annotated[
    str | None, typer.Option(metavar="A,B", help="Compare gauss-seidel,jacobi")
]
FolderOption = Annotated[
    Path | None, typer.Option("--output", "-o", help="Folder to write (default: results/SYSTEM)")
]
ThinOption = Annotated[
    int | None, typer.Option(help="Record every N-th macro step (default: 20 000 rows)")
]
BandOption = Annotated[
    Several,
    typer.Option(
        metavar="position=M, attitude=DEG", help="Set the bands in which an error has settled"
    ),
]
KeepOutOption = Annotated[float, typer.Option(help="Set a keep-out radius about the target [m]")]
FiguresOption = Annotated[
    bool, typer.Option("--figures/--no-figures", help="Draw figures, or none")
]
MeasuresOption = Annotated[
    str | None, typer.Option(metavar="A,B,..", help="Columns of the table (default: all)")
]
DatasetOption = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Dataset to write (default: results/NAME.zarr)"),
]
WorkersOption = Annotated[
    int | None, typer.Option(help="Use N processes or jobs (default: processors; 0: this one)")
]
SchedulerOption = Annotated[
    str | None, typer.Option(metavar="ADDRESS", help="Use the Dask cluster at this address")
]
SlurmOption = Annotated[bool, typer.Option("--slurm", help="Submit the workers as SLURM jobs")]
CaOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Certificate of the authority that signs all others"),
]
CertOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Own certificate, for --scheduler and --slurm")
]
KeyOption = Annotated[Path | None, typer.Option(metavar="FILE", help="Key of the certificate")]
InsecureOption = Annotated[
    bool, typer.Option("--insecure", help="Accept a scheduler without TLS, open to everybody")
]
DashboardOption = Annotated[
    bool, typer.Option("--dashboard", help="Serve Dask's pages to users of this machine")
]
ResumeOption = Annotated[bool, typer.Option("--resume", help="Go on after an interruption")]
HeldOption = Annotated[
    Several,
    typer.Option(
        "--require",
        metavar="'success >= 99 %'",
        help="Require this of shares or metrics, else exit status 1",
    ),
]
ExpectedOption = Annotated[
    bool,
    typer.Option("--strict", help="Let [expected], or success of every run, decide on the status"),
]


@app.command("compare")
@takes_changes("set", "map", "on", "step", "stop", "require")
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
    measures: MeasuresOption = None,
    patience: PatienceOption = None,
    ending: FormatOption = Format.PNG,
    style: StyleOption = Look.SCREEN,
    figures: FiguresOption = True,
    strict: StrictOption = False,
    quiet: QuietOption = False,
    changes: Any = None,
) -> None:
    """Run variants side by side: one table and figures.

    Every combination of the given values runs, in parallel, in the set that the system has for
    comparisons unless --params names others. Results, table and figures go to one folder.
    """
    from harness.cli.verdicts import insist
    from harness.master.isolated import PATIENCE
    from harness.master.progress import progress_bar
    from harness.studies.compare import compare
    from harness.studies.variants import combinations

    names = _columns(system, measures)
    given = {"swap": swap, "latency": latency, "set": vary}
    variants = combinations(changes, _varied(params, algorithm, given))
    folder = output or Path("results") / Path(system).stem
    shown = not quiet and sys.stderr.isatty()
    with progress_bar(f"{len(variants)} runs", len(variants), shown) as show:
        found = compare(
            system,
            variants,
            folder,
            limits=_limits(band, keep_out),
            every=every,
            patience=PATIENCE if patience is None else patience,
            progress=show,
        )
    text = found.text(names) if found.results else ""
    if text and not quiet:
        typer.echo(printable(text))
    drawn = _overlaid(found.results, folder, ending, style) if figures else ""
    if not quiet:
        typer.echo(f"\nresults{',' if figures else ' and'} comparison.csv{drawn} in {folder}")
    if found.failures:
        raise ComparisonError("\n".join(found.failures))
    insist(found.results, changes.get("require", ()), strict)


def _columns(system: str, measures: str | None) -> list[str]:
    """Names of the option --measures; UsageError if there is no such measure."""
    if not measures:
        return []
    from harness.mission.library import everything
    from harness.spelling import did_you_mean
    from harness.ssp.library import load

    with load(system):
        known = {measure.name for measure in everything().measures} | {"macro step"}
    names = [name.strip() for name in measures.split(",")]
    for name in names:
        if name not in known:
            raise UsageError(f"--measures {name}: no such measure{did_you_mean(name, known)}")
    return names


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
    from harness.mission import Limits

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
        Path,
        typer.Argument(metavar="CAMPAIGN.toml", help="Campaign file: system, factors, metrics"),
    ],
    output: DatasetOption = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    slurm: SlurmOption = False,
    tls_ca: CaOption = None,
    tls_cert: CertOption = None,
    tls_key: KeyOption = None,
    insecure: InsecureOption = False,
    dashboard: DashboardOption = False,
    resume: ResumeOption = False,
    require: HeldOption = None,
    strict: ExpectedOption = False,
    ending: FormatOption = Format.PNG,
    style: StyleOption = Look.SCREEN,
    figures: FiguresOption = True,
    quiet: QuietOption = False,
) -> None:
    """Run a system thousands of times.

    The file sets what varies; metrics, failures and histories go to one Zarr dataset.
    """
    from harness.cli.campaigns import counting, pictures
    from harness.studies.campaign.campaign import campaign

    folder = output or Path("results") / f"{definition.stem}.zarr"
    problem = None
    with counting(definition.stem, not quiet) as show:
        try:
            found = campaign(
                definition,
                folder,
                workers=workers,
                scheduler=scheduler,
                slurm=slurm,
                tls_ca=tls_ca,
                tls_cert=tls_cert,
                tls_key=tls_key,
                insecure=insecure,
                dashboard=dashboard,
                resume=resume,
                require=require or (),
                strict=strict,
                progress=show,
                said=(lambda text: None) if quiet else (lambda text: typer.echo(text, err=True)),
            )
        except RequirementError as error:  # all is there
            found, problem = error.partial, error
    typer.echo(printable(found.summary()))
    place = figures_of(folder)
    drawn = pictures(found.store, place, ending.value, style.value) if figures else []
    typer.echo(f"\ndataset {folder}" + (f", {len(drawn)} figures in {place}" if drawn else ""))
    if problem is not None:
        raise problem


@app.command("study")
def study_command(  # noqa: PLR0913, PLR0917 - one argument per option
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Campaign of the project; without a name: list them"),
    ] = None,
    output: DatasetOption = None,
    workers: WorkersOption = None,
    resume: ResumeOption = False,
    require: HeldOption = None,
    strict: ExpectedOption = False,
    ending: FormatOption = Format.PNG,
    style: StyleOption = Look.SCREEN,
    quiet: QuietOption = False,
) -> None:
    """Run a campaign of the project.

    Studies of the papers, such as the maps of the space robot.
    """
    from harness.mission.library import campaigns
    from harness.spelling import did_you_mean

    known = campaigns()
    if name is None:
        typer.echo("\n".join(known))
        return
    if name not in known:
        raise UsageError(f"{name}: there is no such study{did_you_mean(name, known)}")
    campaign_command(
        known[name],
        output,
        workers,
        resume=resume,
        require=require,
        strict=strict,
        ending=ending,
        style=style,
        quiet=quiet,
    )
