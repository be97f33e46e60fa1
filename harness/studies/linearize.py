# SPDX-License-Identifier: BSD-2-Clause
"""Linear model of one FMU about an operating point, by central differences over one step of the FMU
itself.

    x(t+h) = A x(t) + B u(t),   y(t+h) = C x(t+h) + D u(t)       deviations from the operating
    point, u held

The states of an FMU are the outputs whose start value is a parameter: `x` starts at `x_0`, a
position at the parameter that a mission names. Outputs that do not follow that parameter (the angle
of a panel that does not exist) are not states. The FMU is restarted at the operating point with its
states moved, so nothing but FMI is needed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import RunError, UsageError
from harness.master import messages
from harness.master.simulation import Simulation
from harness.mission.library import everything
from harness.results.result import Array
from harness.system.interface import Interface
from harness.system.model import Component, Experiment, Parameter, System
from harness.system.values import base, index

RELATIVE_STATE, RELATIVE_INPUT = 1e-4, 1e-2
"""Distances of the differences, relative to the length of the moved vector, but at least to 1."""


@dataclass(frozen=True)
class LinearModel:
    """Matrices A (n, n), B (n, m), C (p, n), D (p, m) at time t [s] for the step h [s], with names,
    units and operating point.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    t: float
    h: float
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: Mapping[str, str]
    point: Mapping[str, float]

    def save(self, path: Path) -> None:
        """Write an .npz: matrices, t, h, and for x, u, y the arrays NAME_names, NAME_units,
        NAME_0.
        """
        arrays: dict[str, Any] = {name: getattr(self, name) for name in "ABCDth"}
        for key, names in (("x", self.states), ("u", self.inputs), ("y", self.outputs)):
            arrays[f"{key}_names"] = np.array(names, dtype=str)
            arrays[f"{key}_units"] = np.array([self.units[n] for n in names], dtype=str)
            arrays[f"{key}_0"] = np.array([self.point[n] for n in names])
        with path.open("wb") as file:  # savez would append .npz to another name
            np.savez(file, **arrays)


def linearize(
    fmu: Path, at: float = 0.0, step: float = 0.1, values: Mapping[str, Any] | None = None
) -> LinearModel:
    """Return the linear model of an FMU after running alone for `at` seconds.

    at: operating point [s], a multiple of step; step: h [s]; values: parameters and held inputs by
    name, as texts or numbers, vectors as lists. Raises UsageError for unknown names, rejected
    values or a time that is not a multiple of the step, FmuError, RunError.
    """
    steps = at / step if step > 0 else math.nan
    if not 0 <= steps < 2**53 or abs(steps - round(steps)) > 1e-9 * max(1.0, steps):
        raise UsageError(
            f"--at {at:g}: expected a multiple of the step of {step:g} s, 0 or more; the step "
            "must be above 0"
        )
    name = re.sub(r"\W", "_", fmu.stem)
    alone = System(name, (Component(name, fmu),), (), Experiment(0.0, at + step, step))
    given = {f"{name}.{variable}": value for variable, value in (values or {}).items()}
    try:
        with Simulation(alone, set=given) as simulation:
            return _Differences(simulation, at, step).model(round(steps))
    except UsageError as error:  # the text of the user has no component
        raise UsageError(str(error).replace(f"--set {name}.", "--set ")) from error


def start_parameters(interface: Interface) -> dict[str, str]:
    """Return the elements of outputs that are states with the parameters of their start values; of
    two outputs with the same parameter (body and centre of mass) the first.
    """
    found: dict[str, str] = {}
    for name in interface.outputs():
        vector = base(name)
        suffix = name[len(vector) :]
        kind, _, rest = vector.partition("_")
        position = kind in ("r", "v") and rest.endswith("N_N")
        start = (f"{kind}_0_N" if position else f"{vector}_0") + suffix
        if start in interface.settable() and start not in found.values():
            found[name] = start
    return found


class _Differences:
    """Columns of the matrices of the FMU in a simulation about one operating point."""

    def __init__(self, simulation: Simulation, at: float, h: float) -> None:
        self.simulation, self.at, self.h = simulation, at, h
        (self.component,) = simulation.system.components
        self.interface = simulation.graph.nodes[0].interface
        self.names = list(self.interface.outputs())
        slots = [slot.name for slot in simulation.graph.slots]
        self.places = [slots.index(f"{self.component.name}.{name}") for name in self.names]
        self.starts = start_parameters(self.interface)
        self.state: dict[str, float] = {}
        self.inputs = {n: self._begin(n) for n in self.interface.named("input")}

    def _begin(self, name: str) -> float:
        """Return the value of an input as set, else its start value."""
        if name in self.component.parameters:
            return float(self.component.parameters[name].value)
        return self.interface.variables[name].start or 0.0

    def _run(self, values: Mapping[str, float], start: float, steps: int) -> Array:
        """Return the outputs after a number of steps from `start` with these values beside the
        settings.
        """
        parameters = {**self.component.parameters, **{n: Parameter(v) for n, v in values.items()}}
        stop = start + max(steps, 1) * self.h
        system = replace(
            self.simulation.system,
            components=(replace(self.component, parameters=parameters),),
            experiment=Experiment(start, stop, self.h),
        )
        self.simulation.begin(system, every=max(steps, 1))
        self.simulation.advance(0)
        doing = f"fmi{self.interface.fmi}DoStep, or the reading after it,"
        messages.note_call(self.component.name, doing)
        self.simulation.advance(steps)
        return self.simulation.bus[self.places]

    def _restart(self, state: Mapping[str, float]) -> dict[str, float]:
        values = {self.starts[name]: value for name, value in state.items()}
        return values | {p: x for state, p, x in everything().restarts if state in values}

    def _follows(self, name: str, state: Mapping[str, float]) -> bool:
        """Return whether the start of the output changes when its start parameter is moved."""
        moved = state[name] + RELATIVE_STATE * max(1.0, _size(name, state))
        found = self._run({**self._restart(state), self.starts[name]: moved}, self.at, 0)
        return bool(found[self.names.index(name)] != state[name])

    def _matrix(self, values: Mapping[str, float], relative: float, moves_state: bool) -> Array:
        """Return the derivatives of the outputs after one step by each value, a column each:
        differences at d and d/2, extrapolated.
        """
        columns = np.zeros((len(self.names), len(values)))
        for k, (name, value) in enumerate(values.items()):
            distance = relative * max(1.0, _size(name, values))
            coarse, fine = (
                self._slope(name, value, d, moves_state) for d in (distance, distance / 2)
            )
            with np.errstate(over="ignore", invalid="ignore"):
                columns[:, k] = (4 * fine - coarse) / 3
            if not np.isfinite(columns[:, k]).all():
                raise self._no_model(f"the differences by {name} overflow")
        return columns

    @np.errstate(over="ignore", invalid="ignore")
    def _slope(self, name: str, value: float, distance: float, moves_state: bool) -> Array:
        """Return the central difference; at a lower bound of the variable the one-sided difference
        of second order.
        """

        def after(moved: float) -> Array:
            state = {**self.state, name: moved} if moves_state else self.state
            inputs = self.inputs if moves_state else {**self.inputs, name: moved}
            return self._run({**self._restart(state), **inputs}, self.at, 1)

        low = self.interface.variables[name].low
        if low is None or value - distance >= low:
            return np.asarray((after(value + distance) - after(value - distance)) / (2 * distance))
        near, far = after(value + distance), after(value + 2 * distance)
        return np.asarray((4 * near - far - 3 * after(value)) / (2 * distance))

    def _no_model(self, reason: str) -> RunError:
        return RunError(self.component.name, self.at, f"{reason}: no linear model")

    def model(self, steps: int) -> LinearModel:
        """Return all matrices after `steps` steps; y(t+h) is split into C x(t+h) + D u."""
        outputs = dict(zip(self.names, self._run({}, 0.0, steps).tolist(), strict=True))
        state = {name: outputs[name] for name in self.starts}
        again = dict(zip(self.names, self._run(self._restart(state), self.at, 0), strict=True))
        for name, value in state.items():
            if abs(again[name] - value) > 1e-9 * max(1.0, abs(again[name])):
                raise RunError(
                    self.component.name,
                    self.at,
                    "a restart from the state of the FMU gives another state: no linear model",
                    name,
                )
        self.state = {name: value for name, value in state.items() if self._follows(name, state)}
        by_state = self._matrix(self.state, RELATIVE_STATE, True)
        by_input = self._matrix(self.inputs, RELATIVE_INPUT, False)
        rows = [self.names.index(name) for name in self.state]
        a, b = by_state[rows], by_input[rows]
        try:
            c: Array = np.asarray(np.linalg.solve(a.T, by_state.T).T) if rows else by_state
        except np.linalg.LinAlgError as error:
            raise self._no_model(
                "the matrix A is singular: states after a step do not depend on the states before"
            ) from error
        units = {v.name: v.unit or "" for v in self.interface.variables.values()}
        names = tuple(self.state), tuple(self.inputs), tuple(self.names)
        point = {**self.inputs, **outputs}
        return LinearModel(a, b, c, by_input - c @ b, self.at, self.h, *names, units, point)


def _size(name: str, values: Mapping[str, float]) -> float:
    """Return the length of the vector that a scalar belongs to."""
    parts = [v for n, v in values.items() if base(n) == base(name) and index(n)]
    return math.hypot(*(parts or [values[name]]))
