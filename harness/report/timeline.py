# SPDX-License-Identifier: BSD-2-Clause
"""Choice of the replay of a result, and its timeline: title, phases, and events at their instants.

A mission defines phases and events of its own. The worst instants of the requirements, the first
violations of the safety rules and the passes through the shadow follow from the result.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from harness.claims.report import rule_findings
from harness.mission.fields import one
from harness.mission.figure import LARGEST
from harness.mission.library import of_result
from harness.mission.mission import together
from harness.report import models
from harness.report.arrays import Arrays
from harness.results.requirements import findings
from harness.results.result import Array, Result
from harness.results.verdict import Verdict
from harness.system.values import base

Scene = dict[str, Any]
DARK = 0.5
"""Part of the disc of the Sun that is covered from which on a body is in the shadow."""


def replay(result: Result, arrays: Arrays) -> Scene | None:
    """Return the replay of a result with its title and all its events in their order; None if it
    contains nothing that moves.
    """
    for kind in of_result(result).scene:
        if result.holds(*kind.needs, parameters=kind.parameters):
            if len((shown := drawable(result, kind.needs)).time) < 2:
                continue
            found = one(dict, kind.build, shown, arrays)
            if files := models.named(result):
                found = models.with_models(found, files, arrays)
            further = [*_worst(result), *_violations(result), *_shadow(arrays, found)]
            known = result.provenance
            chosen = known.params if known and known.params and known.params != "default" else ""
            titles = [plain(name) for name in (result.system, chosen) if name]
            return _titled(found, result.system, ", ".join(titles), further)
    return None


def replay_several(results: Mapping[str, Result], arrays: Arrays) -> Scene | None:
    """Return the replay of several runs by label in one scene, with the events of all runs, each
    with its label; None if their mission has none.
    """
    for kind in together(map(of_result, results.values())).scene:
        shown = {
            label: drawable(result, kind.needs)
            for label, result in results.items()
            if result.holds(*kind.needs, parameters=kind.parameters)
        }
        shown = {label: result for label, result in shown.items() if len(result.time) > 1}
        if kind.several and (found := kind.several(shown, arrays)):
            ends = max(float(result.time[-1]) for result in results.values() if len(result.time))
            further = []
            for label, result in results.items():
                own = [*_worst(result), *_violations(result)]
                if len(result.time) and result.time[-1] < ends:
                    own.append(event(result.time[-1], "the run ends", "abort"))
                further += of_run(label, own)
            return _titled(found, ", ".join(results), f"{len(results)} runs", further)
    return None


def drawable(result: Result, needs: Iterable[str]) -> Result:
    """Return what a replay can draw of a result: the rows in which these variables can be drawn,
    and the variables that can be drawn in all of these rows.
    """
    good = np.abs(result.values) <= LARGEST
    if good.all():
        return result
    rows = np.logical_and.reduce([drawable_rows(result[name]) for name in needs])
    left_out = {base(result.columns[k]) for k in np.flatnonzero(~good[rows].all(axis=0))}
    shown = [k for k, name in enumerate(result.columns) if base(name) not in left_out]
    return replace(
        result,
        time=result.time[rows],
        columns=tuple(result.columns[k] for k in shown),
        units=tuple(result.units[k] for k in shown),
        descriptions=tuple(result.descriptions[k] for k in shown if result.descriptions),
        modes=tuple(result.modes[k] for k in shown if result.modes),
        values=result.values[np.ix_(rows, shown)],
    )


def drawable_rows(values: Array) -> Array:
    """Return which rows of a history can be drawn (rows,)."""
    return np.asarray((np.abs(values) <= LARGEST).all(axis=tuple(range(1, values.ndim))))


def _titled(scene: Scene, name: str, title: str, further: list[Scene]) -> Scene:
    events = sorted([*scene.get("events", ()), *further], key=lambda event: event["time"])
    return scene | {"name": name, "title": title, "events": events}


def of_run(label: str, events: Iterable[Scene]) -> list[Scene]:
    """Return the events of one of several runs, with its label."""
    return [each | {"text": f"{label}: {each['text']}"} for each in events]


def plain(name: str) -> str:
    """Return a name without its folder, with spaces in place of underscores."""
    return name.rpartition("/")[2].replace("_", " ")


def event(time: float, text: str, kind: str = "plain") -> Scene:
    """Return an event at an instant [s]; kind: phase, worst, violation, abort, capture, light,
    plain.
    """
    return {"time": float(time), "text": text, "kind": kind}


def runs_of(values: Array, time: Array, words: tuple[str, ...]) -> list[Scene]:
    """Return the phases in which a variable has one value each: begin, end [s] and the meaning of
    the value.
    """
    edges = np.flatnonzero(np.diff(values, prepend=np.nan))
    ends = [*time[edges[1:]], time[-1]]
    return [
        {"begin": float(time[k]), "end": float(end), "text": words[int(values[k])]}
        for k, end in zip(edges, ends, strict=True)
    ]


def _worst(result: Result) -> Iterator[Scene]:
    for found in findings(result):
        if found.time is None or found.value is None:
            continue
        failed = found.verdict is Verdict.NOT_MET
        value = f"{found.value:.4g} {found.unit.removeprefix('1')}".strip()
        word = "not met, worst" if failed else "worst"
        about = f"{plain(found.name)}: {word} {value}"
        yield event(found.time, about, "violation" if failed else "worst")


def _violations(result: Result) -> Iterator[Scene]:
    for found in rule_findings(of_result(result), result):
        if not found.verdict.fulfilled:
            yield event(found.violated, f"{found.name}: violated for the first time", "violation")


def _shadow(arrays: Arrays, scene: Scene) -> Iterator[Scene]:
    """Yield the instants at which a dated run enters and leaves the shadow of the planet."""
    if "undated" in scene or "sun" not in scene:
        return
    dark = arrays.take(scene["sun"]["shadow"]) > DARK
    time = arrays.take(scene["time"])
    for k in np.flatnonzero(np.diff(dark)) + 1:
        yield event(time[k], "into the shadow" if dark[k] else "out of the shadow", "light")
