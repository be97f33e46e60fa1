# SPDX-License-Identifier: BSD-2-Clause
"""Execution of a campaign from its table to its dataset: it checks the table, performs the runs in
blocks, stores them, computes percentile bands and evaluates the conditions on the campaign.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import RequirementError, UsageError
from harness.files.signals import held
from harness.master.changes import Changes
from harness.master.messages import logged_once
from harness.master.progress import Progress
from harness.results.result import Array
from harness.spelling import some
from harness.ssp.library import find_system, name_of
from harness.studies.campaign import gate, metrics, worker
from harness.studies.campaign.draft import read_plan
from harness.studies.campaign.engine import Block, CompletedBlocks, RunBlocks, prestart, worker_pool
from harness.studies.campaign.layout import fields
from harness.studies.campaign.plan import SUCCESS, Plan
from harness.studies.campaign.sources import differing
from harness.studies.campaign.stopping import Until
from harness.studies.campaign.store import Store, reject_existing
from harness.studies.campaign.summary import text, unjudged
from harness.studies.campaign.worker import FAILED, PENDING, Task
from harness.studies.reuse import compiling

_log = logging.getLogger("harness")

BLOCKS, LARGEST_BLOCK, BLOCK_STEPS = 8, 200, 2_000_000
"""Least number of blocks of a campaign with enough runs; largest numbers of runs and of macro steps
in a block, unless Task.block() needs more. The runs of a block are written together. A block takes
some seconds, which are lost if the campaign is interrupted.
"""


@dataclass(frozen=True)
class Campaign:
    """Campaign that has run, completely or in part, with its dataset."""

    path: Path
    store: Store

    def summary(self) -> str:
        """Return a summary as text: share of successful runs, statistics of the metrics, rank
        correlations with the factors, failed runs and worst runs.
        """
        return text(self.store, str(self.path))

    @property
    def data(self) -> Any:
        """Return the dataset as an xarray.Dataset with the dimension `run`, which contains
        factors, metrics and margins with units and descriptions.
        """
        import xarray

        return xarray.open_zarr(self.path, consolidated=False, chunks=None)


def campaign(  # noqa: PLR0913 - every one is an option of the command line
    definition: str | Path | Mapping[str, Any],
    output: str | Path,
    *,
    workers: int | None = None,
    lanes: bool = True,
    resume: bool = False,
    require: Sequence[str] = (),
    strict: bool = False,
    progress: Callable[[Progress], None] | None = None,
    notify: Callable[[str], None] = lambda _: None,
) -> Campaign:
    """Perform the runs of a campaign and store them in a Zarr dataset.

    definition: path of a campaign TOML, or its table; output: OUT.zarr; workers: number of worker
    processes (default: one per processor, 0: this process); lanes: let a worker make several fused
    runs at once; resume: continue an interrupted campaign; require: conditions such as
    `lower(success) >= 99 %`; strict: the values in `[expected]` must hold, or, without that table,
    every run must succeed; progress: called after every block; notify: called with each note for
    the user.

    Raises before the first run UsageError, or StructureError with all problems of the table. Raises
    ResultsError if the dataset cannot be written, and after the last run RequirementError if a
    condition is not met, the success of a run could not be evaluated or a source file has changed;
    its attribute `partial` is the completed Campaign. A run that fails raises nothing.
    """
    prestart(workers, worker.__name__)
    with logged_once():
        plan, task = read_plan(definition)
    _reject_conditions(task, require)
    task = task.in_lanes(lanes, notify)
    with ExitStack() as life:
        store, completed = _begun((plan, task), Path(output), resume, worker_pool(workers), life)
        _write(plan, store, completed, progress)
        store.finish()
    return _evaluated(Campaign(Path(output), store), require, strict)


def _begun(
    read: tuple[Plan, Task],
    path: Path,
    resume: bool,
    pool: AbstractContextManager[RunBlocks],
    life: ExitStack,
) -> tuple[Store, CompletedBlocks]:
    """Create the dataset, or reopen it with `resume`, and start the missing runs; return the
    dataset and the iterator of completed blocks.

    read: plan and task of the campaign; pool: context manager of the function that performs blocks;
    life: stack that unlocks the dataset and ends the workers when it is closed.
    """
    plan, task = read
    laid = list(fields(plan, task))
    if task.lanes:
        life.enter_context(compiling(plan.system, plan.fixed, plan.runs * task.steps))
    if resume and path.exists():
        store = Store.resumed(path, plan, laid, life)
        run_blocks = life.enter_context(pool)
        return store, run_blocks(task, _blocks(plan, store.block, store.pending()))
    reject_existing(path)
    run_blocks = life.enter_context(pool)
    block = task.block(min(LARGEST_BLOCK, plan.runs // BLOCKS, BLOCK_STEPS // task.steps))
    completed = run_blocks(task, _blocks(plan, block, range(0, plan.runs, block)))
    store = Store.create(path, plan, block, laid)  # meanwhile workers make the first runs
    life.enter_context(store.alone())
    return store, completed


def _reject_conditions(task: Task, require: Sequence[str]) -> None:
    """Raise UsageError with all conditions that this campaign cannot evaluate."""
    success = [SUCCESS] if SUCCESS in task.metrics else []
    units = {n: metrics.unit(text, task.kinds) for n, text in task.table.metrics.items()}
    if wrong := list(gate.wrong(require, [*task.requirements, *success], units)):
        raise UsageError("\n".join(wrong))


def _evaluated(found: Campaign, require: Sequence[str], strict: bool) -> Campaign:
    """Return the completed campaign `found`; raise RequirementError if a condition is not met, the
    success of a run could not be evaluated, or source files have changed during the campaign.
    """
    problems = [*filter(None, [unjudged(found.store)])]
    if names := differing(found.store.plan().sources):
        problems.append(
            f"{some(names)}: changed while the campaign ran, so runs may have used either version"
        )
    problems += gate.failures(found.store, require, strict)
    if problems:
        error = RequirementError("\n".join(problems))
        error.partial = found
        raise error
    return found


def _write(
    plan: Plan,
    store: Store,
    completed: CompletedBlocks,
    progress: Callable[[Progress], None] | None,
) -> None:
    """Write blocks into the dataset as they are completed, and call `progress` after each. End
    early if the stopping rule `until` is decided.
    """
    status, rule = store.array("status"), plan.table.until
    success = store.array(SUCCESS) if rule else status
    for first, rows in completed:
        part = slice(first, first + len(rows))
        with held():  # an interruption waits until the block is complete
            store.write(first, [plan.values(first + k) for k in range(len(rows))], rows, {})
        status[part] = [row.status for row in rows]
        if progress is not None:
            done, failed = int((status != PENDING).sum()), int((status == FAILED).sum())
            progress(Progress(done, plan.runs, failed))
        if rule is not None:
            success[part] = [row.metrics[SUCCESS] for row in rows]
            if n := _decided(rule, status, success):
                store.shorten(n)
                return


def _decided(rule: Until, status: Array, success: Array) -> int | None:
    """Return the number of runs, from the first run on, after which the stopping rule is decided;
    None if it is not decided yet. Only runs before the first pending run count.

    status, success: status and value of the metric `success` of every run (runs,).
    """
    pending = np.flatnonzero(status == PENDING)
    end = pending[0] if len(pending) else None
    return rule.decided((~(success[:end] > 0)).tolist())


def _blocks(plan: Plan, size: int, firsts: Iterable[int]) -> Iterator[Block]:
    """Yield blocks of `size` runs with the changes of each run; firsts: number of the first run of
    each block.
    """
    for first in firsts:
        runs = range(first, min(first + size, plan.runs))
        yield Block(first, [plan.changes(plan.values(run)) for run in runs])


# ---- repetition of one run


def like(text: str, system: str | Path | None = None) -> tuple[str | Path, Changes]:
    """Return the system and the changes with which harness.run() repeats one run of a dataset.

    text: path of the dataset and number of the run, `OUT.zarr#1234`; system: name or present path
    of the system (None: the path in the dataset). Raises UsageError (no such run, or the dataset
    belongs to another system) or ResultsError.
    """
    name, mark, number = text.rpartition("#")
    if not mark or not number.isdigit():
        raise UsageError(f"--like {text}: expected a dataset and the number of a run, OUT.zarr#7")
    store = Store.open(Path(name))
    runs = store.runs
    if int(number) >= runs:
        raise UsageError(f"--like {text}: the dataset has runs 0 to {runs - 1}")
    if not store.array("status")[int(number)]:
        raise UsageError(
            f"--like {text}: run {number} has not completed; continue the campaign with --resume"
        )
    plan = store.plan()
    for source in differing(plan.sources):
        _log.warning("%s: has changed since run %s of %s", source, number, store.path.name)
    if system is not None and plan.system.read_bytes() != find_system(system).read_bytes():
        raise UsageError(
            f"--like {text}: this run is of {name_of(plan.system)}, not of {Path(system).stem}"
        )
    return system or plan.system, plan.changes(store.values(int(number)))
