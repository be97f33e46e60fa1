# SPDX-License-Identifier: BSD-2-Clause
"""Several runs of one fused system at once: each run is a lane, an element of the vector registers.
The results are bit-identical to single runs.

core/build/lanes.py compiles a library for all lanes from the FMU of the whole system. Each run also
has an instance of this FMU. The instance checks parameters and initial values and can reject them,
and makes the first macro step. Then its state is copied into the lane, and copied back at the end.

    python -m harness.master.lanes WHOLE.fmu        # compile into the cache
"""

from __future__ import annotations

import ctypes
import importlib.util
import math
import os
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from time import thread_time

from harness.files import cache, paths, signals
from harness.files.machine import has_avx2, has_avx512
from harness.files.output import PrivateFolder
from harness.master.calls import layout
from harness.master.fused import LIBRARY, ZIG, NotFusedError, WholeInstance, run_tool
from harness.master.simulation import CHUNK_SECONDS, Simulation
from harness.system.interface import unpacked_sources
from harness.system.schedule import Verb

COMPILERS = ("g++", "clang++")
"""Commands of C++ compilers to look for; if none exists, the compiler in the package ziglang is
used.
"""

NAME = "lanes.so"
CHUNK = 1000
"""Number of macro steps before the first check for Ctrl-C. It doubles for the next check while the
steps between two checks take less than half of CHUNK_SECONDS.
"""


@lru_cache
def width() -> int:
    """Return the number of runs at once on this processor: 8 with AVX-512, 4 with AVX2, else 2.
    Return 1 if there is no compiler, no C sources, or no cache, through which processes share the
    library.
    """
    there = compiler() and paths.core() and cache.folder() and os.name == "posix"
    if not there:
        return 1
    if has_avx512():
        return 8
    return 4 if has_avx2() else 2


@lru_cache
def compiler() -> tuple[str, ...]:
    """Return the command of the C++ compiler, () if there is none."""
    found = next(filter(None, map(shutil.which, COMPILERS)), None)
    if found:
        return (found,)
    return (*ZIG, "c++") if importlib.util.find_spec(LIBRARY) else ()


def library(fmu: Path, wait: bool = False) -> Path | None:
    """Return the path of the lane library, in the cache, of the FMU of a whole system; None if it
    is not in the cache or width() is 1. wait: whether to compile a missing library, and to raise
    NotFusedError if the compiler fails.
    """
    tool, command = _core() / "build" / "lanes.py", shlex.join(compiler())

    def make(path: Path) -> None:
        with PrivateFolder() as folder:
            place = unpacked_sources(fmu, folder / "whole")[0].parent
            run_tool(tool, str(place), "-o", str(path), f"--width={width()}", f"--cxx={command}")

    if width() == 1 or not (wait or cache.has(NAME, _key(fmu))):
        return None
    return cache.made(NAME, _key(fmu), make)


@lru_cache(maxsize=8)
def _key(fmu: Path) -> bytes:
    """Return the key of a lane library in the cache, made of everything that determines the code of
    the library (FMU, tools, compiler and number of lanes).
    """
    program, build = Path(compiler()[0]).resolve(), _core() / "build"
    if len(compiler()) > 1:
        program = Path(importlib.import_module(LIBRARY).__path__[0]) / "zig"
    names = ("lanes.py", "lanes_source.py", "build_fmu.py")
    tools = (*(build / name for name in names), *sorted((_core() / "lanes").iterdir()))
    about = repr((width(), str(program), paths.stamp(program))).encode()
    return b"\0".join([about, *(file.read_bytes() for file in (fmu, *tools))])


def _core() -> Path:
    return paths.core() or Path()


@contextmanager
def compiling(fmu: Path) -> Iterator[None]:
    """Compile the lane library of a whole system (an FMU) in the background during the `with`
    block; a compilation that is not complete at the end of the block is ended.
    """
    command = [sys.executable, "-m", __name__, str(fmu)]
    none = subprocess.DEVNULL
    process = subprocess.Popen(
        command, stdin=none, stdout=none, stderr=none, start_new_session=True
    )
    try:
        yield
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)
        process.wait()


class _Runs(ctypes.Structure):
    """C struct Runs of core/lanes/runs.h: the runs in the lanes, with their common
    time and the table of recorded rows of each.
    """

    _fields_ = layout(
        (ctypes.c_double, "start step"),
        (ctypes.c_int64, "every steps count"),
        (ctypes.c_size_t, "columns"),
        (ctypes.c_void_p, "reference states tables"),
        (ctypes.c_int64, "done lost"),
        (ctypes.c_double, "now"),
        (ctypes.c_void_p, "work"),
    )


class Lanes:
    """Loaded lane library of a whole system. Only one thread of a process may use it."""

    def __init__(self, path: Path) -> None:
        self._library = ctypes.CDLL(str(path))
        self._library.begin.restype = ctypes.c_bool
        self._library.advance.argtypes = [ctypes.c_void_p, ctypes.c_int64]
        self.width = ctypes.c_int.in_dll(self._library, "width").value

    def advance(self, simulations: Sequence[Simulation], to: int | None = None) -> list[bool]:
        """Perform macro steps until `to` are complete (default: all) for simulations of one system
        that differ only in values and have completed equally many steps. Return for each simulation
        whether its run is valid. A run in which the FMU rejects a step is not valid and must be
        repeated alone.
        """
        first, count = simulations[0], len(simulations)
        instances = [_whole(simulation) for simulation in simulations]
        outputs = instances[0].node.outputs
        states = [i.save(s.time) for i, s in zip(instances, simulations, strict=True)]
        references = (ctypes.c_uint * len(outputs))(*(w.variable.reference for w in outputs))
        addresses = (ctypes.c_void_p * count)(*(state.value for state in states))
        tables = (ctypes.c_void_p * count)(*(s.recorder.table.ctypes.data for s in simulations))
        arrays = [ctypes.addressof(array) for array in (references, addresses, tables)]
        numbers = *first.clock, first.recorder.every, first.steps, count, len(outputs)
        runs = _Runs(*numbers, *arrays, first.step)
        if not self._library.begin(ctypes.byref(runs)):
            raise MemoryError
        try:
            pace = self._run(runs, first.steps if to is None else to)
        finally:
            self._library.end(ctypes.byref(runs))
            for simulation, instance, state in zip(simulations, instances, states, strict=True):
                instance.restore(state, simulation.time)
                instance.free(state)
        complete = [not runs.lost >> i & 1 for i in range(count)]
        for simulation, instance, valid in zip(simulations, instances, complete, strict=True):
            simulation.recorder.done, simulation.pace = runs.done, pace / count
            if valid:
                instance.propagate(Verb.GET, simulation.bus, simulation.time)
        return complete

    def _run(self, runs: _Runs, to: int) -> float:
        """Perform macro steps until `to` are complete, and check for Ctrl-C after every stretch of
        steps. Return the processor time [s] that a macro step of all lanes took in the fastest
        stretch. Elapsed time would include the time of other processes.
        """
        chunk, pace = CHUNK, math.inf
        while runs.done < to and runs.lost != (1 << runs.count) - 1:
            before, began = runs.done, thread_time()
            self._library.advance(ctypes.byref(runs), min(before + chunk, to))
            seconds = thread_time() - began
            pace = min(pace, seconds / max(1, runs.done - before))
            chunk = 2 * chunk if seconds < CHUNK_SECONDS / 2 else chunk
            signals.check()
        return pace if pace < math.inf else 0.0


def _whole(simulation: Simulation) -> WholeInstance:
    (instance,) = simulation.instances
    assert isinstance(instance, WholeInstance)
    return instance


if __name__ == "__main__":
    os.nice(10)
    try:
        library(Path(sys.argv[1]), wait=True)
    except (NotFusedError, KeyboardInterrupt) as error:
        sys.exit(str(error))
