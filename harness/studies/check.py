# SPDX-License-Identifier: BSD-2-Clause
"""What is wrong with a system or an FMU: everything at once, errors apart from warnings.

Errors keep it from being run, exactly those that a run would end with. Warnings are what is not by
the book.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from harness.errors import FmuError, HarnessError, StructureError, UsageError
from harness.files import paths
from harness.master.changes import choose_set, set_names
from harness.rules.judge import judge
from harness.spelling import did_you_mean
from harness.ssp import reader
from harness.studies.notes import noted
from harness.system.graph import readable_interfaces
from harness.system.interface import Interface, binaries, has_binary, platforms, read_interface
from harness.system.model import System
from harness.system.problems import problems as graph_problems
from harness.system.problems import size_problems
from harness.system.schedule import macro_steps


class Verdict(NamedTuple):
    """What can be run: a line that says so, and the warnings, one line each."""

    text: str
    warnings: tuple[str, ...] = ()

    def __str__(self) -> str:
        count = len(self.warnings)
        return f"{self.text}, {count} warning{'s' * (count > 1)}" if count else self.text


def check(name: str, strict: bool = False) -> Verdict:
    """Verdict on a system or FMU, given by name or path.

    strict: warnings are errors. Raises StructureError or FmuError with everything that is wrong,
    warnings included.
    """
    systems, fmus = paths.systems(), paths.fmus()
    path = systems.get(name) or fmus.get(name) or Path(name)
    if not paths.is_file(path):
        raise UsageError(
            f"{name}: there is no such system or FMU{did_you_mean(name, [*systems, *fmus])}"
        )
    return (_check_fmu if path.suffix == ".fmu" else _check_system)(path, strict)


def _check_fmu(path: Path, strict: bool) -> Verdict:
    found = judge(path)
    errors = [*found.errors, *_complaints(lambda: _loadable(path))[: not found.errors]]
    lines = (*errors, *(f"warning: {w}" for w in found.warnings))
    if errors or (strict and lines):
        raise FmuError("\n".join(f"{path.name}: {line}" for line in lines))
    interface = read_interface(path)
    counts = {kind: len(interface.named(kind)) for kind in ("input", "output", "parameter")}
    text = f"{path.name}: fine ({', '.join(f'{n} {kind}s' for kind, n in counts.items())})"
    return Verdict(text, tuple(f"{path.name}: {warning}" for warning in found.warnings))


def _loadable(path: Path) -> None:
    """FmuError if the FMU has nothing to load."""
    if problem := _without_binary(read_interface(path)):
        raise FmuError(problem)


def _without_binary(interface: Interface) -> str | None:
    """Why a readable FMU has nothing to load here, or None."""
    if has_binary(interface):
        return None
    others = platforms(interface)
    shown = f", only for {', '.join(others)}" if others else f" ({binaries(interface)[0]})"
    return f"it holds no binary for this platform{shown}"


def _check_system(path: Path, strict: bool) -> Verdict:
    """Everything that is wrong with the file, its wiring with every parameter set, its FMUs and its
    time span.
    """
    with noted() as notes, reader.examined(path) as (system, problems):
        errors = [*problems, *_system_errors(system)]
    lines = (*errors, *(f"warning: {note}" for note in notes))
    if errors or (strict and lines):
        raise StructureError(lines)
    missing = [name for name in ("step", "stop") if getattr(system.experiment, name) is None]
    counts = (
        f"{len(system.components)} components, {len(system.connections)} connections, "
        f"{len(set_names(system))} sets"
    )
    wanted = f", give {' and '.join(f'--{name}' for name in missing)}" if missing else ""
    return Verdict(f"{system.name}: fine ({counts}){wanted}", tuple(notes))


def _system_errors(system: System) -> Iterator[str]:
    """Time span, FMUs, and the wiring with every parameter set as far as the FMUs can be read."""
    experiment = system.experiment
    if experiment.step is not None and experiment.stop is not None:
        periods = [max(1, c.every) for c in system.components]
        yield from _complaints(partial(macro_steps, experiment, periods))
    there = tuple(c for c in system.components if c.fmu.is_file())  # else the reader has said it
    interfaces, unreadable = readable_interfaces(replace(system, components=there))
    yield from unreadable
    for component in system.components:
        interface = interfaces.get(component.name)
        if interface and (problem := _without_binary(interface)):
            yield f"{component.name}: {component.fmu.name}: {problem}"
    yield from size_problems(system, interfaces)
    for name in set_names(system):
        yield from graph_problems(choose_set(system, name), interfaces)
    _say_warnings(interfaces)


def _say_warnings(interfaces: dict[str, Interface]) -> None:
    """All warnings of the FMUs, each once."""
    log = logging.getLogger("harness")
    for interface in {i.path: i for i in interfaces.values()}.values():
        for warning in interface.warnings:
            log.warning("%s: %s", interface.path.name, warning)


def _complaints(test: Callable[[], object]) -> list[str]:
    try:
        test()
    except HarnessError as error:
        return str(error).splitlines()
    return []
