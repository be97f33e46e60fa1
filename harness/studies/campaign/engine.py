# SPDX-License-Identifier: BSD-2-Clause
"""Execution of many runs: in this process, or distributed over workers.

An engine receives blocks and yields their rows in any order. Runs of a worker that was killed are
repeated one by one, and a run that kills its worker again is lost.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial
from itertools import islice
from queue import SimpleQueue
from typing import Any, NamedTuple, Protocol

from harness.studies.campaign.clusters import Workers, connected
from harness.studies.pool import CRASH, LostWorkerError, WorkerPool, prepare
from harness.studies.reuse import retaining

AHEAD = 3
"""Blocks per worker that are in progress or wait."""


class Work(Protocol):
    """Data that all runs share and workers receive, and the function that performs runs."""

    @property
    def piece(self) -> int:
        """Return the runs that a worker is given at once."""

    def run(self, part: Sequence[Any]) -> list[Any]:
        """Return the rows of runs, one after the other in one process."""

    def lost(self, message: str) -> Any:
        """Return the row of a run that has left only a message."""


class Block(NamedTuple):
    """Runs that are stored together."""

    first: int
    orders: Sequence[Any]


CompletedBlocks = Iterator[tuple[int, list[Any]]]
"""First run and rows of every completed block."""
RunBlocks = Callable[[Any, Iterable[Block]], CompletedBlocks]
"""Function that runs all blocks of a Work; it can be called repeatedly."""


class Executing(NamedTuple):
    """Executor with its present number of workers, the smallest number, and the exception that a
    lost worker raises.
    """

    executor: Executor
    there: Callable[[], int]
    least: int
    ended: type[Exception]


def prestart(workers: Workers, module: str) -> None:
    """Pre-start the fork server of local workers; module: imported by the workers."""
    if workers.workers != 0 and not workers.elsewhere:
        prepare(module)


@contextmanager
def worker_pool(
    workers: Workers, notify: Callable[[str], None] = lambda _: None
) -> Iterator[RunBlocks]:
    """Yield a function that runs blocks. Processes of this machine may still be starting.

    notify: receives notes for the user. Raises UsageError (a scheduler that does not answer, no
    SLURM).
    """
    least = workers.processes
    if workers.elsewhere:
        from distributed import KilledWorker

        with connected(workers, notify) as client:
            executor = client.get_executor(pure=False)
            there = lambda: max(least, len(client.nthreads()))  # noqa: E731
            yield partial(_spread, Executing(executor, there, least, KilledWorker))
    elif workers.workers == 0:
        with retaining():
            yield _here
    else:
        with WorkerPool(least, retaining) as executor:
            yield partial(_spread, Executing(executor, lambda: least, least, LostWorkerError))


def _here(work: Work, blocks: Iterable[Block]) -> CompletedBlocks:
    for block in blocks:
        yield block.first, work.run(block.orders)


def _spread(pool: Executing, work: Work, blocks: Iterable[Block]) -> CompletedBlocks:
    """Start the first blocks at once, and return the iterator of completed blocks."""
    spread = _Spread(pool, work, blocks)
    spread.fill()
    return spread.completed()


class _Spread:
    """Blocks in progress: a few per worker ahead, so that memory does not grow. The last blocks are
    run in pieces, so that all workers end together.
    """

    def __init__(self, pool: Executing, work: Work, blocks: Iterable[Block]) -> None:
        self.pool, self.work = pool, work
        self.left = last_in_pieces(blocks, pool.least, work.piece)
        self.jobs: dict[Future[list[Any]], tuple[Block, int, Sequence[Any]]] = {}
        self.begun: dict[int, dict[int, list[Any]]] = {}
        """Rows of blocks in progress by first run of the block and place of the piece."""
        self.over: SimpleQueue[Future[list[Any]]] = SimpleQueue()

    def fill(self) -> None:
        """Submit blocks until AHEAD per worker are in progress or waiting."""
        count = AHEAD * self.pool.there() - len(self.begun)
        for block, piece in islice(self.left, max(0, count)):
            self.begun[block.first] = {}
            for place in range(0, len(block.orders), piece):
                part = block.orders[place : place + piece]
                job = self._submit(part)
                self.jobs[job] = block, place, part
                job.add_done_callback(self.over.put)

    def _submit(self, part: Sequence[Any]) -> Future[list[Any]]:
        return self.pool.executor.submit(self.work.run, part)

    def completed(self) -> CompletedBlocks:
        """Yield completed blocks, and submit others in their place."""
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
        """Return the rows of a part of a block. If its worker was killed, its runs are repeated one
        by one.
        """
        try:
            return job.result()
        except self.pool.ended:
            return [self._alone(order) for order in part]

    def _alone(self, order: Any) -> Any:
        try:
            return self._submit([order]).result()[0]
        except self.pool.ended:
            return self.work.lost(CRASH)


def last_in_pieces(blocks: Iterable[Block], count: int, piece: int) -> Iterator[tuple[Block, int]]:
    """Yield blocks with the runs per task: a whole block, except for the last `count` blocks, which
    are split into pieces.
    """
    left = iter(blocks)
    last = deque(islice(left, count))
    for block in left:
        last.append(block)
        whole = last.popleft()
        yield whole, len(whole.orders)
    yield from ((block, piece) for block in last)
