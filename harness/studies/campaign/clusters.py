# SPDX-License-Identifier: BSD-2-Clause
"""Where a campaign runs: processes of this machine, or of Dask, by the address of a scheduler or as
jobs of SLURM.

Neither of these lets anybody in who has not got the credentials, and none opens a page that was not
asked for.
"""

from __future__ import annotations

import logging
import os
import shlex
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from shutil import which
from typing import Any
from urllib.parse import urlsplit

from harness.errors import UsageError
from harness.files.temporary import PrivateFolder
from harness.studies.campaign import credentials

SETTINGS = {
    # what dask watches itself for, by default fifty times a second, takes a tenth of a processor
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.scheduler.allowed-failures": 1,
    "distributed.scheduler.active-memory-manager.start": False,
}
"""Of dask, for its scheduler here."""
MEMORY_GB = 2
"""Of a job of SLURM per core, where jobqueue.yaml says nothing."""
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
        raise UsageError("--tls-ca: is for --scheduler and --slurm; nobody can reach workers here")
    if workers.insecure and workers.scheduler is None:
        raise UsageError("--insecure: is for --scheduler; nobody else can be reached without TLS")
    if workers.dashboard and not workers.elsewhere:
        raise UsageError("--dashboard: is for --scheduler and --slurm")
    if workers.dashboard and workers.slurm and not find_spec("bokeh"):
        raise UsageError("--dashboard: needs pip install bokeh")
    if workers.scheduler is not None:
        credentials.of_scheduler(workers.scheduler, workers.tls, workers.insecure)
    elif workers.slurm:
        credentials.named(workers.tls)
    return workers


@contextmanager
def connected(workers: Workers, said: Callable[[str], None]) -> Iterator[Any]:
    """A client of dask.distributed, with the cluster that it is for; said: receives what the user
    should know.
    """
    from dask import config
    from distributed import Client

    for name in list(logging.root.manager.loggerDict):  # what it logs is not for our user
        if name.startswith("distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    with ExitStack() as life:
        # a folder of Dask's own would be one in which others may put what workers import
        private = str(life.enter_context(PrivateFolder()))
        life.enter_context(config.set({**SETTINGS, "temporary-directory": private}))
        target, security = _target(workers, life)
        try:
            client = life.enter_context(Client(target, security=security))
        except (OSError, TimeoutError) as error:
            raise UsageError(f"--scheduler {workers.scheduler}: {_why(error)}") from error
        if security is None:
            said(f"{workers.scheduler}: {credentials.OPEN}")
        if workers.dashboard:
            link = urlsplit(client.dashboard_link)
            place = link if workers.scheduler else link._replace(netloc=f"{HERE}:{link.port}")
            said(f"dashboard: {place.geturl()}")
        yield client


def _target(workers: Workers, life: ExitStack) -> tuple[Any, Any]:
    """Cluster or address that a client is for, and its credentials."""
    if workers.scheduler is not None:
        security = credentials.of_scheduler(workers.scheduler, workers.tls, workers.insecure)
        bare = security is not None and "://" not in workers.scheduler
        return ("tls://" if bare else "") + workers.scheduler, security
    jobs = _jobs(workers, life)
    return jobs, jobs.security


def _jobs(workers: Workers, life: ExitStack) -> Any:
    """Jobs as jobqueue.yaml says, by default of one core; every core gets a process of its own,
    for a process flies one run at a time. Credentials that nobody names are made and handed on in
    a folder that only this user may enter, beside the logs of the jobs.
    """
    from dask import config

    if which("sbatch") is None:
        raise UsageError("--slurm: there is no sbatch here; call it where jobs are submitted")
    try:
        from dask_jobqueue.slurm import SLURMCluster
    except ImportError as error:
        raise UsageError('--slurm: needs pip install "servicing-fmus[slurm]"') from error

    def said(name: str, otherwise: Any) -> Any:
        return config.get(f"jobqueue.slurm.{name}", None) or otherwise

    cores, scheduler = said("cores", 1), _scheduler(workers.dashboard)
    shared = life.enter_context(PrivateFolder(Path.cwd()))
    try:
        jobs = SLURMCluster(
            cores=cores,
            processes=cores,
            memory=said("memory", f"{cores * MEMORY_GB}GB"),
            log_directory=said("log-directory", "slurm-logs"),
            local_directory=said("local-directory", shlex.quote(str(shared))),
            security=credentials.named(workers.tls) or credentials.made_in(shared),
            scheduler_cls=scheduler["cls"],
            scheduler_options={**said("scheduler-options", {}), **scheduler["options"]},
            worker_extra_args=[
                *said("worker-extra-args", []),
                "--worker-class",
                "harness.studies.campaign.nodes.Worker",
            ],
        )
        life.enter_context(jobs)
        jobs.scale(jobs=workers.count or 1)
    except (OSError, RuntimeError, ValueError) as error:
        raise UsageError(f"--slurm: {' '.join(str(error).split())}") from error
    return jobs


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
