# SPDX-License-Identifier: BSD-2-Clause
"""Commands for many runs of a system: `harness compare`, `harness campaign`, the analyses
`sensitivity`, `worst`, `probability`, `boundary`, `tune`, and `harness study` for a file of the
project.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import (
    Drawing,
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
from harness.spelling import did_you_mean, printable

StudyArgument = Annotated[
    Path, argument("CAMPAIGN.toml", "File with system, factors, study; or NAME of the project")
]
DatasetOption = Annotated[Path | None, output("Dataset to write (default: results/NAME.zarr)")]
WorkersOption = Annotated[
    int | None, option("", "Use N processes or jobs (default: processors; 0: this one)")
]
LanesOption = Annotated[
    bool, option("--lanes/--no-lanes", "Make several fused runs of a worker at once")
]
ResumeOption = Annotated[bool, option("--resume", "Continue after an interruption")]


@dataclass(frozen=True)
class Cluster:
    """Workers of a campaign and the connection to them."""

    workers: WorkersOption = None
    scheduler: Annotated[str | None, option("ADDRESS", "Use the Dask cluster at this address")] = (
        None
    )
    slurm: Annotated[bool, option("--slurm", "Submit the workers as SLURM jobs")] = False
    lanes: LanesOption = True
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
    """Factors of a comparison."""

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
        """Return the options with their values as arguments of combinations()."""
        several = {"swap": self.swap, "latency": self.latency, "set": self.vary}
        varied = [("params", self.params), ("algorithm", self.algorithm)]
        varied += [(option, text) for option, texts in several.items() for text in texts or ()]
        return [(option, text) for option, text in varied if text]


@dataclass(frozen=True)
class Compared:
    """Execution of the variants, and the columns of their table."""

    executor: ExecutorOption = None
    every: Annotated[
        int | None, option("", "Record every N-th macro step (default: 20 000 rows)")
    ] = None
    metrics: Annotated[str | None, option("A,B,..", "Columns of the table (default: all)")] = None
    patience: PatienceOption = None

    def how(self) -> dict[str, Any]:
        """Return the arguments of compare()."""
        from harness.master.isolated import PATIENCE

        return {
            "every": self.every,
            "patience": PATIENCE if self.patience is None else self.patience,
            "executor": self.executor or "c",
        }

    def columns(self, system: str) -> list[str]:
        """Return the columns of the table, all by default; raise UsageError for an
        unknown metric.
        """
        if not self.metrics:
            return []
        from harness.mission.library import everything
        from harness.ssp.library import load

        with load(system):
            known = {metric.name for metric in everything().metrics} | {"macro step"}
        names = [name.strip() for name in self.metrics.split(",")]
        for name in names:
            if name not in known:
                raise UsageError(
                    f"--metrics {name}: there is no such metric{did_you_mean(name, known)}"
                )
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

    Every combination of the given values runs, in parallel, in the parameter set that the system
    defines for comparisons, unless --params names others. Results, table and figures go to one
    folder.
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


@command("bound", "params", "set", "swap", "map", "step", "stop")
def bound_command(  # noqa: PLR0913 - one argument per option or group of them
    *,
    system: SystemArgument,
    output: Annotated[Path | None, output("File for the run of the optimal force")] = None,
    cost: Annotated[str, option("--cost sum|norm", "Count force per axis, or its length")] = "sum",
    grid: Annotated[float | None, option("", "Solve on a grid of this step [s]")] = None,
    without: Annotated[Texts, option("--without NAME", "Leave this constraint out")] = None,
    store: Annotated[bool, option("", "Let reports and comparisons here show the optimum")] = False,
    changes: Any,
) -> None:
    """Show what a run, or each phase of a mission, would have cost at least.

    The least impulse is the optimum of a convex problem with the constraints of the mission. Its
    force is simulated open loop: with the requirements of the system, or phase by phase with the
    plants of both bodies.
    """
    from harness.studies import optimum

    if store and (cost != "sum" or without):
        raise UsageError("--store: is valid only with all constraints and --cost sum")
    found = optimum.bound(system, cost=cost, grid=grid, without=without or (), **changes)
    for line in found.lines():
        typer.echo(line)
    if store:
        typer.echo(f"stored in {optimum.store(found)}")
    if output is None:
        return
    if isinstance(found, optimum.PhaseAnswer):
        raise UsageError(
            f"-o {output}: optima of phases are simulated one by one, there is no single run"
        )
    found.verified.save(output)


def _written(results: Any, folder: Path, pictures: Pictures) -> str:
    """Draw the figures of a comparison, and return the contents of its folder as text."""
    if not pictures.figures:
        return "results and comparison.csv"
    from harness.figures.plots import overlay

    drawn = overlay(results, folder, *pictures.how())
    return f"results, comparison.csv and {len(drawn)} figures"


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """Settings of a campaign: execution, gates, output."""

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
    figures: Annotated[
        bool, option("--figures/--no-figures", "Draw figures, as `harness plot OUT.zarr` does")
    ] = False
    drawing: Drawing
    quiet: QuietOption = False

    def run(self, definition: Path) -> None:
        """Run a campaign, print its summary and draw its figures if wanted."""
        from harness.cli.watch import counting
        from harness.studies.campaign.campaign import campaign

        folder = self.output or Path("results") / f"{definition.stem}.zarr"
        how: dict[str, Any] = {"resume": self.resume, "strict": self.strict}
        how |= {"require": self.require or (), **asdict(self.cluster)}
        notify = (lambda text: None) if self.quiet else (lambda text: typer.echo(text, err=True))
        problem = None
        with counting(definition.stem, not self.quiet) as show:
            try:
                found = campaign(definition, folder, progress=show, notify=notify, **how)
            except RequirementError as error:  # the dataset is complete
                found, problem = error.partial, error
        drawn = ""
        if self.figures:
            from harness.report.campaign import pictures

            place = figures_of(folder)
            drawn = f", {len(pictures(folder, place, *self.drawing.how()))} figures in {place}"
        if not self.quiet:
            typer.echo(f"{printable(found.summary())}\n\ndataset {folder}{drawn}")
            typer.echo(_next(folder))
        if problem is not None:
            raise problem


def _next(dataset: Path) -> str:
    """Return the line with the command that shows a dataset."""
    return f"next: harness report {dataset} -o {dataset.stem}.html"


@command("campaign")
def campaign_command(definition: StudyArgument, campaign: Campaign) -> None:
    """Run a system thousands of times.

    The file defines the factors. Metrics, failures and histories go to one Zarr dataset.
    """
    campaign.run(_file(definition))


def _file(given: Path) -> Path:
    """Return the file of a campaign; an available mission provides it by its name."""
    from harness.mission.library import campaigns

    if given.suffix or given.exists():
        return given
    known = campaigns()
    if str(given) not in known:
        close = did_you_mean(str(given), known) or "; `harness study` lists the campaigns"
        raise UsageError(f"{given}: there is no such file or campaign{close}")
    return known[str(given)]


# ---- analyses

STUDIES = {
    "sensitivity": """Find out which factors matter.

    By Morris or Sobol; for the dataset of a complete campaign, OUT.zarr, by dependence (HSIC),
    without further runs.
    """,
    "worst": """Search for the worst run of each requirement.

    Status 1 if a requirement fails in a run of the search.
    """,
    "probability": """Estimate how probable a failure is.

    By subset simulation or random runs. Status 1 unless the probability is below the entry
    `below`.
    """,
    "boundary": "Map where a requirement fails, over two factors.",
    "tune": "Tune gains for the best worst margin over draws and an archive of worst runs.",
}
"""Commands and their help, by the name of their table in the file."""


@dataclass(frozen=True)
class How:
    """Output and workers of a study."""

    output: DatasetOption = None
    workers: WorkersOption = None
    lanes: LanesOption = True
    resume: ResumeOption = False
    quiet: QuietOption = False

    def run(self, kind: str, definition: Path) -> bool:
        """Run a study, print its summary and return whether its verdict is positive."""
        from harness.cli.watch import counting
        from harness.studies.analyses import STUDIES

        target = self.output or Path("results") / f"{definition.stem}_{kind}.zarr"
        with counting(kind, not self.quiet and sys.stderr.isatty()) as show:
            found = STUDIES[kind](
                definition,
                target,
                workers=self.workers,
                lanes=self.lanes,
                resume=self.resume,
                progress=show,
                notify=lambda text: None if self.quiet else typer.echo(printable(text)),
            )
        if not self.quiet:
            typer.echo(f"{printable(found.summary())}\n\ndataset {found.path}")
            follows = kind == "sensitivity" and definition.suffix == ".toml"
            typer.echo(f"next: harness worst {definition}" if follows else _next(found.path))
        return found.verdict


def _add(kind: str, text: str) -> None:
    """Add the command of a study."""

    @command(kind, text=inspect.cleandoc(text))
    def study(definition: StudyArgument, how: How) -> None:
        if not how.run(kind, _file(definition)):
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

    Each table such as [worst] is one study, whose dataset is results/NAME_KIND.zarr. `harness worst
    NAME` runs one of them, `harness campaign NAME` runs the plain campaign.
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
        raise UsageError(
            f"--output: the file defines {len(kinds)} studies; run one: harness {kinds[0]} {name}"
        )
    if not kinds:
        campaign = Campaign(
            output=how.output,
            cluster=Cluster(workers=how.workers, lanes=how.lanes),
            resume=how.resume,
            drawing=Drawing(),
            quiet=how.quiet,
        )
        campaign.run(known[name])
    verdicts = [how.run(kind, known[name]) for kind in kinds]
    raise typer.Exit(0 if all(verdicts) else 1)
