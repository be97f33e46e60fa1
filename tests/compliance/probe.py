# SPDX-License-Identifier: BSD-2-Clause
"""A master of the smallest kind: raw FMI 2.0 calls by ctypes, with callbacks of its own. No FMPy,
no harness.

`Instance.call` makes one call and returns its status; the named methods are what a master does and
insist on fmi2OK.
"""

from __future__ import annotations

import ctypes
import math
import sys
import zipfile
from ctypes import byref, c_size_t, c_void_p
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from tests.compliance import api, description
from tests.compliance.api import Status

PLATFORMS = {
    "linux": ("linux64", ".so"),
    "darwin": ("darwin64", ".dylib"),
    "win32": ("win64", ".dll"),
}
FOLDER, ENDING = PLATFORMS[sys.platform]
GRIDS = ("max_step", "sample_period", "T0", "latency")
"""Names of the parameters that are the internal step of a plant, the period of software, the call
period of thrusters.
"""

LIBC = ctypes.CDLL(None)
LIBC.calloc.restype, LIBC.calloc.argtypes = c_void_p, (c_size_t, c_size_t)
LIBC.free.restype, LIBC.free.argtypes = None, (c_void_p,)


def _text(data: bytes) -> str:
    return data.decode(errors="replace")


class Message(NamedTuple):
    instance: str
    status: int
    category: str
    text: str
    environment: int | None


class Host:
    """The callbacks of a master: stores the messages, counts the memory, and can run out of memory
    at the n-th request.
    """

    ENVIRONMENT = 0x5EC

    def __init__(self, *, logger=True, allocate=True, free=True, out_of_memory_at=None):
        self.messages: list[Message] = []
        self.live: set[int] = set()
        self.requests = 0
        self.out_of_memory_at = out_of_memory_at
        self.callbacks = api.Callbacks(
            api.LOGGER(self._log) if logger else api.LOGGER(),
            api.ALLOCATE(self._allocate) if allocate else api.ALLOCATE(),
            api.FREE(self._free) if free else api.FREE(),
            api.STEP_FINISHED(),
            self.ENVIRONMENT,
        )

    def _log(self, environment, instance, status, category, text):
        self.messages.append(
            Message(_text(instance), status, _text(category), _text(text), environment)
        )

    def _allocate(self, count, size):
        self.requests += 1
        if self.requests == self.out_of_memory_at:
            return None
        place = LIBC.calloc(count, size)
        self.live.add(place)
        return place

    def _free(self, place):
        if place:
            self.live.remove(place)  # KeyError: not ours, or freed twice
            LIBC.free(place)

    @property
    def errors(self) -> list[str]:
        return [
            m.text
            for m in self.messages
            if m.category == "logStatusError" and m.status == Status.ERROR
        ]


class Fmu:
    """An unpacked FMU with its library loaded."""

    def __init__(self, archive: Path, folder: Path) -> None:
        with zipfile.ZipFile(archive) as files:
            files.extractall(folder)
        self.folder = folder
        self.resources = (folder / "resources").as_uri().encode()
        self.name = archive.stem
        self.about = description.read(archive)
        self.library = api.load(folder / "binaries" / FOLDER / (self.name + ENDING))

    @cached_property
    def inputs(self) -> list[description.Variable]:
        return self.about.of("input")

    @cached_property
    def outputs(self) -> list[description.Variable]:
        return self.about.of("output")

    @cached_property
    def parameters(self) -> list[description.Variable]:
        return self.about.of("parameter")

    def settings(self, **rows) -> dict[str, float]:
        """Values of rows by element name, as far as this FMU has such rows: settings(J_T=[...],
        max_step=0.1).
        """
        elements = {row: [v.name for v in self.about.variables if v.row == row] for row in rows}
        values = {
            row: value if isinstance(value, list | tuple) else [value]
            for row, value in rows.items()
        }
        return {
            name: float(x)
            for row in rows
            for name, x in zip(elements[row], values[row], strict=False)
        }

    def sampled_every(self, period: float) -> dict[str, float]:
        """Parameters that make plants integrate and software sample on the grid k * period, for any
        communication steps of the master.
        """
        switches = {v.row for v in self.about.variables if (v.low, v.high) == (0, 1)}
        return self.settings(**dict.fromkeys([g for g in GRIDS if g not in switches], period))


BUSY = {"select_force": 2.0, "select_torque": 2.0}
"""Inputs at whose start value an FMU rests, and where it is at work."""


def excitation(variables, k: int) -> dict[str, float]:
    """Values of inputs at step k: near the start values, different for every variable and step,
    within the bounds.
    """
    return {v.name: _wave(v, math.sin(0.7 * k + 1.3 * i + 0.1)) for i, v in enumerate(variables)}


def _wave(v: description.Variable, wave: float) -> float:
    if (v.low, v.high) == (0, 1):
        return float(wave > 0)
    start = BUSY.get(v.name, v.start)
    return min(max(start + wave * (0.01 + 1e-6 * abs(start)), v.low), v.high)


class Instance:
    """One instance of an FMU. Frees itself at the end of a `with` block."""

    def __init__(
        self, fmu: Fmu, name="probe", *, host=None, logging=True, guid=None, kind=api.CO_SIMULATION
    ):
        self.fmu, self.library, self.host = fmu, fmu.library, host or Host()
        guid = fmu.about.guid if guid is None else guid
        arguments = (
            name.encode(),
            kind,
            guid.encode(),
            fmu.resources,
            byref(self.host.callbacks),
            0,
            int(logging),
        )
        self.handle = self.library.fmi2Instantiate(*arguments)

    def __enter__(self):
        assert self.handle, self.host.errors
        return self

    def __exit__(self, *_):
        self.free()

    def free(self) -> None:
        self.library.fmi2FreeInstance(self.handle)
        self.handle = None

    def call(self, function: str, *arguments) -> Status:
        return Status(getattr(self.library, function)(self.handle, *arguments))

    def ok(self, function: str, *arguments) -> None:
        status = self.call(function, *arguments)
        assert status is Status.OK, (
            f"{self.fmu.name}: {function} answered {status.name}: {self.host.errors[-1:]}"
        )

    # ---- values

    def try_set(self, values: dict[str, float]) -> Status:
        where = api.references([self.fmu.about.by_name[name].reference for name in values])
        return self.call("fmi2SetReal", where, len(where), api.reals(values.values()))

    def set(self, values: dict[str, float]) -> None:
        assert self.try_set(values) is Status.OK, self.host.errors[-1:]

    def values(self, variables) -> ctypes.Array:
        where, buffer = (
            api.references([v.reference for v in variables]),
            api.reals([0] * len(variables)),
        )
        self.ok("fmi2GetReal", where, len(where), buffer)
        return buffer

    def get(self, name: str) -> float:
        return self.values([self.fmu.about.by_name[name]])[0]

    def outputs(self) -> bytes:
        """The bits of all outputs."""
        return bytes(self.values(self.fmu.outputs))

    def derivative(self, known, seed, unknown=None) -> tuple[Status, list[float]]:
        """Of the unknown outputs (default: all) along the seed; values that were not written are
        NaN.
        """
        unknown = self.fmu.outputs if unknown is None else unknown
        result = api.reals([math.nan] * len(unknown))
        rows, columns = (
            api.references([v.reference for v in variables]) for variables in (unknown, known)
        )
        arguments = (rows, len(unknown), columns, len(known), api.reals(seed), result)
        return self.call("fmi2GetDirectionalDerivative", *arguments), list(result)

    # ---- life

    def set_up(self, start=0.0, stop=None) -> None:
        self.ok("fmi2SetupExperiment", 0, 0.0, start, int(stop is not None), stop or 0.0)

    def enter(self, start=0.0, stop=None) -> None:
        """To initialization mode."""
        self.set_up(start, stop)
        self.ok("fmi2EnterInitializationMode")

    def start(self, values=None, start=0.0, stop=None) -> Instance:
        """To step mode, with parameters and inputs set first."""
        self.set(values or {})
        self.enter(start, stop)
        self.ok("fmi2ExitInitializationMode")
        return self

    def step(self, t: float, h: float) -> None:
        self.ok("fmi2DoStep", t, h, 0)

    def simulate(self, steps: int, h=0.1, first=0, wave=0) -> bytes:
        """Steps first, first+1, ... of size h under excitation; the bits of all outputs after every
        step.
        """
        record = bytearray()
        for k in range(first, first + steps):
            self.set(excitation(self.fmu.inputs, k + wave))
            self.step(k * h, h)
            record += self.outputs()
        return bytes(record)

    # ---- states

    def save(self) -> c_void_p:
        state = c_void_p()
        self.ok("fmi2GetFMUstate", byref(state))
        return state

    def restore(self, state: c_void_p) -> None:
        self.ok("fmi2SetFMUstate", state)

    def drop(self, state: c_void_p) -> None:
        self.ok("fmi2FreeFMUstate", byref(state))

    def serialize(self, state: c_void_p) -> bytes:
        size = c_size_t()
        self.ok("fmi2SerializedFMUstateSize", state, byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.ok("fmi2SerializeFMUstate", state, buffer, size)
        return buffer.raw

    def try_deserialize(self, data: bytes, state: c_void_p) -> Status:
        return self.call(
            "fmi2DeSerializeFMUstate",
            ctypes.create_string_buffer(data, len(data)),
            len(data),
            byref(state),
        )

    def deserialize(self, data: bytes) -> c_void_p:
        state = c_void_p()
        assert self.try_deserialize(data, state) is Status.OK, self.host.errors[-1:]
        return state

    def snapshot(self) -> bytes:
        """Everything that makes up the future of this instance."""
        state = self.save()
        data = self.serialize(state)
        self.drop(state)
        return data
