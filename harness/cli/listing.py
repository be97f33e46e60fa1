# SPDX-License-Identifier: BSD-2-Clause
"""What `harness list` says about systems and FMUs."""

from __future__ import annotations

from pathlib import Path

from harness.errors import UsageError
from harness.files import paths
from harness.master.changes import set_names
from harness.ssp.library import find_system, load
from harness.system.interface import read_interface
from harness.system.model import Experiment, System


def text(name: str | None = None) -> str:
    """All systems with components and sets, and all FMUs, as lines for reading; with a name or path
    one system.
    """
    if name is not None:
        return "\n".join(_system_lines(find_system(name)))
    systems, fmus = paths.systems(), paths.fmus()
    if not systems and not fmus:
        raise UsageError("neither systems nor FMUs found: build the project first")
    lines = ["systems"]
    for path in systems.values():
        lines += [f"  {line}" for line in _system_lines(path)]
    lines += ["FMUs"]
    width = max(map(len, fmus), default=0)
    lines += [
        f"  {name:{width}}  {read_interface(path).model.description or ''}"
        for name, path in fmus.items()
    ]
    return "\n".join(lines)


def _system_lines(path: Path) -> list[str]:
    with load(path) as system:
        experiment = system.experiment
        return [
            f"{system.name}: {system.description}",
            f"  runs        {_time(experiment)}, {experiment.algorithm}",
            f"  components  {', '.join(f'{c.name} ({c.fmu.stem})' for c in system.components)}",
            f"  sets        {', '.join(set_names(system))}",
            *(f"    {s.name}: {s.description}" for s in system.sets if s.description),
            *(f"  swaps       {c}={','.join(fmus)}" for c, fmus in _alternatives(system).items()),
        ]


def _time(experiment: Experiment) -> str:
    """How long a system runs and in which steps, and what it does not say."""
    if experiment.stop is None and experiment.step is None:
        return "with --stop and --step (the file defines neither)"
    stop = "with --stop" if experiment.stop is None else f"{experiment.stop} s"
    return f"{stop}, {'with --step' if experiment.step is None else _step(experiment.step)}"


def _step(seconds: float) -> str:
    return f"macro step {seconds} s"


def _alternatives(system: System) -> dict[str, list[str]]:
    """FMUs that the system has parameters for, by the component that they replace."""
    found: dict[str, list[str]] = {}
    for alternative in system.alternatives:
        found.setdefault(alternative.component, []).append(alternative.fmu)
    return found
