# SPDX-License-Identifier: BSD-2-Clause
"""Workers of a campaign: processes on this machine, workers of a Dask scheduler at an address, or
Dask workers started as SLURM jobs.

Any client of a Dask scheduler can run code as the user who started it. Therefore all connections
use TLS with certificates on both sides, which are made for one campaign or named by the user, and
the web pages of Dask are not served.
"""

from __future__ import annotations

import logging
import os
import shlex
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from shutil import which
from typing import Any

from harness.errors import UsageError
from harness.files.output import PrivateFolder

SETTINGS = {
    # by default Dask profiles itself fifty times a second, which takes a tenth of a processor
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
    "distributed.scheduler.allowed-failures": 1,
    "distributed.scheduler.active-memory-manager.start": False,
}
"""Settings of Dask for the scheduler in this process."""
MEMORY_GB = 2
"""Memory of a SLURM job per core [GB], unless jobqueue.yaml sets it."""
OPEN = "without TLS anybody on the network can run code as this user"
"""Reason in messages on schedulers without TLS."""


@dataclass(frozen=True)
class Workers:
    """Options that determine where a campaign runs.

    workers: number of processes on this machine (0: only the main process, None: one per
    processor), or number of SLURM jobs; scheduler: address of a Dask scheduler; slurm: start
    workers as SLURM jobs; tls_ca, tls_cert, tls_key: PEM files for scheduler and slurm:
    certificate of the authority, own certificate, its key (None: in the file of the certificate);
    insecure: accept a scheduler without TLS; lanes: let a worker make several fused runs at once.
    """

    workers: int | None = None
    scheduler: str | None = None
    slurm: bool = False
    tls_ca: str | Path | None = None
    tls_cert: str | Path | None = None
    tls_key: str | Path | None = None
    insecure: bool = False
    lanes: bool = True

    @property
    def elsewhere(self) -> bool:
        """Return whether the runs are made by Dask workers (scheduler or SLURM), not by processes
        that the campaign starts on this machine.
        """
        return self.scheduler is not None or self.slurm

    @property
    def processes(self) -> int:
        """Return the number of workers: as given, otherwise one per processor of this machine."""
        return self.workers or os.cpu_count() or 1

    def check(self) -> None:
        """Raise UsageError for options that contradict each other, or for a scheduler without TLS
        unless `insecure` accepts it.
        """
        if self.scheduler is not None and self.slurm:
            raise UsageError("--scheduler and --slurm are mutually exclusive")
        if not self.elsewhere and (self.tls_ca or self.tls_cert or self.tls_key):
            raise UsageError(
                "--tls-ca, --tls-cert and --tls-key are valid only with --scheduler or --slurm"
            )
        if self.insecure and self.scheduler is None:
            raise UsageError("--insecure is valid only with --scheduler")
        known = self.credentials() if self.elsewhere else None
        address = f"--scheduler {self.scheduler}"
        if self.scheduler is not None and known is None and not self.insecure:
            raise UsageError(
                f"{address}: {OPEN}; give the credentials of the cluster with --tls-ca, "
                "--tls-cert and --tls-key (or in the configuration of Dask), or accept it with "
                "--insecure"
            )
        if self.scheduler is not None and known and self.scheduler.startswith(("tcp:", "ws:")):
            raise UsageError(
                f"{address}: the address is without TLS, but credentials are given; use tls://HOST:PORT"
            )

    def credentials(self) -> Any:
        """Return the TLS credentials of the given files, otherwise those in the configuration of
        Dask, None if there are none. Raise UsageError if they cannot be used.
        """
        from distributed.security import Security

        files = {"ca": self.tls_ca, "cert": self.tls_cert, "key": self.tls_key}
        ca, cert, key = (f and str(Path(f).absolute()) for f in files.values())
        given = [f"--tls-{name} {file}" for name, file in files.items() if file]
        everybody = ("client", "scheduler", "worker")
        own = {f"tls_{who}_{n}": f for who in everybody for n, f in (("cert", cert), ("key", key))}
        found: Any = Security(tls_ca_file=ca, **own) if given else Security()
        if not given and not (found.tls_ca_file and found.tls_client_cert):
            return None
        found.require_encryption = True
        try:
            if given and not (ca and cert):
                raise ValueError("--tls-ca or --tls-cert is missing")
            found.get_connection_args("client")
        except (OSError, ValueError) as error:  # ssl.SSLError is an OSError
            place = " ".join(given) or "the configuration of Dask, distributed.comm.tls"
            needed = (
                "the certificate of the authority, your own, and its key if it is in another file"
            )
            raise UsageError(f"{place}: expected PEM files, {needed} ({error})") from error
        return found


@contextmanager
def connected(workers: Workers, notify: Callable[[str], None]) -> Iterator[Any]:
    """Yield a client of dask.distributed that is connected to the scheduler, or to a new cluster of
    SLURM jobs, which ends with the block. notify: called with each note for the user.
    """
    from dask import config
    from distributed import Client

    for name in list(logging.root.manager.loggerDict):  # hide the messages of Dask
        if name.startswith("distributed"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
    with ExitStack() as life:
        # workers import files from this folder; other users can write into the default one of Dask
        private = str(life.enter_context(PrivateFolder()))
        life.enter_context(config.set({**SETTINGS, "temporary-directory": private}))
        security, target = workers.credentials(), workers.scheduler
        if target is None:
            target = _jobs(workers, security, life)
            security = target.security
        elif security is not None and "://" not in target:
            target = f"tls://{target}"
        try:
            client = life.enter_context(Client(target, security=security))
        except (OSError, TimeoutError) as error:
            tls = any(word in str(error) for word in ("TLS", "SSL", "closed"))
            why = "rejects the credentials" if tls else "does not answer"
            raise UsageError(f"--scheduler {workers.scheduler}: {why}") from error
        if security is None:
            notify(f"{workers.scheduler}: {OPEN}")
        yield client


def _jobs(workers: Workers, security: Any, life: ExitStack) -> Any:
    """Return a Dask cluster of SLURM jobs, configured by the user's jobqueue.yaml; a job has one
    core by default. Every core gets a separate process, because a process performs one run at a
    time.

    security: TLS credentials of the user (None: new ones are made in a folder of the working
    directory that only this user may enter); life: ends the cluster and removes the folder.
    """
    from dask import config

    if which("sbatch") is None:
        raise UsageError("--slurm: sbatch not found; run this command on a SLURM login node")
    try:
        from dask_jobqueue.slurm import SLURMCluster
    except ImportError as error:
        raise UsageError('--slurm: run pip install "servicing-fmus[slurm]" first') from error
    from harness.studies.campaign import nodes

    def setting(name: str, otherwise: Any) -> Any:
        return config.get(f"jobqueue.slurm.{name}", None) or otherwise

    cores, shared = setting("cores", 1), life.enter_context(PrivateFolder(Path.cwd()))
    further = ["--worker-class", f"{nodes.__name__}.{nodes.Worker.__name__}"]
    try:
        jobs = SLURMCluster(
            cores=cores,
            processes=cores,
            memory=setting("memory", f"{cores * MEMORY_GB}GB"),
            log_directory=setting("log-directory", "slurm-logs"),
            local_directory=setting("local-directory", shlex.quote(str(shared))),
            security=security or _made(shared),
            scheduler_cls=nodes.Scheduler,
            scheduler_options={**setting("scheduler-options", {}), "dashboard": False},
            worker_extra_args=[*setting("worker-extra-args", []), *further],
        )
        life.enter_context(jobs)
        jobs.scale(jobs=workers.workers or 1)
    except (OSError, RuntimeError, ValueError) as error:
        raise UsageError(f"--slurm: {' '.join(str(error).split())}") from error
    return jobs


def _made(folder: Path) -> Any:
    """Return new TLS credentials for one campaign, written as PEM files into a folder that only
    this user may enter.
    """
    from distributed.security import Security

    made: Any = Security.temporary()
    texts = {"cert.pem": made.tls_client_cert, "key.pem": made.tls_client_key}
    for name, text in texts.items():
        (folder / name).touch(0o600)
        (folder / name).write_text(text)
    cert, key = (folder / name for name in texts)
    return Workers(slurm=True, tls_ca=cert, tls_cert=cert, tls_key=key).credentials()
