# SPDX-License-Identifier: BSD-2-Clause
"""What is wrong with a system or an FMU: everything at once."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from fmpy.validation import validate_fmu

from harness import paths
from harness.changes import choose_set, set_names
from harness.errors import FmuError, HarnessError, StructureError, UsageError
from harness.spelling import did_you_mean
from harness.ssp import reader
from harness.system.graph import build_graph
from harness.system.interface import has_binary, read_interface
from harness.system.model import System
from harness.system.schedule import macro_steps


def check(name: str) -> str:
    """Verdict on a system or FMU, given by name or path; StructureError or FmuError with everything
    that is wrong.
    """
    systems, fmus = paths.systems(), paths.fmus()
    path = systems.get(name) or fmus.get(name) or Path(name)
    if not paths.is_file(path):
        raise UsageError(
            f"{name}: there is no such system or FMU{did_you_mean(name, [*systems, *fmus])}"
        )
    if path.suffix == ".fmu":
        return _check_fmu(path)
    with reader.opened(path) as system:
        return _check_system(system)


def _check_fmu(path: Path) -> str:
    if problems := _fmu_problems(path):
        raise FmuError("\n".join(f"{path.name}: {problem}" for problem in problems))
    interface = read_interface(path)
    counts = {kind: len(interface.named(kind)) for kind in ("input", "output", "parameter")}
    return f"{path.name}: fine ({', '.join(f'{n} {kind}s' for kind, n in counts.items())})"


def _fmu_problems(path: Path) -> list[str]:
    """Everything FMPy finds, and a missing binary."""
    if not zipfile.is_zipfile(path):
        return ["damaged or not a zip archive (File is not a zip file)"]
    problems = [" ".join(problem.split()) for problem in validate_fmu(str(path))]
    if not problems and not has_binary(read_interface(path)):
        problems.append("it holds no binary for this platform")
    return problems


def _check_system(system: System) -> str:
    """Check time span and schedule, and structure, FMUs and parameters with every parameter set."""
    experiment = system.experiment
    missing = [name for name in ("step", "stop") if getattr(experiment, name) is None]
    problems = []
    if not missing:
        problems = _complaints(
            lambda: macro_steps(experiment, [c.every for c in system.components])
        )
    for name in set_names(system):
        problems += _complaints(partial(build_graph, choose_set(system, name)))
    if not problems:
        bare = [c for c in system.components if not has_binary(read_interface(c.fmu))]
        problems = [f"{c.name}: {c.fmu.name} holds no binary for this platform" for c in bare]
    if problems:
        raise StructureError(problems)
    counts = (
        f"{len(system.components)} components, {len(system.connections)} connections, "
        f"{len(set_names(system))} sets"
    )
    wanted = f", give {' and '.join(f'--{name}' for name in missing)}" if missing else ""
    return f"{system.name}: fine ({counts}){wanted}"


def _complaints(test: Callable[[], object]) -> list[str]:
    try:
        test()
    except HarnessError as error:
        return str(error).splitlines()
    return []
