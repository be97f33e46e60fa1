"""Several runs of one system side by side, in parallel, measured and put into one table.

Each run has a process of its own, so that an FMU that crashes takes no other run with it.
Computing time is measured afterwards, one run at a time and all in turn.
"""

from __future__ import annotations

import logging
import math
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

from harness.changes import apply
from harness.errors import HarnessError, RunError, UsageError
from harness.master.child import end_with_parent
from harness.master.isolated import in_child, simulate
from harness.master.simulation import Simulation
from harness.results.files import ResultFile, read
from harness.results.result import Result
from harness.ssp.library import load
from harness.studies.measures import MEASURES
from harness.studies.table import Measures, write_csv
from harness.studies.variants import Variant
from harness.system.graph import checked
from harness.system.model import System

_log = logging.getLogger("harness")

ROWS = 20_000
"""Rows that a run has at most unless the user wants otherwise."""
TABLE = "comparison.csv"
ROUNDS, TIMED_STEPS = 3, 5000
"""Rounds of the measurement of computing time, and macro steps of one round."""


@dataclass(frozen=True)
class Outcome:
    """What came of a variant: its results file, if there are results (of a run that ended early the
    partial one), and the one line that says why it ended early ("": it did not).
    """

    variant: Variant
    file: Path | None
    failure: str = ""


@dataclass(frozen=True)
class Comparison:
    """Outcomes with their results by label, and the measures of all: (name, unit) -> label ->
    value.
    """

    outcomes: tuple[Outcome, ...]
    results: Mapping[str, Result]
    measures: Measures

    @property
    def labels(self) -> list[str]:
        """Labels of the variants in the order of the table."""
        return [outcome.variant.label for outcome in self.outcomes]

    @property
    def failures(self) -> list[str]:
        """One line per run that ended early."""
        return [
            f"{outcome.variant.label}: {outcome.failure}"
            for outcome in self.outcomes
            if outcome.failure
        ]


def compare(
    system: str | Path,
    variants: Sequence[Variant],
    directory: Path,
    *,
    every: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Comparison:
    """Run all variants in parallel and measure them; results go to `directory` as LABEL.nc, the table
    to comparison.csv.

    every: record every N-th macro step (default: as many that a run has at most 20 000 rows);
    progress: called with the number of runs that are over. Raises what run() raises before its
    first step, and ResultsError; a run that fails under way ends early, the others go on.
    """
    steps = _check(system, variants, ResultFile(directory / "any.nc"), every)
    files = [ResultFile(directory / f"{variant.file}.nc").path for variant in variants]
    thinning = [_thinning(n) if every is None else every for n in steps]
    done = _run_all(system, list(zip(variants, files, thinning, strict=True)), progress)
    outcomes = tuple(Outcome(variant, *done[variant.label]) for variant in variants)
    results = {outcome.variant.label: read(outcome.file) for outcome in outcomes if outcome.file}
    measures = {
        (m.name, m.unit): {label: m(result) for label, result in results.items()} for m in MEASURES
    }
    labels = [outcome.variant.label for outcome in outcomes]
    comparison = Comparison(
        outcomes, results, measures | {("macro step", "us"): _computing_times(system, outcomes)}
    )
    write_csv(comparison.measures, labels, directory / TABLE)
    return comparison


def _check(
    system: str | Path, variants: Sequence[Variant], file: ResultFile, every: int | None
) -> list[int]:
    """Find everything that is wrong with a variant before any is run; returns the macro steps of
    each.
    """
    steps = []
    if every is not None and every < 1:
        raise UsageError(f"--every must be at least 1, not {every}")
    with load(system) as found:
        for variant in variants:
            changed = apply(found, **variant.changes)
            file.accept(changed)
            steps.append(checked(changed).steps)
    return steps


def _thinning(steps: int) -> int:
    """Macro steps per row for at most ROWS rows, with the end of the run in the last row if that is
    possible.
    """
    least = math.ceil(steps / ROWS)
    return next((n for n in range(least, 2 * least) if steps % n == 0), least)


# ---- running


def _run_all(
    system: str | Path,
    variants: Sequence[tuple[Variant, Path, int]],
    progress: Callable[[int], None] | None,
) -> dict[str, tuple[Path | None, str]]:
    """Run as many variants at once as there are processors; returns by label the file of a run and
    why it ended early ("": it did not).

    variants: with the file for the results and the macro steps per row.
    """
    outcomes = {}
    with ThreadPoolExecutor(min(len(variants), os.cpu_count() or 1)) as pool:
        jobs = {pool.submit(_isolated, system, *variant): variant[0] for variant in variants}
        try:
            for done, job in enumerate(as_completed(jobs), start=1):
                outcomes[jobs[job].label] = job.result()
                if progress is not None:
                    progress(done)
        except BaseException:
            _end(jobs)
            raise
    return outcomes


def _end(jobs: Iterable[Future[Any]]) -> None:
    """Cancel what waits and end what runs."""
    for job in jobs:
        job.cancel()
    for process in multiprocessing.active_children():
        process.terminate()


def _isolated(
    system: str | Path, variant: Variant, file: Path, every: int
) -> tuple[Path | None, str]:
    """Run one variant in a process of its own; returns its file and why it ended early."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, initializer=_in_the_background) as process:
        try:
            return process.submit(_attempt, system, variant, file, every).result()
        except BrokenProcessPool:
            return None, "its process was ended from outside, or by a crash inside an FMU"


@contextmanager
def _silence() -> Iterator[None]:
    """No warnings: _check() has already logged them."""
    level = _log.level
    _log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        _log.setLevel(level)


def _in_the_background() -> None:
    """Leave Ctrl-C and the warnings that _check() has already logged to the parent, and end when it
    ends.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _log.setLevel(logging.ERROR)
    end_with_parent()


def _attempt(
    system: str | Path, variant: Variant, path: Path, every: int
) -> tuple[Path | None, str]:
    file = ResultFile(path)
    try:
        result = _run(system, variant, every)
        _retire_table(path.parent)
        file.write(result)
    except RunError as error:
        if error.partial is None:
            return None, str(error)
        try:
            file.keep(error.partial)
        except HarnessError as lost:
            return None, f"{error}; {lost}"
        return file.partial if file.partial.is_file() else None, str(error)
    except HarnessError as error:
        return None, str(error)
    return path, ""


def _retire_table(folder: Path) -> None:
    """Remove the table of an earlier comparison when its first results are replaced."""
    with suppress(OSError):
        (folder / TABLE).unlink()


def _run(system: str | Path, variant: Variant, every: int) -> Result:
    with load(system) as found:
        return simulate(apply(found, **variant.changes), every=every)


# ---- computing time


def _computing_times(system: str | Path, outcomes: Sequence[Outcome]) -> dict[str, float]:
    """Time of a macro step of every complete run [us], the fastest of several rounds in turn."""
    best: dict[str, float] = {}
    with load(system) as found, _silence():
        complete = [
            (f.variant.label, apply(found, **f.variant.changes)) for f in outcomes if not f.failure
        ]
        for _ in range(ROUNDS):
            for label, changed in complete:
                best[label] = min(best.get(label, math.inf), _time_apart(changed))
    return best


def _time_apart(system: System) -> float:
    """Computing time, measured in a process of its own; NaN if an FMU does not survive it."""
    try:
        return float(in_child(_computing_time, system))
    except HarnessError:
        return math.nan


def _computing_time(system: System) -> float:
    """Time of a macro step from the start of the run on [us]."""
    with Simulation(system, every=TIMED_STEPS) as simulation:
        simulation.initialize()
        simulation.advance(to=min(100, simulation.steps))
        first, last = simulation.step, min(simulation.steps, TIMED_STEPS)
        began = perf_counter()
        simulation.advance(to=last)
        return 1e6 * (perf_counter() - began) / max(last - first, 1)
