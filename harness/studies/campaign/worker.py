# SPDX-License-Identifier: BSD-2-Clause
"""Work of one process of a campaign: it performs the runs of a block with a reused simulation, and
returns one Row per run, which is stored in the dataset.

A run that fails gives a Row too, with its message, the time of failure and the last values of all
variables (NaN if no row was recorded). The same code runs in the main process and in worker
processes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError, InterruptionError, RunError
from harness.master.changes import Changes, as_in_a_file
from harness.master.executors import FUSED
from harness.master.lanes import width
from harness.master.recorder import recorded
from harness.results.requirements import Finding, finding, findings
from harness.results.result import Array, Result
from harness.results.verdict import Verdict
from harness.ssp.library import take_mission
from harness.studies.campaign.metrics import is_condition, measured, read
from harness.studies.campaign.plan import SUCCESS, Table
from harness.studies.reuse import Reading, ReusedSimulation, alike, quietly, retained

PENDING, COMPLETE, FAILED = 0, 1, 2
"""Values of the array `status` of a dataset: the run is not made yet, is complete, or failed."""
VERDICTS = (Verdict.NOT_JUDGED, Verdict.MET, Verdict.NOT_MET, Verdict.NOT_EXERCISED)
"""Verdicts on a requirement; the array `verdict` of a dataset contains indices of this tuple."""

PIECE_STEPS = 100_000
"""Number of macro steps per task of a worker. They take a tenth of a second or more, while sending
a task to the worker takes some milliseconds.
"""

TOGETHER = 8
"""Largest number of runs that lanes of vector registers can make at once, on any processor."""


class Row(NamedTuple):
    """Result of one run, as the dataset stores it.

    status: PENDING, COMPLETE or FAILED; message: reason of a failure, or a line per requirement not
    met or undecided, per metric that raised an error, and for a condition `success` that is not
    met; time: time of the last row [s]; last: last values of all variables (both may be NaN);
    metrics: values by name; verdicts, margins: by requirement, as indices of VERDICTS and as
    distances to failing (-inf for a failed run); histories: recorded time series (rows, elements)
    by variable, NaN after the end of the run.
    """

    status: int
    message: str
    time: float
    last: Array
    metrics: dict[str, float]
    verdicts: tuple[int, ...]
    margins: tuple[float, ...]
    histories: dict[str, Array]


@dataclass(frozen=True)
class Task:
    """Data that all runs of a campaign share, which can be sent to workers, and the code that
    performs runs in a worker.

    key: hash of the plan of the campaign; table: content of the campaign file; folder: folder of
    the files that `table` names; kinds: result without meaningful values, for names, units and
    descriptions of variables and parameters; requirements: texts by name; start, step: start time
    and macro step [s]; steps: macro steps of the longest run; needed: variables that metrics and
    requirements read (None: unknown); lanes: whether a worker may make several runs at once, which
    gives the same bits as single runs.
    """

    key: str
    system: Path
    folder: Path
    table: Table
    kinds: Result
    requirements: Mapping[str, str]
    start: float
    step: float
    steps: int
    needed: frozenset[str] | None = None
    lanes: bool = True

    def __getstate__(self) -> dict[str, Any]:
        """Return the data to send to a worker, without the parameters and the units and
        descriptions of variables, which a worker does not need.
        """
        names = replace(self.kinds, units=(), descriptions=(), parameters=None)
        return {**self.__dict__, "kinds": names}

    @cached_property
    def metrics(self) -> tuple[str, ...]:
        """Return the names of the metrics of every run, including `success` if the campaign file
        defines this metric or there are requirements.
        """
        success = [SUCCESS] if self.requirements else []
        return tuple(dict.fromkeys((*self.table.texts, *success)))

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """Return the indices of those rows of a result that the recorded time series contain."""
        rows = len(recorded(self.steps, self.table.every))
        return recorded(rows - 1, max(1, -(-rows // self.table.record.rows)))

    def in_lanes(self, wanted: bool, notify: Callable[[str], None]) -> Task:
        """Return the task, with lanes if they are `wanted` and possible: with executor `fused` and
        a compiler, the C sources and a cache on this machine. notify: called with a line that
        states how many runs are made at once.
        """
        lanes = wanted and self.table.executor == FUSED and width() > 1
        if lanes:
            notify(
                f"if the library of lanes exists, every worker makes up to {width()} runs at once "
                "in lanes of vector registers; campaigns of many steps compile the library"
            )
        return replace(self, lanes=lanes)

    @property
    def piece(self) -> int:
        """Return the number of runs per task of a worker."""
        return self.block(PIECE_STEPS // self.steps)

    def block(self, runs: int) -> int:
        """Return the number of runs of a block: `runs`, but at least 1. With executor `fused` it is
        rounded down to a multiple of TOGETHER, at least TOGETHER, so that all lanes are in use.
        """
        size = TOGETHER if self.table.executor == FUSED else 1
        return max(size, runs - runs % size)

    def run(self, part: Sequence[Changes]) -> list[Row]:
        """Perform runs in this process, and return their results in the same order."""
        with quietly():
            runner: _Runner = retained(self.key, lambda: _Runner(self))
            return runner.rows(part)

    def lost(self, message: str, time: float = math.nan) -> Row:
        """Return the Row of a run that failed without any recorded row; time: time of the failure
        [s].
        """
        last = np.full(len(self.kinds.columns), np.nan)
        nothing, count = dict.fromkeys(self.metrics, math.nan), len(self.requirements)
        return Row(FAILED, message, time, last, nothing, (0,) * count, (-math.inf,) * count, {})


class _Runner(ReusedSimulation):
    """Reused simulation of this process, which performs runs and computes their metrics.

    needed: names of the variables that a run records, because metrics and requirements read them
    (None: unknown, all are recorded).
    """

    def __init__(self, task: Task) -> None:
        take_mission(task.system)
        texts = task.table.texts.items()
        self.task = task
        self.metrics = {name: read(name, text, task.folder) for name, text in texts}
        self.needed = task.needed
        super().__init__(task.system, task.table.executor)

    def rows(self, part: Sequence[Changes]) -> list[Row]:
        """Perform runs and return their results in the same order. Runs that differ in parameter
        values only are made at once if the task allows it.
        """

        def most() -> int:
            return self.width if self.task.lanes and self.needed is not None else 1

        rows: dict[int, Row] = {}
        for group in alike(part, most):
            results: list[Result | None] = [None]
            if len(group) > 1:
                runs = [part[k] for k in group]
                results = self.together(runs, self.task.table.every, self.needed or ())
            for k, result in zip(group, results, strict=True):
                rows[k] = _run(self, part[k], result)
        return [rows[k] for k in sorted(rows)]


def _run(runner: _Runner, changes: Changes, result: Result | None) -> Row:
    """Return the Row of a run, which is performed first if `result` is None. If metrics read a
    variable that the run did not record, the run is repeated with all variables.
    """
    task, table = runner.task, runner.task.table
    try:
        if result is None:
            result = runner.run(changes, table.every, table.patience, runner.needed)
        row = _row(runner, COMPLETE, "", result)
        if isinstance(result, Reading) and result.missed:
            result = runner.run(changes, table.every, table.patience)
            row = _row(runner, COMPLETE, "", result)
        if isinstance(result, Reading):
            runner.needed = frozenset(result.read).union(runner.needed or ())
        return row
    except InterruptionError as error:  # Ctrl-C ends the whole campaign
        raise KeyboardInterrupt from error
    except RunError as error:
        if error.partial is not None:
            return _row(runner, FAILED, str(error), error.partial)
        return task.lost(str(error), error.time)
    except HarnessError as error:
        return task.lost(as_in_a_file(error))


def _row(runner: _Runner, status: int, message: str, result: Result) -> Row:
    task = runner.task
    metrics, reasons = measured(runner.metrics, result)
    found = [f for f in findings(result) if f.name in task.requirements]
    if task.requirements and SUCCESS not in metrics:
        metrics[SUCCESS], reasons[SUCCESS] = _all_met(found)
    if status == FAILED and SUCCESS in metrics:
        metrics[SUCCESS] = 0.0
    if status == COMPLETE:
        lines = {f.name: f.statement for f in found if f.verdict is not Verdict.MET}
        lines |= {name: reason for name, reason in reasons.items() if reason}
        if metrics.get(SUCCESS) == 0 and is_condition(text := task.table.success):
            lines[SUCCESS] = finding(result, SUCCESS, text).statement
        message = "\n".join(f"{name}: {reason}" for name, reason in lines.items())
    margins = {f.name: f.margin for f in found if f.margin is not None}
    if status == FAILED:
        margins = dict.fromkeys(task.requirements, -math.inf)
    verdicts = {f.name: VERDICTS.index(f.verdict) for f in found if status == COMPLETE}
    return Row(
        status,
        message,
        float(result.time[-1]),
        _last(task, result),
        metrics,
        tuple(verdicts.get(name, 0) for name in task.requirements),
        tuple(margins.get(name, math.nan) for name in task.requirements),
        {name: _thinned(task, result[name]) for name in task.table.recorded if name in result},
    )


def _all_met(found: Sequence[Finding]) -> tuple[float, str]:
    """Return 1 if all requirements of a run are met and 0 if one is not met, with an empty text;
    return NaN and the reason if a requirement has no verdict.
    """
    if any(f.verdict is Verdict.NOT_MET for f in found):
        return 0.0, ""
    missing = next((f for f in found if f.verdict is not Verdict.MET), None)
    return (1.0, "") if missing is None else (float("nan"), f"{missing.name} {missing.statement}")


def _last(task: Task, result: Result) -> Array:
    """Return the last row of a result (columns,), in the order of the columns of the dataset; NaN
    for variables that this run lacks, because a swapped FMU may have other variables.
    """
    last = result.last if isinstance(result, Reading) else result.values[-1]
    if result.columns == task.kinds.columns:
        return np.array(last)
    given = dict(zip(result.columns, last, strict=True))
    return np.array([given.get(name, np.nan) for name in task.kinds.columns])


def _thinned(task: Task, history: Array) -> Array:
    """Return those rows of a time series (rows, elements) that the dataset records, and NaN for
    rows after the end of the run.
    """
    flat = history.reshape(len(history), -1)
    rows = [row for row in task.rows if row < len(flat)]
    full = np.full((len(task.rows), flat.shape[1]), np.nan)
    full[: len(rows)] = flat[rows]
    return full
