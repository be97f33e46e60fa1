# SPDX-License-Identifier: BSD-2-Clause
"""A whole system as a WebAssembly module, which core/build/web_module.py compiles from the sources
in its fused FMU: a page flies it with the bits of a run here.
"""

from __future__ import annotations

import hashlib
import importlib.util
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.files import cache, paths
from harness.master.fused import COMPILER, NotFusedError, Whole
from harness.system.graph import Checked
from harness.system.model import System

LIBRARY = "ziglang"
"""Package that brings the compiler."""


@dataclass(frozen=True)
class Module:
    """A module and what its flights are told.

    names, references, values: of everything that can be set, in one order; outputs: references by
    the name of the column.
    """

    code: bytes
    names: tuple[str, ...]
    references: tuple[int, ...]
    values: NDArray[np.float64]
    outputs: dict[str, int]


def compiler() -> list[str]:
    """The command of the compiler; HarnessError naming the extra if it is not there."""
    if importlib.util.find_spec(LIBRARY) is None:
        raise HarnessError(
            f"a live page needs {LIBRARY}: pip install 'servicing-fmus[fly]' (or {LIBRARY})"
        )
    return [sys.executable, "-m", LIBRARY, "cc"]


def module_of(system: System, found: Checked) -> Module:
    """The module of a checked system; HarnessError if there is no compiler, or if the system cannot
    be one FMU (NotFusedError: str() is the reason).
    """
    web = compiler()
    native = COMPILER if shutil.which(COMPILER) else shlex.join(web)
    whole = Whole(system, found.graph, native)
    fmu = whole.interface.path
    key = hashlib.sha256(fmu.read_bytes())
    for file in _tools():
        key.update(file.read_bytes())
    key.update(repr(web).encode())
    file = cache.made("whole.wasm", key.digest(), lambda to: _compile(fmu, to, web))
    slots = (slot.name for slot in found.graph.slots)
    return Module(
        file.read_bytes(),
        tuple(whole.interface.settable()),
        tuple(whole.references),
        whole.values(system, found.graph),
        {name: wire.variable.reference for name, wire in zip(slots, whole.outputs, strict=True)},
    )


def _tools() -> list[Path]:
    core = paths.core()
    assert core is not None  # there is a whole
    return [core / "web" / "fly.c", core / "build" / "web_module.py"]


def _compile(fmu: Path, output: Path, command: list[str]) -> None:
    tool = [sys.executable, str(_tools()[1]), str(fmu), "-o", str(output)]
    done = subprocess.run(
        [*tool, f"--cc={shlex.join(command)}"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        text=True, errors="replace", check=False, stdin=subprocess.DEVNULL,
    )  # fmt: skip
    if done.returncode:
        said = [line for line in done.stdout.splitlines() if line.strip()]
        raise NotFusedError(said[0] if said else f"web_module.py ended with {done.returncode}")
