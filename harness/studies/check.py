# SPDX-License-Identifier: BSD-2-Clause
"""What is wrong with a system or an FMU: everything at once, errors apart from warnings.

Errors keep it from being run, exactly those that a run would end with. Warnings are what is not by
the book.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, Unpack

from harness.errors import FmuError, HarnessError, RefusalError, StructureError, UsageError
from harness.files import paths
from harness.master.changes import Changes, apply, choose_set, set_names
from harness.master.messages import noted
from harness.master.refusals import as_typed
from harness.master.trial import refused, unreachable
from harness.mission.library import SYSTEM
from harness.remote.targets import TARGETS, missing
from harness.results.requirements import say_inconsistencies
from harness.rules.judge import judge
from harness.spelling import did_you_mean
from harness.ssp.library import examined
from harness.system.graph import readable_interfaces
from harness.system.interface import binary_problem, read_interface
from harness.system.model import System
from harness.system.problems import problems as graph_problems
from harness.system.problems import size_problems, value_problems
from harness.system.schedule import macro_steps


class Verdict(NamedTuple):
    """What can be run: a line that says so, and the warnings, one line each."""

    text: str
    warnings: tuple[str, ...] = ()

    def __str__(self) -> str:
        count = len(self.warnings)
        return f"{self.text}, {count} warning{'s' * (count > 1)}" if count else self.text


def check(name: str, strict: bool = False, **changes: Unpack[Changes]) -> Verdict:
    """Verdict on a system or FMU, given by name or path.

    strict: warnings are errors; changes: those of run(), then what it would fly is judged instead
    of all parameter sets. Raises StructureError or FmuError with everything that is wrong, warnings
    included, and UsageError for changes that cannot be made.
    """
    systems, fmus = paths.systems(), paths.fmus()
    path = systems.get(name) or fmus.get(name) or Path(name)
    if paths.is_file(path / SYSTEM):
        path = path / SYSTEM
    if not paths.is_file(path):
        raise UsageError(
            f"{name}: there is no such system or FMU{did_you_mean(name, [*systems, *fmus])}"
        )
    if path.suffix != ".fmu":
        return _check_system(path, strict, changes)
    if changes:
        raise UsageError(f"{name}: --{next(iter(changes))} changes a system, and this is an FMU")
    return _check_fmu(path, strict)


def machine() -> Iterator[str]:
    """For every flight processor, whether this machine can build for it and emulate it, or what it
    lacks; a line each.
    """
    for target in TARGETS.values():
        yield missing(target) or f"{target.name}: {target.text}: ready"


def _check_fmu(path: Path, strict: bool) -> Verdict:
    found = judge(path)
    errors = found.errors or _complaints(lambda: _load(path))
    lines = (*errors, *(f"warning: {w}" for w in found.warnings))
    if errors or (strict and lines):
        raise FmuError("\n".join(f"{path.name}: {line}" for line in lines))
    interface = read_interface(path)
    counts = {kind: len(interface.named(kind)) for kind in ("input", "output", "parameter")}
    text = f"{path.name}: fine ({', '.join(f'{n} {kind}s' for kind, n in counts.items())})"
    return Verdict(text, tuple(f"{path.name}: {warning}" for warning in found.warnings))


def _load(path: Path) -> None:
    """FmuError if an FMU without errors of its description has nothing to load."""
    if problem := binary_problem(read_interface(path)):
        raise FmuError(problem)


def _check_system(path: Path, strict: bool, changes: Changes) -> Verdict:
    """Everything that is wrong with the file, its wiring with every parameter set or with these
    changes, its FMUs, the values that they are given, and its time span.
    """
    with noted() as notes, examined(path) as (found, problems):
        system = apply(found, **changes) if changes and not problems else found
        sets = [""] if changes else set_names(system)
        chosen = [choose_set(system, name) if name else system for name in sets]
        errors = [*problems, *_system_errors(system, chosen)]
        if not errors:
            say_inconsistencies(*chosen)
    lines = (*errors, *(f"warning: {note}" for note in notes))
    if errors or (strict and lines):
        raise StructureError(lines)
    missing = [name for name in ("step", "stop") if getattr(system.experiment, name) is None]
    counts = (
        f"{len(system.components)} components, {len(system.connections)} connections, "
        f"{'these changes' if changes else f'{len(set_names(system))} sets'}"
    )
    wanted = f", give {' and '.join(f'--{name}' for name in missing)}" if missing else ""
    return Verdict(f"{system.name}: fine ({counts}){wanted}", tuple(notes))


def _system_errors(system: System, chosen: Sequence[System]) -> Iterator[str]:
    """Time span, FMUs, wiring, and the values of the system in its parameter sets as far as the
    FMUs can be read.
    """
    experiment = system.experiment
    if experiment.step is not None and experiment.stop is not None:
        periods = [max(1, c.every) for c in system.components]
        yield from _complaints(partial(macro_steps, experiment, periods))
    there = tuple(c for c in system.components if c.fmu.is_file())  # else the reader has said it
    interfaces, unreadable = readable_interfaces(replace(system, components=there))
    yield from unreadable
    for component in system.components:
        interface = interfaces.get(component.name)
        if interface and (problem := binary_problem(interface)):
            yield f"{component.name}: {component.fmu.name}: {problem}"
    yield from size_problems(system, interfaces)
    first, *others = chosen
    yield from graph_problems(first, interfaces)
    for each in others:  # which differ from it in values only
        yield from value_problems(each, interfaces, each.components)
    boards = [name for name, place in system.origin.on.items() if "://" in place]
    for error in (*refused(chosen), *unreachable(system, boards)):
        typed: HarnessError = error
        if isinstance(error, RefusalError):
            typed = as_typed(error, system.origin.set, f"{error.component}.")
        yield from str(typed).splitlines()
    for interface in {i.path: i for i in interfaces.values()}.values():
        for warning in interface.warnings:
            logging.getLogger("harness").warning("%s: %s", interface.path.name, warning)


def _complaints(test: Callable[[], object]) -> list[str]:
    try:
        test()
    except HarnessError as error:
        return str(error).splitlines()
    return []
