# SPDX-License-Identifier: BSD-2-Clause
"""Where a campaign runs: processes of this machine, a Dask scheduler by its address, or SLURM."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from multiprocessing import forkserver, resource_tracker
from shutil import which
from types import ModuleType
from typing import Any

from harness.errors import UsageError
from harness.files.signals import held
from harness.studies.campaign import worker

DEATHS = 1
"""Workers of its own that a block, or a piece of one, may lose before it is taken apart."""
KEPT = 32 << 20
MEMORY = {
    "MALLOC_ARENA_MAX": 1,
    "MALLOC_TRIM_THRESHOLD_": 8 * KEPT,
    "MALLOC_MMAP_THRESHOLD_": KEPT,
}
"""A worker flies one run after the other in the same memory: it need not give it back and ask the
system for the same pages again (glibc takes at most 32 MiB, and gives threads heaps of 64 MiB that
come and go).
"""
ALONE = {"OMP_NUM_THREADS": 1, "MKL_NUM_THREADS": 1, "OPENBLAS_NUM_THREADS": 1}
"""There is a worker per processor: linear algebra takes no further ones (as dask has it)."""
METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
NEEDED = ("distributed", worker.__name__)
"""Modules that are imported once for all workers of this machine."""
SETTINGS = {
    "distributed.scheduler.allowed-failures": DEATHS,
    **{f"distributed.nanny.pre-spawn-environ.{name}": size for name, size in MEMORY.items()},
    "distributed.worker.multiprocessing-method": METHOD,
    # what dask watches itself for, by default fifty times a second, takes a tenth of a processor
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.scheduler.active-memory-manager.start": False,
}
"""Of dask, for the workers of a campaign."""
MEMORY_GB = 2
"""Of a job per core, where jobqueue.yaml says nothing."""


@dataclass(frozen=True)
class Workers:
    """Where a campaign runs: so many workers (0: this process alone; None: one per processor), or
    a scheduler by its address, or SLURM.
    """

    count: int | None = None
    scheduler: str | None = None
    slurm: bool = False

    @property
    def elsewhere(self) -> bool:
        """Whether they are not processes of this machine that we start."""
        return self.scheduler is not None or self.slurm


@contextmanager
def connected(workers: Workers) -> Iterator[Any]:
    """A client of dask.distributed, with the cluster that it is for."""
    from dask import config
    from distributed import Client, utils

    utils._forkserver_preload_set = True  # prepare() has done that, with fewer modules
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
            target = _local(processes(workers), life)
        try:
            with nullcontext() if workers.elsewhere else held():  # half a client cannot be closed
                client = life.enter_context(Client(target))
        except (OSError, TimeoutError) as error:
            raise UsageError(f"--scheduler {workers.scheduler}: does not answer") from error
        yield client


def processes(workers: Workers) -> int:
    """Of this machine."""
    return workers.count or os.cpu_count() or 1


def dashboard(client: Any) -> str:
    """Address of the dashboard, if there is one."""
    from importlib.util import find_spec

    return str(client.dashboard_link or "") if find_spec("bokeh") else ""


# ---- processes of this machine


def prepare(workers: Workers) -> None:
    """Start the process that workers of this machine are forked from, without waiting until it has
    imported what they need.
    """
    if METHOD != "forkserver" or workers.elsewhere or workers.count == 0:
        return
    multiprocessing.get_context(METHOD).set_forkserver_preload(list(NEEDED))
    wanted = {name: str(value) for name, value in {**MEMORY, **ALONE}.items()}
    with _ctrl_c_for_us_alone(), _environment(wanted):
        forkserver.ensure_running()


@contextmanager
def _environment(wanted: Mapping[str, str]) -> Iterator[None]:
    """What is not set otherwise is set for a while."""
    further = {name: value for name, value in wanted.items() if name not in os.environ}
    os.environ.update(further)
    try:
        yield
    finally:
        for name in further:
            del os.environ[name]


def _local(count: int, life: ExitStack) -> Any:
    """Workers on this machine, on their way, that end with `life`."""
    from distributed import LocalCluster

    life.enter_context(_without_main())
    with held(), _ctrl_c_for_us_alone():
        cluster = life.enter_context(
            LocalCluster(
                n_workers=0,
                threads_per_worker=1,
                processes=True,
                dashboard_address=":0",
                silence_logs=logging.CRITICAL,
                memory_limit=0,
                env=dict(os.environ),  # the process that they are forked from has that of its start
            )
        )
        cluster.scale(count)
        return cluster


@contextmanager
def _without_main() -> Iterator[None]:
    """Processes that are started here do not run the script again that has called us: what they do
    is in modules of ours and in files that they read.
    """
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


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


# ---- SLURM


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
