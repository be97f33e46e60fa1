# SPDX-License-Identifier: BSD-2-Clause
"""Single FMUs and whole systems that the published cases simulate. In this package only this module
loads FMUs and simulates systems.
"""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from numpy.typing import ArrayLike, NDArray

from harness.errors import UsageError
from harness.files import paths
from harness.master.changes import apply
from harness.master.isolated import simulate
from harness.results.result import Result
from harness.ssp.library import load


class Port:
    """Vector variable of an FMU, with the arguments of the FMI calls that get and set its value.
    They are built once, for all calls.
    """

    def __init__(self, references: list[int]) -> None:
        self.references = (ctypes.c_uint32 * len(references))(*references)
        self.values = np.zeros(len(references))
        self.arguments = (
            self.references,
            ctypes.c_size_t(len(references)),
            self.values.ctypes.data_as(ctypes.POINTER(ctypes.c_double)),
        )


class Instance:
    """Initialised instance of an FMU; time: communication point that it has reached [s]."""

    def __init__(
        self, folder: str, parameters: Mapping[str, Any], inputs: Mapping[str, Any]
    ) -> None:
        """Load, instantiate and initialise the FMU that is unpacked in `folder`."""
        description = read_model_description(folder)
        references: dict[str, list[int]] = {}
        for variable in description.modelVariables:
            references.setdefault(variable.name.partition("[")[0], []).append(
                variable.valueReference
            )
        self.ports = {name: Port(every) for name, every in references.items()}
        self.inputs = {
            variable.name.partition("[")[0]
            for variable in description.modelVariables
            if variable.causality == "input"
        }
        self.time = 0.0
        self._slave = FMU2Slave(
            guid=description.guid,
            modelIdentifier=description.coSimulation.modelIdentifier,
            unzipDirectory=folder,
        )
        self._slave.instantiate()
        self._slave.setupExperiment(startTime=0.0)
        self._slave.enterInitializationMode()
        self.set({**parameters, **inputs})
        self._slave.exitInitializationMode()

    def set(self, values: Mapping[str, ArrayLike]) -> None:
        """Set variables by name to scalars, vectors or matrices."""
        for name, value in values.items():
            port = self.ports[name]
            port.values[:] = np.ravel(value)
            self._slave.fmi2SetReal(self._slave.component, *port.arguments)

    def get(self, name: str) -> NDArray[np.float64]:
        """Return the elements of a variable as a vector; a scalar has one element."""
        port = self.ports[name]
        self._slave.fmi2GetReal(self._slave.component, *port.arguments)
        return port.values.copy()

    def step(self, h: float) -> None:
        """Take one communication step [s]."""
        self._slave.doStep(self.time, h)
        self.time += h

    def close(self) -> None:
        """Free the instance and unload its library."""
        self._slave.freeInstance()


class Library:
    """FMUs of the project, each unpacked at its first use; a context manager that frees all its
    instances.
    """

    def __enter__(self) -> Self:
        self._place = TemporaryDirectory(prefix="validation-", ignore_cleanup_errors=True)
        self._folders: dict[str, str] = {}
        self._instances: list[Instance] = []
        return self

    def __exit__(self, *_: object) -> None:
        while self._instances:
            self._instances.pop().close()
        self._place.cleanup()

    def unit(
        self, name: str, parameters: Mapping[str, Any], inputs: Mapping[str, Any] | None = None
    ) -> Instance:
        """Return a new instance, initialised with these parameters and inputs at t = 0."""
        self._instances.append(Instance(self._folder(name), parameters, inputs or {}))
        return self._instances[-1]

    def _folder(self, name: str) -> str:
        if name not in self._folders:
            if name not in (known := paths.fmus()):
                raise UsageError(f"{name}: there is no such FMU")
            self._folders[name] = str(Path(self._place.name) / name)
            extract(str(known[name]), unzipdir=self._folders[name])
        return self._folders[name]


def run_system(name: str, *, every: int = 1, **changes: Any) -> Result:
    """Simulate a system of the project and return the result; every: macro steps per row; changes:
    keys of harness.master.changes.Changes, such as params.
    """
    with load(name) as system:
        return simulate(apply(system, **changes), every=every)
