# SPDX-License-Identifier: BSD-2-Clause
"""Work of one process: runs of a block, one after the other, with a reused simulation.

A run that fails is a row like the others: its message, the time, the last state. The same code runs
in this process, on the processors of this machine and in a cluster.
"""

from __future__ import annotations

import math
from collections import deque
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
from harness.studies.reuse import Reading, ReusedSimulation, kind, quietly, retained

PENDING, COMPLETE, FAILED = 0, 1, 2
"""Numbers of the status of a run in a dataset."""
VERDICTS = (Verdict.NOT_JUDGED, Verdict.MET, Verdict.NOT_MET, Verdict.NOT_EXERCISED)
"""Verdicts on a requirement by their number in a dataset."""

PIECE_STEPS = 100_000
"""Macro steps that a worker is given at once: a tenth of a second or more, against some
milliseconds for handing them over.
"""

TOGETHER = 8
"""Most runs that the lanes of vectors make at once, on any processor."""


class Row(NamedTuple):
    """Record of one run. message: why it failed, or a line per metric without a value and per
    requirement that is not met; verdicts: on the requirements, as indices of VERDICTS; margins:
    distances to failing, -inf for a failed run; histories: (rows, elements) by variable, NaN beyond
    the end.
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
    """Data that all runs of a campaign share, as plain data, and their execution in one process.

    key: of the plan; kinds: names, units and texts of variables and parameters; requirements: texts
    by name of the requirements evaluated in every run; steps: macro steps of the longest run, of
    `step` s from `start` s on; needed: variables that a run is expected to read (None: unknown);
    lanes: whether several runs may be made together, with equal bits.
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
        """Return the data that a worker needs: the names of the variables without units and
        texts.
        """
        names = replace(self.kinds, units=(), descriptions=(), parameters=None)
        return {**self.__dict__, "kinds": names}

    @cached_property
    def metrics(self) -> tuple[str, ...]:
        """Return the metrics of a run, including success if it is defined."""
        success = [SUCCESS] if self.requirements else []
        return tuple(dict.fromkeys((*self.table.texts, *success)))

    @cached_property
    def rows(self) -> NDArray[np.int64]:
        """Return the numbers of the rows of which histories are recorded."""
        rows = len(recorded(self.steps, self.table.every))
        return recorded(rows - 1, max(1, -(-rows // self.table.record.rows)))

    def in_lanes(self, wanted: bool, notify: Callable[[str], None]) -> Task:
        """Return the task with the decision on lanes; notify: receives a line that states how many
        runs are made at once.
        """
        lanes = wanted and self.table.executor == FUSED and width() > 1
        if lanes:
            notify(
                f"up to {width()} runs at once in the lanes of vectors, where their library is "
                "compiled"
            )
        return replace(self, lanes=lanes)

    @property
    def piece(self) -> int:
        """Return the runs that a worker is given at once."""
        return self.block(PIECE_STEPS // self.steps)

    def block(self, runs: int) -> int:
        """Return the number of runs of a block, about `runs`: of fused runs a multiple of the runs
        that the lanes of vectors can make at once.
        """
        size = TOGETHER if self.table.executor == FUSED else 1
        return max(size, runs - runs % size)

    def run(self, part: Sequence[Changes]) -> list[Row]:
        """Return the records of runs, one after the other."""
        with quietly():
            runner: _Runner = retained(self.key, lambda: _Runner(self))
            return runner.rows(part)

    def lost(self, message: str, time: float = math.nan) -> Row:
        """Return the record of a run that has left only a message."""
        last = np.full(len(self.kinds.columns), np.nan)
        nothing, count = dict.fromkeys(self.metrics, math.nan), len(self.requirements)
        return Row(FAILED, message, time, last, nothing, (0,) * count, (-math.inf,) * count, {})


class _Runner(ReusedSimulation):
    """Reused simulation of this process with its metrics; needed: variables that the runs so far
    have read or are expected to read, None if unknown.
    """

    def __init__(self, task: Task) -> None:
        take_mission(task.system)
        texts = task.table.texts.items()
        self.task = task
        self.metrics = {name: read(name, text, task.folder) for name, text in texts}
        self.needed = task.needed
        super().__init__(task.system, task.table.executor)

    def rows(self, part: Sequence[Changes]) -> list[Row]:
        """Return the records of runs, in their order; runs that differ in values only are made
        together.
        """
        rows: dict[int, Row] = {}
        kinds = [kind(changes) for changes in part]
        left = deque(sorted(range(len(part)), key=lambda k: (kinds[k], k)))
        while left:
            group = [left.popleft()]
            most = self.width if self.task.lanes and self.needed is not None else 1
            while left and len(group) < most and kinds[left[0]] == kinds[group[0]]:
                group.append(left.popleft())
            results: list[Result | None] = [None]
            if len(group) > 1:
                runs = [part[k] for k in group]
                results = self.together(runs, self.task.table.every, self.needed or ())
            for k in group:
                rows[k] = _run(self, part[k], results.pop(0))
        return [rows[k] for k in sorted(rows)]


def _run(runner: _Runner, changes: Changes, result: Result | None) -> Row:
    """Return the record of a run, from its result or made alone. Repeat the run with all variables
    if it read one that is not recorded.
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
    except InterruptionError as error:  # Ctrl-C ends the campaign, not this run alone
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
    """Return whether all requirements of a run are met, NaN and the reason if this is unknown."""
    if any(f.verdict is Verdict.NOT_MET for f in found):
        return 0.0, ""
    missing = next((f for f in found if f.verdict is not Verdict.MET), None)
    return (1.0, "") if missing is None else (float("nan"), f"{missing.name} {missing.statement}")


def _last(task: Task, result: Result) -> Array:
    """Return the last row in the columns of the campaign; a swapped FMU may have others."""
    last = result.last if isinstance(result, Reading) else result.values[-1]
    if result.columns == task.kinds.columns:
        return np.array(last)
    given = dict(zip(result.columns, last, strict=True))
    return np.array([given.get(name, np.nan) for name in task.kinds.columns])


def _thinned(task: Task, history: Array) -> Array:
    flat = history.reshape(len(history), -1)
    rows = [row for row in task.rows if row < len(flat)]
    full = np.full((len(task.rows), flat.shape[1]), np.nan)
    full[: len(rows)] = flat[rows]
    return full
