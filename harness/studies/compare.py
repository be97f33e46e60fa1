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
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from harness.changes import apply
from harness.errors import HarnessError, RunError
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
ROUNDS, TIMED_STEPS = 3, 5000
"""Rounds of the measurement of computing time, and macro steps of one round."""


@dataclass(frozen=True)
class Outcome:
    """What came of a variant: its results file, and the one line that says why it ended early ("": it
    did not).
    """

    variant: Variant
    file: Path
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
    steps = _check(system, variants)
    files = [ResultFile(directory / f"{variant.file}.nc").path for variant in variants]
    for file in files:
        file.unlink(missing_ok=True)
    thinning = [every or _thinning(n) for n in steps]
    failures = _run_all(system, list(zip(variants, files, thinning, strict=True)), progress)
    outcomes = tuple(
        Outcome(variant, file, failures[variant.label])
        for variant, file in zip(variants, files, strict=True)
    )
    results = {
        outcome.variant.label: read(outcome.file) for outcome in outcomes if outcome.file.is_file()
    }
    measures = {
        (m.name, m.unit): {label: m(result) for label, result in results.items()} for m in MEASURES
    }
    labels = [outcome.variant.label for outcome in outcomes]
    comparison = Comparison(
        outcomes, results, measures | {("macro step", "us"): _computing_times(system, outcomes)}
    )
    write_csv(comparison.measures, labels, directory / "comparison.csv")
    return comparison


def _check(system: str | Path, variants: Sequence[Variant]) -> list[int]:
    """Find everything that is wrong with a variant before any is run; returns the macro steps of
    each.
    """
    steps = []
    with load(system) as found:
        for variant in variants:
            steps.append(checked(apply(found, **variant.changes)).steps)
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
) -> dict[str, str]:
    """Run as many variants at once as there are processors; returns by label why a run ended
    early ("": it did not).

    variants: with the file for the results and the macro steps per row.
    """
    failures = {}
    with ThreadPoolExecutor(min(len(variants), os.cpu_count() or 1)) as pool:
        jobs = {pool.submit(_isolated, system, *variant): variant[0] for variant in variants}
        try:
            for done, job in enumerate(as_completed(jobs), start=1):
                failures[jobs[job].label] = job.result()
                if progress is not None:
                    progress(done)
        except BaseException:
            _end(jobs)
            raise
    return failures


def _end(jobs: Iterable[Future[str]]) -> None:
    """Cancel what waits and end what runs."""
    for job in jobs:
        job.cancel()
    for process in multiprocessing.active_children():
        process.terminate()


def _isolated(system: str | Path, variant: Variant, file: Path, every: int) -> str:
    """Run one variant in a process of its own; returns why it ended early."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, initializer=_in_the_background) as process:
        try:
            return process.submit(_attempt, system, variant, file, every).result()
        except BrokenProcessPool:
            return "its process was ended from outside, or by a crash inside an FMU"


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


def _attempt(system: str | Path, variant: Variant, file: Path, every: int) -> str:
    try:
        ResultFile(file).write(_run(system, variant, every))
    except RunError as error:
        if error.partial is not None:
            ResultFile(file).write(error.partial)
        return str(error)
    except HarnessError as error:
        return str(error)
    return ""


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
                best[label] = min(best.get(label, math.inf), _computing_time(changed))
    return best


def _computing_time(system: System) -> float:
    """Time of a macro step from the start of the run on [us]."""
    with Simulation(system, every=TIMED_STEPS) as simulation:
        simulation.initialize()
        simulation.advance(to=min(100, simulation.steps))
        first, last = simulation.step, min(simulation.steps, TIMED_STEPS)
        began = perf_counter()
        simulation.advance(to=last)
        return 1e6 * (perf_counter() - began) / max(last - first, 1)
