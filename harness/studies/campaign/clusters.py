# SPDX-License-Identifier: BSD-2-Clause
"""Where a campaign runs: processes of this machine, a Dask scheduler by its address, or SLURM.

None of them lets anybody in who has not got the credentials, and none opens a page that was not
asked for.
"""

from __future__ import annotations

import atexit
import logging
import multiprocessing
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from multiprocessing import forkserver, resource_tracker
from types import ModuleType
from typing import Any

from harness.errors import UsageError
from harness.files.signals import held
from harness.files.temporary import PrivateFolder
from harness.studies.campaign import credentials, slurm, worker

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
NODES = "harness.studies.campaign.nodes"
NEEDED = ("distributed", NODES, worker.__name__)
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
HERE = "127.0.0.1"
"""What is not for other machines listens here."""


@dataclass(frozen=True)
class Workers:
    """Where a campaign runs: so many workers (0: this process alone; None: one per processor), or
    a scheduler by its address, or SLURM.

    tls: credentials for the latter two; insecure: the scheduler may be without; dashboard: with
    Dask's pages, for this machine.
    """

    count: int | None = None
    scheduler: str | None = None
    slurm: bool = False
    tls: credentials.Files = credentials.NONE
    insecure: bool = False
    dashboard: bool = False

    @property
    def elsewhere(self) -> bool:
        """Whether they are not processes of this machine that we start."""
        return self.scheduler is not None or self.slurm


def checked(workers: Workers) -> Workers:
    """Workers as asked for; UsageError if they contradict themselves, or everybody may enter."""
    if workers.scheduler is not None and workers.slurm:
        raise UsageError("--scheduler and --slurm: one of both")
    if not workers.elsewhere and any(workers.tls):
        raise UsageError("--tls-ca: is for --scheduler and --slurm; workers here have their own")
    if workers.insecure and workers.scheduler is None:
        raise UsageError("--insecure: is for --scheduler; all others have TLS anyway")
    if workers.dashboard and workers.scheduler is None and not find_spec("bokeh"):
        raise UsageError("--dashboard: needs pip install bokeh")
    if workers.scheduler is not None:
        credentials.of_scheduler(workers.scheduler, workers.tls, workers.insecure)
    elif workers.slurm:
        credentials.named(workers.tls)
    return workers


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
        # a folder of Dask's own would be one in which others may put what workers import
        life.enter_context(config.set({**SETTINGS, "temporary-directory": str(_private().path)}))
        target, security = _target(workers, life)
        try:
            with nullcontext() if workers.elsewhere else held():  # half a client cannot be closed
                client = life.enter_context(Client(target, security=security))
        except (OSError, TimeoutError) as error:
            raise UsageError(f"--scheduler {workers.scheduler}: {_why(error)}") from error
        yield client


def _target(workers: Workers, life: ExitStack) -> tuple[Any, Any]:
    """Cluster or address that a client is for, and its credentials."""
    if workers.scheduler is not None:
        security = credentials.of_scheduler(workers.scheduler, workers.tls, workers.insecure)
        bare = security is not None and "://" not in workers.scheduler
        return ("tls://" if bare else "") + workers.scheduler, security
    pages = _scheduler(workers.dashboard)
    if workers.slurm:
        found = slurm.cluster(workers.count, credentials.named(workers.tls), pages, life)
    else:
        found = _local(processes(workers), pages, life)
    return found, found.security


def _why(error: BaseException) -> str:
    """What keeps a scheduler from answering: its credentials are not ours, or it is not there."""
    refused = "TLS" in str(error) or "SSL" in str(error) or "closed" in str(error)
    return "refuses the credentials" if refused else "does not answer"


def _scheduler(pages: bool) -> dict[str, Any]:
    """Class and options of a scheduler, with Dask's dashboard for this machine or without."""
    from distributed import Scheduler

    from harness.studies.campaign import nodes

    options = {"dashboard": pages, "dashboard_address": f"{HERE}:0" if pages else None}
    return {"cls": Scheduler if pages else nodes.Scheduler, "options": options}


def processes(workers: Workers) -> int:
    """Of this machine."""
    return workers.count or os.cpu_count() or 1


# ---- processes of this machine


def prepare(workers: Workers) -> None:
    """Start the process that workers of this machine are forked from, without waiting until it has
    imported what they need.
    """
    if METHOD != "forkserver" or workers.elsewhere or workers.count == 0:
        return
    # its socket lies in a folder that a killed process would leave behind
    process: Any = multiprocessing.current_process()
    process._config.setdefault("tempdir", str(_private().path))
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


@cache
def _private() -> PrivateFolder:
    """Of this process: for the socket of the server that workers are forked from, which stays, and
    for what Dask keeps in files.
    """
    folder = PrivateFolder()
    atexit.register(folder.close)
    return folder


def _local(count: int, scheduler: dict[str, Any], life: ExitStack) -> Any:
    """Workers on this machine, on their way, that end with `life`."""
    from distributed import Nanny, SpecCluster

    from harness.studies.campaign import nodes

    security = credentials.made()
    node = {"host": HERE, "protocol": "tls://", "security": security}
    options = {
        **node,
        "worker_class": nodes.Worker,
        "nthreads": 1,
        "memory_limit": 0,
        "silence_logs": logging.CRITICAL,
        "env": dict(os.environ),  # the process that they are forked from has that of its start
    }
    life.enter_context(_without_main())
    with held(), _ctrl_c_for_us_alone():
        cluster = life.enter_context(
            SpecCluster(
                scheduler={**scheduler, "options": {**scheduler["options"], **node}},
                worker={"cls": Nanny, "options": options},
                security=security,
                silence_logs=logging.CRITICAL,
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
