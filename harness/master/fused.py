# SPDX-License-Identifier: BSD-2-Clause
"""Whole system compiled from the C sources in its FMUs: to one FMU, which runs as one instance, or
to a WebAssembly module, which a live page runs with results that are bit-identical to a run here.

core/build/fuse.py writes, compiles and packs the FMU, core/build/web_module.py compiles the module.
For runs, one FMU is compiled per structure of a system (components, connections, schedule); the
values of its parameters and open inputs are set before every run.
"""

from __future__ import annotations

import ctypes
import json
import logging
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import FmuError, HarnessError, installed
from harness.files import adapter, cache, paths
from harness.files.machine import has_avx2
from harness.files.output import PrivateFolder
from harness.master.calls import OK, WARNING
from harness.master.fmu import Instance
from harness.master.transfer import Transfer
from harness.results.provenance import whole_provenance
from harness.spelling import first_error
from harness.system.graph import Checked, Graph, Node, Slot, Wire
from harness.system.interface import read_interface, unpacked_sources
from harness.system.model import Component, System
from harness.system.schedule import Verb, schedule
from harness.system.values import base

_log = logging.getLogger("harness")

MACRO_STEP = "macro_step"
"""Name of the parameter for the macro step [s] in the FMU of a whole system. The length of every
step of this FMU is a whole multiple of the macro step.
"""

COMPILER = "cc"

OF_PROCESSOR = ("-mavx2", "-mno-fma") if has_avx2() else ()
"""Compiler flags for a system that runs on this machine only; they save a quarter of the
instructions. The results are bit-identical, because products and sums are rounded one by one (no
FMA).
"""

LIBRARY = "ziglang"
"""Python package that contains the compiler zig, for live pages and as a replacement for a missing
C++ compiler.
"""
ZIG = (sys.executable, "-m", LIBRARY)


class NotFusedError(HarnessError):
    """Error: a system cannot be compiled to one FMU. str() gives the reason in one line."""


def write_whole(
    system: System, graph: Graph, path: Path, fmi: int = 2, scalars: bool = False
) -> None:
    """Write a checked system as one FMU to `path`; raise NotFusedError if that is impossible. The
    values of the system become the start values of the FMU. The FMU states the name of the system,
    the version of this package and the provenance.

    fmi: version of FMI, 2 or 3; scalars: whether elements of vectors and matrices are separate
    variables also in FMI 3.0.
    """
    interfaces = {node.component.name: node.interface for node in graph.nodes}
    plan = _plan(system, graph, system.name) | whole_provenance(system, interfaces)
    _make(plan | {"scalars": scalars}, path, _command(COMPILER), fmi)


class Whole:
    """FMU compiled from a whole system. It can run all systems of the same structure (components,
    connections, schedule), which differ only in values.
    """

    def __init__(self, system: System, graph: Graph, compiler: str = COMPILER) -> None:
        """Compile the FMU, or take it from the cache; raise NotFusedError if the system cannot be
        compiled.
        """
        self._structure = structure(system, graph)
        plan = _plan(system, graph, "whole")
        command = [*_command(compiler), *OF_PROCESSOR]
        file = cache.made("whole.fmu", _key(plan, command), lambda to: _make(plan, to, command))
        self.interface = read_interface(file)
        found = self.interface.variables
        self.outputs = tuple(Wire(found[slot.name], i) for i, slot in enumerate(graph.slots))
        self._places = {v.name: i for i, v in enumerate(self.interface.settable().values())}
        self.references = [v.reference for v in self.interface.settable().values()]
        starts = {f"{p['name']}.{k}": v for p in plan["parts"] for k, v in p["own"].items()}
        self._starts = np.array([starts.get(name, 0.0) for name in self._places])
        self.ours = all(paths.is_ours(node.interface.path) for node in graph.nodes)

    def fits(self, system: System, graph: Graph) -> bool:
        """Return whether a system differs from the compiled one only in values, so that this FMU
        can run it.
        """
        return structure(system, graph) == self._structure

    def node(self, recorded: Sequence[int] | None) -> Node:
        """Return a graph node with this FMU; it is the only node of a run with this FMU. recorded:
        indices of the outputs to record, in the order of the system's graph (None: all outputs).
        """
        component = Component("whole", self.interface.path)
        outputs = self.outputs
        if recorded is not None:
            outputs = tuple(Wire(outputs[slot].variable, i) for i, slot in enumerate(recorded))
        return Node(component, self.interface, (), outputs, (), ())

    def values(self, system: System, graph: Graph) -> NDArray[np.float64]:
        """Return the values (variables,) of all settable variables of this FMU for a run of
        `system`, in the order of the variables in the FMU.
        """
        values = self._starts.copy()
        values[self._places[MACRO_STEP]] = system.experiment.step or 0.0
        for node in graph.nodes:
            for variable, value in node.settings:
                place = self._places.get(f"{node.component.name}.{variable.name}")
                if place is not None:  # None: a connected input, which cannot be set
                    values[place] = value
        return values


def compiled(system: System, graph: Graph) -> Whole | None:
    """Compile a system to one FMU and return it; if that is impossible, log the reason and return
    None.
    """
    try:
        return Whole(system, graph)
    except NotFusedError as reason:
        _log.warning("%s: cannot be fused, so it runs with the executor c: %s", system.name, reason)
        return None


def prepare(system: System, graph: Graph) -> None:
    """Compile a system to one FMU for later runs, which find it in the cache. If that is
    impossible, log the reason.
    """
    compiled(system, graph)


def structure(system: System, graph: Graph) -> tuple[Any, ...]:
    """Return everything that determines the code of a fused system: order of execution
    (gauss-seidel or jacobi), signals, schedule and connections. Systems with equal tuples differ
    only in values.
    """
    places = [(n.component.name, n.component.every, n.component.latency) for n in graph.nodes]
    inputs = [(id(node.interface), node.inputs) for node in graph.nodes]
    return system.experiment.algorithm, graph.slots, places, inputs


@lru_cache(maxsize=8)
def slots_of(slots: tuple[Slot, ...], names: frozenset[str]) -> tuple[int, ...]:
    """Return in order the indices of the slots (elements, `component.variable[i]`) that belong to
    the variables in `names` (whole variables, without `[i]`).
    """
    return tuple(i for i, slot in enumerate(slots) if base(slot.name) in names)


class WholeInstance(Instance):
    """Instance of the FMU of a whole system, whose values are all set by one call."""

    def __init__(self, node: Node, folder: Callable[[], Path], whole: Whole) -> None:
        super().__init__(node, folder, whole.ours)
        self.whole = whole
        n = len(whole.references)
        self._references = (ctypes.c_uint * n)(*whole.references)
        self.values: NDArray[np.float64] = np.zeros(n)
        self._get = Transfer(self.calls, "GetReal", whole.outputs)

    def set_start_values(self, time: float) -> None:
        """Set all parameters and open inputs by one call; raise RunError if the FMU rejects a
        value. Only the FMU's message in the error names the rejected variable.
        """
        self._used = True
        address = self.values.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        count = len(self.values)
        status = self.calls.call("SetReal", self._references, count, address)
        if status not in (OK, WARNING):
            raise self._failure(status, "setReal rejected", time)

    def everything(self) -> NDArray[np.float64]:
        """Return the present values (outputs,) of all outputs of the system, in the order of its
        graph, including outputs that are not recorded.
        """
        bus = np.zeros(len(self.whole.outputs))
        self.raise_if_failed(Verb.GET, self._get.read(bus), 0.0)
        return bus


# ---- WebAssembly module for live pages


class Module(NamedTuple):
    """WebAssembly module and the inputs of its runs.

    code: bytes of the module; names, references, values: name, value reference and start value of
    every settable variable, in the same order; outputs: value reference by name of the column.
    """

    code: bytes
    names: tuple[str, ...]
    references: tuple[int, ...]
    values: NDArray[np.float64]
    outputs: dict[str, int]


def module_of(system: System, found: Checked) -> Module:
    """Return the WebAssembly module of a checked system; raise HarnessError without a compiler, or
    NotFusedError if the system cannot be compiled to one FMU.
    """
    installed(LIBRARY, "live")
    web = [*ZIG, "cc"]
    native = COMPILER if shutil.which(COMPILER) else shlex.join(web)
    whole = Whole(system, found.graph, native)
    core, fmu = _core(), whole.interface.path
    tool, options = core / "build" / "web_module.py", f"--cc={shlex.join(web)}"
    contents = (file.read_bytes() for file in (fmu, core / "web" / "simulation.c", tool))
    key = b"\0".join([repr(web).encode(), *contents])

    def make(path: Path) -> None:
        with PrivateFolder() as folder:
            sources = map(str, unpacked_sources(fmu, folder / "whole"))
            run_tool(tool, *sources, "-o", str(path), options)

    file = cache.made("whole.wasm", key, make)
    slots = (slot.name for slot in found.graph.slots)
    return Module(
        file.read_bytes(),
        tuple(whole.interface.settable()),
        tuple(whole.references),
        whole.values(system, found.graph),
        {name: wire.variable.reference for name, wire in zip(slots, whole.outputs, strict=True)},
    )


# ---- the input of fuse.py


def _plan(system: System, graph: Graph, name: str) -> dict[str, Any]:
    """Return the system in the input format of fuse.py; raise NotFusedError if a variable is not
    Real.
    """
    found = ((n.component.name, n.interface.variables.values()) for n in graph.nodes)
    if others := sorted(n for n, known in found if any(v.type != "Real" for v in known)):
        raise NotFusedError(
            f"{', '.join(others)}: not all variables are of type Real, as a fused system needs"
        )
    experiment = system.experiment
    driver = {w.slot: (i, w.variable.name) for i, n in enumerate(graph.nodes) for w in n.outputs}
    place = {node.component.name: i for i, node in enumerate(graph.nodes)}
    actions = schedule(experiment.algorithm, [node.component for node in graph.nodes])
    return {
        "name": re.sub(r"\W", "_", f"_{name}" if name[:1].isdigit() else name),
        "text": " ".join((system.description or system.name).split()),
        "start": experiment.start,
        "stop": experiment.stop or 0.0,
        "step": experiment.step or 0.0,
        "parts": [_part(node, driver, experiment.algorithm) for node in graph.nodes],
        "plan": [[a.verb.value, place[a.instance.name], a.every, a.phase] for a in actions],
    }


def _part(node: Node, driver: dict[int, tuple[int, str]], algorithm: str) -> dict[str, Any]:
    component = node.component
    own = {name: v.start for name, v in node.interface.settable().items()}
    late = component.latency > 0 or (algorithm == "jacobi" and component.every > 1)
    return {
        "name": component.name,
        "fmu": str(component.fmu),
        "own": own,
        "values": own | {s.variable.name: s.value for s in node.settings},
        "driven": {w.variable.name: [*driver[w.slot], *w.change] for w in node.inputs},
        "late": late,
    }


# ---- compiling


def _command(compiler: str) -> list[str]:
    """Return the command `compiler` split into its words; raise NotFusedError if the compiler or
    the C sources of the project are missing.
    """
    command = shlex.split(compiler)
    if paths.core() is None:
        raise NotFusedError("the C sources of the project are missing: reinstall servicing-fmus")
    if not command or shutil.which(command[0]) is None:
        raise NotFusedError(f"there is no C compiler ({compiler})")
    return command


def _key(plan: dict[str, Any], compiler: Sequence[str]) -> bytes:
    """Return the key of a compiled system in the cache: structure, FMUs and tools. Values are not
    in the key, because they are set before a run.
    """
    parts = plan["parts"]
    built = [plan["plan"], compiler, *([p["name"], p["driven"], p["late"]] for p in parts)]
    found = Path(shutil.which(compiler[0]) or "").resolve()
    folders = (sorted((_core() / name).iterdir()) for name in ("adapter", "build"))
    tools = (f for files in folders for f in files if f.suffix in (".c", ".h", ".py"))
    contents = (f.read_bytes() for f in (*(Path(p["fmu"]) for p in parts), *tools))
    about = json.dumps([built, str(found), repr(paths.stamp(found))])
    return b"\0".join([about.encode(), *contents])


def _core() -> Path:
    core = paths.core()
    assert core is not None  # _command(), called before, raises an error without C sources
    return core


def _make(plan: dict[str, Any], path: Path, compiler: Sequence[str], fmi: int = 2) -> None:
    with PrivateFolder() as folder:
        fmus = enumerate(sorted({part["fmu"] for part in plan["parts"]}))
        try:
            sources = {f: unpacked_sources(Path(f), folder / str(i)) for i, f in fmus}
        except FmuError as error:
            raise NotFusedError(str(error)) from error
        parts = [p | {"sources": list(map(str, sources[p["fmu"]]))} for p in plan["parts"]]
        file = folder / "system.json"
        file.write_text(json.dumps(plan | {"parts": parts}), encoding="utf-8")
        options = (f"--cc={shlex.join(compiler)}", f"--fmi={fmi}", *adapter.options(compiler, fmi))
        run_tool(_core() / "build" / "fuse.py", str(file), "-o", str(path), *options)


def run_tool(tool: Path, *arguments: str) -> None:
    """Run a Python script of core/build in a new process; if it fails, raise NotFusedError with the
    first error that it prints.
    """
    done = subprocess.run(
        [sys.executable, str(tool), *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, errors="replace", check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    if done.returncode:
        raise NotFusedError(first_error(done.stdout))
