# SPDX-License-Identifier: BSD-2-Clause
"""Campaign from its table to its dataset: plan, store, blocks, bands."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import RequirementError, UsageError
from harness.files.signals import held
from harness.master.changes import Changes
from harness.master.messages import logged_once
from harness.spelling import some
from harness.ssp.library import find_system, name_of
from harness.studies.campaign import gate, metrics, worker
from harness.studies.campaign.clusters import Workers
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
"""Smallest number of blocks of a campaign; largest numbers of runs and of macro steps of a block:
some seconds of work, which a kill or Ctrl-C loses.
"""


@dataclass(frozen=True)
class Progress:
    """Number of completed runs, of all runs, and of completed runs that have failed."""

    done: int
    runs: int
    failed: int


@dataclass(frozen=True)
class Campaign:
    """Dataset of a campaign, complete or partial."""

    path: Path
    store: Store

    def summary(self) -> str:
        """Return success, metrics, rank correlations, failures and the worst runs as text."""
        return text(self.store, str(self.path))

    @property
    def data(self) -> Any:
        """Return the dataset as an xarray.Dataset: runs with labelled factors, metrics and
        margins.
        """
        import xarray

        return xarray.open_zarr(self.path, consolidated=False, chunks=None)


def campaign(  # noqa: PLR0913 - every one is an option of the command line
    definition: str | Path | Mapping[str, Any],
    output: str | Path,
    *,
    resume: bool = False,
    require: Sequence[str] = (),
    strict: bool = False,
    progress: Callable[[Progress], None] | None = None,
    notify: Callable[[str], None] = lambda _: None,
    **where: Any,
) -> Campaign:
    """Run a campaign into a Zarr dataset.

    definition: path of a campaign TOML, or its table; output: OUT.zarr; resume: continue an
    interrupted campaign; require: conditions such as `lower(success) >= 99 %`; strict: the values
    in `[expected]` must hold, or, without that table, every run must succeed; progress:
    called after every block; notify: called with each note; where: workers (processes, default: one
    per processor, 0: this process), and clusters as `harness campaign` takes them.

    Guard a script that calls campaign() by `if __name__ == "__main__":`, because workers import it.
    Raises UsageError, StructureError with all that is wrong before the first run, ResultsError, and
    RequirementError if a condition is not met or the success of a run could not be evaluated
    (`partial` is the campaign, which is complete). A run that fails is a row of the dataset.
    """
    who = Workers(**where)
    who.check()
    prestart(who, worker.__name__)
    with logged_once():
        plan, task = read_plan(definition)
    _reject_conditions(task, require)
    task = task.in_lanes(who.lanes, notify)
    with ExitStack() as life:
        store, completed = _begun(
            (plan, task), Path(output), resume, worker_pool(who, notify), life
        )
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
    """Return the dataset, locked until the end of `life`, and the iterator of its
    missing blocks.
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
    store = Store.create(path, plan, block, laid)  # while the first runs are in progress
    life.enter_context(store.alone())
    return store, completed


def _reject_conditions(task: Task, require: Sequence[str]) -> None:
    """Raise UsageError for conditions that this campaign cannot evaluate."""
    success = [SUCCESS] if SUCCESS in task.metrics else []
    units = {n: metrics.unit(text, task.kinds) for n, text in task.table.metrics.items()}
    if wrong := list(gate.wrong(require, [*task.requirements, *success], units)):
        raise UsageError("\n".join(wrong))


def _evaluated(found: Campaign, require: Sequence[str], strict: bool) -> Campaign:
    problems = [*filter(None, [unjudged(found.store)])]
    if names := differing(found.store.plan().sources):
        problems.append(f"changed while the campaign ran: {some(names)}; its runs may differ")
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
    """Write the completed runs block by block."""
    status, rule = store.array("status"), plan.table.until
    missed = np.where(status == PENDING, PENDING, _missed(store) if rule else 1)
    done, failed = int((status != 0).sum()), int((status == FAILED).sum())
    for first, rows in completed:
        earlier = status[first : first + len(rows)]
        with held():  # an interruption waits until the block is complete
            store.write(first, [plan.values(first + k) for k in range(len(rows))], rows, {})
        done += len(rows) - int((earlier != 0).sum())
        failed += sum(row.status == FAILED for row in rows) - int((earlier == FAILED).sum())
        if rule is not None:
            missed[first : first + len(rows)] = [2 - (r.metrics[SUCCESS] == 1) for r in rows]
        if progress is not None:
            progress(Progress(done, plan.runs, failed))
        if rule is not None and (n := _decided(rule, missed)):
            store.shorten(n)
            return


def _missed(store: Store) -> NDArray[np.int8]:
    """Return 1 for every run that has succeeded, else 2."""
    succeeded = store.array(SUCCESS) == 1 if SUCCESS in store.names("metric") else False
    return np.where(succeeded, 1, 2)


def _decided(rule: Until, missed: NDArray[np.int8]) -> int | None:
    """Return the number of runs, counted without gaps, after which a campaign is decided."""
    gap = np.flatnonzero(missed == PENDING)
    return rule.decided((missed[: gap[0] if len(gap) else None] == 2).tolist())


def _blocks(plan: Plan, size: int, firsts: Iterable[int]) -> Iterator[Block]:
    for first in firsts:
        runs = range(first, min(first + size, plan.runs))
        yield Block(first, [plan.changes(plan.values(run)) for run in runs])


# ---- repetition of one run


def like(text: str, system: str | Path | None = None) -> tuple[str | Path, Changes]:
    """Return system and changes of one run of a dataset, `OUT.zarr#1234`, for run(); system:
    present path of the .ssp, None: the path in the dataset.

    Raises UsageError (no such run, or the dataset is of another system) or ResultsError.
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
    for name in differing(plan.sources):
        text = "%s: differs from the one used in run %s of %s"
        _log.warning(text, name, number, store.path.name)
    if system is not None and plan.system.read_bytes() != find_system(system).read_bytes():
        raise UsageError(
            f"--like {text}: is a run of {name_of(plan.system)}, not of {Path(system).stem}"
        )
    return system or plan.system, plan.changes(store.values(int(number)))
