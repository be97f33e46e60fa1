# SPDX-License-Identifier: BSD-2-Clause
"""Linear model of one FMU about an operating point, by central differences over one FMU step.

    x(t+h) = A x(t) + B u(t),   y(t+h) = C x(t+h) + D u(t)

x, u, y: deviations of states, inputs and outputs from the operating point; u is constant over a
step. The states of an FMU are the outputs whose start value is a parameter: output `x` starts at
parameter `x_0`, position `r_BN_N` or velocity `v_BN_N` at `r_0_N` or `v_0_N`. An output that does
not change with its start parameter (such as the angle of a panel that does not exist) is not a
state. For each difference the FMU is restarted at the operating point with one state or input
moved, so only standard FMI calls are needed.
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
"""Distances by which states and inputs are moved, relative to the length of the vector that the
moved element belongs to, or relative to 1 if this length is below 1.
"""


@dataclass(frozen=True)
class LinearModel:
    """Linear model with n states, m inputs and p outputs: matrices A (n, n), B (n, m), C (p, n) and
    D (p, m) at time t [s] for the step h [s].

    states, inputs, outputs: names; units, point: unit and value at the operating point, by name.
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
        """Write the model as .npz: arrays A, B, C, D, t and h, and for states x, inputs u and
        outputs y their names (`x_names`), units (`x_units`) and operating point (`x_0`).
        """
        arrays: dict[str, Any] = {name: getattr(self, name) for name in "ABCDth"}
        for key, names in (("x", self.states), ("u", self.inputs), ("y", self.outputs)):
            arrays[f"{key}_names"] = np.array(names, dtype=str)
            arrays[f"{key}_units"] = np.array([self.units[n] for n in names], dtype=str)
            arrays[f"{key}_0"] = np.array([self.point[n] for n in names])
        with path.open("wb") as file:  # given a path, savez would append .npz
            np.savez(file, **arrays)


def linearize(
    fmu: Path, at: float = 0.0, step: float = 0.1, values: Mapping[str, Any] | None = None
) -> LinearModel:
    """Return the linear model of an FMU at the state that it reaches after running alone for `at`
    seconds.

    at: time of the operating point [s], a multiple of step; step: step of the model, h [s]; values:
    parameters and constant inputs by name, as texts or numbers, vectors as lists. Raises UsageError
    for unknown names, rejected values or a time that is not a multiple of the step, FmuError if the
    FMU cannot be read or loaded, and RunError if it fails in initialization or in a step, or if
    there is no linear model.
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
    except UsageError as error:  # show names without the component, as the user typed them
        raise UsageError(str(error).replace(f"--set {name}.", "--set ")) from error


def start_parameters(interface: Interface) -> dict[str, str]:
    """Return the names of the scalar outputs that may be states, each with the name of the
    parameter that sets its start value. If two outputs have the same start parameter, as the
    positions of a body and of its centre of mass, only the first output is returned.
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
    """Computation of a linear model about one operating point, by repeated runs of a simulation
    that contains only the FMU.
    """

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
        """Return the value of an input: the value that the user has set, otherwise the start value
        in the FMU.
        """
        if name in self.component.parameters:
            return float(self.component.parameters[name].value)
        return self.interface.variables[name].start or 0.0

    def _run(self, values: Mapping[str, float], start: float, steps: int) -> Array:
        """Return the values of all outputs after `steps` steps from the time `start` [s]; values:
        further values of parameters and inputs, besides those that the user has set.
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
        """Return whether the initial value of the output `name` changes with its start parameter,
        which self.starts contains. state: values at the operating point of all outputs that may be
        states, by name.
        """
        moved = state[name] + RELATIVE_STATE * max(1.0, _size(name, state))
        found = self._run({**self._restart(state), self.starts[name]: moved}, self.at, 0)
        return bool(found[self.names.index(name)] != state[name])

    def _matrix(self, values: Mapping[str, float], relative: float, moves_state: bool) -> Array:
        """Return the derivatives (outputs, values) of all outputs after one step with respect to
        each state or input in `values`, by Richardson extrapolation of differences at the distances
        d and d/2.

        relative: d, relative to the length of the vector that the moved element belongs to, or to 1
        if the vector is shorter;
        moves_state: whether `values` are states, not inputs.
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
                raise self._no_model(f"derivatives with respect to {name} overflow")
        return columns

    @np.errstate(over="ignore", invalid="ignore")
    def _slope(self, name: str, value: float, distance: float, moves_state: bool) -> Array:
        """Return the derivatives of all outputs after one step with respect to one state or input.
        The difference is central, or one-sided of second order if the variable would fall below its
        lower limit.
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

    def _no_model(self, reason: str, variable: str | None = None) -> RunError:
        text = f"there is no linear model: {reason}"
        return RunError(self.component.name, self.at, text, variable)

    def model(self, steps: int) -> LinearModel:
        """Return the linear model at the operating point that the FMU reaches after `steps` steps.
        C and D of y(t+h) = C x(t+h) + D u(t) are computed from the derivatives of y(t+h) with
        respect to x(t) and u(t).
        """
        outputs = dict(zip(self.names, self._run({}, 0.0, steps).tolist(), strict=True))
        state = {name: outputs[name] for name in self.starts}
        again = dict(zip(self.names, self._run(self._restart(state), self.at, 0), strict=True))
        for name, value in state.items():
            if abs(again[name] - value) > 1e-9 * max(1.0, abs(again[name])):
                raise self._no_model("a restart gives this state another value", name)
        self.state = {name: value for name, value in state.items() if self._follows(name, state)}
        by_state = self._matrix(self.state, RELATIVE_STATE, True)
        by_input = self._matrix(self.inputs, RELATIVE_INPUT, False)
        rows = [self.names.index(name) for name in self.state]
        a, b = by_state[rows], by_input[rows]
        try:
            c: Array = np.asarray(np.linalg.solve(a.T, by_state.T).T) if rows else by_state
        except np.linalg.LinAlgError as error:
            raise self._no_model(
                "A is singular: some states after a step do not depend on the states before it"
            ) from error
        units = {v.name: v.unit or "" for v in self.interface.variables.values()}
        names = tuple(self.state), tuple(self.inputs), tuple(self.names)
        point = {**self.inputs, **outputs}
        return LinearModel(a, b, c, by_input - c @ b, self.at, self.h, *names, units, point)


def _size(name: str, values: Mapping[str, float]) -> float:
    """Return the length of the vector to which the scalar `name` belongs, or the absolute value of
    a scalar that belongs to no vector; values: values of all scalars by name.
    """
    parts = [v for n, v in values.items() if base(n) == base(name) and index(n)]
    return math.hypot(*(parts or [values[name]]))
