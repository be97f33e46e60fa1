# SPDX-License-Identifier: BSD-2-Clause
"""Linear model of one FMU about an operating point, by central differences over one step of the FMU
itself.

    x(t+h) = A x(t) + B u(t),   y(t+h) = C x(t+h) + D u(t)       deviations from the operating
    point, u held

The states of an FMU are those of its outputs whose start value is a parameter: `x` starts at
`x_0`, a position at the parameter that a mission names. Outputs that do not follow that parameter
(the angle of a panel that does not exist) are none. The FMU is restarted at the operating point
with them moved, so nothing but FMI is needed.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from harness.errors import RefusalError, RunError, UsageError
from harness.files.temporary import PrivateFolder
from harness.master import messages
from harness.master.calls import OK, WARNING
from harness.master.fmu import loaded
from harness.master.refusals import as_typed, refusals
from harness.mission.library import everything
from harness.system.interface import Interface, read_interface
from harness.system.values import Variable, assign, base, coerce, index, parse

Array = NDArray[np.float64]
RELATIVE_STATE, RELATIVE_INPUT = 1e-4, 1e-2
"""Distances of the differences, relative to the size of the vector that is moved, at least of 1."""


@dataclass(frozen=True)
class LinearModel:
    """A (n, n), B (n, m), C (p, n), D (p, m) at time t [s] for the step h [s], with names, units,
    operating point.
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
    """Linear model of an FMU after running alone for `at` seconds.

    at: operating point [s], a multiple of step; step: h [s]; values: parameters and held inputs by
    name, as texts or numbers, vectors as lists. Raises UsageError for unknown names, refused values
    or a time that is no multiple of the step, FmuError, RunError.
    """
    if not _is_multiple(at, step):
        raise UsageError(
            f"the operating point {at:g} s must be a multiple of the step {step:g} s, which must "
            "be positive"
        )
    interface = read_interface(fmu)
    try:
        with _Bench(interface, _settings(interface, values or {})) as bench:
            return _Differences(bench, at, step).model()
    except RefusalError as error:
        raise as_typed(error, values or {}, "") from error


def _is_multiple(at: float, step: float) -> bool:
    if not (step > 0 and at >= 0 and at / step < 2**53):  # NaN is none either
        return False
    return abs(at / step - round(at / step)) <= 1e-9 * max(1.0, at / step)


def _settings(interface: Interface, values: Mapping[str, Any]) -> dict[str, float]:
    settings: dict[str, float] = {}
    for name, value in values.items():
        try:
            read = parse(value) if isinstance(value, str) else value
            found = assign(name, read, interface.settable())
            settings |= {k: float(coerce(v, "Real")) for k, v in found.items()}
        except ValueError as error:
            raise UsageError(f"{name}: {error}") from error
    return settings


def start_parameters(interface: Interface) -> dict[str, str]:
    """Elements of outputs that are states, and the parameters that hold their start values; of two
    outputs with the same one (body and centre of mass) the first.
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


class _Bench:
    """The FMU on the bench: restarted as often as needed with other values."""

    def __init__(self, interface: Interface, settings: Mapping[str, float]) -> None:
        self.interface, self.name = interface, interface.model.modelName
        self.settings = dict(settings)
        self.states = start_parameters(interface)
        self.inputs = list(interface.named("input"))
        self.outputs = list(interface.outputs())

    def __enter__(self) -> Self:
        with ExitStack() as files:
            self._calls = loaded(
                self.name, self.interface, lambda: files.enter_context(PrivateFolder()), files
            )
            files.callback(self._calls.free)
            self._files = files.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._files.close()

    def run(self, values: Mapping[str, float], start: float, steps: int, h: float) -> Array:
        """Outputs after `steps` steps of h from `start` with these values beside the settings."""
        everything = {**self.settings, **values}
        self._do("Reset", start)
        for row in self._rows(everything):
            given = [everything.get(v.name, float(v.begin or 0)) for v in row]
            self._check(self._calls.put(row, given), f"Set{row[0].access}", start)
        for function, arguments in self._calls.initialization(start, None):
            self._do(function, start, *arguments)
        self._do("ExitInitializationMode", start)
        for k in range(steps):
            messages.note_call(self.name, f"{self._calls.prefix}DoStep")
            self._check(self._calls.step(start + k * h, h, 1), "DoStep", start + k * h)
        return self._finite(self._read(start + steps * h), start + steps * h)

    def _rows(self, names: Collection[str]) -> list[tuple[Variable, ...]]:
        """What goes in one call: all variables of a type, in FMI 3.0 all elements of an array."""
        variables = [self.interface.variables[name] for name in names]
        if self.interface.fmi == 3:
            found = {(v.access, v.reference): self.interface.row(v) for v in variables}
            return list(found.values())
        kinds = dict.fromkeys(v.access for v in variables)
        return [tuple(v for v in variables if v.access == kind) for kind in kinds]

    def _read(self, time: float) -> Array:
        """All outputs."""
        found: dict[str, float] = {}
        for row in self._rows(self.outputs):
            status, values = self._calls.get(row)
            self._check(status, f"Get{row[0].access}", time)
            found |= dict(zip((v.name for v in row), values, strict=True))
        return np.array([found[name] for name in self.outputs])

    def _do(self, function: str, time: float, *arguments: Any) -> None:
        self._check(self._calls.call(function, *arguments), function, time)

    def _check(self, status: int, function: str, time: float) -> None:
        if status in (OK, WARNING):
            return
        said = f"{self._calls.prefix}{function} failed with status {status}"
        reason = messages.take_error(self.name) or said
        if refused := refusals(reason, self.interface.settable()):
            raise RefusalError(self.name, time, refused)
        raise RunError(self.name, time, reason)

    def _finite(self, outputs: Array, time: float) -> Array:
        for name, value in zip(self.outputs, outputs, strict=True):
            if not np.isfinite(value):
                raise RunError(self.name, time, "output is not a finite number", name)
        return outputs

    def start_value(self, name: str) -> float:
        """Value of a parameter or input as set, else its start value."""
        declared = self.interface.variables[name].start
        return self.settings.get(name, 0.0 if declared is None else declared)

    def lowest(self, name: str) -> float:
        """Declared lower bound of a variable."""
        declared = self.interface.variables[name].low
        return -np.inf if declared is None else declared


class _Differences:
    """Columns of the matrices about one operating point."""

    def __init__(self, bench: _Bench, at: float, h: float) -> None:
        self.bench, self.at, self.h = bench, at, h
        outputs = dict(zip(bench.outputs, bench.run({}, 0.0, round(at / h), h), strict=True))
        self.state = {name: outputs[name] for name in bench.states}
        self.inputs = {name: bench.start_value(name) for name in bench.inputs}
        self.outputs = outputs
        self._check_restart()
        self.state = {name: value for name, value in self.state.items() if self._follows(name)}

    def _restart(self, state: Mapping[str, float]) -> dict[str, float]:
        values = {self.bench.states[name]: value for name, value in state.items()}
        return values | {p: x for state, p, x in everything().restarts if state in values}

    def _check_restart(self) -> None:
        again = self.bench.run(self._restart(self.state), self.at, 0, self.h)
        for name, value in zip(self.bench.outputs, again, strict=True):
            if name in self.state and abs(value - self.state[name]) > 1e-9 * max(1.0, abs(value)):
                raise RunError(self.bench.name, self.at, "it cannot be restarted here", name)

    def _follows(self, name: str) -> bool:
        """Whether the output starts elsewhere when its start parameter is moved."""
        value, start = self.state[name], self.bench.states[name]
        moved = value + RELATIVE_STATE * max(1.0, _size(name, self.state))
        found = self.bench.run({**self._restart(self.state), start: moved}, self.at, 0, self.h)
        return bool(found[self.bench.outputs.index(name)] != value)

    def _matrix(self, values: Mapping[str, float], relative: float, moves_state: bool) -> Array:
        """Derivatives of the outputs after one step by each value, a column each: differences at d
        and d/2, extrapolated.
        """
        columns = np.zeros((len(self.bench.outputs), len(values)))
        for k, (name, value) in enumerate(values.items()):
            distance = relative * max(1.0, _size(name, values))
            coarse, fine = (
                self._slope(name, value, d, moves_state) for d in (distance, distance / 2)
            )
            with np.errstate(over="ignore", invalid="ignore"):
                columns[:, k] = (4 * fine - coarse) / 3
            if not np.isfinite(columns[:, k]).all():
                reason = f"the differences by {name} overflow: no linear model"
                raise RunError(self.bench.name, self.at, reason)
        return columns

    @np.errstate(over="ignore", invalid="ignore")
    def _slope(self, name: str, value: float, distance: float, moves_state: bool) -> Array:
        """Central difference; at a lower bound of the variable the one-sided one, also of second
        order.
        """

        def after(moved: float) -> Array:
            state = {**self.state, name: moved} if moves_state else self.state
            inputs = self.inputs if moves_state else {**self.inputs, name: moved}
            return self.bench.run({**self._restart(state), **inputs}, self.at, 1, self.h)

        if value - distance >= self.bench.lowest(name):
            return np.asarray((after(value + distance) - after(value - distance)) / (2 * distance))
        near, far = after(value + distance), after(value + 2 * distance)
        return np.asarray((4 * near - far - 3 * after(value)) / (2 * distance))

    def model(self) -> LinearModel:
        """All matrices; y(t+h) is split into C x(t+h) + D u."""
        bench = self.bench
        by_state = self._matrix(self.state, RELATIVE_STATE, True)
        by_input = self._matrix(self.inputs, RELATIVE_INPUT, False)
        rows = [bench.outputs.index(name) for name in self.state]
        a, b = by_state[rows], by_input[rows]
        try:
            c: Array = np.asarray(np.linalg.solve(a.T, by_state.T).T) if rows else by_state
        except np.linalg.LinAlgError as error:
            reason = "its states after a step do not depend on those before: no linear model"
            raise RunError(bench.name, self.at, reason) from error
        units = {v.name: v.unit or "" for v in bench.interface.variables.values()}
        names = tuple(self.state), tuple(self.inputs), tuple(bench.outputs)
        point = {**self.inputs, **self.outputs}
        return LinearModel(a, b, c, by_input - c @ b, self.at, self.h, *names, units, point)


def _size(name: str, values: Mapping[str, float]) -> float:
    """Length of the vector that a scalar belongs to."""
    parts = [v for n, v in values.items() if base(n) == base(name) and index(n)]
    return math.hypot(*(parts or [values[name]]))
