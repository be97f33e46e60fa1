# SPDX-License-Identifier: BSD-2-Clause
"""How the blocks of a campaign are run: by this process, or spread over workers.

An engine is given blocks and yields what came of them, in whatever order. What was given to a
worker that was killed flies once more, run by run, and the run that kills another one is a failed
run.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from functools import partial
from itertools import islice
from queue import SimpleQueue
from typing import Any, NamedTuple

from harness.master.changes import Changes
from harness.studies.campaign import worker
from harness.studies.campaign.clusters import Workers, connected
from harness.studies.campaign.plan import Task
from harness.studies.campaign.worker import Row
from harness.studies.crew import CRASH, Crew, LostError, prepare

AHEAD = 3
"""Blocks per worker that are under way or wait."""


class Block(NamedTuple):
    """Runs that are written together."""

    first: int
    changes: Sequence[Changes]


Flown = Iterator[tuple[int, list[Row]]]
"""First run and rows of the blocks that are over."""
Fly = Callable[[Task, Iterable[Block]], Flown]
"""Runs all blocks; may be called again and again."""


class Hands(NamedTuple):
    """Who does it: an executor, how many processes are there, at least, and what it raises if one
    was ended.
    """

    executor: Executor
    there: Callable[[], int]
    least: int
    ended: type[Exception]


def get_ready(workers: Workers) -> None:
    """Let processes of this machine be near when they are needed."""
    if workers.workers != 0 and not workers.elsewhere:
        prepare(worker.__name__)


@contextmanager
def crew(workers: Workers, said: Callable[[str], None]) -> Iterator[Fly]:
    """Who runs blocks; processes of this machine are still starting when it is there.

    said: receives what the user should know. Raises UsageError (a
    scheduler that does not answer, no SLURM).
    """
    least = workers.processes
    if workers.elsewhere:
        with connected(workers, said) as client:
            yield partial(_spread, of_cluster(client, least))
    elif workers.workers == 0:
        with worker.at_work():
            yield _here
    else:
        with Crew(least, worker.at_work) as executor:
            yield partial(_spread, Hands(executor, lambda: least, least, LostError))


def of_cluster(client: Any, least: int) -> Hands:
    """The workers of a cluster of Dask."""
    from distributed import KilledWorker

    executor = client.get_executor(pure=False)
    return Hands(executor, lambda: max(least, len(client.nthreads())), least, KilledWorker)


def _here(task: Task, blocks: Iterable[Block]) -> Flown:
    for block in blocks:
        yield block.first, worker.fly_block(task, block.changes)


def _spread(hands: Hands, task: Task, blocks: Iterable[Block]) -> Flown:
    """All workers are busy from this call on."""
    spread = _Spread(hands, task, blocks)
    spread.fill()
    return spread.flown()


class _Spread:
    """Blocks on their way: a few per worker ahead, so that memory does not grow; the last ones are
    flown in pieces, so that all workers end together.
    """

    def __init__(self, hands: Hands, task: Task, blocks: Iterable[Block]) -> None:
        self.hands, self.task = hands, task
        self.left = last_in_pieces(blocks, hands.least, task.piece)
        self.jobs: dict[Future[list[Row]], tuple[Block, int, Sequence[Changes]]] = {}
        self.landed: dict[int, dict[int, list[Row]]] = {}
        """Of a block by its first run: rows by the place of their piece."""
        self.over: SimpleQueue[Future[list[Row]]] = SimpleQueue()

    def fill(self) -> None:
        """Hand over as many blocks as there is room for."""
        room = AHEAD * self.hands.there() - len(self.landed)
        for block, piece in islice(self.left, max(0, room)):
            self.landed[block.first] = {}
            for place in range(0, len(block.changes), piece):
                part = block.changes[place : place + piece]
                job = self._flight(part)
                self.jobs[job] = block, place, part
                job.add_done_callback(self.over.put)

    def _flight(self, part: Sequence[Changes]) -> Future[list[Row]]:
        return self.hands.executor.submit(worker.fly_block, self.task, part)

    def flown(self) -> Flown:
        """Blocks that are complete; others take their place."""
        while self.jobs:
            job = self.over.get()
            block, place, part = self.jobs.pop(job)
            rows = self.landed[block.first]
            rows[place] = self._rows(job, part)
            if sum(map(len, rows.values())) == len(block.changes):
                del self.landed[block.first]
                self.fill()
                yield block.first, [row for place in sorted(rows) for row in rows[place]]

    def _rows(self, job: Future[list[Row]], part: Sequence[Changes]) -> list[Row]:
        """Of a piece; the runs of one whose worker was killed fly once more, each alone."""
        try:
            return job.result()
        except self.hands.ended:
            return [self._alone(changes) for changes in part]

    def _alone(self, changes: Changes) -> Row:
        try:
            return self._flight([changes]).result()[0]
        except self.hands.ended:
            return worker.lost(self.task, CRASH)


def last_in_pieces(blocks: Iterable[Block], count: int, piece: int) -> Iterator[tuple[Block, int]]:
    """Blocks and how many of their runs are handed over at once: all, but for the last ones."""
    left = iter(blocks)
    last = deque(islice(left, count))
    for block in left:
        last.append(block)
        whole = last.popleft()
        yield whole, len(whole.changes)
    yield from ((block, piece) for block in last)
