# SPDX-License-Identifier: BSD-2-Clause
"""What one process does: runs of a block, one after the other, with a simulation that stays warm.

A run that fails is a row like the others: its message, the time, the last state. The same code runs
in this process, on the processors of this machine and in a cluster.
"""

from __future__ import annotations

import atexit
import logging
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError, InterruptionError, RunError
from harness.master.changes import Changes, as_in_a_file
from harness.results.requirements import Finding, finding, findings
from harness.results.result import Result
from harness.results.verdict import Verdict
from harness.ssp.library import take_mission
from harness.studies.campaign.metrics import Metric, is_condition, measured, read
from harness.studies.campaign.plan import SUCCESS, Task
from harness.studies.warm import Reading, Warm

Array = NDArray[np.float64]

PENDING, COMPLETE, FAILED = 0, 1, 2
"""Status of a run."""
VERDICTS = (Verdict.NOT_JUDGED, Verdict.MET, Verdict.NOT_MET, Verdict.NOT_EXERCISED)
"""Verdicts on a requirement by their number in a dataset."""

_log = logging.getLogger("harness")


class Row(NamedTuple):
    """What is kept of one run; message: why it failed, or a line per metric without a value and per
    requirement that is not met; verdicts: on the requirements, as places in VERDICTS; margins:
    their distance to failing, -inf of a run that has failed; histories: (rows, elements) by
    variable, NaN beyond its end.
    """

    status: int
    message: str
    time: float
    last: Array
    metrics: dict[str, float]
    verdicts: tuple[int, ...]
    margins: tuple[float, ...]
    histories: dict[str, Array]


@dataclass
class _Pilot:
    """The warm simulation of this process, and its metrics; wanted: variables that were read of the
    runs so far, None before the first.
    """

    task: Task
    warm: Warm
    metrics: dict[str, Metric] = field(default_factory=dict)
    wanted: frozenset[str] | None = None


_pilots: dict[str, _Pilot] = {}


def _pilot(task: Task) -> _Pilot:
    """The one of this campaign; that of an earlier one is closed."""
    if task.key not in _pilots:
        close()
        take_mission(task.system)
        found = {n: read(n, text, task.folder) for n, text in task.table.texts.items()}
        _pilots[task.key] = _Pilot(task, Warm(task.system, task.table.executor), found)
    return _pilots[task.key]


@atexit.register
def close() -> None:
    """End the simulation of this process."""
    while _pilots:
        _pilots.popitem()[1].warm.close()


@contextmanager
def at_work() -> Iterator[None]:
    """What a process is in while it flies blocks."""
    try:
        yield
    finally:
        close()


def fly_block(task: Task, block: Sequence[Changes]) -> list[Row]:
    """All runs of a block, without their warnings: what there is to say was said with the plan."""
    level = _log.level
    _log.setLevel(logging.ERROR)
    try:
        return [_fly(_pilot(task), changes) for changes in block]
    finally:
        _log.setLevel(level)


def _fly(pilot: _Pilot, changes: Changes) -> Row:
    task = pilot.task
    try:
        return _complete(pilot, changes)
    except InterruptionError as error:  # the user means the campaign, not this run
        raise KeyboardInterrupt from error
    except RunError as error:
        if error.partial is not None:
            return _row(pilot, FAILED, str(error), error.partial)
        return lost(task, str(error), error.time)
    except HarnessError as error:
        return lost(task, as_in_a_file(error))


def _complete(pilot: _Pilot, changes: Changes) -> Row:
    """A run that does not fail; once more, with everything, if something was read of it that was
    not recorded.
    """
    table = pilot.task.table
    result = pilot.warm.fly(changes, table.every, table.patience, pilot.wanted)
    row = _row(pilot, COMPLETE, "", result)
    if isinstance(result, Reading) and result.missed:
        result = pilot.warm.fly(changes, table.every, table.patience)
        row = _row(pilot, COMPLETE, "", result)
    if isinstance(result, Reading):
        pilot.wanted = frozenset(result.asked).union(pilot.wanted or ())
    return row


def lost(task: Task, message: str, time: float = math.nan) -> Row:
    """The row of a run that has left nothing but a message."""
    last = np.full(len(task.kinds.columns), np.nan)
    nothing, count = dict.fromkeys(task.metrics, math.nan), len(task.requirements)
    return Row(FAILED, message, time, last, nothing, (0,) * count, (-math.inf,) * count, {})


def _row(pilot: _Pilot, status: int, message: str, result: Result) -> Row:
    task = pilot.task
    metrics, reasons = measured(pilot.metrics, result)
    judged = [f for f in findings(result) if f.name in task.requirements]
    if task.requirements and SUCCESS not in metrics:
        metrics[SUCCESS], reasons[SUCCESS] = _all_met(judged)
    if status == FAILED and SUCCESS in metrics:
        metrics[SUCCESS] = 0.0
    if status == COMPLETE:
        told = {f.name: f.told for f in judged if f.verdict is not Verdict.MET}
        told |= {name: reason for name, reason in reasons.items() if reason}
        if metrics.get(SUCCESS) == 0 and is_condition(text := task.table.success):
            told[SUCCESS] = finding(result, SUCCESS, text).told
        message = "\n".join(f"{name}: {reason}" for name, reason in told.items())
    margins = {f.name: f.margin for f in judged if f.margin is not None}
    if status == FAILED:
        margins = dict.fromkeys(task.requirements, -math.inf)
    verdicts = {f.name: VERDICTS.index(f.verdict) for f in judged if status == COMPLETE}
    return Row(
        status,
        message,
        float(result.time[-1]),
        _last(task, result),
        metrics,
        tuple(verdicts.get(name, 0) for name in task.requirements),
        tuple(margins.get(name, math.nan) for name in task.requirements),
        {name: _thinned(task, result[name]) for name in task.table.kept if name in result},
    )


def _all_met(judged: Sequence[Finding]) -> tuple[float, str]:
    """Whether all requirements of a run are met, and if nobody can say so, why."""
    if any(f.verdict is Verdict.NOT_MET for f in judged):
        return 0.0, ""
    missing = next((f for f in judged if f.verdict is not Verdict.MET), None)
    return (1.0, "") if missing is None else (float("nan"), f"{missing.name} {missing.told}")


def _last(task: Task, result: Result) -> Array:
    """Last row in the columns of the campaign; a swapped FMU may have others."""
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
