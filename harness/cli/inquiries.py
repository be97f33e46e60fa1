# SPDX-License-Identifier: BSD-2-Clause
"""Studies that ask on: `harness sensitivity`, `worst`, `probability`, `map` and `tune`."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from harness.cli.options import QuietOption, takes
from harness.cli.studies import DatasetOption, ResumeOption, WorkersOption
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
    from harness.cli.campaigns import counting
    from harness.studies.inquiry.study import STUDIES

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
    if not found.verdict:
        raise typer.Exit(1)
