# SPDX-License-Identifier: BSD-2-Clause
"""Workers that are jobs of SLURM."""

from __future__ import annotations

import shlex
from contextlib import ExitStack
from pathlib import Path
from shutil import which
from typing import Any

from harness.errors import UsageError
from harness.files.temporary import PrivateFolder
from harness.studies.campaign import credentials

MEMORY_GB = 2
"""Of a job per core, where jobqueue.yaml says nothing."""


def cluster(count: int | None, security: Any, scheduler: dict[str, Any], life: ExitStack) -> Any:
    """Jobs as jobqueue.yaml says, by default of one core; every core gets a process of its own,
    for a process flies one run at a time.

    security: credentials, None: they are made and handed on in a folder that only this user may
    enter, beside the logs of the jobs; scheduler: its class and options.
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

    cores = said("cores", 1)
    shared = life.enter_context(PrivateFolder(Path.cwd()))
    try:
        jobs = SLURMCluster(
            cores=cores,
            processes=cores,
            memory=said("memory", f"{cores * MEMORY_GB}GB"),
            log_directory=said("log-directory", "slurm-logs"),
            local_directory=said("local-directory", shlex.quote(str(shared))),
            security=security or credentials.made_in(shared),
            scheduler_cls=scheduler["cls"],
            scheduler_options={**said("scheduler-options", {}), **scheduler["options"]},
            worker_extra_args=[
                *said("worker-extra-args", []),
                "--worker-class",
                "harness.studies.campaign.nodes.Worker",
            ],
        )
        life.enter_context(jobs)
        jobs.scale(jobs=count or 1)
    except (OSError, RuntimeError, ValueError) as error:
        raise UsageError(f"--slurm: {' '.join(str(error).split())}") from error
    return jobs
