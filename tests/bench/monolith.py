# SPDX-License-Identifier: BSD-2-Clause
"""The yardsticks in monolith.c: a system as one C program without FMI, and a bare C loop over its
FMUs.

Both know Gauss-Seidel with one macro step for all and Real variables only, record nothing and check
nothing in passing. `make bench` compares with them; the tests compare their numbers with the
master's.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import StructureError, UsageError
from harness.files.paths import built
from harness.master.fmu import Instance
from harness.master.simulation import Simulation
from harness.master.transfer import Transfer
from harness.system.graph import Graph, Node, build_graph
from harness.system.model import System
from harness.system.schedule import Verb


class _Copy(ctypes.Structure):
    """Layout of struct Copy of monolith.c."""

    _fields_ = [("source", ctypes.c_void_p), ("target", ctypes.c_void_p)]


class _Part(ctypes.Structure):
    """Layout of struct Part of monolith.c."""

    _fields_ = [
        ("model", ctypes.c_void_p),
        ("memory", ctypes.c_void_p),
        ("copies", ctypes.c_void_p),
        ("copy_count", ctypes.c_size_t),
    ]


class _Slave(ctypes.Structure):
    """Layout of struct Slave of monolith.c."""

    _fields_ = [
        *(
            (name, ctypes.c_void_p)
            for name in ("component", "set", "step", "get", "inputs", "outputs")
        ),
        ("input_count", ctypes.c_size_t),
        ("output_count", ctypes.c_size_t),
        *((name, ctypes.c_void_p) for name in ("sources", "input_values", "output_values")),
    ]


def library() -> Any:
    """monolith.so with its signatures; UsageError if it has not been built."""
    path = built("monolith")
    if path is None:
        raise UsageError("the monolithic program has not been built: build the project")
    lib = ctypes.CDLL(str(path))
    pointer, unsigned, double, size, long = (
        ctypes.c_void_p,
        ctypes.c_uint,
        ctypes.c_double,
        ctypes.c_size_t,
        ctypes.c_long,
    )
    lib.find_model.restype, lib.find_model.argtypes = pointer, [ctypes.c_char_p]
    lib.new_model.restype, lib.new_model.argtypes = pointer, [pointer]
    lib.variable.restype, lib.variable.argtypes = pointer, [pointer, pointer, unsigned]
    lib.initialize_model.restype, lib.initialize_model.argtypes = None, [pointer, pointer, double]
    lib.free_model.restype, lib.free_model.argtypes = None, [pointer]
    lib.run_monolith.restype, lib.run_monolith.argtypes = (
        None,
        [pointer, size, double, double, long],
    )
    lib.run_slaves.restype, lib.run_slaves.argtypes = (
        ctypes.c_int,
        [pointer, size, double, double, long],
    )
    return lib


class Monolith:
    """A system of the project's own models as one C program, initialised and ready to run."""

    def __init__(self, system: System) -> None:
        """StructureError if a component is none of the project's models, UsageError if nothing has
        been built.
        """
        self.graph: Graph = build_graph(system)
        self.start, self.step = system.experiment.start, system.experiment.step or 0.0
        self.steps = 0
        self._lib = library()
        self._models = [self._find(node) for node in self.graph.nodes]
        self._memory = [self._lib.new_model(model) for model in self._models]
        self._settings()
        self._slots = list(self._output_places())
        self._copies = [self._copies_of(i) for i in range(len(self._models))]
        self._parts = (_Part * len(self._models))(
            *(
                _Part(m, x, ctypes.addressof(c), len(c))
                for m, x, c in zip(self._models, self._memory, self._copies, strict=True)
            )
        )
        self.initialize()

    def _find(self, node: Node) -> int:
        model = self._lib.find_model(node.interface.model.modelName.encode())
        if model is None:
            raise StructureError(
                [
                    f"{node.component.name}: {node.interface.path.name} is not a model of the "
                    "monolithic program"
                ]
            )
        return int(model)

    def _place(self, i: int, reference: int) -> int:
        return int(self._lib.variable(self._models[i], self._memory[i], reference))

    def _settings(self) -> None:
        for i, node in enumerate(self.graph.nodes):
            for variable, value in node.settings:
                ctypes.c_double.from_address(self._place(i, variable.reference)).value = float(
                    value
                )

    def _output_places(self) -> Iterator[int]:
        for i, node in enumerate(self.graph.nodes):
            for wire in node.outputs:
                yield self._place(i, wire.variable.reference)

    def _copies_of(self, i: int) -> ctypes.Array[_Copy]:
        wires = self.graph.nodes[i].inputs
        return (_Copy * len(wires))(
            *(_Copy(self._slots[w.slot], self._place(i, w.variable.reference)) for w in wires)
        )

    def initialize(self) -> None:
        """All parts at the start time, in as many rounds as there are parts: every initial value
        has then travelled through the longest chain.
        """
        for _ in self._models:
            for i, copies in enumerate(self._copies):
                for copy in copies:
                    ctypes.memmove(copy.target, copy.source, ctypes.sizeof(ctypes.c_double))
                self._lib.initialize_model(self._models[i], self._memory[i], self.start)

    def run(self, steps: int) -> None:
        """Advance by `steps` macro steps; only from a start at t = 0 may this be called more than
        once.
        """
        self._lib.run_monolith(
            self._parts, len(self._parts), self.start + self.steps * self.step, self.step, steps
        )
        self.steps += steps

    def outputs(self) -> NDArray[np.float64]:
        """All outputs now, in the order of the columns of a Result: (columns,)."""
        return np.array([ctypes.c_double.from_address(place).value for place in self._slots])

    def __del__(self) -> None:
        for memory in getattr(self, "_memory", ()):
            self._lib.free_model(memory)


class SlaveLoop:
    """The FMUs of an initialised Simulation under the bare loop; the Simulation must stay open."""

    def __init__(self, simulation: Simulation) -> None:
        self.simulation = simulation
        self._lib = library()
        self._places: dict[int, int] = {}
        for instance in simulation.instances:
            transfer = _only(instance, Verb.GET)
            transfer.view[:] = simulation.bus[transfer.slots]
            base = ctypes.addressof(transfer.values)
            self._places |= {int(slot): base + 8 * i for i, slot in enumerate(transfer.slots)}
        self._sources = [self._sources_of(instance) for instance in simulation.instances]
        self._slaves = (_Slave * len(simulation.instances))(
            *(
                _slave(instance, sources)
                for instance, sources in zip(simulation.instances, self._sources, strict=True)
            )
        )

    def _sources_of(self, instance: Instance) -> ctypes.Array[ctypes.c_void_p]:
        slots = _only(instance, Verb.SET).slots
        return (ctypes.c_void_p * len(slots))(*(self._places[int(slot)] for slot in slots))

    def run(self, steps: int) -> None:
        """Perform macro steps 0 .. steps - 1."""
        clock = self.simulation.clock
        status = self._lib.run_slaves(
            self._slaves, len(self._slaves), clock.start, clock.step, steps
        )
        if status:
            raise StructureError(["an FMU failed under the bare loop"])


def _only(instance: Instance, verb: Verb) -> Transfer:
    """The Real transfer of an instance, empty if it has none."""
    return next(
        (t for t in instance.transfers[verb] if t.real),
        Transfer(instance.calls, f"{verb.name.title()}Real", ()),
    )


def _slave(instance: Instance, sources: ctypes.Array[ctypes.c_void_p]) -> _Slave:
    read, write = _only(instance, Verb.SET), _only(instance, Verb.GET)
    functions = map(instance.calls.function, ("DoStep", "SetReal", "GetReal"))
    step, setter, getter = (ctypes.cast(f, ctypes.c_void_p).value for f in functions)
    return _Slave(
        instance.calls.handle,
        setter,
        step,
        getter,
        ctypes.addressof(read.references),
        ctypes.addressof(write.references),
        len(read.names),
        len(write.names),
        ctypes.addressof(sources),
        ctypes.addressof(read.values),
        ctypes.addressof(write.values),
    )
