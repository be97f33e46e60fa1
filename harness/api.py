# SPDX-License-Identifier: BSD-2-Clause
"""Public functions that need several packages of the harness, and the methods plot, save and report
of Result.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack
from warnings import catch_warnings, simplefilter

from harness.errors import UsageError, library
from harness.files.cache import with_second_try
from harness.files.output import written
from harness.master.changes import Changes, Pairs, apply, pairs
from harness.master.isolated import PATIENCE, guarded, simulate
from harness.master.remainder import rest
from harness.results.files import read, save
from harness.results.requirements import log_inconsistencies
from harness.results.result import Result
from harness.ssp.library import load
from harness.system.graph import log_warnings, log_warnings_of
from harness.system.interface import read_interface
from harness.system.model import System
from harness.system.swap import find_fmu
from harness.system.values import plain

if TYPE_CHECKING:
    from harness.learning.apart import Apart
    from harness.learning.environment import Environment
    from harness.studies.compare import Comparison
    from harness.studies.linearize import LinearModel

Several = Sequence[str] | Mapping[str, Sequence[Any]]
"""Values to compare: texts `name=value,value,...`, or a mapping from a name to its values."""


def run(  # noqa: PLR0913 - every one is an option of the command line
    system: str | Path | System,
    *,
    executor: str = "c",
    every: int | None = None,
    progress: bool = False,
    in_process: bool = False,
    patience: float = math.inf,
    **changes: Unpack[Changes],
) -> Result:
    """Run a system and return the recorded rows.

    system: name of a system of the project, path of an .ssp, or a System; executor: `c`, `python`
    or `fused` (equal bits); every: record every N-th macro step (default: defined by the system);
    progress: show a bar on stderr; in_process: run third-party FMUs in this process; patience:
    limit for one call into a third-party FMU [s] (docs/robustness.md); changes: deviations from the
    system, see harness.master.changes.Changes (params, set, swap, map, on, latency, step, stop,
    algorithm, epoch, require, open).

    Raises UsageError, ArchiveError, StructureError, FmuError, or RunError, whose `partial` holds
    the rows recorded before the failure.
    """

    def work() -> Result:
        with load(system) as found:
            changed = rest(apply(found, **changes))
            log_warnings(changed)
            log_inconsistencies(changed)
            return simulate(
                changed,
                executor=executor,
                every=every,
                progress=progress,
                in_process=in_process,
                patience=patience,
            )

    return with_second_try(work)


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
    open: Sequence[str] = (),
    every: int | None = None,
    patience: float = PATIENCE,
    progress: Callable[[int], None] | None = None,
    executor: str = "c",
) -> Comparison:
    """Run every combination of the given values in parallel; return a Comparison with the results
    and metrics of all runs.

    folder: for the results and the table comparison.csv; params: parameter sets or files; swap:
    FMUs by component; latency: macro steps by component; vary: values by `component.parameter`;
    algorithm: names; set, map, on, step, stop, require, open: as for run(), the same in all runs;
    every: record every N-th macro step (default: at most 20 000 rows); patience: limit for one call
    into a third-party FMU [s]; progress: called with the number of completed runs; executor: `c`,
    `python` or `fused`, as for run().

    Raises UsageError, the exceptions that run() raises before the first step, and ResultsError. A
    run that fails later ends early and is listed in Comparison.failures; the other runs continue.
    """
    from harness.studies import compare as comparison
    from harness.studies.variants import combinations

    listed = {"params": params, "algorithm": algorithm}
    varied = [(option, ",".join(values)) for option, values in listed.items() if values]
    for option, given in (("swap", swap), ("latency", latency), ("set", vary)):
        varied += [(option, text) for text in _texts(given)]

    fixed: Changes = {"set": set, "map": map, "on": on, "require": require, "open": open}
    chosen = combinations({**fixed, "step": step, "stop": stop}, varied)
    return comparison.compare(
        system,
        chosen,
        Path(folder),
        every=every,
        patience=patience,
        progress=progress,
        executor=executor,
    )


def environment(system: str | Path, **how: Any) -> Environment | Apart:
    """Return a system as an environment of Gymnasium, in which an agent replaces components.

    open: components that the agent replaces (default: chosen by the mission); observe: variables
    that the agent reads (default: the inputs of these components); act: outputs of these components
    that the agent sets (default: the connected outputs); bounds: limits of these outputs by name, x
    for -x to x, or (least, largest) (default: the limits of the actuators in the parameter set that
    the system defines for comparisons, else the bounds that the mission defines); every: macro
    steps per action (default: defined by the mission, else the longest period of the replaced
    components); scale: divisors of the observations by name; if it is given, actions are scaled to
    -1 to 1.

    The reward of a step is the value of the expression `reward` (default: 0) at the end of the
    step, minus the increase of the expression `cost` (default: defined by the mission, such as
    delta-v [m/s]), minus the violations of requirements times `weights` (a number, or numbers by
    name; default 1). An episode ends at the stop time, or if an FMU fails, a requirement is
    violated or a condition of the mission holds. ends: requirements and conditions that end an
    episode, in place of all requirements; shield: safety component of the system, such as
    `monitor`, whose abort ends the episode, or `filter`, which changes the force that the agent
    commands.

    factors: campaign file; episode k starts with the factors of its run k; record: macro steps per
    recorded row (default: `every`, one row per action); further arguments: changes as for run().
    If one of the FMUs is third-party, the whole environment runs in a child process (class Apart
    with the methods of Environment). Raises UsageError, the errors that run() raises before the
    first step, and HarnessError without the extra `learn`.
    """
    library("gymnasium", "learn")
    from harness.learning import apart

    return apart.environment(system, **how)


def _texts(given: Several) -> list[str]:
    """Return values to compare as texts `name=value,value,...`."""
    if not isinstance(given, Mapping):
        return list(given)
    return [f"{name}={','.join(map(str, map(plain, values)))}" for name, values in given.items()]


def linearize(
    fmu: str | Path, at: float = 0.0, step: float = 0.1, *, set: Pairs = ()
) -> LinearModel:
    """Return the linear model of one FMU after it has run alone for `at` seconds.

    fmu: name or path; at: time of the operating point [s], a multiple of step; step: time step of
    the linear model [s]; set: values of parameters and constant inputs, as texts `name=value` or a
    mapping. Raises UsageError, FmuError, RunError.
    """
    from harness.studies import linearize as linear

    path, given = find_fmu(fmu), dict(pairs("--set", set))
    log_warnings_of(read_interface(path))
    model: linear.LinearModel = guarded([path], linear.linearize, path, at, step, given)
    return model


def write_page(
    source: Result | str | Path,
    path: str | Path,
    live: bool = False,
    lesson: str | Path | None = None,
) -> Path:
    """Write the HTML report of a result, a results file, the folder of a comparison or the dataset
    of a campaign, and return its path.

    live: include the system of the run, so that the reader can change its parameters and run it
    again in the browser (extra `live`); lesson: TOML file with exercises for a live page.

    Raises UsageError or ResultsError if the source cannot be read, HarnessError if a library of the
    extra `report` is missing, ResultsError if the page cannot be written.
    """
    from harness.report import campaign, comparison, run
    from harness.report import live as live_page
    from harness.studies.compare import TABLE

    folder = None if isinstance(source, Result) else Path(source)
    live = live or lesson is not None
    with catch_warnings():
        simplefilter("ignore", RuntimeWarning)  # numpy warns of NaN and infinity, which are allowed
        if live or folder is None or not folder.is_dir():
            taught = None if lesson is None else live_page.read_lesson(Path(lesson))
            result = source if isinstance(source, Result) else read(source)
            text = live_page.of_run(result, taught) if live else run.of_run(result)
        elif (folder / TABLE).is_file():
            text = comparison.of_folder(folder)
        elif (folder / "zarr.json").is_file():
            text = campaign.of_dataset(folder)
        else:
            raise UsageError(f"{source}: contains neither {TABLE} nor the dataset of a campaign")
    with written(Path(path)) as target:
        target.write_text(text, encoding="utf-8")
    return Path(path)


def _plot(self: Result, *names: str) -> Any:
    """Return a matplotlib Figure. names: variables to draw, or the name of one figure of the
    mission (none: the first figure of the result). Raises UsageError, ResultsError.
    """
    from harness.figures.plots import shown

    return shown(self, names)


def _report(self: Result, path: str | Path) -> Path:
    """Write an HTML page with plots, verdicts and a replay, and return its path. Raises
    HarnessError.
    """
    return write_page(self, path)


# methods of Result, set here so that harness.results need not import the packages that draw
Result.plot = _plot
Result.save = save
Result.report = _report
