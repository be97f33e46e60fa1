# SPDX-License-Identifier: BSD-2-Clause
"""Driver of an analysis: it reads the table of the analysis, such as `[worst]` in the file of a
campaign, performs the runs that the method requests, stores them in the dataset, and returns their
margins to the method.

A generation is a set of runs that the method requests together. The method receives their margins
in the order of its request, so results are bit-identical for any number of workers. A resumed
analysis starts its method from the beginning, and the driver takes the margins of completed runs
from the dataset.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Annotated, Any, NamedTuple, TypeVar

import msgspec
import numpy as np
from msgspec import Meta

from harness.errors import StructureError, UsageError
from harness.files.signals import held
from harness.master.progress import Progress
from harness.results.result import Array
from harness.spelling import one_line
from harness.studies.analyses.evaluator import Evaluator, margins_of
from harness.studies.analyses.study import Study, of_unit
from harness.studies.campaign.draft import table_of
from harness.studies.campaign.layout import fields
from harness.studies.campaign.plan import Values
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import FAILED, PENDING, Row
from harness.system.tables import problems

T = TypeVar("T")
Names = Annotated[str | list[str], Meta(description="a name or a list of names")]

LARGEST_BLOCK, BLOCK_STEPS = 200, 500_000
"""Largest numbers of runs and of macro steps in a block. The runs of a block are written together.
A block takes some seconds; its runs are lost if the process is killed before they are written.
"""


class _Record(NamedTuple):
    """Completed run that is not yet written to the dataset: its standard normal coordinates (d,),
    the values of its factors, and its row of the dataset.
    """

    numbers: Array
    values: Values
    row: Row


class Driver:
    """Driver of one analysis, which performs its runs and writes its dataset.

    path: path of the dataset; completed: number of runs so far; failed: number of these that
    failed, without runs from the dataset of a resumed analysis; nominal: margins (requirements,) of
    run 0, the nominal run; unjudged: by requirement, the number of runs so far whose margin is NaN
    or +inf, so that they provide no evidence about the requirement.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        path: Path,
        kind: str,
        resume: bool,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self.evaluator, self.path, self.progress = evaluator, path, progress
        self.completed, self.failed = 0, 0
        self._life = ExitStack()
        self._waiting: list[_Record] = []
        plan, task = evaluator.plan, evaluator.task
        laid = list(fields(plan, task))
        if resume and path.exists():
            self.store = Store.resumed(path, plan, laid, self._life, kind)
        else:
            block = task.block(min(LARGEST_BLOCK, BLOCK_STEPS // task.steps))
            self.store = Store.create(path, plan, block, laid)
            self.store.group.attrs.update({"kind": kind})
            self._life.enter_context(self.store.alone())
        pending = np.flatnonzero(self.store.array("status") == PENDING)
        # the dataset contains all runs before the first pending one
        self._stored = int(pending[0]) if len(pending) else self.store.runs
        self._numbers, self._margins = map(self.store.array, ("numbers", "margin"))
        self.unjudged = np.zeros(len(evaluator.names), dtype=int)
        self.nominal = self.evaluate(np.zeros((1, evaluator.d)))[0]

    # ---- runs

    def evaluate(self, numbers: Array) -> Array:
        """Return the margins (rows, requirements) of one generation of runs, given by standard
        normal coordinates (rows, d). Margins of runs that are in the dataset are taken from it; all
        other runs are performed. Raise UsageError if all of several runs failed.
        """
        first, last = self.completed, self.completed + len(numbers)
        known = self._margins[first : min(last, self._stored)]
        for k in range(len(known)):
            self._reject_other(first + k, numbers[k])
        parts, block = [known], self.store.block
        for k in range(len(known), len(numbers), block):
            parts.append(self._run(first + k, numbers[k : k + block]))
        margins = np.concatenate(parts)
        self.unjudged += (np.isnan(margins) | np.isposinf(margins)).sum(axis=0)
        self._show(last)
        self.completed = last
        if len(numbers) > 1 and np.isneginf(margins).all():
            raise UsageError(f"all {len(numbers)} runs of a generation failed{self._first()}")
        return margins

    def _run(self, first: int, numbers: Array) -> Array:
        """Perform new runs, at most one block, write all blocks that are now complete, and return
        the margins (rows, requirements). first: number of the first of these runs; numbers: their
        standard normal coordinates (rows, d).
        """
        values = [self.evaluator.values(z, first + k) for k, z in enumerate(numbers)]
        rows = self.evaluator.run(values)
        self.failed += sum(row.status == FAILED for row in rows)
        self._waiting += map(_Record, numbers, values, rows)
        done = first + len(rows)
        self._write(done // self.store.block * self.store.block)
        self._show(done)
        return margins_of(rows)

    def _show(self, done: int) -> None:
        if self.progress is not None:
            self.progress(Progress(done, self.store.runs, self.failed))

    def _write(self, end: int) -> None:
        """Write the runs with numbers below `end` that are not in the dataset yet."""
        count = max(0, end - self._stored)
        part, self._waiting = self._waiting[:count], self._waiting[count:]
        if not part:
            return
        numbers, values, rows = zip(*part, strict=True)
        with held():  # an interruption waits until the block is complete
            self.store.write(self._stored, values, rows, {"numbers": numbers})
        self._stored += len(part)

    def _reject_other(self, run: int, z: Array) -> None:
        """Raise UsageError if a stored run has other coordinates than the requested row z (d,)."""
        if self._numbers[run].tobytes() != np.ascontiguousarray(z).tobytes():
            raise UsageError(
                f"{self.path}: cannot resume: the analysis now draws run {run} with other values, "
                "as after a change of a package version; write another dataset"
            )

    def _first(self) -> str:
        """Return a message as the end of an error message: of the first failed run that is not in
        the dataset yet, else the first one in the dataset; "" if there is none.
        """
        messages = [f.row.message for f in self._waiting if f.row.status == FAILED]
        messages += [m for m in self.store.array("message") if m]
        return f"; first message: {one_line(messages[0])}" if messages else ""

    # ---- finish

    def finish(self, estimate: dict[str, Any]) -> Study:
        """Write the runs that are not in the dataset yet, and `estimate`, the result of the
        analysis, as JSON in an attribute of the dataset; return the completed study.
        """
        self._write(self.store.runs)
        counts = dict(zip(self.evaluator.names, self.unjudged, strict=True))
        found = json.dumps(estimate | {"unjudged": counts}, default=lambda value: value.tolist())
        self.store.group.attrs["estimate"] = found
        return Study(self.path, self.store)

    def close(self) -> None:
        """Write the runs that are not in the dataset yet, and unlock the dataset."""
        try:
            self._write(self.store.runs)
        finally:
            self._life.close()


# ---- parts of every analysis


def prepared(kind: type[T], definition: Any, how: Mapping[str, Any]) -> tuple[T, Evaluator]:
    """Return the entries of the table of an analysis, and the evaluator that performs its runs;
    raise StructureError with all problems of the entries.

    kind: class of the entries, whose name in lower case is the name of the table; definition: path
    of a campaign TOML or its table; how: options workers, lanes and notify as for campaign().
    """
    name = kind.__name__.lower()
    given = table_of(definition).get(name, {})
    if wrong := list(problems(given, kind, name)):
        raise StructureError(wrong)
    workers, lanes = how.get("workers"), how.get("lanes", True)
    notify = how.get("notify", print)
    evaluator = Evaluator(definition, workers=workers, lanes=lanes, notify=notify)
    return msgspec.convert(given, kind), evaluator


@contextmanager
def begun(
    kind: str, evaluator: Evaluator, runs: int, output: str | Path, how: Mapping[str, Any]
) -> Iterator[Driver]:
    """Yield the driver of a study with its dataset open. After the block, close the evaluator and
    the driver, which unlocks the dataset.

    kind: name of the study; runs: number of planned runs besides the nominal one; output: path of
    the dataset, OUT.zarr; how: options of the study, such as `resume`.
    """
    evaluator.reserve(1 + runs)
    resume, show = how.get("resume", False), how.get("progress")
    with evaluator, closing(Driver(evaluator, Path(output), kind, resume, show)) as driver:
        yield driver


def report_nominal(driver: Driver, of: Mapping[str, int]) -> None:
    """Notify the user of each requirement that the nominal run does not meet; raise UsageError if
    the nominal run does not exercise one, or it cannot be evaluated. of: column of each requirement
    among the margins.
    """
    for name, k in of.items():
        margin = driver.nominal[k]
        if np.isnan(margin):
            raise UsageError(
                f"{name}: not exercised or not judged in the nominal run; name other "
                "requirements in `of`"
            )
        if margin < 0:
            unit = str(driver.store.array("margin_units")[k])
            driver.evaluator.notify(
                f"{name}: the nominal run fails, with a margin of {of_unit(margin, unit)}"
            )
