# SPDX-License-Identifier: BSD-2-Clause
"""Values that FMUs refuse, found before any run: what an FMU demands of its parameters it says when
it is initialised, and for that it needs none of the others.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from harness.errors import FmuError, HarnessError, RefusalError, RunError
from harness.files.paths import is_file, is_ours
from harness.master.isolated import in_child, timed
from harness.master.messages import noted
from harness.master.refusals import as_typed, without
from harness.master.simulation import Simulation
from harness.system.model import System


def refused(
    systems: Iterable[System], foreign: Collection[str] = (), patience: float = math.inf
) -> Iterator[RefusalError]:
    """What the FMUs of these systems refuse, one error per component and its values.

    foreign: components that are tried although their FMUs are not ours, each in a process of its
    own; patience: how long such a one may take for one call [s].
    """
    for system in _alone_once(systems, foreign):
        try:
            _try(system, patience)
        except RefusalError as error:
            yield error
        except HarnessError:  # of anything else the run itself speaks
            continue


def _alone_once(systems: Iterable[System], foreign: Collection[str]) -> Iterator[System]:
    """Components that can be tried, each with its values once."""
    tried = set()
    for system in systems:
        for c in system.components:
            values = c.name, c.fmu, frozenset(c.parameters.items())
            wanted = c.name in foreign or is_ours(c.fmu)
            if wanted and values not in tried and is_file(c.fmu):
                tried.add(values)
                yield _alone(system, c.name)


def always_refused(
    systems: Iterable[System], given: Mapping[str, Any], varied: Collection[str], patience: float
) -> Iterator[HarnessError]:
    """What FMUs refuse in every run, because it is about nothing that varies, in the words of the
    user: given: values by name, as they were typed; varied: names of what differs.
    """
    components = {name.partition(".")[0] for name in given}
    for error in refused(systems, components, patience):
        if common := without(error, varied):
            yield as_typed(common, given, f"{error.component}.")


def unreachable(system: System, components: Iterable[str]) -> Iterator[HarnessError]:
    """What stands in the way of components on boards: nobody answers, another interface, values
    that are refused. Each board is asked up to its initialization, in a process of its own.
    """
    for name in components:
        try:
            in_child(_begin, _alone(system, name))
        except (FmuError, RefusalError) as error:
            yield error
        except RunError:  # of what it makes of open inputs
            continue


def _alone(system: System, name: str) -> System:
    """One component for one macro step."""
    component, experiment = system.component(name), system.experiment
    step = experiment.step or 1.0
    span = replace(experiment, step=step, stop=experiment.start + max(1, component.every) * step)
    return System(system.name, (component,), (), span)


def _begin(system: System) -> None:
    with Simulation(system) as simulation:
        simulation.initialize()


def _try(system: System, patience: float) -> None:
    with noted():
        if is_ours(system.components[0].fmu):
            _begin(system)
        else:
            timed(system, patience=patience)
