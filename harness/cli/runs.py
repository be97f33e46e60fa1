# SPDX-License-Identifier: BSD-2-Clause
"""Command `harness run`."""

from __future__ import annotations

import math
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import typer

from harness.cli.options import (
    CHANGES,
    ExecutorOption,
    PatienceOption,
    QuietOption,
    StrictOption,
    Texts,
    argument,
    command,
    option,
    output,
    size_of,
    systems,
)
from harness.errors import RunError, UsageError
from harness.spelling import printable

SystemOption = Annotated[
    str | None,
    argument(
        "[SYSTEM]", "System: name, or path of an .ssp (not needed with --like RESULT)", systems
    ),
]
OutputOption = Annotated[Path | None, output("File to write: .nc or .csv")]


@dataclass(frozen=True)
class Requested:
    """Options of `harness run` that select the run and how it is executed."""

    executor: ExecutorOption = None
    every: Annotated[int | None, option("", "Record every N-th macro step")] = None
    like: Annotated[
        str | None,
        option("RESULT", "Repeat the run of this results file, or run OUT.zarr#N of a campaign"),
    ] = None
    in_process: Annotated[
        bool, option("--in-process", "Run third-party FMUs in this process, for debugging")
    ] = False
    patience: PatienceOption = None
    start: Annotated[
        Texts, option("C=FILE", "Start a body from a CCSDS OEM or two-line elements")
    ] = None
    epoch: Annotated[
        str | None,
        option("DATE", "Set the UTC of t = 0 (for --start, direction of the Sun, date of results)"),
    ] = None

    def run(self, system: str | None, changes: dict[str, Any]) -> Any:
        """Return the run to execute: a run of `system` with changes, or with --like the repetition
        of a result; raise UsageError if neither is given.
        """
        from harness.studies.rerun import Rerun, again

        changes = self._started(system, changes)
        if self.like is not None:
            return again(self.like, system, changes)  # type: ignore[arg-type]
        if system is None:
            raise UsageError(
                "SYSTEM is missing: give a name (`harness list` shows them) or path, or "
                "--like RESULT"
            )
        return Rerun(system, changes)  # type: ignore[arg-type]

    def _started(self, system: str | None, changes: dict[str, Any]) -> dict[str, Any]:
        """Return `changes` completed by the epoch of --epoch and the start values in the files of
        --start; a value of --set replaces a start value. Raise UsageError if --epoch or --start is
        given without a system.
        """
        if not self.start and self.epoch is None:
            return changes
        from harness.master.changes import pairs
        from harness.mission.exchange import start_values
        from harness.ssp.library import load

        if system is None:
            raise UsageError(
                f"--{'start' if self.start else 'epoch'}: SYSTEM is missing: give its name or path"
            )
        with load(system) as found:
            files = dict(pairs("--start", self.start or ()))
            begun = start_values(found, files, self.epoch, **changes)
        for note in begun.notes:
            typer.echo(printable(f"note: {note}"))
        given = {**begun.values, **dict(pairs("--set", changes.get("set", ())))}
        return {**changes, "set": given, "epoch": begun.epoch}

    def how(self, wanted: Any) -> dict[str, Any]:
        """Return the keyword arguments of simulate(). wanted: the run to execute; its settings
        apply where the command line has no option.
        """
        return {
            "executor": self.executor or wanted.executor,
            "every": wanted.every if self.every is None else self.every,
            "in_process": self.in_process,
            "patience": math.inf if self.patience is None else self.patience,
        }


@command("run", *CHANGES)
def run_command(  # noqa: PLR0913 - one argument per option or group of them
    *,
    system: SystemOption = None,
    changes: Any,
    output: OutputOption = None,
    requested: Requested,
    strict: StrictOption = False,
    quiet: QuietOption = False,
) -> None:
    """Run a system and write the results.

    Without -o the results are in results/SYSTEM.nc. If --like names a results file, they are in
    results/SYSTEM_again.nc, and the exit status is 1 if the bits differ from that file.
    """
    # OpenBLAS starts no further threads, since they would have no work in a run
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from harness.files.cache import with_second_try
    from harness.results.files import ResultFile
    from harness.studies.rerun import agreement

    wanted = requested.run(system, changes)
    name = f"{Path(wanted.system).stem or 'run'}{'' if wanted.model is None else '_again'}"
    file = ResultFile(output or Path("results") / f"{name}.nc")
    how = requested.how(wanted)
    result = with_second_try(lambda: _run(wanted, file, how, quiet))
    if wanted.model is not None:
        is_other = bool(changes or requested.start or requested.epoch or requested.every)
        equal, line = agreement(wanted.model, result, is_other)
        typer.echo(line)
        if not equal:
            raise typer.Exit(1)
    elif requested.like is not None and not quiet:
        typer.echo(f"next: harness report {file.path} -o {file.path.stem}.html")
    if strict or "require" in changes:
        from harness.cli.verdicts import insist

        insist({"": result}, changes.get("require", ()), strict)


def _run(wanted: Any, file: Any, how: dict[str, Any], quiet: bool) -> Any:
    """Run the system, write the result to `file` and print a summary unless `quiet`. If the run
    fails, write the rows recorded so far.
    """
    from harness.files.signals import held
    from harness.master.changes import apply
    from harness.master.isolated import simulate
    from harness.master.remainder import rest
    from harness.results.requirements import log_inconsistencies
    from harness.ssp.library import load
    from harness.system.graph import log_warnings

    began = perf_counter()
    with load(wanted.system) as found:
        changed = rest(apply(found, **wanted.changes))
        log_warnings(changed)
        log_inconsistencies(changed)
        file.accept(changed)
        with held():  # Ctrl-C takes effect after the rows are written
            try:
                progress = not quiet and sys.stderr.isatty()
                result = simulate(changed, progress=progress, **how)
            except RunError as error:
                if error.partial is not None:
                    error.append(_write_partial(file, error.partial))
                raise
            seconds = perf_counter() - began
            file.write(result)
            if not quiet:
                _report(result, seconds, file.path)
    return result


def _write_partial(file: Any, partial: Any) -> str:
    """Write the rows of a run that ended early and return a text that names the file. If the run
    was interrupted after its last step, the result is complete and written as such.
    """
    if partial.complete:
        file.write(partial)
        return f"all {len(partial.time)} rows are in {file.path}"
    path, error = file.write_partial(partial)
    return f"{len(partial.time)} recorded rows are in {path}" + (f" ({error})" if error else "")


def _report(result: Any, seconds: float, path: Path) -> None:
    from harness.mission.library import notes_of
    from harness.results.requirements import findings

    typer.echo(
        f"{printable(result.system)}: {result.time[-1]:g} s in {seconds:.2f} s, "
        f"{len(result.time)} rows in {path}{size_of(path)}"
    )
    for note in notes_of(result):
        typer.echo(printable(f"note: {note}"))
    for finding in findings(result):
        typer.echo(f"requirement {printable(str(finding))}")
