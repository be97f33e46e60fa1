# SPDX-License-Identifier: BSD-2-Clause
"""Co-simulated system as plain data: the content of an .ssp, and what an .ssp does not contain: its
source with the changes made to it, components left open, and the entries of `[start]`.

All classes are immutable. dataclasses.replace() makes a variant of a system.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from harness.system.units import Hop, Unit
from harness.system.values import Scalar, base

DEFAULT_SET = "default"
"""Name of the parameter set that a system has if none is chosen."""


class Port(NamedTuple):
    """One scalar variable of one component."""

    component: str
    variable: str

    def __str__(self) -> str:
        return f"{self.component}.{self.variable}"

    @property
    def signal(self) -> str:
        """Name of the scalar, vector or matrix to which the variable belongs: its name without
        indices.
        """
        return base(self.variable)


class Connection(NamedTuple):
    """Connection from the output `source` to the input `target`; hops: conversions of the value, in
    order. Without hops only the unit is converted.
    """

    source: Port
    target: Port
    hops: tuple[Hop, ...] = ()


@dataclass(frozen=True)
class Parameter:
    """Value of a parameter, or start value of an unconnected input; `unit` as written in the file
    (None: the unit of the variable).

    meaning: definition of the unit, if the file has one; hops: conversions before the value is set;
    optional: True in a file of another tool; the value is then ignored if the component has no such
    variable, as SSP prescribes.
    """

    value: Scalar
    unit: str | None = None
    meaning: Unit | None = field(default=None, compare=False)
    hops: tuple[Hop, ...] = ()
    optional: bool = False


Parameters = Mapping[str, Parameter]
"""Parameters of one component by the name of the scalar variable."""


@dataclass(frozen=True)
class Component:
    """FMU in its place in a system, with its parameters and its schedule.

    every: macro steps per step of this component; latency: number of macro steps by which its
    outputs are published later.
    """

    name: str
    fmu: Path
    parameters: Parameters = field(default_factory=dict)
    every: int = 1
    latency: int = 0


@dataclass(frozen=True)
class Experiment:
    """Time span [s], macro step [s] (None: the file gives none) and order of execution of a run;
    every: each N-th macro step is recorded by default; epoch: UTC of t = 0, such as
    2026-01-31T12:00:00 ("": no date).
    """

    start: float = 0.0
    stop: float | None = None
    step: float | None = None
    algorithm: str = "gauss-seidel"
    every: int = 1
    epoch: str = ""


@dataclass(frozen=True)
class ParameterSet:
    """Named parameters of all components, which replace the default parameters; stop and step [s]
    override the values in the experiment unless they are None.
    """

    name: str
    description: str = ""
    parameters: Mapping[str, Parameters] = field(default_factory=dict)
    stop: float | None = None
    step: float | None = None


@dataclass(frozen=True)
class Alternative:
    """Parameters, by component, that apply when the FMU with the model name `fmu` replaces the FMU
    of a component.
    """

    component: str
    fmu: str
    parameters: Mapping[str, Parameters] = field(default_factory=dict)


class Swap(NamedTuple):
    """FMU that replaces the FMU of a component: its name or path as given, and the hash of its
    content.
    """

    component: str
    fmu: str
    sha256: str


@dataclass(frozen=True)
class Origin:
    """Source of a system and the changes made to it.

    source, sha256: name or path of the source as given, and hash of its file; params,
    params_sha256: parameter set or file, and hash of a file; set: values by `component.variable`;
    swaps: FMUs that replaced the FMU of a component; maps: name in the system by name of the port
    in the new FMU; on: processor by component; latency: macro steps by component.
    """

    source: str = ""
    sha256: str = ""
    params: str | None = None
    params_sha256: str = ""
    set: Mapping[str, Any] = field(default_factory=dict)
    swaps: Mapping[str, Swap] = field(default_factory=dict)
    maps: Mapping[str, str] = field(default_factory=dict)
    on: Mapping[str, str] = field(default_factory=dict)
    latency: Mapping[str, int] = field(default_factory=dict)


Range = tuple[float | None, float | None]
"""Smallest and largest value; None: no limit given."""


@dataclass(frozen=True)
class System:
    """Components in execution order, their connections, and the settings of a run.

    strict: a connection of unequal units, or an input without a connection and a value, is an error
    (not in files of other tools); declared: units that the file states by port, to be compared with
    the FMUs; requirements: conditions by name, see harness.results.requirements; consistency:
    conditions on parameters by name; a condition that fails is logged; compared: parameter set that
    a comparison uses by default ("": none); sliders: parameters that the reader of a live page may
    change, with their ranges (None: range of the FMU); mission: name of its mission; without: open
    components, whose outputs the user sets during a run (harness.master.steering); starts: entries
    of `[start]`: by component, the path of the file, or the two-line elements, from which its
    parameters are computed; and as `attitude` the frame relative to which the start attitudes are
    preserved when the orbit is replaced; origin: source and changes of the system.
    """

    name: str
    components: tuple[Component, ...]
    connections: tuple[Connection, ...]
    experiment: Experiment
    description: str = ""
    sets: tuple[ParameterSet, ...] = ()
    alternatives: tuple[Alternative, ...] = ()
    strict: bool = False
    requirements: Mapping[str, str] = field(default_factory=dict)
    consistency: Mapping[str, str] = field(default_factory=dict)
    compared: str = ""
    sliders: Mapping[str, Range] = field(default_factory=dict)
    mission: str = ""
    without: tuple[str, ...] = ()
    declared: Mapping[Port, Unit] = field(default_factory=dict, compare=False)
    starts: Mapping[str, str] = field(default_factory=dict, compare=False)
    origin: Origin = field(default_factory=Origin, compare=False)

    def component(self, name: str) -> Component:
        """Return the component with this name; raise KeyError if there is no such component."""
        return self._by_name[name]

    @cached_property
    def _by_name(self) -> dict[str, Component]:
        return {c.name: c for c in self.components}
