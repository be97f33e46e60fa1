# SPDX-License-Identifier: BSD-2-Clause
"""`harness run`."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer

from harness.cli.options import (
    ExecutorOption,
    PatienceOption,
    QuietOption,
    StrictOption,
    completed_systems,
    figures_of,
    size_of,
    takes,
    takes_changes,
)
from harness.errors import RunError, UsageError
from harness.spelling import printable

app = typer.Typer()


OutputOption = Annotated[
    Path | None, typer.Option("--output", "-o", help="File to write: .nc, .csv, .mat or .parquet")
]
RecordOption = Annotated[int | None, typer.Option(help="Record every N-th macro step")]
LikeOption = Annotated[
    str | None,
    typer.Option(
        metavar="RESULT",
        help="Repeat this result (.nc, .csv, .mat), or run OUT.zarr#N of a campaign",
    ),
]
SystemOption = Annotated[
    str | None,
    typer.Argument(
        metavar="[SYSTEM]",
        help="System: name, or path of an .ssp (not needed with --like RESULT)",
        autocompletion=completed_systems,
    ),
]
WatchOption = Annotated[
    bool, typer.Option("--watch", help="Show range, errors, speed and phase during the run")
]
StartOption = Annotated[
    list[str] | None,
    typer.Option(metavar="C=FILE", help="Start a body from a CCSDS OEM or two-line elements"),
]
EpochOption = Annotated[
    str | None,
    typer.Option(metavar="DATE", help="Set the UTC of t = 0: for --start, the Sun, the result"),
]
InProcessOption = Annotated[
    bool, typer.Option("--in-process", help="Run third-party FMUs in this process, for debugging")
]
RealtimeOption = Annotated[
    float | None, typer.Option(metavar="FACTOR", help="Keep pace with a clock (1: real time)")
]
LateOption = Annotated[
    str | None,
    typer.Option(metavar="wait|hold|stop", help="Choose what to do if a remote component is late"),
]


@dataclass(frozen=True)
class Live:
    """What shows a run while it goes, and its pace."""

    watch: WatchOption = False
    realtime: RealtimeOption = None
    late: LateOption = None

    def shown(self, quiet: bool) -> dict[str, Any]:
        """Arguments of simulate(): what is called with the progress, and the pacer."""
        from harness.master.pacer import Pacer

        how: dict[str, Any] = {"progress": not quiet and sys.stderr.isatty()}
        if self.watch:
            from harness.cli.watch import watched

            how["progress"] = watched
        if self.realtime is not None:
            how["pacer"] = Pacer(self.realtime)
        return how


@app.command("run")
@takes_changes(
    "params", "set", "swap", "map", "on", "latency", "step", "stop", "algorithm", "require"
)
@takes("live", Live)
def run_command(  # noqa: PLR0913, PLR0917 - one argument per option or group of them
    system: SystemOption = None,
    changes: Any = None,
    output: OutputOption = None,
    executor: ExecutorOption = None,
    every: RecordOption = None,
    like: LikeOption = None,
    in_process: InProcessOption = False,
    patience: PatienceOption = None,
    start: StartOption = None,
    epoch: EpochOption = None,
    strict: StrictOption = False,
    live: Any = None,
    quiet: QuietOption = False,
) -> None:
    """Run a system and write the results.

    Default: results/SYSTEM.nc. With --like RESULT the exit status is 1 if the bits differ.
    """
    from harness.cli.verdicts import insist
    from harness.results.files import ResultFile

    wanted = _wanted(system, like, _started(system, start, epoch, changes))
    name = f"{Path(wanted.system).stem or 'run'}{'' if wanted.model is None else '_again'}"
    file = ResultFile(output or Path("results") / f"{name}.nc")
    how = {
        **live.shown(quiet),
        "executor": executor or wanted.executor,
        "every": wanted.every if every is None else every,
        "in_process": in_process,
        "patience": math.inf if patience is None else patience,
    }
    result = _run(wanted.system, wanted.changes, file, how, quiet, live.late)
    if wanted.model is not None:
        _say_whether_equal(wanted.model, result, bool(changes or start or every))
    elif like is not None:
        _draw(result, figures_of(file.path))
    insist({"": result}, changes.get("require", ()), strict)


def _started(
    system: str | None, start: list[str] | None, epoch: str | None, changes: Any
) -> dict[str, Any]:
    """The changes with the epoch, and start values from files below those of --set."""
    if not start and epoch is None:
        return dict(changes)
    from harness.exchange.start import start_values
    from harness.master.changes import pairs
    from harness.ssp.library import load

    if system is None:
        raise UsageError(f"--{'start' if start else 'epoch'}: SYSTEM is missing")
    with load(system) as found:
        begun = start_values(found, dict(pairs("--start", start or ())), epoch, **changes)
    for note in begun.notes:
        typer.echo(printable(f"note: {note}"))
    given = {**begun.values, **dict(pairs("--set", changes.get("set", ())))}
    return {**changes, "set": given, "epoch": begun.epoch}


def _wanted(system: str | None, like: str | None, changes: Any) -> Any:
    """What the command line asks for."""
    from harness.studies.again import Again, again

    if like is not None:
        return again(like, system, changes)
    if system is None:
        raise UsageError("SYSTEM is missing (harness list shows them), or --like RESULT")
    return Again(system, changes)


def _draw(result: Any, folder: Path) -> None:
    """Figures of a run, if anything changes in it."""
    from harness.figures.plots import plot

    if (result.values == result.values[0]).all():
        typer.echo("no figures: nothing that the result holds changes")
        return
    for path in plot(result, folder):
        typer.echo(path)


def _say_whether_equal(model: Any, result: Any, asked: bool) -> None:
    from harness.studies.again import agreement

    equal, line = agreement(model, result, asked)
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
    from harness.results.requirements import say_inconsistencies
    from harness.ssp.library import load
    from harness.system.graph import say_warnings

    began = perf_counter()
    with load(system) as found:
        pacer = how.get("pacer")
        changed = timely(found, changes, None if pacer is None else pacer.factor, late)
        say_warnings(changed)
        say_inconsistencies(changed)
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
    return f"{len(partial.time)} recorded rows are in {file.keep(partial)}"


def _report(result: Any, seconds: float, path: Path) -> None:
    from harness.mission.library import notes_of
    from harness.results.requirements import findings

    typer.echo(
        f"{printable(result.system)}: {result.time[-1]:g} s in {seconds:.2f} s, "
        f"{len(result.time)} rows in {path}{size_of(path)}"
    )
    if result.provenance is not None and result.provenance.timing:
        typer.echo(f"pace: {result.provenance.timing}")
    for note in notes_of(result):
        typer.echo(printable(f"note: {note}"))
    for finding in findings(result):
        typer.echo(f"requirement {printable(str(finding))}")
