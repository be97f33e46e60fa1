# SPDX-License-Identifier: BSD-2-Clause
"""How the blocks of a campaign are run: by this process, or spread over workers.

An engine is given blocks and yields what came of them, in whatever order. What was given to a
worker that was killed goes to another one; what kills every worker is taken apart, and the run that
does it is a failed run.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import islice
from typing import Any, NamedTuple

from harness.master.changes import Changes
from harness.studies.campaign import worker
from harness.studies.campaign.clusters import Workers, connected, processes
from harness.studies.campaign.credentials import OPEN
from harness.studies.campaign.worker import Row, Task

CRASH = "its process was ended from outside, or by a crash inside an FMU"
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


@contextmanager
def crew(workers: Workers, said: Callable[[str], None]) -> Iterator[Fly]:
    """Who runs blocks; processes of this machine are still starting when it is there.

    said: receives what the user should know, as the address of the dashboard. Raises UsageError (a
    scheduler that does not answer, no SLURM).
    """
    if workers.count == 0 and not workers.elsewhere:
        try:
            yield _here
        finally:
            worker.close()
        return
    with connected(workers) as client:
        if client.security.require_encryption is not True:
            said(f"{workers.scheduler}: {OPEN}")
        if workers.dashboard:
            said(f"dashboard: {client.dashboard_link}")
        yield partial(_spread, client, workers)


def _here(task: Task, blocks: Iterable[Block]) -> Flown:
    for block in blocks:
        yield block.first, worker.fly_block(task, block.changes)


def _spread(client: Any, workers: Workers, task: Task, blocks: Iterable[Block]) -> Flown:
    """All workers are busy from this call on."""
    spread = _Spread(client, workers, task, blocks)
    spread.fill()
    return spread.flown()


class _Spread:
    """Blocks on their way: a few per worker ahead, so that memory does not grow; the last ones are
    flown in pieces, so that all workers end together.
    """

    def __init__(self, client: Any, workers: Workers, task: Task, blocks: Iterable[Block]) -> None:
        from distributed import as_completed

        self.client, self.task = client, task
        self.least = processes(workers)
        self.left = last_in_pieces(blocks, self.least, task.piece)
        self.jobs: dict[Any, tuple[Block, int, Sequence[Changes]]] = {}
        self.landed: dict[int, dict[int, list[Row]]] = {}
        """Of a block by its first run: rows by the place of their piece."""
        self.ended = as_completed()

    def fill(self) -> None:
        """Hand over as many blocks as there is room for."""
        room = AHEAD * max(self.least, len(self.client.nthreads())) - len(self.landed)
        for block, piece in islice(self.left, max(0, room)):
            self.landed[block.first] = {}
            for place in range(0, len(block.changes), piece):
                part = block.changes[place : place + piece]
                job = self.client.submit(worker.fly_block, self.task, part, pure=False)
                self.jobs[job] = block, place, part
                self.ended.add(job)

    def flown(self) -> Flown:
        """Blocks that are complete; others take their place."""
        for job in self.ended:
            block, place, part = self.jobs.pop(job)
            rows = self.landed[block.first]
            rows[place] = self._rows(job, part)
            if sum(map(len, rows.values())) == len(block.changes):
                del self.landed[block.first]
                self.fill()
                yield block.first, [row for place in sorted(rows) for row in rows[place]]

    def _rows(self, job: Any, part: Sequence[Changes]) -> list[Row]:
        """Of a piece; the runs of one whose workers were killed fly once more, each alone."""
        from distributed import KilledWorker

        try:
            return list(job.result())
        except KilledWorker:
            return [self._alone(changes) for changes in part]
        finally:
            job.release()

    def _alone(self, changes: Changes) -> Row:
        from distributed import KilledWorker

        job = self.client.submit(worker.fly_block, self.task, [changes], pure=False)
        try:
            row: Row = job.result()[0]
        except KilledWorker:
            return worker.lost(self.task, CRASH)
        return row


def last_in_pieces(blocks: Iterable[Block], count: int, piece: int) -> Iterator[tuple[Block, int]]:
    """Blocks and how many of their runs are handed over at once: all, but for the last ones."""
    left = iter(blocks)
    last = deque(islice(left, count))
    for block in left:
        last.append(block)
        whole = last.popleft()
        yield whole, len(whole.changes)
    yield from ((block, piece) for block in last)
