# SPDX-License-Identifier: BSD-2-Clause
"""Messages of an FMU that rejects its parameters, received through callbacks of our own.

FMPy has one logger for all FMUs of a process: the last one registered.
"""

from __future__ import annotations

from pathlib import Path

from tests.compliance.api import Status
from tests.compliance.probe import Fmu, Instance

from .driver import Values, archive, flat


def rejection(name: str, parameters: Values, folder: Path) -> str:
    """The message with which the FMU leaves initialization mode; empty if it does not mind."""
    fmu = Fmu(archive(name), folder)
    with Instance(fmu) as instance:
        instance.set(
            fmu.settings(**{row: values.tolist() for row, values in flat(parameters).items()})
        )
        instance.enter()
        status = instance.call("fmi2ExitInitializationMode")
        return instance.host.errors[-1] if status is Status.ERROR else ""
