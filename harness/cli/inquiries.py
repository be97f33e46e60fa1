# SPDX-License-Identifier: BSD-2-Clause
"""Studies that ask on: `harness sensitivity`, `worst`, `probability`, `map` and `tune`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.options import QuietOption
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


@app.command("sensitivity")
def sensitivity_command(
    definition: EitherArgument,
    output: DatasetOption = None,
    workers: WorkersOption = None,
    resume: ResumeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Find out which factors matter.

    By Morris or Sobol; for a complete campaign by dependence (HSIC), without further flights.
    """
    _study("sensitivity", definition, output, workers, resume, quiet)


@app.command("worst")
def worst_command(
    definition: FileArgument,
    output: DatasetOption = None,
    workers: WorkersOption = None,
    resume: ResumeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Search for the worst flight of each requirement.

    Status 1 if a requirement fails in a flight that was found.
    """
    _study("worst", definition, output, workers, resume, quiet)


@app.command("probability")
def probability_command(
    definition: FileArgument,
    output: DatasetOption = None,
    workers: WorkersOption = None,
    resume: ResumeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Estimate how probable a failure is.

    By subset simulation, importance sampling or random flights. Status 1 unless the probability is
    below the entry `below`.
    """
    _study("probability", definition, output, workers, resume, quiet)


@app.command("map")
def map_command(
    definition: FileArgument,
    output: DatasetOption = None,
    workers: WorkersOption = None,
    resume: ResumeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Map where a requirement fails, over two factors."""
    _study("map", definition, output, workers, resume, quiet)


@app.command("tune")
def tune_command(
    definition: FileArgument,
    output: DatasetOption = None,
    workers: WorkersOption = None,
    resume: ResumeOption = False,
    quiet: QuietOption = False,
) -> None:
    """Tune gains for the best worst margin over draws and an archive of worst flights."""
    _study("tune", definition, output, workers, resume, quiet)


def _study(  # noqa: PLR0913, PLR0917 - what the command line says
    kind: str,
    definition: Path,
    output: Path | None,
    workers: int | None,
    resume: bool,
    quiet: bool,
) -> None:
    from harness.cli.campaigns import counting
    from harness.studies.inquiry.study import STUDIES

    target = output or Path("results") / f"{definition.stem}_{kind}.zarr"
    with counting(kind, not quiet and sys.stderr.isatty()) as show:
        found = STUDIES[kind](
            definition,
            target,
            workers=workers,
            resume=resume,
            progress=show,
            said=(lambda text: None) if quiet else (lambda text: typer.echo(printable(text))),
        )
    typer.echo(printable(found.summary()))
    typer.echo(f"\ndataset {found.path}")
    if not found.verdict:
        raise typer.Exit(1)
