# SPDX-License-Identifier: BSD-2-Clause
"""Check of a system or an FMU, which reports all problems at once and separates errors from
warnings.

An error prevents a run: the run would end with the same error. A warning does not, e.g. a deviation
from the standard. An FMU checks its parameter values when it is initialised. This needs no other
FMU, so rejected values are found before any run by initialising each FMU alone.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Unpack

from harness.conformance.check import examine
from harness.errors import (
    FmuError,
    HarnessError,
    RejectedValueError,
    RunError,
    StructureError,
    UsageError,
)
from harness.files import paths
from harness.master.changes import Changes, apply, choose_set, set_names
from harness.master.isolated import PATIENCE, all_ours, in_child, simulate, timed
from harness.master.messages import as_typed, noted, without
from harness.master.remainder import rest
from harness.master.simulation import Simulation
from harness.mission.library import SYSTEM
from harness.remote.firmware import PROCESSORS, missing
from harness.results import verdict
from harness.results.requirements import condition, findings, log_inconsistencies
from harness.spelling import did_you_mean
from harness.ssp.library import examined
from harness.system.graph import readable_interfaces
from harness.system.interface import binary_problem, read_interface
from harness.system.model import System
from harness.system.problems import problems as graph_problems
from harness.system.problems import size_problems, value_problems
from harness.system.schedule import macro_steps

_log = logging.getLogger("harness")


class Verdict(NamedTuple):
    """Result of a successful check: `text` is the line that states that the system or FMU can be
    run; `warnings` has one line per problem that does not prevent a run.
    """

    text: str
    warnings: tuple[str, ...] = ()

    def __str__(self) -> str:
        count = len(self.warnings)
        return f"{self.text}, {count} warning{'s' * (count > 1)}" if count else self.text


def check(name: str, strict: bool = False, **changes: Unpack[Changes]) -> Verdict:
    """Return the verdict on a system or FMU, given by name or path.

    strict: treat warnings as errors; changes: options of run(). Without changes, the system is
    checked with each of its parameter sets; with changes, only the changed system is checked.
    Raises StructureError (system) or FmuError (FMU) with all problems, warnings included, and
    UsageError for an unknown name or changes that cannot be made.
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
        raise UsageError(
            f"--{next(iter(changes))}: is valid only for a system, and {name} is an FMU"
        )
    return _check_fmu(path, strict)


def machine() -> Iterator[str]:
    """Yield one line per flight processor: `ready` if this machine has its compiler and emulator,
    otherwise the missing tools.
    """
    for processor in PROCESSORS.values():
        yield missing(processor) or f"{processor.name}: {processor.text}: ready"


def _check_fmu(path: Path, strict: bool) -> Verdict:
    found = examine(path)
    errors = found.errors or _complaints(lambda: _load(path))
    lines = (*errors, *(f"warning: {w}" for w in found.warnings))
    if errors or (strict and lines):
        raise FmuError("\n".join(f"{path.name}: {line}" for line in lines))
    interface = read_interface(path)
    counts = {kind: len(interface.named(kind)) for kind in ("input", "output", "parameter")}
    text = f"{path.name}: fine ({', '.join(f'{n} {kind}s' for kind, n in counts.items())})"
    return Verdict(text, tuple(f"{path.name}: {warning}" for warning in found.warnings))


def _load(path: Path) -> None:
    """Raise FmuError if an FMU has no binary that this machine can load."""
    if problem := binary_problem(read_interface(path)):
        raise FmuError(problem)


def _check_system(path: Path, strict: bool, changes: Changes) -> Verdict:
    """Return the verdict on a system file; raise StructureError with all problems.

    FMUs, connections, parameter values and time span are checked, with every parameter set or, if
    there are changes, with these changes only.
    """
    with noted() as notes, examined(path) as (found, problems):
        system = found if problems else rest(apply(found, **changes) if changes else found)
        sets = [""] if changes else set_names(system)
        chosen = [choose_set(system, name) if name else system for name in sets]
        errors = [*problems, *_system_errors(system, chosen)]
        if not errors:
            log_inconsistencies(*chosen)
            log_decided(chosen[0])
    lines = (*errors, *(f"warning: {note}" for note in notes))
    if errors or (strict and lines):
        raise StructureError(lines)
    missing = [name for name in ("step", "stop") if getattr(system.experiment, name) is None]
    counts = (
        f"{len(system.components)} components, {len(system.connections)} connections, "
        f"{'with these changes' if changes else f'{len(set_names(system))} parameter sets'}"
    )
    needed = f", give {' and '.join(f'--{name}' for name in missing)}" if missing else ""
    return Verdict(f"{system.name}: fine ({counts}){needed}", tuple(notes))


def _system_errors(system: System, chosen: Sequence[System]) -> Iterator[str]:
    """Yield one line per error in the time span, FMUs, connections and parameter values of a
    system. Values for an FMU that cannot be read are not checked.

    chosen: the system with each of the parameter sets whose values are checked.
    """
    experiment = system.experiment
    if experiment.step is not None and experiment.stop is not None:
        periods = [max(1, c.every) for c in system.components]
        yield from _complaints(partial(macro_steps, experiment, periods))
    # examined() has reported components whose file is missing
    there = tuple(c for c in system.components if c.fmu.is_file())
    interfaces, unreadable = readable_interfaces(replace(system, components=there))
    yield from unreadable
    for component in system.components:
        interface = interfaces.get(component.name)
        if interface and (problem := binary_problem(interface)):
            yield f"{component.name}: {component.fmu.name}: {problem}"
    yield from size_problems(system, interfaces)
    first, *others = chosen
    yield from graph_problems(first, interfaces)
    for each in others:  # other parameter sets change values only, not the structure
        yield from value_problems(each, interfaces, each.components)
    boards = [name for name, place in system.origin.on.items() if "://" in place]
    for error in (*rejected(chosen), *unreachable(system, boards)):
        typed: HarnessError = error
        if isinstance(error, RejectedValueError):
            typed = as_typed(error, system.origin.set, f"{error.component}.")
        yield from str(typed).splitlines()
    for interface in {i.path: i for i in interfaces.values()}.values():
        for warning in interface.warnings:
            _log.warning("%s: %s", interface.path.name, warning)


def log_decided(system: System) -> None:
    """Log a warning for each requirement whose verdict is the same in every run, because the
    requirement fails already in the first row or depends on parameters only. Systems with
    third-party FMUs are left out, since a check runs none of their code.
    """
    period = max(max(1, c.every) for c in system.components)
    experiment = system.experiment
    if experiment.step is None or not all_ours(system):
        return
    stop = experiment.start + period * experiment.step
    with suppress(HarnessError):  # a run reports the same error to the user
        with noted():
            short = replace(system, experiment=replace(experiment, stop=stop))
            run = simulate(short, patience=PATIENCE)
        first = replace(run, time=run.time[:1], values=run.values[:1])
        for found in findings(first):
            fixed = all(path.startswith("parameter ") for path in condition(found.text).variables)
            if fixed or found.verdict is verdict.Verdict.NOT_MET:
                _log.warning("%s; every run has this verdict: the start values decide it", found)


def _complaints(test: Callable[[], object]) -> list[str]:
    try:
        test()
    except HarnessError as error:
        return str(error).splitlines()
    return []


# ---- rejected values and unreachable boards, found before any run


def rejected(
    systems: Iterable[System], third_party: Collection[str] = (), patience: float = math.inf
) -> Iterator[RejectedValueError]:
    """Yield an error for each component whose FMU rejects its parameter values. Every component is
    initialised alone, once per distinct combination of its values.

    third_party: names of components that are tried even if their FMUs are third-party, each by a
    run of one step in a separate process (other third-party FMUs are left out); patience: limit for
    one call into such an FMU [s].
    """
    for system in _alone_once(systems, third_party):
        try:
            _try(system, patience)
        except RejectedValueError as error:
            yield error
        except HarnessError:  # the run itself reports other errors
            continue


def _alone_once(systems: Iterable[System], third_party: Collection[str]) -> Iterator[System]:
    """Yield systems with one component each: one for every component and distinct combination of
    its values. Components without a readable file are left out, and so are components with
    third-party FMUs that `third_party` does not name.
    """
    tried = set()
    for system in systems:
        for c in system.components:
            values = c.name, c.fmu, frozenset(c.parameters.items())
            chosen = c.name in third_party or paths.is_ours(c.fmu)
            if chosen and values not in tried and paths.is_file(c.fmu):
                tried.add(values)
                yield _alone(system, c.name)


def always_rejected(
    systems: Iterable[System], given: Mapping[str, Any], varied: Collection[str], patience: float
) -> Iterator[HarnessError]:
    """Yield an error for each component whose FMU rejects values in every run, because the
    parameters with these values do not vary between runs. The error shows the values as the user
    typed them.

    given: fixed values by parameter, as typed; varied: names of the parameters that vary; patience:
    limit for one call into a third-party FMU [s].
    """
    components = {name.partition(".")[0] for name in given}
    for error in rejected(systems, components, patience):
        if common := without(error, varied):
            yield as_typed(common, given, f"{error.component}.")


def unreachable(system: System, components: Iterable[str]) -> Iterator[HarnessError]:
    """Yield an error for each named component whose board does not answer, contains another FMU, or
    rejects values. Each board is initialised alone, in a separate process.
    """
    for name in components:
        try:
            in_child(_begin, _alone(system, name))
        except (FmuError, RejectedValueError) as error:
            yield error
        except RunError:  # ignored: unconnected inputs can cause a failure that no run has
            continue


def _alone(system: System, name: str) -> System:
    """Return the system reduced to the named component, for one step of this component."""
    component, experiment = system.component(name), system.experiment
    step = experiment.step or 1.0
    span = replace(experiment, step=step, stop=experiment.start + max(1, component.every) * step)
    return System(system.name, (component,), (), span)


def _begin(system: System) -> None:
    with Simulation(system) as simulation:
        simulation.initialize()


def _try(system: System, patience: float) -> None:
    with noted():
        if paths.is_ours(system.components[0].fmu):
            _begin(system)
        else:
            timed(system, patience=patience)
