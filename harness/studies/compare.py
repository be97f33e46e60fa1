"""Several flights of one system side by side: flown in parallel, one table, overlaid figures.

Each flight has a process of its own, so that an FMU that crashes takes no other flight with it.
Computing time is measured afterwards, one flight at a time and all in turn.
"""

from __future__ import annotations

import csv
import logging
import math
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

from harness.changes import apply
from harness.errors import HarnessError, ResultsError, RunError
from harness.master.simulation import Simulation, simulate
from harness.results.files import ResultFile, read
from harness.results.result import Result
from harness.ssp.library import load
from harness.studies.cases import Case
from harness.studies.measures import MEASURES
from harness.system.graph import build_graph
from harness.system.model import System
from harness.system.schedule import macro_steps

_log = logging.getLogger("harness")

ROWS = 20_000
"""Rows that a flight has at most unless the user wants otherwise."""
ROUNDS, TIMED_STEPS = 3, 5000
"""Rounds of the measurement of computing time, and macro steps of one round."""


@dataclass(frozen=True)
class Flight:
    """What came of a case: its results file, and the one line that says why it ended early ("": it
    did not).
    """

    case: Case
    file: Path
    failure: str = ""


@dataclass(frozen=True)
class Comparison:
    """Flights with their results by label, and the figures of all: (name, unit) -> label ->
    value.
    """

    flights: tuple[Flight, ...]
    results: Mapping[str, Result]
    figures: Mapping[tuple[str, str], Mapping[str, float]]

    @property
    def failures(self) -> list[str]:
        """One line per flight that ended early."""
        return [
            f"{flight.case.label}: {flight.failure}" for flight in self.flights if flight.failure
        ]


def compare(
    system: str | Path,
    cases: Sequence[Case],
    directory: Path,
    *,
    every: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Comparison:
    """Fly all cases in parallel and measure them; results go to `directory` as LABEL.nc, the table
    to comparison.csv.

    every: record every N-th macro step (default: as many that a flight has at most 20 000 rows);
    progress: called with the number of flights that are over. Raises what run() raises before its
    first step, and ResultsError; a flight that fails under way ends early, the others go on.
    """
    steps = _check(system, cases)
    files = [ResultFile(directory / f"{case.file}.nc").path for case in cases]
    for file in files:
        file.unlink(missing_ok=True)
    thinning = [every or _thinning(n) for n in steps]
    failures = _fly_all(system, list(zip(cases, files, thinning, strict=True)), progress)
    flights = tuple(
        Flight(case, file, failures[case.label]) for case, file in zip(cases, files, strict=True)
    )
    results = {flight.case.label: read(flight.file) for flight in flights if flight.file.is_file()}
    figures = {
        (m.name, m.unit): {label: m(result) for label, result in results.items()} for m in MEASURES
    }
    comparison = Comparison(
        flights, results, figures | {("macro step", "us"): _computing_times(system, flights)}
    )
    _write_table(comparison, directory / "comparison.csv")
    return comparison


def _check(system: str | Path, cases: Sequence[Case]) -> list[int]:
    """Find everything that is wrong with a case before any takes off; returns the macro steps of
    each.
    """
    steps = []
    with load(system) as found:
        for case in cases:
            changed = apply(found, **case.changes)
            build_graph(changed)
            steps.append(macro_steps(changed.experiment, [c.every for c in changed.components]))
    return steps


def _thinning(steps: int) -> int:
    """Macro steps per row for at most ROWS rows, with the end of the run in the last row if that is
    possible.
    """
    least = math.ceil(steps / ROWS)
    return next((n for n in range(least, 2 * least) if steps % n == 0), least)


# ---- flying


def _fly_all(
    system: str | Path,
    cases: Sequence[tuple[Case, Path, int]],
    progress: Callable[[int], None] | None,
) -> dict[str, str]:
    """Fly as many cases at once as there are processors; returns by label why a flight ended early
    ("": it did not).

    cases: with the file for the results and the macro steps per row.
    """
    failures = {}
    with ThreadPoolExecutor(min(len(cases), os.cpu_count() or 1)) as pool:
        jobs = {pool.submit(_isolated, system, *case): case[0] for case in cases}
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
    """Cancel what waits and end what flies."""
    for job in jobs:
        job.cancel()
    for process in multiprocessing.active_children():
        process.terminate()


def _isolated(system: str | Path, case: Case, file: Path, every: int) -> str:
    """Fly one case in a process of its own; returns why it ended early."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, initializer=_in_the_background) as process:
        try:
            return process.submit(_fly, system, case, file, every).result()
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
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)


def _fly(system: str | Path, case: Case, file: Path, every: int) -> str:
    try:
        ResultFile(file).write(_run(system, case, every))
    except RunError as error:
        if error.partial is not None:
            ResultFile(file).write(error.partial)
        return str(error)
    except HarnessError as error:
        return str(error)
    return ""


def _run(system: str | Path, case: Case, every: int) -> Result:
    with load(system) as found:
        return simulate(apply(found, **case.changes), every=every)


# ---- computing time


def _computing_times(system: str | Path, flights: Sequence[Flight]) -> dict[str, float]:
    """Time of a macro step of every complete flight [us], the fastest of several rounds in turn."""
    best: dict[str, float] = {}
    with load(system) as found, _silence():
        complete = [
            (f.case.label, apply(found, **f.case.changes)) for f in flights if not f.failure
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


# ---- the table


def text(comparison: Comparison) -> str:
    """The table for reading, one line per flight; figures that no flight has are left out, single
    gaps are `-`.
    """
    shown = [
        key
        for key, column in comparison.figures.items()
        if any(map(math.isfinite, column.values()))
    ]
    heading = [(*name.split(" ", 1), "")[:2] for name, _ in shown]
    rows = [["", *words] for words in zip(*heading, strict=True)]
    rows += [["", *(f"[{unit}]" for _, unit in shown)]]
    rows += [[label, *map(_rounded, figures)] for label, figures in _rows(comparison, shown)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(_line(row, widths) for row in rows)


def _rows(
    comparison: Comparison, keys: Sequence[tuple[str, str]]
) -> Iterator[tuple[str, list[float]]]:
    for flight in comparison.flights:
        label = flight.case.label
        yield label, [comparison.figures[key].get(label, math.nan) for key in keys]


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    cells = [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
    return "  ".join([row[0].ljust(widths[0]), *cells]).rstrip()


def _rounded(value: float) -> str:
    """Four digits, but whole numbers and three decimals; very small numbers as a power of ten."""
    if not math.isfinite(value):
        return "-"
    if abs(value) >= 1:
        return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return f"{value:.1e}" if 0 < abs(value) < 5e-4 else f"{value:.3f}"


def _write_table(comparison: Comparison, path: Path) -> None:
    """All figures with all digits, one line per flight; figures that do not exist are empty."""
    keys = list(comparison.figures)
    try:
        with path.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(["flight", *(f"{name} [{unit}]" for name, unit in keys)])
            for label, figures in _rows(comparison, keys):
                writer.writerow(
                    [label, *("" if math.isnan(value) else repr(value) for value in figures)]
                )
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written ({error.strerror})") from error
