# SPDX-License-Identifier: BSD-2-Clause
"""Contents of a system: its components, and the inputs, outputs and parameters of a component or
FMU. Also the plan that the mission computes for a system, and the least impulse of a run.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeAlias, Unpack

import numpy as np

from harness.errors import UsageError
from harness.files import paths
from harness.master.changes import Changes, apply
from harness.master.remainder import rest
from harness.mission import LeastImpulse, Plan
from harness.mission.library import everything, mission
from harness.spelling import did_you_mean
from harness.ssp.library import load, of_component
from harness.system.conversion import final
from harness.system.graph import SAMPLE_PERIOD, read_interfaces
from harness.system.interface import Interface, read_interface
from harness.system.model import Parameters, Port, System
from harness.system.values import Grid, Index, Scalar, base, grid, index

Nested: TypeAlias = "Scalar | list[Nested] | None"
"""Value of a scalar, vector (list) or matrix (list of rows); None for a missing value."""

GROUPS = ("input", "output", "parameter")
"""Causalities of the variables that are shown, in this order."""


class Signal(NamedTuple):
    """Variable of an FMU: a scalar, or a vector or matrix with all its elements.

    shape: () for a scalar; default: start value in the FMU; value: value in the system (None: the
    FMU is in no system, or the variable is connected or an output); low, high: limits that the FMU
    declares (None: none); text: description; wires: connected outputs of an input, or connected
    inputs of an output, as `component.variable`.
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
    """Component of a system; step: communication step [s], None if the user must give it;
    sample_period: sample period of its flight software [s], None if the FMU has none; text:
    description of the FMU.
    """

    name: str
    fmu: str
    step: float | None
    sample_period: float | None
    text: str


class Difference(NamedTuple):
    """Parameter or open input, named `component.name`, whose value differs between two systems.

    before, after: its values in the two systems, None where the component has no such variable or
    the input is connected; text: description.
    """

    name: str
    unit: str
    before: Nested
    after: Nested
    text: str


@dataclass(frozen=True)
class Shown:
    """Contents to show. title: one line; rows: the components of a system, the variables of an FMU
    or component, or the differences between two systems.
    """

    title: str
    rows: tuple[Part, ...] | tuple[Signal, ...] | tuple[Difference, ...]


def show(name: str | Path, word: str | None = None, **changes: Unpack[Changes]) -> Shown:
    """Return the components of a system, or the signals of one component or of an FMU.

    name: `SYSTEM`, `SYSTEM.component` or an FMU, each by name or path; word: return only rows with
    this word in name or description; changes: applied to the system first, as for run(). Raises
    UsageError, and the errors of load() and apply().
    """
    if (place := of_component(name)) is None:
        found = _of_fmu(name, changes)
    else:
        with load(place[0]) as system:
            changed = rest(apply(system, **changes))
            found = _of_component(changed, place[1]) if place[1] else _of_system(changed)
    return found if word is None else _with_word(found, word)


def differences(
    name: str | Path, word: str | None = None, *, before: Changes, after: Changes
) -> Shown:
    """Return the values that differ between two variants of a system, or of one of its components.

    name: `SYSTEM` or `SYSTEM.component`; word: as for show(); before, after: changes by which the
    two variants are made from the system, as for run() (empty: the system itself). Raises the
    errors of show().
    """
    if (place := of_component(name)) is None:
        raise UsageError(f"{name or '(nothing)'}: expected SYSTEM or SYSTEM.component")
    path, component = place
    with load(path) as system:
        first, second = (rest(apply(system, **changes)) for changes in (before, after))
        known = (c.name for each in (first, second) for c in each.components)
        chosen = [component] if component else dict.fromkeys(known)
        rows = tuple(row for each in chosen for row in _different(first, second, each))
    found = Shown(f"{name}: {'values that differ' if rows else 'no value differs'}", rows)
    return found if word is None else _with_word(found, word)


def _different(before: System, after: System, component: str) -> Iterator[Difference]:
    """Yield the variables of a component whose values differ between two systems."""
    signals = [
        {s.name: s for s in _of_component(each, component).rows if isinstance(s, Signal)}
        for each in (before, after)
    ]
    for name, signal in (signals[1] | signals[0]).items():
        old, new = (s.value if (s := each.get(name)) else None for each in signals)
        if old != new:
            yield Difference(f"{component}.{name}", signal.unit, old, new, signal.text)


def _with_word(found: Shown, word: str) -> Shown:
    """Return only the rows that have the word in their name or description; raise UsageError if
    there are none.
    """
    rows = tuple(r for r in found.rows if word.casefold() in f"{r.name}\n{r.text}".casefold())
    if not rows:
        close = did_you_mean(word, [row.name for row in found.rows])
        raise UsageError(f"{word}: no name or description contains this word{close}")
    return Shown(found.title, rows)  # type: ignore[arg-type]


def _of_fmu(name: str | Path, changes: Changes) -> Shown:
    known = paths.fmus()
    path = known.get(str(name), Path(name))
    if not paths.is_file(path):
        close = did_you_mean(str(name), [*paths.systems(), *known])
        raise UsageError(
            f"{name or '(nothing)'}: there is no such system or FMU{close}; "
            "a component is named SYSTEM.component"
        )
    if changes:
        raise UsageError(f"--{next(iter(changes))}: is valid only for a system, not the FMU {name}")
    interface = read_interface(path)
    rows = (s._replace(value=None) for s in _signals(interface, {}, {}))
    return Shown(_title(interface.path.name, interface.model.description), tuple(rows))


def _of_system(system: System) -> Shown:
    interfaces, step = read_interfaces(system), system.experiment.step
    rows = []
    for c in system.components:
        interface = interfaces[c.name]
        period = _value(SAMPLE_PERIOD, c.parameters, interface)
        sample = float(period) if isinstance(period, int | float) else None
        every = None if step is None else c.every * step
        text = interface.model.description or ""
        rows.append(Part(c.name, interface.path.stem, every, sample, text))
    return Shown(_title(system.name, system.description), tuple(rows))


def _of_component(system: System, name: str) -> Shown:
    known = [c.name for c in system.components]
    if name not in known:
        raise UsageError(f"{system.name} has no component {name}{did_you_mean(name, known)}")
    interface = read_interfaces(system)[name]
    ends: dict[str, list[Port]] = {}
    for source, target, _ in system.connections:
        if target.component == name:
            ends.setdefault(target.variable, []).append(source)
        if source.component == name:
            ends.setdefault(source.variable, []).append(target)
    given = system.component(name).parameters
    title = _title(f"{system.name}.{name} ({interface.path.name})", interface.model.description)
    return Shown(title, tuple(_signals(interface, given, ends)))


def _title(name: str, description: str | None) -> str:
    return f"{name}: {description or ''}".rstrip(": ")


# ---- signals


def _signals(
    interface: Interface, given: Parameters, ends: Mapping[str, Sequence[Port]]
) -> Iterator[Signal]:
    """Yield the variables of an FMU, all elements of a vector or matrix as one Signal. If elements
    of a vector or matrix are missing, each existing element is a Signal.

    given: values of the component in its system; ends: by variable, the variables of other
    components to which it is connected.
    """
    for causality in GROUPS:
        groups: dict[str, list[str]] = {}
        for name in interface.named(causality):
            groups.setdefault(base(name) if index(name) else name, []).append(name)
        for name, elements in groups.items():
            whole = grid(map(index, elements)) if len(elements) > 1 else None
            if whole is not None:
                yield _signal(name, elements, whole, interface, given, ends)
            else:
                yield from (_signal(e, [e], None, interface, given, ends) for e in elements)


def _signal(  # noqa: PLR0913, PLR0917 - all data that a signal contains
    name: str,
    elements: Sequence[str],
    whole: Grid | None,
    interface: Interface,
    given: Parameters,
    ends: Mapping[str, Sequence[Port]],
) -> Signal:
    first = interface.variables[elements[0]]
    wires = {f"{p.component}.{p.signal}": None for e in elements for p in ends.get(e, ())}
    default, value = (
        _nested(whole, {e: _value(e, values, interface) for e in elements})
        for values in ({}, given)
    )
    given_here = None if wires or first.causality == "output" else value
    shape, unit = whole.shape if whole else (), first.unit or ""
    about = (name, first.causality, first.type, shape, unit, default, given_here, first.low)
    return Signal(*about, first.high, first.description, tuple(wires))


def _value(name: str, given: Parameters, interface: Interface) -> Scalar | None:
    """Return the value of a variable in its system, otherwise its start value in the FMU; None if
    the FMU has no such variable or start value.
    """
    variable = interface.variables.get(name)
    if variable is None:
        return None
    return final(given[name], variable, interface) if name in given else variable.begin


def _nested(whole: Grid | None, values: Mapping[str, Scalar | None]) -> Nested:
    """Return a scalar, a list (vector) or a list of rows (matrix) with the values of the elements;
    None if no element has a value.

    whole: shape of the vector or matrix (None: a scalar); values: by name of the element.
    """
    if whole is None or all(value is None for value in values.values()):
        return next(iter(values.values()))
    table = np.empty(whole.shape, dtype=object)
    for name, value in values.items():
        table[whole.place(index(name))] = value
    rows: Nested = table.tolist()
    return rows


# ---- plans


def plan(system: str | Path | System, **changes: Unpack[Changes]) -> Plan:
    """Return the plan that the mission of a system computes for it, e.g. its impulses and times.

    changes: as for run(). Raises UsageError if the mission has no plan, and the errors of run().
    """
    with load(system) as found:
        own = mission(found.mission) if found.mission else everything()  # else: all missions
        planners = own.plans if own else ()
        if not planners:
            raise UsageError(f"{found.name}: its mission has no plan")
        for planner in planners[:-1]:  # ignore their errors, raise an error of the last
            with suppress(UsageError):
                return planner(found, **changes)
        return planners[-1](found, **changes)


COSTS = ("sum", "norm")
"""Costs of a force: the sum of its absolute components, or its Euclidean norm."""


def bound(
    system: str | Path,
    *,
    cost: str = "sum",
    grid: float | None = None,
    without: Collection[str] = (),
    **changes: Unpack[Changes],
) -> LeastImpulse:
    """Return the least impulse that a run of a system needs, as its mission computes it.

    cost: one of COSTS; grid: time step of the optimisation problem [s] (None: as the mission
    defines); without: names of constraints to leave out; changes: as for run(). Raises UsageError
    if the mission defines no problem for the system, the errors of run(), and HarnessError if there
    is no optimum.
    """
    if cost not in COSTS:
        raise UsageError(f"--cost {cost}: expected {' or '.join(COSTS)}")
    with load(system) as found:
        changed = apply(found, **changes)
        own = mission(changed.mission) if changed.mission else None
        for answer in own.bounds if own else ():
            if (least := answer(changed, cost, grid, without)) is not None:
                return least
    raise UsageError(f"{changed.name}: its mission defines no convex problem for this system")
