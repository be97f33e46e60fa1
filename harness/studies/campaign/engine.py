# SPDX-License-Identifier: BSD-2-Clause
"""How many runs are run: by this process, or spread over workers.

An engine is given blocks and yields what came of them, in whatever order. What was given to a
worker that was killed is run once more, run by run, and a run that kills another one is lost.
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
from harness.studies.crew import CRASH, Crew, LostError, prepare
from harness.studies.warm import at_work

AHEAD = 3
"""Blocks per worker that are under way or wait."""


class Work(Protocol):
    """What all runs have in common, as plain data."""

    @property
    def piece(self) -> int:
        """Runs that a worker is given at once."""

    def fly(self, part: Sequence[Any]) -> list[Any]:
        """What comes of runs, one after the other in one process."""

    def lost(self, message: str) -> Any:
        """What comes of a run that has left nothing but a message."""


class Block(NamedTuple):
    """Runs that are kept together."""

    first: int
    orders: Sequence[Any]


Flown = Iterator[tuple[int, list[Any]]]
"""First run of the blocks that are over, and what came of their runs."""
Fly = Callable[[Any, Iterable[Block]], Flown]
"""Runs all blocks of a Work; may be called again and again."""


class Hands(NamedTuple):
    """Who does it: an executor, how many processes are there, at least, and what it raises if one
    was ended.
    """

    executor: Executor
    there: Callable[[], int]
    least: int
    ended: type[Exception]


def get_ready(workers: Workers, module: str) -> None:
    """Let processes of this machine be near when they are needed; module: what they import."""
    if workers.workers != 0 and not workers.elsewhere:
        prepare(module)


@contextmanager
def crew(workers: Workers, said: Callable[[str], None] = lambda _: None) -> Iterator[Fly]:
    """Who runs blocks; processes of this machine are still starting when it is there.

    said: receives what the user should know. Raises UsageError (a scheduler that does not answer,
    no SLURM).
    """
    least = workers.processes
    if workers.elsewhere:
        from distributed import KilledWorker

        with connected(workers, said) as client:
            executor = client.get_executor(pure=False)
            there = lambda: max(least, len(client.nthreads()))  # noqa: E731
            yield partial(_spread, Hands(executor, there, least, KilledWorker))
    elif workers.workers == 0:
        with at_work():
            yield _here
    else:
        with Crew(least, at_work) as executor:
            yield partial(_spread, Hands(executor, lambda: least, least, LostError))


def _here(work: Work, blocks: Iterable[Block]) -> Flown:
    for block in blocks:
        yield block.first, work.fly(block.orders)


def _spread(hands: Hands, work: Work, blocks: Iterable[Block]) -> Flown:
    """All workers are busy from this call on."""
    spread = _Spread(hands, work, blocks)
    spread.fill()
    return spread.flown()


class _Spread:
    """Blocks on their way: a few per worker ahead, so that memory does not grow; the last ones are
    flown in pieces, so that all workers end together.
    """

    def __init__(self, hands: Hands, work: Work, blocks: Iterable[Block]) -> None:
        self.hands, self.work = hands, work
        self.left = last_in_pieces(blocks, hands.least, work.piece)
        self.jobs: dict[Future[list[Any]], tuple[Block, int, Sequence[Any]]] = {}
        self.landed: dict[int, dict[int, list[Any]]] = {}
        """Of a block by its first run: rows by the place of their piece."""
        self.over: SimpleQueue[Future[list[Any]]] = SimpleQueue()

    def fill(self) -> None:
        """Hand over as many blocks as there is room for."""
        room = AHEAD * self.hands.there() - len(self.landed)
        for block, piece in islice(self.left, max(0, room)):
            self.landed[block.first] = {}
            for place in range(0, len(block.orders), piece):
                part = block.orders[place : place + piece]
                job = self._flight(part)
                self.jobs[job] = block, place, part
                job.add_done_callback(self.over.put)

    def _flight(self, part: Sequence[Any]) -> Future[list[Any]]:
        return self.hands.executor.submit(self.work.fly, part)

    def flown(self) -> Flown:
        """Blocks that are complete; others take their place."""
        while self.jobs:
            job = self.over.get()
            block, place, part = self.jobs.pop(job)
            rows = self.landed[block.first]
            rows[place] = self._rows(job, part)
            if sum(map(len, rows.values())) == len(block.orders):
                del self.landed[block.first]
                self.fill()
                yield block.first, [row for place in sorted(rows) for row in rows[place]]

    def _rows(self, job: Future[list[Any]], part: Sequence[Any]) -> list[Any]:
        """Of a piece; the runs of one whose worker was killed fly once more, each alone."""
        try:
            return job.result()
        except self.hands.ended:
            return [self._alone(order) for order in part]

    def _alone(self, order: Any) -> Any:
        try:
            return self._flight([order]).result()[0]
        except self.hands.ended:
            return self.work.lost(CRASH)


def last_in_pieces(blocks: Iterable[Block], count: int, piece: int) -> Iterator[tuple[Block, int]]:
    """Blocks and how many of their runs are handed over at once: all, but for the last ones."""
    left = iter(blocks)
    last = deque(islice(left, count))
    for block in left:
        last.append(block)
        whole = last.popleft()
        yield whole, len(whole.orders)
    yield from ((block, piece) for block in last)
