# SPDX-License-Identifier: BSD-2-Clause
"""The public functions: what `from harness import ...` offers, and what the commands call."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from harness.master.changes import Changes, Pairs, pairs
from harness.master.isolated import PATIENCE, guarded, simulate
from harness.master.pacer import Pacer, timely
from harness.master.simulation import Simulation
from harness.results.files import read, save
from harness.results.requirements import say_inconsistencies
from harness.results.result import Result
from harness.ssp.library import load
from harness.system.graph import say_warnings, say_warnings_of
from harness.system.interface import read_interface
from harness.system.model import System
from harness.system.swap import find_fmu
from harness.system.values import plain

if TYPE_CHECKING:
    from harness.mission import Limits
    from harness.studies.campaign.campaign import Campaign
    from harness.studies.compare import Comparison
    from harness.studies.inquiry.flights import Flights
    from harness.studies.inquiry.study import Study
    from harness.studies.linearize import LinearModel
    from harness.studies.show import Shown

__all__ = [
    "Flights",
    "Result",
    "Simulation",
    "boundary",
    "build",
    "campaign",
    "compare",
    "export",
    "linearize",
    "load",
    "probability",
    "read",
    "run",
    "sensitivity",
    "show",
    "tune",
    "worst",
]

Several = Sequence[str] | Mapping[str, Sequence[Any]]
"""Values side by side: texts `name=value,value,...`, or a mapping of names to values."""


def run(  # noqa: PLR0913 - every one is an option of the command line
    system: str | Path | System,
    *,
    executor: str = "c",
    every: int | None = None,
    progress: bool = False,
    in_process: bool = False,
    patience: float = math.inf,
    realtime: float | None = None,
    late: str | None = None,
    **changes: Unpack[Changes],
) -> Result:
    """Run a system and return the recorded rows.

    system: name of a system of the project, path of an .ssp, or a System; executor: `c`, `python`
    or `fused` (equal bits); every: record every N-th macro step (default: defined by the system);
    progress: show a bar on stderr; in_process: run third-party FMUs in this process; patience:
    limit for one call into a third-party FMU [s] (docs/robustness.md); realtime: simulated seconds
    per second; late: `wait`, `hold` or `stop` if a remote component misses this pace
    (docs/processors.md); changes: deviations from the system, see harness.master.changes.Changes
    (params, set, swap, map, on, latency, step, stop, algorithm, epoch, require).

    Raises UsageError, ArchiveError, StructureError, FmuError, or RunError, whose `partial` holds
    the rows recorded before the failure.
    """
    pacer = None if realtime is None else Pacer(realtime)
    with load(system) as found:
        changed = timely(found, changes, realtime, late)
        say_warnings(changed)
        say_inconsistencies(changed)
        return simulate(
            changed,
            executor=executor,
            every=every,
            progress=progress,
            in_process=in_process,
            patience=patience,
            pacer=pacer,
        )


def compare(  # noqa: PLR0913 - every one is an option of the command line
    system: str | Path,
    folder: str | Path,
    *,
    params: Sequence[str] = (),
    swap: Several = (),
    latency: Several = (),
    vary: Several = (),
    algorithm: Sequence[str] = (),
    set: Pairs = (),
    map: Pairs = (),
    on: Pairs = (),
    step: float | None = None,
    stop: float | None = None,
    require: Sequence[str] | Mapping[str, str] = (),
    limits: Limits | None = None,
    every: int | None = None,
    patience: float = PATIENCE,
    progress: Callable[[int], None] | None = None,
    executor: str = "c",
) -> Comparison:
    """Run every combination of the given values in parallel, and measure the runs.

    folder: for the results and the table comparison.csv; params: parameter sets or files; swap:
    FMUs by component; latency: macro steps by component; vary: values by `component.parameter`;
    algorithm: names; set, map, on, step, stop, require: as for run(), the same for all; limits:
    bands and keep-out radius; every: record every N-th macro step (default: at most 20 000 rows);
    patience: limit for one call into a third-party FMU [s]; progress: called with the number of
    completed runs; executor: `c`, `python` or `fused`, as for run().

    Raises UsageError, the exceptions of run() before its first step, and ResultsError. A run that
    fails later ends early and is listed in Comparison.failures; the other runs continue.
    """
    from harness.studies import compare as comparison
    from harness.studies.variants import combinations

    listed = {"params": params, "algorithm": algorithm}
    varied = [(option, ",".join(values)) for option, values in listed.items() if values]
    for option, given in (("swap", swap), ("latency", latency), ("set", vary)):
        varied += [(option, text) for text in _texts(given)]

    fixed: Changes = {"set": set, "map": map, "on": on, "require": require}
    chosen = combinations({**fixed, "step": step, "stop": stop}, varied)
    return comparison.compare(
        system,
        chosen,
        Path(folder),
        limits=limits,
        every=every,
        patience=patience,
        progress=progress,
        executor=executor,
    )


def campaign(
    definition: str | Path | Mapping[str, Any], output: str | Path, **how: Any
) -> Campaign:
    """Run a campaign into a Zarr dataset.

    definition: path of a campaign TOML, or its table; output: OUT.zarr; how: workers (processes,
    default: one per processor, 0: this process), scheduler, slurm, tls_ca, tls_cert, tls_key,
    insecure (as `harness campaign`), resume (continue an interrupted campaign), require
    (conditions such as `lower(success) >= 99 %`), strict, progress (called after every block),
    `said` (called with each note).

    Guard a script that calls campaign() by `if __name__ == "__main__":`, because workers import it.
    Raises UsageError, StructureError, ResultsError, and RequirementError if a condition is not met.
    """
    from harness.studies.campaign import campaign as study

    return study.campaign(definition, output, **how)


def sensitivity(
    definition: str | Path | Mapping[str, Any], output: str | Path | None = None, **how: Any
) -> Study:
    """Rank the factors of a campaign by their effect on each requirement.

    definition: path of a campaign TOML with a table [sensitivity], or the table itself; or the
    dataset of a complete campaign, which needs no further run and no output. output: OUT.zarr;
    how: workers, resume, progress, `said` as for campaign(). Raises UsageError, StructureError.
    """
    return _study("sensitivity", definition, output, **how)


def worst(definition: str | Path | Mapping[str, Any], output: str | Path, **how: Any) -> Study:
    """Search for the smallest margin of each requirement.

    definition: path of a campaign TOML with a table [worst], or the table itself; output: OUT.zarr;
    the worst runs and the nominal one are repeated with all rows into OUT_worst/NAME.nc; how: as
    for sensitivity(). Raises UsageError, StructureError.
    """
    return _study("worst", definition, output, **how)


def probability(
    definition: str | Path | Mapping[str, Any], output: str | Path, **how: Any
) -> Study:
    """Estimate how probable it is that a requirement fails.

    definition: path of a campaign TOML with a table [probability], or the table itself; output:
    OUT.zarr; how: as for sensitivity(). Raises UsageError, StructureError.
    """
    return _study("probability", definition, output, **how)


def boundary(definition: str | Path | Mapping[str, Any], output: str | Path, **how: Any) -> Study:
    """Map where a requirement fails over two factors; all others are nominal.

    definition: path of a campaign TOML with a table [map], or the table itself; output: OUT.zarr;
    how: as for sensitivity(). Raises UsageError, StructureError.
    """
    return _study("map", definition, output, **how)


def tune(definition: str | Path | Mapping[str, Any], output: str | Path, **how: Any) -> Study:
    """Search for the gains with the largest worst margin.

    definition: path of a campaign TOML with a table [tune], or the table itself; output: OUT.zarr;
    how: as for sensitivity(). Raises UsageError, StructureError.
    """
    return _study("tune", definition, output, **how)


def _study(kind: str, *given: Any, **how: Any) -> Study:
    from harness.studies.inquiry import STUDIES

    return STUDIES[kind](*given, **how)


def __getattr__(name: str) -> Any:
    """Flights, which needs libraries of campaigns, on first use."""
    if name == "Flights":
        from harness.studies.inquiry.flights import Flights

        return Flights
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def export(
    system: str | Path | System,
    target: str | Path,
    fmi: int | None = None,
    ssp: int | None = None,
    **changes: Unpack[Changes],
) -> Path:
    """Write a system with all changes to a file and return its path.

    target: NAME.ssp, NAME.fmu (one FMU of the whole system), or a folder for the .ssp; fmi: version
    of FMI of an .fmu, 2 (default) or 3; ssp: version of SSP of an .ssp, 1 or 2 (default 1, with
    FMUs of FMI 3.0 2); changes: as for run(). Running the .ssp gives the bits of running the system
    with the same changes; the same changes give the same bytes. Raises the exceptions of run()
    before its first step, or ResultsError.
    """
    from harness.exports import package

    return package.export(system, Path(target), fmi, ssp, **changes)


def build(
    name: str | Path, output: str | Path | None = None, compiler: str = "cc", fmi: int = 2
) -> Path:
    """Build an FMU from a C or Python file and return its path.

    name: the file, or a folder NAME with NAME.c or NAME.py; output: default NAME.fmu beside the
    file; compiler: command for C with its arguments, quoted as in a shell; fmi: version of FMI, 2
    or 3 (3: of a C file). Raises UsageError if the file, the compiler or a package is missing, and
    FmuError with the message of the compiler.
    """
    from harness.authoring import build as authoring

    return authoring.build(name, output, compiler, fmi).path


def show(name: str | Path, word: str | None = None, **changes: Unpack[Changes]) -> Shown:
    """Components of a system, or signals of an FMU, alone or in its place in a system.

    name: `SYSTEM`, `SYSTEM.component` or an FMU, each by name or path; word: return only rows with
    this word in name or description; changes: as for run(). Raises UsageError, ArchiveError,
    StructureError.
    """
    from harness.studies import show as study

    return study.show(name, word, **changes)


def _texts(given: Several) -> list[str]:
    """Values side by side as the command line writes them."""
    if not isinstance(given, Mapping):
        return list(given)
    return [f"{name}={','.join(map(str, map(plain, values)))}" for name, values in given.items()]


def linearize(
    fmu: str | Path, at: float = 0.0, step: float = 0.1, *, set: Pairs = ()
) -> LinearModel:
    """Linear model of one FMU after it has run alone for `at` seconds.

    fmu: name or path; at: operating point [s], a multiple of step; step: h [s]; set: parameters and
    held inputs, as texts `name=value` or a mapping. Raises UsageError, FmuError, RunError.
    """
    from harness.studies import linearize as linear

    path, given = find_fmu(fmu), dict(pairs("--set", set))
    say_warnings_of(read_interface(path))
    model: linear.LinearModel = guarded([path], linear.linearize, path, at, step, given)
    return model


def _plot(self: Result, *names: str) -> Any:
    """A matplotlib Figure: of these variables, the figure of this name, or the first figure of the
    result. Raises UsageError, ResultsError.
    """
    from harness.figures.plots import shown

    return shown(self, names)


def _report(self: Result, path: str | Path) -> Path:
    """Write an HTML page with plots, verdicts and a replay; returns its path, HarnessError."""
    from harness.report.html import write

    return write(self, path)


# attached here, so that results know nothing of those who draw them
Result.plot = _plot
Result.save = save
Result.report = _report
