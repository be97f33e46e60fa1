# SPDX-License-Identifier: BSD-2-Clause
"""Execution of many runs: in this process, or by worker processes.

worker_pool() yields a function that receives blocks of runs and yields the rows of the dataset for
each block when it is complete, in any order. If a worker process crashes or is killed, the runs of
its task are repeated one by one. If this happens again in a repeated run, this run gets a row with
an error message only.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from itertools import islice
from queue import SimpleQueue
from typing import Any, NamedTuple, Protocol

from harness.studies.pool import CRASH, LostWorkerError, WorkerPool, prepare
from harness.studies.reuse import retaining

AHEAD = 3
"""Number of blocks per worker that are submitted at the same time: in progress or in the queue."""


class Work(Protocol):
    """Object that is sent to the workers: the data that all runs share, and how to perform runs."""

    @property
    def piece(self) -> int:
        """Return the number of runs per task of a worker."""

    def run(self, part: Sequence[Any]) -> list[Any]:
        """Perform runs one after the other in this process; return their rows in the same order."""

    def lost(self, message: str) -> Any:
        """Return the row of a run whose worker process crashed or was killed: it has the error
        message but no results.
        """


class Block(NamedTuple):
    """Consecutive runs that are stored together: number of the first run, and one order per run. An
    order is the data from which a Work performs a run, such as the changes of the run.
    """

    first: int
    orders: Sequence[Any]


CompletedBlocks = Iterator[tuple[int, list[Any]]]
"""Iterator over completed blocks: number of the first run, and the rows of all runs of the block.
"""
RunBlocks = Callable[[Any, Iterable[Block]], CompletedBlocks]
"""Function that takes a Work and its blocks, and performs all runs; it can be called repeatedly."""


def processes(workers: int | None) -> int:
    """Return the number of workers: as given, but one per processor for None or 0."""
    return workers or os.cpu_count() or 1


def prestart(workers: int | None, module: str) -> None:
    """Start the fork server early and let it import a module that the workers need; do nothing if
    all runs are made in this process (workers = 0). module: name of the module.
    """
    if workers != 0:
        prepare(module)


@contextmanager
def worker_pool(workers: int | None) -> Iterator[RunBlocks]:
    """Yield a function that performs blocks of runs on worker processes. The workers may still be
    starting when the `with` block begins.

    workers: number of workers (None: one per processor, 0: the runs are made in this process).
    """
    if workers == 0:
        with retaining():
            yield _here
    else:
        with WorkerPool(processes(workers), retaining) as pool:
            yield partial(_spread, pool)


def _here(work: Work, blocks: Iterable[Block]) -> CompletedBlocks:
    for block in blocks:
        yield block.first, work.run(block.orders)


def _spread(pool: WorkerPool, work: Work, blocks: Iterable[Block]) -> CompletedBlocks:
    """Submit the first blocks to the workers at once; return the iterator of completed blocks."""
    spread = _Spread(pool, work, blocks)
    spread.fill()
    return spread.completed()


class _Spread:
    """Distribution of blocks to the workers. Only AHEAD blocks per worker are submitted at a time,
    so that memory does not grow. The last blocks are divided into pieces, so that all workers
    finish at nearly the same time.
    """

    def __init__(self, pool: WorkerPool, work: Work, blocks: Iterable[Block]) -> None:
        self.pool, self.work = pool, work
        self.left = last_in_pieces(blocks, pool.count, work.piece)
        self.jobs: dict[Future[list[Any]], tuple[Block, int, Sequence[Any]]] = {}
        self.begun: dict[int, dict[int, list[Any]]] = {}
        """Rows of the blocks in progress, by the first run of the block and then by the index, in
        the block, of the first run of the piece.
        """
        self.over: SimpleQueue[Future[list[Any]]] = SimpleQueue()

    def fill(self) -> None:
        """Submit blocks until AHEAD blocks per worker are in progress or wait in the queue."""
        count = AHEAD * self.pool.count - len(self.begun)
        for block, piece in islice(self.left, max(0, count)):
            self.begun[block.first] = {}
            for place in range(0, len(block.orders), piece):
                part = block.orders[place : place + piece]
                job = self._submit(part)
                self.jobs[job] = block, place, part
                job.add_done_callback(self.over.put)

    def _submit(self, part: Sequence[Any]) -> Future[list[Any]]:
        return self.pool.submit(self.work.run, part)

    def completed(self) -> CompletedBlocks:
        """Yield blocks as they are completed, and submit further blocks in their place."""
        while self.jobs:
            job = self.over.get()
            block, place, part = self.jobs.pop(job)
            rows = self.begun[block.first]
            rows[place] = self._rows(job, part)
            if sum(map(len, rows.values())) == len(block.orders):
                del self.begun[block.first]
                self.fill()
                yield block.first, [row for place in sorted(rows) for row in rows[place]]

    def _rows(self, job: Future[list[Any]], part: Sequence[Any]) -> list[Any]:
        """Return the rows of a part of a block, which its task `job` has computed. If the worker
        process crashed or was killed before the task was complete, repeat the runs one by one.
        """
        try:
            return job.result()
        except LostWorkerError:
            return [self._alone(order) for order in part]

    def _alone(self, order: Any) -> Any:
        try:
            return self._submit([order]).result()[0]
        except LostWorkerError:
            return self.work.lost(CRASH)


def last_in_pieces(blocks: Iterable[Block], count: int, piece: int) -> Iterator[tuple[Block, int]]:
    """Yield every block with the number of runs per task: the last `count` blocks are divided into
    tasks of `piece` runs, each earlier block is one task.
    """
    left = iter(blocks)
    last = deque(islice(left, count))
    for block in left:
        last.append(block)
        whole = last.popleft()
        yield whole, len(whole.orders)
    yield from ((block, piece) for block in last)
