# SPDX-License-Identifier: BSD-2-Clause
"""Driver of an analysis: it performs the runs that the method requests, stores them in the dataset,
and supplies the margins.

A generation is a set of runs that the method requests together. It receives their margins in the
order of its request, so results are bit-identical for any number of workers. A resumed analysis
starts its method from the beginning, and the driver takes the margins of completed runs from the
dataset.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from contextlib import ExitStack
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from harness.errors import UsageError
from harness.files.signals import held
from harness.master.progress import Progress
from harness.results.result import Array
from harness.spelling import one_line
from harness.studies.analyses.evaluator import Evaluator, margins_of, unjudged
from harness.studies.campaign.layout import fields
from harness.studies.campaign.plan import Values
from harness.studies.campaign.store import Store, reject_existing
from harness.studies.campaign.worker import FAILED, PENDING, Row

T = TypeVar("T")

LARGEST_BLOCK, BLOCK_STEPS = 200, 500_000
"""Largest numbers of runs and of macro steps in a block, whose runs are written together. A block
takes some seconds, which are lost if the process is killed.
"""


class _Record(NamedTuple):
    """Completed run that is not yet written: its generation and number, coordinates (d,), values of
    the factors, and record.
    """

    generation: int
    run: int
    numbers: Array
    values: Values
    row: Row


def run_method(method: Generator[Array, Array, T], evaluate: Callable[[Array], Array]) -> T:
    """Run a method to its end and return its estimate; evaluate: function from the coordinates that
    the method yields to the margins that it receives.
    """
    try:
        z = next(method)
        while True:
            z = method.send(evaluate(z))
    except StopIteration as end:
        found: T = end.value
        return found


class Driver:
    """Driver of one analysis, which performs its runs and writes its dataset.

    path, kind: of the dataset; completed: number of runs so far; nominal: margins (requirements,)
    of run 0, the nominal run; unjudged: number of runs so far whose margin is no evidence, by
    requirement; failed: number of failed runs.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        path: Path,
        kind: str,
        resume: bool = False,
        progress: Callable[[Progress], None] | None = None,
    ) -> None:
        self.evaluator, self.path, self.progress = evaluator, path, progress
        self.completed, self.generation, self.failed = 0, 0, 0
        self._life = ExitStack()
        self._waiting: list[_Record] = []
        plan, task = evaluator.plan, evaluator.task
        laid = list(fields(plan, task))
        if resume and path.exists():
            self.store = Store.resumed(path, plan, laid, self._life, kind)
        else:
            reject_existing(path)
            block = task.block(min(LARGEST_BLOCK, BLOCK_STEPS // task.steps))
            self.store = Store.create(path, plan, block, laid)
            self.store.group.attrs.update({"kind": kind})
            self._life.enter_context(self.store.alone())
        names = ("numbers", "margin", "status")
        self._numbers, self._margins, self._status = map(self.store.array, names)
        self.unjudged = np.zeros(len(evaluator.names), dtype=int)
        self.nominal = self.evaluate(np.zeros((1, evaluator.d)))[0]

    # ---- runs

    def answer(
        self,
        method: Generator[Array, Array, T],
        columns: int | list[int],
        placed: Callable[[Array], Array] = lambda z: z,
    ) -> T:
        """Run a method to its end and return its estimate.

        columns: indices of the requirements whose margins the method receives; placed: function
        from the points that the method yields to coordinates of runs (rows, d).
        """
        return run_method(method, lambda z: self.evaluate(placed(z))[:, columns])

    def evaluate(self, numbers: Array) -> Array:
        """Return the margins (rows, requirements) for coordinates (rows, d), from the dataset if
        the runs are stored there, otherwise from new runs. The rows are one generation.
        """
        first, last = self.completed, self.completed + len(numbers)
        if last > self.store.runs and not self.store.about.decided:
            raise UsageError(
                f"{self.path}: the study needs more runs than the {self.store.runs} reserved in "
                "the dataset"
            )
        there = np.flatnonzero(self._status[first:last] != PENDING)
        for k in there:
            self._reject_other(first + int(k), numbers[k])
        margins = np.full((len(numbers), len(self.evaluator.names)), np.nan)
        margins[there] = self._margins[first + there]
        missing = np.setdiff1d(np.arange(len(numbers)), there)
        for start in range(0, len(missing), self.store.block):
            part = missing[start : start + self.store.block]
            margins[part] = self._run(numbers[part], [first + int(place) for place in part])
        self.unjudged += unjudged(margins).sum(axis=0)
        self._show(last)
        self.completed, self.generation = last, self.generation + 1
        if len(numbers) > 1 and np.isneginf(margins).all():
            raise UsageError(f"all {len(numbers)} runs of a generation failed{self._first()}")
        return margins

    def _run(self, numbers: Array, runs: list[int]) -> Array:
        """Perform new runs, at most as many as a block has; return their margins, and write the
        runs of blocks that are complete.
        """
        values = list(map(self.evaluator.values, numbers, runs))
        rows = self.evaluator.run(values)
        self.failed += sum(row.status == FAILED for row in rows)
        each = zip(runs, numbers, values, rows, strict=True)
        self._waiting += [_Record(self.generation, *record) for record in each]
        self._write((runs[-1] + 1) // self.store.block * self.store.block)
        self._show(runs[-1] + 1)
        return margins_of(rows)

    def _show(self, done: int) -> None:
        if self.progress is not None:
            self.progress(Progress(done, self.store.runs, self.failed))

    def _write(self, end: int) -> None:
        """Write the waiting runs with numbers below `end`, consecutive runs together."""
        part = [record for record in self._waiting if record.run < end]
        self._waiting = self._waiting[len(part) :]
        for _, each in groupby(enumerate(part), lambda placed: placed[1].run - placed[0]):
            stretch = [record for _, record in each]
            further: dict[str, list[Any]] = {
                "numbers": [record.numbers for record in stretch],
                "generation": [record.generation for record in stretch],
            }
            values, rows = [f.values for f in stretch], [f.row for f in stretch]
            with held():  # an interruption waits until the block is complete
                self.store.write(stretch[0].run, values, rows, further)

    def _reject_other(self, run: int, z: Array) -> None:
        """Raise UsageError if a stored run has other coordinates than the requested row z (d,)."""
        if self._numbers[run].tobytes() != np.ascontiguousarray(z).tobytes():
            raise UsageError(
                f"{self.path}: cannot resume: run {run} was generated with different package "
                "versions"
            )

    def _first(self) -> str:
        """Return the message of the first failed run as text for an error, "" if there is none."""
        messages = [f.row.message for f in self._waiting if f.row.status == FAILED]
        messages += [m for m in self.store.array("message") if m]
        return f"; first message: {one_line(messages[0])}" if messages else ""

    # ---- finish

    def finish(self, estimate: dict[str, Any]) -> Store:
        """Write the waiting runs, remove planned runs that were not needed, and store the estimate
        as plain data; return the dataset.
        """
        self._write(self.completed)
        if not self.store.about.decided:
            self.store.shorten(self.completed)
        counts = dict(zip(self.evaluator.names, self.unjudged, strict=True))
        found = json.dumps(estimate | {"unjudged": counts}, default=lambda value: value.tolist())
        self.store.group.attrs["estimate"] = found
        return self.store

    def close(self) -> None:
        """Write the waiting runs and unlock the dataset."""
        try:
            self._write(self.store.runs)
        finally:
            self._life.close()
