# SPDX-License-Identifier: BSD-2-Clause
"""Commands for many runs of a system: `harness compare`, `harness campaign`, the analyses
`sensitivity` and `worst`, `harness study` for a file of the project. Also `harness bound`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import (
    Drawing,
    ExecutorOption,
    PatienceOption,
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
    Path, argument("CAMPAIGN.toml", "Campaign file, or NAME of a campaign of the project")
]


@dataclass(frozen=True)
class How:
    """Options of campaigns and analyses: output, workers and display."""

    output: Annotated[Path | None, output("Dataset to write (default: in results/)")] = None
    workers: Annotated[
        int | None, option("", "Use N workers (default: one per processor; 0: this process)")
    ] = None
    lanes: Annotated[
        bool, option("--lanes/--no-lanes", "Run several fused runs at once in each worker")
    ] = True
    resume: Annotated[bool, option("--resume", "Continue after an interruption")] = False
    quiet: QuietOption = False


@dataclass(frozen=True)
class Varied:
    """Options of `harness compare` that state the values to combine."""

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
        """Return pairs (name of an option, its comma-separated values), for combinations()."""
        several = {"swap": self.swap, "latency": self.latency, "set": self.vary}
        varied = [("params", self.params), ("algorithm", self.algorithm)]
        varied += [(option, text) for option, texts in several.items() for text in texts or ()]
        return [(option, text) for option, text in varied if text]


@dataclass(frozen=True)
class Compared:
    """Options of `harness compare` for the execution of the runs and the columns of the table."""

    executor: ExecutorOption = None
    every: Annotated[
        int | None, option("", "Record every N-th macro step (default: at most 20 001 rows)")
    ] = None
    metrics: Annotated[str | None, option("A,B,..", "Columns of the table (default: all)")] = None
    patience: PatienceOption = None

    def how(self) -> dict[str, Any]:
        """Return keyword arguments of compare(): `every`, `patience` (largest duration of an FMI
        call [s]) and `executor`.
        """
        from harness.master.isolated import PATIENCE

        return {
            "every": self.every,
            "patience": PATIENCE if self.patience is None else self.patience,
            "executor": self.executor or "c",
        }

    def columns(self, system: str) -> list[str]:
        """Return the names of metrics in --metrics, [] without this option (show all metrics);
        raise UsageError for an unknown metric.
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
    drawing: Drawing,
    figures: Annotated[bool, option("--figures/--no-figures", "Draw figures, or none")] = True,
    strict: StrictOption = False,
    quiet: QuietOption = False,
    changes: Any,
) -> None:
    """Run variants of a system and compare them in one table and in figures.

    All combinations of the given values are run in parallel, with the parameter set that the system
    defines for comparisons unless --params names others. Results, table and figures are written to
    one folder.
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
    contents = "results and comparison.csv"
    if figures:
        from harness.figures.plots import overlay

        drawn = overlay(found.results, folder, *drawing.how())
        contents = f"results, comparison.csv and {len(drawn)} figures"
    if not quiet:
        typer.echo(f"\n{contents} in {folder}")
    if found.failures:
        raise ComparisonError("\n".join(found.failures))
    insist(found.results, changes.get("require", ()), strict)


@command("bound", "params", "set", "swap", "map", "step", "stop")
def bound_command(  # noqa: PLR0913 - one argument per option or group of them
    *,
    system: SystemArgument,
    output: Annotated[Path | None, output("File for the run with the optimal force")] = None,
    cost: Annotated[str, option("--cost sum|norm", "Integrate |F_x|+|F_y|+|F_z|, or |F|")] = "sum",
    grid: Annotated[float | None, option("", "Solve on a grid of this step [s]")] = None,
    without: Annotated[Texts, option("--without NAME", "Leave this constraint out")] = None,
    store: Annotated[bool, option("", "Store the optimum for reports and comparisons")] = False,
    changes: Any,
) -> None:
    """Show the least impulse for a run, or for each phase of a mission.

    The least impulse is the optimum of a convex problem with the constraints of the mission. The
    optimal force is verified by an open-loop simulation: for a run, of the system with its
    requirements; for phases, of each phase with the plants of both bodies.
    """
    from harness.results.files import save
    from harness.studies.show import bound

    if store and (cost != "sum" or without):
        raise UsageError("--store: needs --cost sum and all constraints, so no --without")
    found = bound(system, cost=cost, grid=grid, without=without or (), **changes)
    for line in found.lines():
        typer.echo(line)
    if store:
        typer.echo(f"stored in {found.store()}")
    if output is None:
        return
    if found.verified is None:
        raise UsageError(
            f"-o {output}: optima of phases are simulated one by one, so no single run can be "
            "written; omit -o"
        )
    save(found.verified, output)


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """Options of `harness campaign`: execution, conditions on the exit status, figures."""

    how: How
    require: Annotated[
        Texts,
        option(
            "--require 'success >= 99 %'", "Require this of a share or metric, else exit status 1"
        ),
    ] = None
    strict: Annotated[
        bool, option("--strict", "Exit with 1 unless [expected] holds (without it: no run fails)")
    ] = False
    figures: Annotated[
        bool, option("--figures/--no-figures", "Draw figures, as `harness plot OUT.zarr` does")
    ] = False
    drawing: Drawing

    def run(self, definition: Path) -> None:
        """Run the campaign of a TOML file, print its summary, and draw its figures if requested."""
        from harness.master.progress import counting
        from harness.studies.campaign.campaign import campaign

        how = self.how
        folder = how.output or Path("results") / f"{definition.stem}.zarr"
        problem = None
        with counting(definition.stem, not how.quiet) as show:
            try:
                found = campaign(
                    definition,
                    folder,
                    workers=how.workers,
                    lanes=how.lanes,
                    resume=how.resume,
                    require=self.require or (),
                    strict=self.strict,
                    progress=show,
                    notify=lambda text: None if how.quiet else typer.echo(text, err=True),
                )
            except RequirementError as error:  # raised below; the dataset is complete
                found, problem = error.partial, error
        drawn = ""
        if self.figures:
            from harness.report.campaign import pictures

            place = figures_of(folder)
            drawn = f", {len(pictures(folder, place, *self.drawing.how()))} figures in {place}"
        if not how.quiet:
            typer.echo(f"{printable(found.summary())}\n\ndataset {folder}{drawn}")
            typer.echo(_next(folder))
        if problem is not None:
            raise problem


def _next(dataset: Path) -> str:
    """Return a line for the user with the command that writes an HTML report of a dataset."""
    return f"next: harness report {dataset} -o {dataset.stem}.html"


@command("campaign")
def campaign_command(definition: StudyArgument, campaign: Campaign) -> None:
    """Run a system thousands of times with drawn or listed factors.

    The file defines the factors. Metrics, failures and time series go to one Zarr dataset.
    """
    campaign.run(_file(definition))


def _file(given: Path) -> Path:
    """Return the TOML file of a campaign from its path, or from its name in an available mission;
    raise UsageError for an unknown name.
    """
    from harness.mission.library import campaigns

    if given.suffix or os.path.exists(given):  # noqa: PTH110 - a Path raises for a too long name
        return given
    known = campaigns()
    if str(given) not in known:
        close = did_you_mean(str(given), known) or "; `harness study` lists the campaigns"
        raise UsageError(f"{given}: there is no such file or campaign{close}")
    return known[str(given)]


# ---- analyses


def _analyse(kind: str, definition: Path, how: How) -> bool:
    """Run an analysis, print its summary and return whether the exit status is 0 (Study.verdict);
    kind: a key of analyses.STUDIES; definition: the campaign file.
    """
    from harness.master.progress import counting
    from harness.studies.analyses import STUDIES

    target = how.output or Path("results") / f"{definition.stem}_{kind}.zarr"
    with counting(kind, not how.quiet and sys.stderr.isatty()) as show:
        found = STUDIES[kind](
            definition,
            target,
            workers=how.workers,
            lanes=how.lanes,
            resume=how.resume,
            progress=show,
            notify=lambda text: None if how.quiet else typer.echo(printable(text)),
        )
    if not how.quiet:
        typer.echo(f"{printable(found.summary())}\n\ndataset {found.path}")
        further = f"next: harness worst {definition}" if kind == "sensitivity" else ""
        typer.echo(further or _next(found.path))
    return found.verdict


@command("sensitivity")
def sensitivity_command(definition: StudyArgument, how: How) -> None:
    """Find out which factors matter.

    The method is Morris or Sobol, as the campaign file defines.
    """
    _analyse("sensitivity", _file(definition), how)


@command("worst")
def worst_command(definition: StudyArgument, how: How) -> None:
    """Search for the worst run of each requirement.

    The exit status is 1 if a requirement fails or is not evaluated in a run of the search.
    """
    if not _analyse("worst", _file(definition), how):
        raise typer.Exit(1)


@command("study")
def study_command(
    name: Annotated[
        str | None, argument("[NAME]", "Campaign of the project; without a name: list them")
    ] = None,
    *,
    how: How,
) -> None:
    """Run all studies of a campaign file of the project, or the campaign itself.

    Each table such as [worst] is one study, whose dataset is results/NAME_KIND.zarr. A file without
    such a table is run as a campaign. `harness worst NAME` runs a single study, `harness campaign
    NAME` only the campaign.
    """
    from harness.mission.library import campaigns
    from harness.studies.analyses import STUDIES
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
        Campaign(how=how, drawing=Drawing()).run(known[name])
    verdicts = [_analyse(kind, known[name], how) for kind in kinds]
    raise typer.Exit(0 if all(verdicts) else 1)
