# SPDX-License-Identifier: BSD-2-Clause
"""One FMU as the tests see it: made from a .fmu with parameters by vector name, then set, stepped
and read.

Scalars `v[1], v[2], v[3]` of the interface are the vector `v`, `J[1,2]` are elements of the matrix
`J`. A record such as a sinusoid may be given as a dict: {"M_dist_T": {"bias": (1, 0, 0)}} is
{"M_dist_T.bias": (1, 0, 0)}.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

Values = Mapping[str, object]
ROOT = Path(__file__).resolve().parents[2]


def archive(name: str) -> Path:
    """The .fmu in the build folder that SERVICING_FMUS_BUILD names."""
    return ROOT / os.environ.get("SERVICING_FMUS_BUILD", "build") / "fmus" / f"{name}.fmu"


def flat(values: Values, prefix: str = "") -> dict[str, np.ndarray]:
    """Records become dotted names, values become flat arrays (row-major)."""
    result = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            result |= flat(value, f"{prefix}{name}.")
        else:
            result[prefix + name] = np.array(value, dtype=float).ravel()
    return result


class Call:
    """The arrays for a call that reads or writes some vectors."""

    def __init__(self, references: dict[str, list[int]]) -> None:
        self.sizes = {name: len(each) for name, each in references.items()}
        self.size = sum(self.sizes.values())
        self.references = (ctypes.c_uint * self.size)(
            *(n for row in references.values() for n in row)
        )
        self.numbers: Any = ctypes.c_double * self.size

    def vectors(self, numbers: list[float]) -> dict[str, np.ndarray]:
        """The vectors by name; a scalar is a number."""
        values, found, first = np.array(numbers), {}, 0
        for name, size in self.sizes.items():
            found[name] = values[first : first + size] if size > 1 else values[first]
            first += size
        return found


class Kind:
    """An unpacked FMU: where it lies and which value references make up each vector."""

    def __init__(self, name: str, folder: Path) -> None:
        self.call = cache(self._call)
        self.folder = extract(str(archive(name)), unzipdir=str(folder))
        self.description = read_model_description(self.folder)
        self.references: dict[str, list[int]] = {}
        self.outputs: dict[str, None] = {}  # an ordered set
        for v in self.description.modelVariables:
            vector = v.name.partition("[")[0]
            self.references.setdefault(vector, []).append(v.valueReference)
            if v.causality == "output":
                self.outputs[vector] = None

    def _call(self, *names: str) -> Call:
        return Call({name: self.references[name] for name in names})


class FMU2Library(FMU2Slave):
    """FMPy's, which looks up the types of its functions for every instance anew: here the first one
    passes them on. FMPy takes the version of FMI from the beginning of the name.
    """

    types: ClassVar = {}

    def _loadFunctions(self):
        if not self.types:
            super()._loadFunctions()
            self.types.update(
                {n: (f.argnames, f.argtypes, f.restype) for n, f in self._functions.items()}
            )
        for name, types in self.types.items():
            self._functions[name] = function = getattr(self.dll, name)
            function.argnames, function.argtypes, function.restype = types


class Unit:
    """One instance. `time` is the communication point it has reached."""

    def __init__(self, kind: Kind, parameters: Values, inputs: Values, start: float) -> None:
        self.kind, self.time = kind, start
        d = kind.description
        self.slave = FMU2Library(
            guid=d.guid, modelIdentifier=d.coSimulation.modelIdentifier, unzipDirectory=kind.folder
        )
        self.slave.instantiate()
        self.slave.setupExperiment(startTime=start)
        self.slave.enterInitializationMode()
        self.set(parameters)
        self.set(inputs)
        self.slave.exitInitializationMode()

    def set(self, values: Values) -> None:
        given = flat(values)
        call = self.kind.call(*given)
        for name, size in call.sizes.items():
            assert len(given[name]) == size, f"{name} has {size} elements"
        numbers = call.numbers(*(x for value in given.values() for x in value.tolist()))
        if numbers:
            self.slave.fmi2SetReal(self.slave.component, call.references, call.size, numbers)

    def step(self, h: float, inputs: Values | None = None) -> None:
        """Set the inputs and step by h."""
        self.set(inputs or {})
        self.slave.doStep(self.time, h)
        self.time += h

    def get(self, name: str) -> Any:
        """Vector of an output or parameter; a scalar comes as a number."""
        return self._read(name)[name]

    def outputs(self) -> dict[str, Any]:
        return self._read(*self.kind.outputs)

    def _read(self, *names: str) -> dict[str, Any]:
        call = self.kind.call(*names)
        numbers = call.numbers()
        self.slave.fmi2GetReal(self.slave.component, call.references, call.size, numbers)
        return call.vectors(numbers[:])

    def history(self, h: float, steps: int, *names: str) -> tuple[np.ndarray, ...]:
        """Times and the named outputs, one row per communication point including the present
        one.
        """
        rows = [[self.time, *map(self.get, names)]]
        for _ in range(steps):
            self.step(h)
            rows.append([self.time, *map(self.get, names)])
        return tuple(np.array(column) for column in zip(*rows, strict=True))

    def close(self) -> None:
        self.slave.freeInstance()


def bits(unit: Unit) -> bytes:
    """All outputs of a unit to the last bit."""
    return b"".join(np.asarray(value).tobytes() for value in unit.outputs().values())
