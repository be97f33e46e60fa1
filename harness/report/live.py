# SPDX-License-Identifier: BSD-2-Clause
"""Live page: a report that contains its system as a WebAssembly module, and sliders for parameters.
When a slider is moved, the page runs the system again in the browser, and computes requirements,
headline values, curves and the replay from the new rows by the instructions in the page.

There are no instructions for a curve or headline value that a Python function of a mission
computes, nor for a curve that is interrupted at jumps. After a slider has been moved, such a curve
or value still shows the run in the file, and a label states this.
"""

from __future__ import annotations

import base64
import gzip
import hashlib
import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import msgspec
import numpy as np

from harness.errors import StructureError, UsageError
from harness.master.changes import Changes, apply
from harness.master.fused import Module, module_of
from harness.master.isolated import guarded
from harness.master.remainder import rest
from harness.mission import Limits, Metric
from harness.report import run
from harness.report.arrays import Arrays, Canvas
from harness.report.template import render
from harness.results.evaluation import fitted, unit_in
from harness.results.margins import Requirement
from harness.results.program import Program
from harness.results.requirements import condition
from harness.results.result import Result
from harness.ssp.library import load
from harness.system.graph import Checked, checked, read_interfaces
from harness.system.model import System
from harness.system.sliders import Slider, sliders
from harness.system.tables import Number, Text, problems, read_toml

Data = dict[str, Any]

STEPS = 200
"""Number of steps of a slider. A parameter with the limits 0 and 1 is a switch and has one step."""


class Exercise(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Exercise of a lesson.

    solved: requirement that the run meets when the exercise is solved; settings: values of the
    sliders with which a run meets this requirement.
    """

    question: Text
    solved: Text
    hint: Text
    answer: Text
    settings: dict[str, Number]


class Lesson(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Lesson of a live page: title, text, equations and exercises beside the sliders.

    system, params: system and parameter set of the first run (params "": the parameter values of
    the system).
    """

    title: Text
    system: Text
    text: Text
    exercises: Annotated[list[Exercise], msgspec.Meta(min_length=1)]
    equations: list[Text] = []
    params: Text = ""


def read_lesson(path: Path) -> Lesson:
    """Return the lesson in a TOML file; raise UsageError if the file cannot be read, StructureError
    with all problems of its entries.
    """
    table = read_toml(path)
    given = table.get("exercises")
    exercises = given if isinstance(given, list) else []
    places = [(each, f"exercises {k}") for k, each in enumerate(exercises, 1)]
    inside = [problem for each, place in places for problem in problems(each, Exercise, place)]
    wrong = [p for p in problems(table, Lesson) if not (inside and p.startswith("exercises:"))]
    if wrong or inside:
        raise StructureError(f"{path.name}: {problem}" for problem in (*wrong, *inside))
    return msgspec.convert(table, Lesson)


def of_run(result: Result, lesson: Lesson | None = None) -> str:
    """Return the live page of one run, which contains its system, as HTML text.

    Raises UsageError if the result does not name its system or has a variable that is not an output
    of the system, HarnessError if the compiler is missing or the system cannot be compiled into one
    module.
    """
    known = result.provenance
    if known is None or not known.source:
        raise UsageError("the result does not name its system, which a live page needs")
    changes: Changes = known.changes()  # type: ignore[assignment]
    with load(known.source) as found:
        return _page(result, rest(apply(found, **changes)), lesson)


def _page(result: Result, system: System, lesson: Lesson | None = None) -> str:
    steps = checked(system)
    module: Module = guarded([c.fmu for c in system.components], module_of, system, steps)
    named = sliders(system.sliders, read_interfaces(system))
    canvas = run.canvas_of(result, Arrays())
    data = run.content(canvas, result)
    values = list(headline_values(result, canvas.arrays.program))
    return render(
        "live.html",
        canvas,
        data,
        live=True,
        **run.texts(result) | {"metrics": [each[:2] for each in values]},
        sliders=[_slider(result, module, slider) for slider in named],
        lesson=lesson,
        simulation=_simulation(result, system, steps, module)
        | programs(result, canvas, lesson)
        | {"metrics": [number for *_, number in values]},
        module=base64.b64encode(gzip.compress(module.code, 9, mtime=0)).decode(),
    )


def programs(result: Result, canvas: Canvas, lesson: Lesson | None = None) -> Data:
    """Return the instructions with which the page computes requirements, exercises, curves and
    arrays of the replay from the rows of another run.

    The entry `samples` describes each array of the replay that can be computed, by the number of an
    instruction, the reduction of the rows from an instant up to the next ("row": none; "mean",
    "least", "largest"), and an index in the entry `rows`. The element of `rows` with this index is
    the list of the rows at the instants of the array; arrays with equal lists share one element.
    """
    known, arrays, lists = result.provenance, canvas.arrays, dict[tuple[int, ...], int]()
    wanted = known.requirements if known else ()
    questions = [(each.question, each.solved) for each in lesson.exercises] if lesson else []
    samples = {}
    for name, (history, over, time) in arrays.samples.items():
        rows = tuple(np.searchsorted(result.time, time).tolist())
        samples[name] = [history, over, lists.setdefault(rows, len(lists))]
    return {
        "requirements": [requirement(result, arrays.program, *each) for each in wanted],
        "exercises": [requirement(result, arrays.program, *each) for each in questions],
        "samples": samples,
        "rows": list(lists),
        "program": arrays.program.data(),
        "points": canvas.points,
    }


def headline_values(result: Result, program: Program) -> Iterator[tuple[Metric, float, int | None]]:
    """Yield each metric with its value in the result and the number of the instruction that
    computes it from another run (None: only a Python function computes it). The value is NaN if the
    metric has no value in this result but may have one in another run.
    """
    for metric, value in run.metrics(result):
        if text := metric.expression(result, Limits()):
            yield metric, value, program.expression(fitted(result, text))
        elif math.isfinite(value):
            yield metric, value, None


def requirement(result: Result, program: Program, name: str, text: str) -> Data:
    """Return a requirement as data for the page; if the page cannot evaluate it, with the reason in
    the entry `rejected`.
    """
    about = {"name": name, "text": text}
    try:
        condition(text)
        required = Requirement(fitted(result, text), partial(unit_in, result), program)
    except (KeyError, ValueError) as error:
        return about | {"rejected": str(error.args[0])}
    return about | required.data()


# ---- data of the simulation


def _simulation(result: Result, system: System, found: Checked, module: Module) -> Data:
    """Return the data with which the page runs the system: time span, columns of the result,
    parameters.
    """
    if missing := [name for name in result.columns if name not in module.outputs]:
        raise UsageError(
            f"the result contains {missing[0]}, which is not an output of the system as it is now; "
            "run the system again"
        )
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
    """Return the checksum of all values, with which the page checks that its first run has the same
    bits; the columns of all variables and parameters; and the values of the parameters.
    """
    table = result.parameters
    return {
        "sha256": hashlib.sha256(np.ascontiguousarray(result.values).tobytes()).hexdigest(),
        "names": _names(result),
        "parameters": {} if table is None else _names(table),
        "constants": [] if table is None else table.values[0].tolist(),
    }


def _names(table: Result) -> Data:
    """Return the pair [shape, indices of its columns] of every variable and of every element, by
    name.
    """
    found: Data = {name: [[], [i]] for i, name in enumerate(table.columns)}
    vectors = table.vectors.items()
    return found | {name: [list(c.shape), c.ravel().tolist()] for name, c in vectors}


def _slider(result: Result, module: Module, slider: Slider) -> Data:
    """Return a slider as data for the template, with the value of its parameter in the run."""
    place = module.names.index(slider.name)
    value = float(module.values[place])
    known = result.parameters.columns if result.parameters else ()
    return {
        "name": slider.name,
        "text": slider.variable.description,
        "unit": "" if slider.variable.unit in (None, "1") else slider.variable.unit,
        "low": min(slider.low, value),
        "high": max(slider.high, value),
        "value": repr(value),
        "place": place,
        "constant": known.index(slider.name) if slider.name in known else -1,
        "steps": 1 if (slider.variable.low, slider.variable.high) == (0, 1) else STEPS,
    }
