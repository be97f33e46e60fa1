# SPDX-License-Identifier: BSD-2-Clause
"""Many runs of a system: `harness compare` and `harness campaign`."""

from __future__ import annotations

import math
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import (
    ExecutorOption,
    PatienceOption,
    Pictures,
    QuietOption,
    StrictOption,
    SystemArgument,
    figures_of,
    takes,
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


@dataclass(frozen=True)
class Cluster:
    """Who performs the runs of a campaign, and how they are reached."""

    workers: WorkersOption = None
    scheduler: SchedulerOption = None
    slurm: SlurmOption = False
    tls_ca: CaOption = None
    tls_cert: CertOption = None
    tls_key: KeyOption = None
    insecure: InsecureOption = False
    dashboard: DashboardOption = False


ResumeOption = Annotated[bool, typer.Option("--resume", help="Continue after an interruption")]
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


@dataclass(frozen=True)
class Varied:
    """What is compared."""

    params: ParamsOption = None
    swap: SwapOption = None
    latency: LatencyOption = None
    vary: VaryOption = None
    algorithm: AlgorithmsOption = None

    def options(self) -> list[tuple[str, str]]:
        """Options with the values given, as combinations() takes them."""
        several = {"swap": self.swap, "latency": self.latency, "set": self.vary}
        varied = [("params", self.params), ("algorithm", self.algorithm)]
        varied += [(option, text) for option, texts in several.items() for text in texts or ()]
        return [(option, text) for option, text in varied if text]


@dataclass(frozen=True)
class Bands:
    """What errors and distances are held against."""

    band: BandOption = None
    keep_out: KeepOutOption = 0.0


@app.command("compare")
@takes_changes("set", "map", "on", "step", "stop", "require")
@takes("pictures", Pictures)
@takes("bands", Bands)
@takes("varied", Varied)
def compare_command(  # noqa: PLR0913, PLR0917 - one argument per option or group of them
    system: SystemArgument,
    varied: Any = None,
    output: FolderOption = None,
    executor: ExecutorOption = None,
    every: ThinOption = None,
    bands: Any = None,
    measures: MeasuresOption = None,
    patience: PatienceOption = None,
    pictures: Any = None,
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
    variants = combinations(changes, varied.options())
    folder = output or Path("results") / Path(system).stem
    shown = not quiet and sys.stderr.isatty()
    limits, wait = _limits(bands.band, bands.keep_out), PATIENCE if patience is None else patience
    with progress_bar(f"{len(variants)} runs", len(variants), shown) as show:
        found = compare(
            system, variants, folder, limits=limits, every=every, patience=wait, progress=show,
            executor=executor or "c",
        )  # fmt: skip
    if found.results and not quiet:
        typer.echo(printable(found.text(names)))
    drawn = _overlaid(found.results, folder, pictures) if pictures.figures else ""
    if not quiet:
        listed = "results, comparison.csv" if drawn else "results and comparison.csv"
        typer.echo(f"\n{listed}{drawn} in {folder}")
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


def _overlaid(results: Any, folder: Path, pictures: Pictures) -> str:
    """Draw the figures of a comparison; how many, as the end of a list."""
    from harness.figures.plots import overlay
    from harness.figures.style import style_of

    drawn = overlay(results, folder, pictures.ending.value, style_of(pictures.style.value))
    return f" and {len(drawn)} figures"


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
@takes("pictures", Pictures)
@takes("cluster", Cluster)
def campaign_command(  # noqa: PLR0913, PLR0917 - one argument per option or group of them
    definition: Annotated[
        Path,
        typer.Argument(metavar="CAMPAIGN.toml", help="Campaign file: system, factors, metrics"),
    ],
    output: DatasetOption = None,
    cluster: Any = None,
    resume: ResumeOption = False,
    require: HeldOption = None,
    strict: ExpectedOption = False,
    pictures: Any = None,
    quiet: QuietOption = False,
) -> None:
    """Run a system thousands of times.

    The file sets what varies; metrics, failures and histories go to one Zarr dataset.
    """
    from harness.cli import campaigns
    from harness.studies.campaign.campaign import campaign

    folder = output or Path("results") / f"{definition.stem}.zarr"
    how = {"resume": resume, "require": require or (), "strict": strict, **asdict(cluster)}
    said = (lambda text: None) if quiet else (lambda text: typer.echo(text, err=True))
    problem = None
    with campaigns.counting(definition.stem, not quiet) as show:
        try:
            found = campaign(definition, folder, progress=show, said=said, **how)
        except RequirementError as error:  # all is there
            found, problem = error.partial, error
    typer.echo(printable(found.summary()))
    place, look = figures_of(folder), (pictures.ending.value, pictures.style.value)
    drawn = campaigns.pictures(found.store, place, *look) if pictures.figures else []
    typer.echo(f"\ndataset {folder}" + (f", {len(drawn)} figures in {place}" if drawn else ""))
    if problem is not None:
        raise problem
