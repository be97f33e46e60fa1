# SPDX-License-Identifier: BSD-2-Clause
"""The page of a run that flies the system itself: report, module, sliders, and the operations by
which the page makes its arrays from the rows of another flight.

The report is written once over traced rows (harness.report.trace). What does not come out equal
when the operations are repeated over slightly other rows belongs to the run of the file alone, and
the page says so.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np

from harness.errors import UsageError
from harness.master.changes import Changes, apply
from harness.master.fused import Module, module_of
from harness.report import conditions, run
from harness.report.arrays import Arrays, Canvas, kept_rows
from harness.report.template import render, text_of
from harness.report.trace import Trace, traces_kept
from harness.results.result import Array, Result, Rows
from harness.ssp.library import load
from harness.system.graph import Checked, checked, read_interfaces
from harness.system.model import System
from harness.system.sliders import Slider, sliders

Data = dict[str, Any]

LIVE = ("flight.js", "judge.js", "course.js", "fly.js", "fly.css")
"""What a page that flies has beside what every page has."""
STEPS = 200
"""Steps of a slider, but for that of a switch."""
NOISE = 1e-9
"""Part by which rows are changed to see what the operations have lost."""


def of_run(result: Result) -> str:
    """The page of one run as text, with its system inside.

    Raises UsageError if the result does not say what was flown, HarnessError if the compiler is
    missing or the system cannot be one module.
    """
    known = result.provenance
    if known is None or not known.source:
        raise UsageError("the result does not name its system, which a live page needs")
    changes: Changes = known.changes()  # type: ignore[assignment]
    with load(known.source) as found:
        return _page(result, apply(found, **changes))


def _page(result: Result, system: System) -> str:
    steps = checked(system)
    module = module_of(system, steps)
    named = list(sliders(system.sliders, read_interfaces(system)))
    content = traced(result, [slider.name for slider in named])
    return render(
        "fly.html",
        content.canvas,
        content.data,
        **run.texts(result),
        sliders=[_slider(result, module, slider) for slider in named],
        flight=_flight(result, system, steps, module) | content.operations(),
        module=base64.b64encode(gzip.compress(module.code, 9, mtime=0)).decode(),
        live={name: text_of(name) for name in LIVE},
    )


# ---- what a flight is told


def _flight(result: Result, system: System, found: Checked, module: Module) -> Data:
    if missing := [name for name in result.columns if name not in module.outputs]:
        raise UsageError(f"the system has no {missing[0]} any more: run it again")
    known, span = result.provenance, system.experiment
    return {
        "start": span.start,
        "step": span.step,
        "steps": found.steps,
        "every": min(known.every if known else 1, found.steps + 1),
        "columns": [module.outputs[name] for name in result.columns],
        "settings": list(module.references),
        "values": module.values.tolist(),
        **_about(result),
    }


def _about(result: Result) -> Data:
    """The bits of its rows, the requirements, and the names of what they speak of."""
    known, table = result.provenance, result.parameters
    wanted = known.requirements if known else ()
    return {
        "sha256": hashlib.sha256(np.ascontiguousarray(result.values).tobytes()).hexdigest(),
        "names": _names(result),
        "parameters": {} if table is None else _names(table),
        "constants": [] if table is None else table.values[0].tolist(),
        "requirements": [conditions.requirement(result, *each) for each in wanted],
    }


def _names(table: Result) -> Data:
    """Shape and columns of every variable, and of every element."""
    found: Data = {name: [[], [i]] for i, name in enumerate(table.columns)}
    vectors = table.vectors.items()
    return found | {name: [list(c.shape), c.ravel().tolist()] for name, c in vectors}


def _slider(result: Result, module: Module, slider: Slider) -> Data:
    """A slider for the template, with its value in the run."""
    place = module.names.index(slider.name)
    value = float(module.values[place])
    table = result.parameters
    held = table is not None and slider.name in table.columns
    return {
        "name": slider.name,
        "text": slider.variable.description,
        "unit": "" if slider.variable.unit in (None, "1") else slider.variable.unit,
        "low": min(slider.low, value),
        "high": max(slider.high, value),
        "value": repr(value),
        "place": place,
        "constant": table.columns.index(slider.name) if table is not None and held else -1,
        "steps": 1 if (slider.variable.low, slider.variable.high) == (0, 1) else STEPS,
    }


# ---- arrays and curves that know how they were made


class TracedArrays(Arrays):
    """Arrays of which those that were traced have a name for every operation."""

    def __init__(self) -> None:
        super().__init__()
        self.made: dict[str, int] = {}
        """Operation by the name of an array."""
        self.order: list[tuple[str, Array]] = []
        """Names and numbers as they were asked for."""
        self._names_of: dict[int, str] = {}

    def keep(self, values: Any) -> str:
        """Name of an array; that of another one only if the same operation made it."""
        plain, place = np.array(values, dtype=np.float64), getattr(values, "place", -1)
        if place >= 0 and place not in self._names_of:
            self._names_of[place] = self.own(plain)
            self.made[self._names_of[place]] = place
        name = self._names_of[place] if place >= 0 else super().keep(plain)
        self.order.append((name, plain))
        return name

    def own(self, values: Array) -> str:
        """Name of an array that nobody else has."""
        return self._written(f"t{len(self.content)}", np.ascontiguousarray(values, dtype="<f4"))


class TracedCanvas(Canvas):
    """A canvas whose curves know their operations: the page thins them anew; chosen: the rows of
    curves in planes, those of another canvas if they are given.
    """

    def __init__(self, points: int, chosen: Sequence[Rows] = ()) -> None:
        self.traced = TracedArrays()
        super().__init__(self.traced, points)
        self.drawn: list[Data] = []
        self.chosen: list[Rows] = []
        self._given = iter(chosen)

    def curve(self, time: Array, values: Array, name: str, **look: Any) -> Data:
        """One history with its extremes."""
        arrays = self.traced
        rows = kept_rows(np.array(values, dtype=np.float64), self.points)
        self.thinned |= len(rows) < len(values)
        both = {"x": time, "y": values}
        plain = {key: np.array(each, dtype=np.float64) for key, each in both.items()}
        names = {key: arrays.own(each[rows]) for key, each in plain.items()}
        arrays.order += [(names[key], each) for key, each in plain.items()]
        places = {key: getattr(each, "place", -1) for key, each in both.items()}
        if min(places.values()) >= 0:
            self.drawn.append({"names": names, "places": places, "points": self.points})
        return {"name": name, **names, **look}

    def rows_of(self, x: Array, y: Array) -> Rows:
        """The rows of a curve in a plane that are drawn."""
        own = super().rows_of(np.array(x, dtype=float), np.array(y, dtype=float))
        self.chosen.append(next(self._given, own))
        return self.chosen[-1]


class Content(NamedTuple):
    """What a live page draws: canvas and data, the operations behind them, and the names of the
    arrays that these do not make.
    """

    canvas: TracedCanvas
    data: Data
    trace: Trace
    fixed: set[str]

    def operations(self) -> Data:
        """The operations that arrays and curves need, for the page; long lists of places once."""
        made, curves = self.canvas.traced.made, self.canvas.drawn
        asked = {*made.values(), *(p for c in curves for p in c["places"].values())}
        numbers, operations, lists = self.trace.written(asked)
        return {
            "operations": operations,
            "made": {name: numbers[place] for name, place in made.items()},
            "curves": [
                curve | {"places": {key: numbers[p] for key, p in curve["places"].items()}}
                for curve in curves
            ],
            "lists": lists,
            "fixed": sorted(self.fixed),
        }


def traced(result: Result, changing: list[str]) -> Content:
    """The content of the page over traced rows, and what was lost on the way among its arrays."""
    trace, canvas = Trace(), TracedCanvas(run.canvas_of(result, Arrays()).points)
    with traces_kept():
        roots = {name: trace.root(name, values) for name, values in _roots(result).items()}
        data = run.content(canvas, _over(result, roots))
    return Content(canvas, data, trace, set(_lost(result, changing, canvas, trace)))


def _roots(result: Result) -> dict[str, Array]:
    """What a flight brings."""
    table = result.parameters
    fixed = {} if table is None else {"parameters": table.values}
    return {"time": result.time, "values": result.values, **fixed}


def _over(result: Result, roots: dict[str, Array]) -> Result:
    """The result with other rows and parameters."""
    table = result.parameters
    fixed = None if table is None else replace(table, values=roots["parameters"])
    return replace(result, time=roots["time"], values=roots["values"], parameters=fixed)


def _lost(result: Result, changing: list[str], canvas: TracedCanvas, trace: Trace) -> Iterator[str]:
    """Names of arrays that the operations do not give over slightly other rows and parameters."""
    roots = _other(result, changing)
    other = TracedCanvas(canvas.points, canvas.chosen)
    run.content(other, _over(result, roots))
    value, places = trace.evaluate(roots), dict(canvas.traced.made)
    for curve in canvas.drawn:
        places |= {curve["names"][key]: place for key, place in curve["places"].items()}
    orders = canvas.traced.order, other.traced.order
    nothing = ("", np.empty(0))
    for (name, before), (_, wanted) in zip_longest(*orders, fillvalue=nothing):
        found = value(places[name]) if name in places else before
        if name and not np.array_equal(found, wanted, equal_nan=True):
            yield name


def _other(result: Result, changing: list[str]) -> dict[str, Array]:
    """Rows and parameters that differ from those of the result in the last digits: all that is no
    whole number throughout, and the parameters that sliders change.
    """
    noise = np.random.default_rng(1)
    which = {"values": (np.nan_to_num(result.values) % 1 != 0).any(axis=0)}
    if result.parameters is not None:
        which["parameters"] = np.isin(result.parameters.columns, changing)
    found = {name: np.array(values) for name, values in _roots(result).items()}
    for name, moving in which.items():  # what stands still does so
        factor = 1 + NOISE * noise.uniform(0.5, 1.0, found[name].shape[1])
        found[name] = np.where(moving, found[name] * factor, found[name])
    return found
