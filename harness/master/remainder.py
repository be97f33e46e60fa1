# SPDX-License-Identifier: BSD-2-Clause
"""Systems without the components that another tool simulates. Inputs that were connected to these
components become open inputs, with the initial values that they have in the whole system.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

from harness.errors import UsageError
from harness.master.isolated import guarded
from harness.master.simulation import Simulation
from harness.results.expressions import parsed
from harness.system.conversion import way
from harness.system.graph import read_interfaces
from harness.system.model import Parameter, Parameters, System
from harness.system.swap import existing


def rest(system: System) -> System:
    """Return the system without its open components (System.without)."""
    out = system.without
    return remainder(replace(system, without=()), out) if out else system


def remainder(system: System, names: Collection[str]) -> System:
    """Return a system without the named components. Requirements, consistency conditions and
    sliders that refer to them are removed. Parameter sets lose their values for these components.
    Raises UsageError for an unknown name or if no component remains.
    """
    named = {existing(system, "--open", name) for name in names}
    if len(named) == len(system.components):
        raise UsageError(f"--open: no component of {system.name} remains")
    starts = guarded([c.fmu for c in system.components], _starts, system, names)

    def begun(parameters: Mapping[str, Parameters]) -> dict[str, Parameters]:
        return {n: {**p, **starts[n]} for n, p in parameters.items() if n not in names}

    def remaining(texts: Mapping[str, str]) -> dict[str, str]:
        return {name: text for name, text in texts.items() if not _needs(text, names)}

    return replace(
        system,
        components=tuple(
            replace(c, parameters=begun({c.name: c.parameters})[c.name])
            for c in system.components
            if c.name not in names
        ),
        connections=tuple(
            c for c in system.connections if not {c.source.component, c.target.component} & {*names}
        ),
        sets=tuple(replace(s, parameters=begun(s.parameters)) for s in system.sets),
        alternatives=tuple(a for a in system.alternatives if a.component not in names),
        requirements=remaining(system.requirements),
        consistency=remaining(system.consistency),
        sliders={n: r for n, r in system.sliders.items() if n.partition(".")[0] not in names},
        strict=False,
    )


def _starts(system: System, names: Collection[str]) -> dict[str, dict[str, Parameter]]:
    """Return the initial values of all inputs that are connected to outputs of the named
    components, as parameters by component and variable.
    """
    interfaces = read_interfaces(system)
    with Simulation(system, executor="python") as simulation:
        simulation.initialize()
        first = simulation.result()
    starts: dict[str, dict[str, Parameter]] = {c.name: {} for c in system.components}
    for each in system.connections:
        if each.source.component in names and each.target.component not in names:
            value = float(first[str(each.source)][0])
            change = way(each, interfaces)
            starts[each.target.component][each.target.variable] = Parameter(change(value))
    return starts


def _needs(text: str, names: Collection[str]) -> bool:
    """Return whether the text of a requirement or consistency condition contains a variable or a
    parameter of one of the named components.
    """
    read = (path.rpartition(" ")[2] for path in parsed(text).variables)
    return any(path.partition(".")[0] in names for path in read)
