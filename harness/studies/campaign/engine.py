# SPDX-License-Identifier: BSD-2-Clause
"""Who runs the blocks of a campaign: this process, the processors of this machine, or a cluster.

An engine is given blocks and yields what came of them, in whatever order. The block of a worker
that was killed goes to another one; a block that kills every worker is taken apart, and the run
that does it is a failed run.
"""

from __future__ import annotations

import logging
import os
import signal
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import islice
from multiprocessing import resource_tracker
from shutil import which
from typing import Any, NamedTuple

from harness.errors import UsageError
from harness.files.signals import held
from harness.master.changes import Changes
from harness.studies.campaign import worker
from harness.studies.campaign.worker import Row, Task

CRASH = "its process was ended from outside, or by a crash inside an FMU"
DEATHS = 1
"""Workers of its own that a block may lose before it is taken apart."""
KEPT = 32 << 20
SETTINGS = {
    "distributed.scheduler.allowed-failures": DEATHS,
    # a worker flies one run after the other in the same memory: it need not give it back and ask
    # the system for the same pages again (glibc takes at most 32 MiB)
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 8 * KEPT,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": KEPT,
    "distributed.worker.profile.enabled": False,
}
"""Of dask, for the workers of a campaign."""
MEMORY_GB = 2
"""Of a job per core, where jobqueue.yaml says nothing."""
AHEAD = 3
"""Blocks per worker that are under way or wait."""


class Block(NamedTuple):
    """Runs that are flown one after the other by one worker."""

    first: int
    changes: Sequence[Changes]


Flown = Iterator[tuple[int, list[Row]]]
"""First run and rows of the blocks that are over."""


@dataclass(frozen=True)
class Workers:
    """Where a campaign runs: so many workers (0: this process alone; None: one per processor), or
    a scheduler by its address, or SLURM.
    """

    count: int | None = None
    scheduler: str | None = None
    slurm: bool = False


def fly(
    task: Task, blocks: Iterable[Block], workers: Workers, said: Callable[[str], None]
) -> Flown:
    """Run all blocks; said: receives what the user should know, as the address of the dashboard."""
    if workers.count == 0 and workers.scheduler is None:
        return _here(task, blocks)
    return _spread(task, iter(blocks), workers, said)


def _here(task: Task, blocks: Iterable[Block]) -> Flown:
    try:
        for block in blocks:
            yield block.first, worker.fly_block(task, block.changes)
    finally:
        worker.close()


# ---- dask


@contextmanager
def _client(workers: Workers) -> Iterator[Any]:
    """A client of dask.distributed, with the cluster that it is for."""
    from dask import config
    from distributed import Client

    for name in list(logging.root.manager.loggerDict):  # what it logs is not for our user
        if name.startswith("distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    with ExitStack() as life:
        life.enter_context(config.set(SETTINGS))
        if workers.scheduler is not None:
            target: Any = workers.scheduler
        elif workers.slurm:
            target = life.enter_context(_slurm(workers.count))
        else:
            target = _local(workers.count, life)
        try:
            yield life.enter_context(Client(target))
        except (OSError, TimeoutError) as error:
            raise UsageError(f"--scheduler {workers.scheduler}: does not answer") from error


def _local(count: int | None, life: ExitStack) -> Any:
    """Workers on this machine that end with `life`, also if Ctrl-C comes while they start."""
    from distributed import LocalCluster

    with held(), _ctrl_c_for_us_alone():
        return life.enter_context(
            LocalCluster(
                n_workers=count or os.cpu_count() or 1,
                threads_per_worker=1,
                processes=True,
                dashboard_address=":0",
                silence_logs=logging.CRITICAL,
                memory_limit=0,
            )
        )


@contextmanager
def _ctrl_c_for_us_alone() -> Iterator[None]:
    """Threads and processes that are started here never see SIGINT; it reaches us afterwards.

    The thread of the cluster passes the mask on to all workers that it starts later.
    """
    if os.name != "posix":
        yield
        return
    resource_tracker.ensure_running()  # it would lift the mask again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _slurm(count: int | None) -> Any:
    """Jobs as jobqueue.yaml says, by default of one core; every core gets a process of its own,
    for a process flies one run at a time.
    """
    from dask import config

    if which("sbatch") is None:
        raise UsageError("--slurm: there is no sbatch here; call it where jobs are submitted")
    try:
        from dask_jobqueue.slurm import SLURMCluster
    except ImportError as error:
        raise UsageError('--slurm: needs pip install "servicing-fmus[slurm]"') from error
    cores = config.get("jobqueue.slurm.cores", None) or 1
    memory = config.get("jobqueue.slurm.memory", None) or f"{cores * MEMORY_GB}GB"
    logs = config.get("jobqueue.slurm.log-directory", None) or "slurm-logs"
    try:
        cluster = SLURMCluster(cores=cores, processes=cores, memory=memory, log_directory=logs)
        cluster.scale(jobs=count or 1)
    except (OSError, RuntimeError, ValueError) as error:
        raise UsageError(f"--slurm: {' '.join(str(error).split())}") from error
    return cluster


def _spread(
    task: Task, blocks: Iterator[Block], workers: Workers, said: Callable[[str], None]
) -> Flown:
    """Keep all workers busy with a few blocks ahead, so that memory does not grow."""
    from distributed import KilledWorker, as_completed

    with _client(workers) as client:
        if link := _dashboard(client):
            said(f"dashboard: {link}")
        waiting: dict[Any, Block] = {}
        queue = as_completed()

        def fill() -> None:
            room = AHEAD * max(1, len(client.nthreads())) - len(waiting)
            for block in islice(blocks, max(0, room)):
                job = client.submit(worker.fly_block, task, block.changes, pure=False)
                waiting[job] = block
                queue.add(job)

        fill()
        for job in queue:
            block = waiting.pop(job)
            try:
                rows = job.result()
            except KilledWorker:
                rows = _one_by_one(client, task, block)
            job.release()
            fill()
            yield block.first, rows


def _dashboard(client: Any) -> str:
    """Address of the dashboard, if there is one."""
    from importlib.util import find_spec

    return str(client.dashboard_link or "") if find_spec("bokeh") else ""


def _one_by_one(client: Any, task: Task, block: Block) -> list[Row]:
    """The runs of a block that has killed its workers."""
    from distributed import KilledWorker

    rows = []
    for changes in block.changes:
        job = client.submit(worker.fly_block, task, [changes], pure=False)
        try:
            rows += job.result()
        except KilledWorker:
            rows.append(worker.lost(task, CRASH))
    return rows
