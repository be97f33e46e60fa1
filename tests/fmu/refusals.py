# SPDX-License-Identifier: BSD-2-Clause
"""What an FMU says when it refuses its parameters, heard through callbacks of our own.

FMPy keeps one logger for all FMUs of a process, that of whoever asked last.
"""

from __future__ import annotations

from pathlib import Path

from tests.compliance.api import Status
from tests.compliance.probe import Fmu, Instance

from .driver import Values, archive, flat


def refusal(name: str, parameters: Values, folder: Path) -> str:
    """The message with which the FMU leaves initialization mode; empty if it does not mind."""
    fmu = Fmu(archive(name), folder)
    with Instance(fmu) as instance:
        instance.set(
            fmu.settings(**{row: values.tolist() for row, values in flat(parameters).items()})
        )
        instance.enter()
        status = instance.call("fmi2ExitInitializationMode")
        return instance.host.errors[-1] if status is Status.ERROR else ""
