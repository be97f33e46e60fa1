# SPDX-License-Identifier: BSD-2-Clause
"""Studies that ask on: `harness sensitivity`, `worst`, `probability`, `map`, `tune`; all of a file
of the project: `harness study`.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import Pictures, QuietOption, takes
from harness.cli.studies import (
    Cluster,
    DatasetOption,
    ExpectedOption,
    HeldOption,
    ResumeOption,
    WorkersOption,
    campaign_command,
)
from harness.errors import UsageError
from harness.spelling import printable

app = typer.Typer()

FileArgument = Annotated[
    Path, typer.Argument(metavar="CAMPAIGN.toml", help="System, factors, requirements, the study")
]
EitherArgument = Annotated[
    Path,
    typer.Argument(
        metavar="CAMPAIGN.toml|OUT.zarr", help="File, or dataset of a complete campaign"
    ),
]


@dataclass(frozen=True)
class How:
    """Where a study writes, and by whom its runs are performed."""

    output: DatasetOption = None
    workers: WorkersOption = None
    resume: ResumeOption = False
    quiet: QuietOption = False


@app.command("sensitivity")
@takes("how", How)
def sensitivity_command(definition: EitherArgument, how: Any = None) -> None:
    """Find out which factors matter.

    By Morris or Sobol; for a complete campaign by dependence (HSIC), without further flights.
    """
    _study("sensitivity", definition, how)


@app.command("worst")
@takes("how", How)
def worst_command(definition: FileArgument, how: Any = None) -> None:
    """Search for the worst flight of each requirement.

    Status 1 if a requirement fails in a flight that was found.
    """
    _study("worst", definition, how)


@app.command("probability")
@takes("how", How)
def probability_command(definition: FileArgument, how: Any = None) -> None:
    """Estimate how probable a failure is.

    By subset simulation, importance sampling or random flights. Status 1 unless the probability is
    below the entry `below`.
    """
    _study("probability", definition, how)


@app.command("map")
@takes("how", How)
def map_command(definition: FileArgument, how: Any = None) -> None:
    """Map where a requirement fails, over two factors."""
    _study("map", definition, how)


@app.command("tune")
@takes("how", How)
def tune_command(definition: FileArgument, how: Any = None) -> None:
    """Tune gains for the best worst margin over draws and an archive of worst flights."""
    _study("tune", definition, how)


def _study(kind: str, definition: Path, how: How) -> None:
    if not ask(kind, definition, how):
        raise typer.Exit(1)


def ask(kind: str, definition: Path, how: How) -> bool:
    """Run a study and print what it found; whether that is well."""
    from harness.cli.campaigns import counting
    from harness.studies.inquiry.studies import STUDIES

    target = how.output or Path("results") / f"{definition.stem}_{kind}.zarr"
    with counting(kind, not how.quiet and sys.stderr.isatty()) as show:
        found = STUDIES[kind](
            definition,
            target,
            workers=how.workers,
            resume=how.resume,
            progress=show,
            said=(lambda text: None) if how.quiet else (lambda text: typer.echo(printable(text))),
        )
    typer.echo(printable(found.summary()))
    typer.echo(f"\ndataset {found.path}")
    return found.verdict


@app.command("study")
@takes("pictures", Pictures)
@takes("cluster", Cluster)
def study_command(  # noqa: PLR0913, PLR0917 - one argument per option or group of them
    name: Annotated[
        str | None,
        typer.Argument(metavar="[NAME]", help="Campaign of the project; without a name: list them"),
    ] = None,
    kind: Annotated[
        str | None,
        typer.Option(metavar="KIND", help="Run this study of the file, or campaign"),
    ] = None,
    output: DatasetOption = None,
    cluster: Any = None,
    resume: ResumeOption = False,
    require: HeldOption = None,
    strict: ExpectedOption = False,
    pictures: Any = None,
    quiet: QuietOption = False,
) -> None:
    """Run a campaign or the studies of a file of the project.

    A file with tables such as [worst] is asked these questions, one after the other, each into
    results/NAME_KIND.zarr; --kind chooses one of them, or the plain campaign.
    """
    from harness.mission.library import campaigns
    from harness.spelling import did_you_mean

    known = campaigns()
    if name is None:
        typer.echo("\n".join(known))
        return
    if name not in known:
        raise UsageError(f"{name}: there is no such study{did_you_mean(name, known)}")
    kinds = _kinds(known[name], kind)
    if kinds == ["campaign"]:
        how: dict[str, Any] = {**asdict(cluster), **asdict(pictures), "resume": resume}
        how |= {"require": require, "strict": strict, "quiet": quiet}
        campaign_command(definition=known[name], output=output, **how)
        return
    if len(kinds) > 1 and output:
        raise UsageError(f"--output: one dataset, {len(kinds)} studies; --kind chooses one")
    if require or strict or cluster != Cluster(workers=cluster.workers):
        raise UsageError("--require, --strict, clusters: of campaigns; studies take --workers")
    asked = How(output, cluster.workers, resume, quiet)
    answers = [ask(each, known[name], asked) for each in kinds]
    raise typer.Exit(0 if all(answers) else 1)


def _kinds(path: Path, wanted: str | None) -> list[str]:
    """What a file is run for: the studies that it describes, else a campaign; or what is wanted."""
    from harness.spelling import did_you_mean
    from harness.studies.campaign.draft import table_of
    from harness.studies.inquiry.studies import STUDIES

    table = table_of(path)
    described = [kind for kind in STUDIES if isinstance(table.get(kind), Mapping)]
    if wanted is None:
        return described or ["campaign"]
    if wanted not in (known := [*described, "campaign"]):
        raise UsageError(
            f"--kind {wanted}: not in {path.name}{did_you_mean(wanted, known)}; "
            f"there are: {', '.join(known)}"
        )
    return [wanted]
