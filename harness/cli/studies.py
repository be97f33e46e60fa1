# SPDX-License-Identifier: BSD-2-Clause
"""Many runs of a system: `harness compare` and `harness campaign`; studies that ask on: `harness
sensitivity`, `worst`, `probability`, `map`, `tune`; all of a file of the project: `harness study`.
"""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Mapping
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
    Texts,
    argument,
    command,
    figures_of,
    option,
    output,
)
from harness.errors import ComparisonError, RequirementError, UsageError
from harness.spelling import did_you_mean, is_number, printable

StudyArgument = Annotated[
    Path, argument("CAMPAIGN.toml", "File with system, factors, study; or NAME of the project")
]
DatasetOption = Annotated[Path | None, output("Dataset to write (default: results/NAME.zarr)")]
WorkersOption = Annotated[
    int | None, option("", "Use N processes or jobs (default: processors; 0: this one)")
]
ResumeOption = Annotated[bool, option("--resume", "Continue after an interruption")]


@dataclass(frozen=True)
class Cluster:
    """Who performs the runs of a campaign, and how they are reached."""

    workers: WorkersOption = None
    scheduler: Annotated[str | None, option("ADDRESS", "Use the Dask cluster at this address")] = (
        None
    )
    slurm: Annotated[bool, option("--slurm", "Submit the workers as SLURM jobs")] = False
    tls_ca: Annotated[
        Path | None, option("FILE", "Certificate of the authority that signs all others")
    ] = None
    tls_cert: Annotated[
        Path | None, option("FILE", "Own certificate, for --scheduler and --slurm")
    ] = None
    tls_key: Annotated[Path | None, option("FILE", "Key of the certificate")] = None
    insecure: Annotated[
        bool, option("--insecure", "Accept a scheduler without TLS, open to everybody")
    ] = False


@dataclass(frozen=True)
class Varied:
    """What is compared."""

    params: Annotated[str | None, option("A,B,..", "Compare these parameter sets")] = None
    swap: Annotated[Texts, option("C=A,B,..", "Compare these FMUs as component C")] = None
    latency: Annotated[
        Texts, option("C=N,M,..", "Compare these delays of component C, in macro steps")
    ] = None
    vary: Annotated[
        Texts, option("C.NAME=V,W,..", "Compare these values of a parameter, or first:last:step")
    ] = None
    algorithm: Annotated[str | None, option("A,B", "Compare gauss-seidel,jacobi")] = None

    def options(self) -> list[tuple[str, str]]:
        """Options with the values given, as combinations() takes them."""
        several = {"swap": self.swap, "latency": self.latency, "set": self.vary}
        varied = [("params", self.params), ("algorithm", self.algorithm)]
        varied += [(option, text) for option, texts in several.items() for text in texts or ()]
        return [(option, text) for option, text in varied if text]


@dataclass(frozen=True)
class Compared:
    """How variants are run, and what their errors and distances are held against."""

    executor: ExecutorOption = None
    every: Annotated[
        int | None, option("", "Record every N-th macro step (default: 20 000 rows)")
    ] = None
    band: Annotated[
        Texts, option("position=M, attitude=DEG", "Set the bands in which an error has settled")
    ] = None
    keep_out: Annotated[float, option("", "Set a keep-out radius about the target [m]")] = 0.0
    measures: Annotated[str | None, option("A,B,..", "Columns of the table (default: all)")] = None
    patience: PatienceOption = None

    def how(self) -> dict[str, Any]:
        """Arguments of compare()."""
        from harness.master.isolated import PATIENCE

        return {
            "limits": self._limits(),
            "every": self.every,
            "patience": PATIENCE if self.patience is None else self.patience,
            "executor": self.executor or "c",
        }

    def _limits(self) -> Any:
        """Limits of a comparison; UsageError."""
        from harness.master.changes import pairs
        from harness.mission import Limits

        given = {}
        for name, text in pairs("--band", self.band or ()):
            value = float(text) if is_number(text) else math.nan
            if name not in ("position", "attitude") or not 0 < value < math.inf:
                wanted = "expected position=METRES or attitude=DEGREES, above 0"
                raise UsageError(f"--band {name}={text}: {wanted}")
            given[name] = value
        if not 0 <= self.keep_out < math.inf:
            wanted = "expected a radius in metres, 0 or more"
            raise UsageError(f"--keep-out {self.keep_out:g}: {wanted}")
        return Limits(keep_out=self.keep_out, **given)

    def columns(self, system: str) -> list[str]:
        """Columns of the table, none: all; UsageError if there is no such measure."""
        if not self.measures:
            return []
        from harness.mission.library import everything
        from harness.ssp.library import load

        with load(system):
            known = {measure.name for measure in everything().measures} | {"macro step"}
        names = [name.strip() for name in self.measures.split(",")]
        for name in names:
            if name not in known:
                raise UsageError(f"--measures {name}: no such measure{did_you_mean(name, known)}")
        return names


@command("compare", "set", "map", "on", "step", "stop", "require")
def compare_command(  # noqa: PLR0913 - one argument per option or group of them
    *,
    system: SystemArgument,
    varied: Varied,
    output: Annotated[Path | None, output("Folder to write (default: results/SYSTEM)")] = None,
    compared: Compared,
    pictures: Pictures,
    strict: StrictOption = False,
    quiet: QuietOption = False,
    changes: Any,
) -> None:
    """Run variants side by side: one table and figures.

    Every combination of the given values runs, in parallel, in the set that the system has for
    comparisons unless --params names others. Results, table and figures go to one folder.
    """
    from harness.cli.verdicts import insist
    from harness.master.progress import progress_bar
    from harness.studies.compare import compare
    from harness.studies.variants import combinations

    names = compared.columns(system)
    variants = combinations(changes, varied.options())
    folder = output or Path("results") / Path(system).stem
    how = compared.how()
    shown = not quiet and sys.stderr.isatty()
    with progress_bar(f"{len(variants)} runs", len(variants), shown) as show:
        found = compare(system, variants, folder, progress=show, **how)
    if found.results and not quiet:
        typer.echo(printable(found.text(names)))
    written = _written(found.results, folder, pictures)
    if not quiet:
        typer.echo(f"\n{written} in {folder}")
    if found.failures:
        raise ComparisonError("\n".join(found.failures))
    insist(found.results, changes.get("require", ()), strict)


def _written(results: Any, folder: Path, pictures: Pictures) -> str:
    """Draw the figures of a comparison; what its folder holds."""
    if not pictures.figures:
        return "results and comparison.csv"
    from harness.figures.plots import overlay

    drawn = overlay(results, folder, *pictures.how())
    return f"results, comparison.csv and {len(drawn)} figures"


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """How a campaign is run, judged and shown."""

    output: DatasetOption = None
    cluster: Cluster
    resume: ResumeOption = False
    require: Annotated[
        Texts,
        option(
            "--require 'success >= 99 %'", "Require this of shares or metrics, else exit status 1"
        ),
    ] = None
    strict: Annotated[
        bool, option("--strict", "Let [expected], or success of every run, decide on the status")
    ] = False
    pictures: Pictures
    quiet: QuietOption = False

    def run(self, definition: Path) -> None:
        """Run a campaign, print what came of it and draw it."""
        from harness.cli import campaigns
        from harness.studies.campaign.campaign import campaign

        folder = self.output or Path("results") / f"{definition.stem}.zarr"
        how: dict[str, Any] = {"resume": self.resume, "strict": self.strict}
        how |= {"require": self.require or (), **asdict(self.cluster)}
        said = (lambda text: None) if self.quiet else (lambda text: typer.echo(text, err=True))
        problem = None
        with campaigns.counting(definition.stem, not self.quiet) as show:
            try:
                seen = campaigns.drawing_soon(show) if self.pictures.figures else show
                found = campaign(definition, folder, progress=seen, said=said, **how)
            except RequirementError as error:  # all is there
                found, problem = error.partial, error
        drawn = ""
        if self.pictures.figures:
            place = figures_of(folder)
            number = len(campaigns.pictures(found.store, place, *self.pictures.how()))
            drawn = f", {number} figures in {place}" if number else ""
        if not self.quiet:
            typer.echo(f"{printable(found.summary())}\n\ndataset {folder}{drawn}")
        if problem is not None:
            raise problem


@command("campaign")
def campaign_command(definition: StudyArgument, campaign: Campaign) -> None:
    """Run a system thousands of times.

    The file sets what varies; metrics, failures and histories go to one Zarr dataset.
    """
    campaign.run(_file(definition))


def _file(given: Path) -> Path:
    """The file of a campaign; one of the missions at hand by its name."""
    from harness.mission.library import campaigns

    return given if given.suffix else campaigns().get(str(given), given)


# ---- studies that ask on

STUDIES = {
    "sensitivity": """Find out which factors matter.

    By Morris or Sobol; for the dataset of a complete campaign, OUT.zarr, by dependence (HSIC),
    without further flights.
    """,
    "worst": """Search for the worst flight of each requirement.

    Status 1 if a requirement fails in a flight that was found.
    """,
    "probability": """Estimate how probable a failure is.

    By subset simulation, importance sampling or random flights. Status 1 unless the probability is
    below the entry `below`.
    """,
    "map": "Map where a requirement fails, over two factors.",
    "tune": "Tune gains for the best worst margin over draws and an archive of worst flights.",
}
"""Commands and their help, by the name of their table in the file."""


@dataclass(frozen=True)
class How:
    """Where a study writes, and by whom its runs are performed."""

    output: DatasetOption = None
    workers: WorkersOption = None
    resume: ResumeOption = False
    quiet: QuietOption = False

    def ask(self, kind: str, definition: Path) -> bool:
        """Run a study and print what it found; whether that is well."""
        from harness.cli.campaigns import counting
        from harness.studies.inquiry import STUDIES

        target = self.output or Path("results") / f"{definition.stem}_{kind}.zarr"
        with counting(kind, not self.quiet and sys.stderr.isatty()) as show:
            found = STUDIES[kind](
                definition,
                target,
                workers=self.workers,
                resume=self.resume,
                progress=show,
                said=lambda text: None if self.quiet else typer.echo(printable(text)),
            )
        if not self.quiet:
            typer.echo(f"{printable(found.summary())}\n\ndataset {found.path}")
        return found.verdict


def _add(kind: str, text: str) -> None:
    """Add the command of a study."""

    @command(kind, text=inspect.cleandoc(text))
    def study(definition: StudyArgument, how: How) -> None:
        if not how.ask(kind, _file(definition)):
            raise typer.Exit(1)


for each in STUDIES.items():
    _add(*each)


@command("study")
def study_command(
    name: Annotated[
        str | None, argument("[NAME]", "Campaign of the project; without a name: list them")
    ] = None,
    *,
    how: How,
) -> None:
    """Run a campaign or the studies of a file of the project.

    A file with tables such as [worst] is asked these questions, one after the other, each into
    results/NAME_KIND.zarr. `harness worst NAME` asks one of them, `harness campaign NAME` runs the
    plain campaign.
    """
    from harness.mission.library import campaigns
    from harness.studies.campaign.draft import table_of

    known = campaigns()
    if name is None:
        typer.echo("\n".join(known))
        return
    if name not in known:
        raise UsageError(f"{name}: there is no such study{did_you_mean(name, known)}")
    table = table_of(known[name])
    kinds = [kind for kind in STUDIES if isinstance(table.get(kind), Mapping)]
    if len(kinds) > 1 and how.output:
        raise UsageError(f"--output: {len(kinds)} studies; ask one, as harness {kinds[0]} {name}")
    if not kinds:
        campaign = Campaign(
            output=how.output,
            cluster=Cluster(workers=how.workers),
            resume=how.resume,
            pictures=Pictures(),
            quiet=how.quiet,
        )
        campaign.run(known[name])
    answers = [how.ask(kind, known[name]) for kind in kinds]
    raise typer.Exit(0 if all(answers) else 1)
