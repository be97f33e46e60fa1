# SPDX-License-Identifier: BSD-2-Clause
"""What there is before anything is run: components of a system, variables of a component or FMU, to
connect and to set; what a mission plans.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias, Unpack

import numpy as np

from harness.errors import UsageError
from harness.files import paths
from harness.master.changes import Changes, apply
from harness.mission import Plan
from harness.mission.library import everything, mission
from harness.spelling import did_you_mean
from harness.ssp.library import load, of_component
from harness.system.conversion import final
from harness.system.graph import SAMPLE_PERIOD, read_interfaces
from harness.system.interface import Interface, read_interface
from harness.system.model import Component, Parameters, Port, System
from harness.system.values import Grid, Index, Scalar, Variable, base, grid, index

Nested: TypeAlias = "Scalar | list[Nested] | None"
"""Value of a scalar, vector (list) or matrix (list of rows); None where there is none."""

GROUPS = ("input", "output", "parameter")
"""Causalities that are shown."""


class Signal(NamedTuple):
    """A variable of an FMU: a scalar, or a vector or matrix whose elements are gathered.

    shape: () for a scalar; default: its start value; value: what it has in the system, None where
    it stands in none, is driven or an output; low, high: limits that the FMU declares; wires: the
    outputs that drive an input, or the inputs that read an output, as `component.variable`.
    """

    name: str
    causality: str
    type: str
    shape: Index
    unit: str
    default: Nested
    value: Nested
    low: float | None
    high: float | None
    text: str
    wires: tuple[str, ...] = ()


class Part(NamedTuple):
    """A component of a system; step: its communication step [s]; sample_period: of its software
    [s], None if it has none.
    """

    name: str
    fmu: str
    step: float | None
    sample_period: float | None
    text: str


@dataclass(frozen=True)
class Shown:
    """What was asked for, in one line, and its parts (of a system) or signals (of an FMU)."""

    title: str
    rows: tuple[Part, ...] | tuple[Signal, ...]


def show(name: str | Path, word: str | None = None, **changes: Unpack[Changes]) -> Shown:
    """Components of a system, or signals of an FMU, alone or in its place in a system.

    name: `SYSTEM`, `SYSTEM.component` or an FMU, each by name or path; word: return only rows with
    this word in name or description; changes: as for run(). Raises UsageError, ArchiveError,
    StructureError.
    """
    if (place := of_component(name)) is None:
        interface = _fmu(name, changes)
        title = f"{interface.path.name}: {_description(interface)}".rstrip(": ")
        rows = (s._replace(value=None) for s in _signals(interface, {}, {}))
        found = Shown(title, tuple(rows))
    else:
        with load(place[0]) as system:
            changed = apply(system, **changes)
            found = _part(changed, place[1]) if place[1] else _parts(changed)
    return found if word is None else _with(found, word)


def _fmu(name: str | Path, changes: Changes) -> Interface:
    known = paths.fmus()
    path = known.get(str(name), Path(name))
    if not paths.is_file(path):
        close = did_you_mean(str(name), [*paths.systems(), *known])
        raise UsageError(
            f"{name or '(nothing)'}: there is no such system or FMU{close}; "
            "a component is named SYSTEM.component"
        )
    if changes:
        raise UsageError(
            f"--{next(iter(changes))}: {name} is an FMU alone; name it as SYSTEM.component"
        )
    return read_interface(path)


def _with(found: Shown, word: str) -> Shown:
    wanted = word.casefold()
    rows = tuple(r for r in found.rows if wanted in f"{r.name}\n{r.text}".casefold())
    if not rows:
        close = did_you_mean(word, [row.name for row in found.rows])
        raise UsageError(f"{word}: nothing is called or described so{close}")
    return Shown(found.title, rows)  # type: ignore[arg-type]


# ---- systems


def _parts(system: System) -> Shown:
    interfaces = read_interfaces(system)
    rows = tuple(_as_part(c, interfaces[c.name], system) for c in system.components)
    return Shown(f"{system.name}: {system.description}".rstrip(": "), rows)


def _as_part(component: Component, interface: Interface, system: System) -> Part:
    step = system.experiment.step
    period = _value(SAMPLE_PERIOD, component.parameters, interface)
    return Part(
        component.name,
        interface.path.stem,
        None if step is None else component.every * step,
        float(period) if isinstance(period, int | float) else None,
        _description(interface),
    )


def _description(interface: Interface) -> str:
    return interface.model.description or ""


# ---- signals


def _part(system: System, name: str) -> Shown:
    known = [c.name for c in system.components]
    if name not in known:
        raise UsageError(f"{system.name} has no component {name}{did_you_mean(name, known)}")
    interface = read_interfaces(system)[name]
    title = f"{system.name}.{name} ({interface.path.name}): {_description(interface)}"
    given = system.component(name).parameters
    return Shown(title.rstrip(": "), tuple(_signals(interface, given, _wires(system, name))))


def _wires(system: System, name: str) -> dict[str, list[Port]]:
    """The ports at the other ends, by variable of the component."""
    wires: dict[str, list[Port]] = {}
    for source, target, _ in system.connections:
        if target.component == name:
            wires.setdefault(target.variable, []).append(source)
        if source.component == name:
            wires.setdefault(source.variable, []).append(target)
    return wires


def _signals(
    interface: Interface, given: Parameters, wires: Mapping[str, Sequence[Port]]
) -> Iterator[Signal]:
    for causality in GROUPS:
        for name, elements in _gathered(interface.named(causality)):
            yield _signal(name, elements, interface, given, wires)


def _gathered(variables: Mapping[str, Variable]) -> Iterator[tuple[str, list[str]]]:
    """Names of signals with their elements; a vector or matrix with gaps stays as scalars."""
    groups: dict[str, list[str]] = {}
    for name in variables:
        groups.setdefault(base(name) if index(name) else name, []).append(name)
    for name, elements in groups.items():
        if len(elements) == 1 or grid(map(index, elements)):
            yield name if len(elements) > 1 else elements[0], elements
        else:
            yield from ((element, [element]) for element in elements)


def _signal(
    name: str,
    elements: Sequence[str],
    interface: Interface,
    given: Parameters,
    wires: Mapping[str, Sequence[Port]],
) -> Signal:
    first = interface.variables[elements[0]]
    whole = grid(map(index, elements)) if name != elements[0] else None
    ends = {f"{p.component}.{p.signal}": None for e in elements for p in wires.get(e, ())}
    default = _nested(whole, {e: _value(e, {}, interface) for e in elements})
    value = _nested(whole, {e: _value(e, given, interface) for e in elements})
    return Signal(
        name,
        first.causality,
        first.type,
        whole.shape if whole else (),
        first.unit or "",
        default,
        None if ends or first.causality == "output" else value,
        first.low,
        first.high,
        first.description,
        tuple(ends),
    )


def _value(name: str, given: Parameters, interface: Interface) -> Scalar | None:
    """What a variable is given, or else its start value."""
    variable = interface.variables.get(name)
    if variable is None:
        return None
    return final(given[name], variable, interface) if name in given else variable.begin


def _nested(whole: Grid | None, values: Mapping[str, Scalar | None]) -> Nested:
    """Values by element as a scalar, list or list of lists; None if there is none at all."""
    if all(value is None for value in values.values()):
        return None
    if whole is None:
        return next(iter(values.values()))
    table = np.empty(whole.shape, dtype=object)
    for name, value in values.items():
        table[whole.place(index(name))] = value
    rows: Nested = table.tolist()
    return rows


# ---- plans

Planner = Callable[..., Plan]


def plan(system: str | Path | System, **changes: Unpack[Changes]) -> Plan:
    """The plan of a system by its mission; changes: those of run().

    Raises UsageError if its mission plans nothing, else what run() raises.
    """
    with load(system) as found:
        own = mission(found.mission) if found.mission else everything()
        planners = own.plans if own else ()
        if not planners:
            raise UsageError(f"{found.name}: its mission plans nothing")
        return _first(planners, found, **changes)


def _first(planners: tuple[Planner, ...], system: System, **changes: Unpack[Changes]) -> Plan:
    """The plan of the first planner that the system is for: of a system without a mission every
    one is asked.
    """
    *others, last = planners
    for planner in others:
        with suppress(UsageError):
            return planner(system, **changes)
    return last(system, **changes)
