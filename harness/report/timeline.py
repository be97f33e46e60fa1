# SPDX-License-Identifier: BSD-2-Clause
"""Replay of a result, with a title and a timeline of phases and events.

The mission of the result builds the scene, and can define phases and events. This module adds as
events the worst instant of each requirement, the first violation of each safety rule, and each
passage into or out of the shadow of the planet.
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
from harness.report.arrays import Arrays
from harness.results.requirements import findings
from harness.results.result import Array, Result
from harness.results.verdict import Verdict
from harness.system.values import base

Scene = dict[str, Any]
DARK = 0.5
"""Limit of the share of the Sun's disc that the planet covers; with a larger share, the bodies are
in the shadow.
"""


def replay(result: Result, arrays: Arrays) -> Scene | None:
    """Return the scene of the replay of a result, with its title and all events in the order of
    time; None if the mission has no scene for the result, or fewer than two rows can be drawn.

    arrays: arrays of the page, to which the arrays of the scene are added.
    """
    for kind in of_result(result).scene:
        if result.holds(*kind.needs, parameters=kind.parameters):
            if len((shown := drawable(result, kind.needs)).time) < 2:
                continue
            found = one(dict, kind.build, shown, arrays)
            further = [*_worst(result), *_violations(result), *_shadow(arrays, found)]
            known = result.provenance
            chosen = known.params if known and known.params and known.params != "default" else ""
            titles = [plain(name) for name in (result.system, chosen) if name]
            return _titled(found, result.system, ", ".join(titles), further)
    return None


def replay_several(results: Mapping[str, Result], arrays: Arrays) -> Scene | None:
    """Return one scene with the replays of several runs and their events, as replay() adds them but
    without the shadow, and with the end of each run that ends before the last; None if no mission
    has a scene for several runs. The text of an event begins with the label of its run.

    results: by label of the run; arrays: as for replay().
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
    """Return a result without the rows in which one of the variables `needs` cannot be drawn, and
    without those other variables that cannot be drawn in one of the remaining rows. A value can be
    drawn if it is a number of at most LARGEST.
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
    """Return a mask (rows,) of the rows in which all elements of a time series are numbers of at
    most LARGEST.
    """
    return np.asarray((np.abs(values) <= LARGEST).all(axis=tuple(range(1, values.ndim))))


def _titled(scene: Scene, name: str, title: str, further: list[Scene]) -> Scene:
    events = sorted([*scene.get("events", ()), *further], key=lambda event: event["time"])
    return scene | {"name": name, "title": title, "events": events}


def of_run(label: str, events: Iterable[Scene]) -> list[Scene]:
    """Return the events of one run for a replay of several runs: each text begins with the label of
    the run.
    """
    return [each | {"text": f"{label}: {each['text']}"} for each in events]


def plain(name: str) -> str:
    """Return a name without a folder, and with spaces in place of underscores."""
    return name.rpartition("/")[2].replace("_", " ")


def event(time: float, text: str, kind: str = "plain") -> Scene:
    """Return an event at an instant `time` [s]; kind: phase, worst, violation, abort, capture,
    light or plain, which determines its look.
    """
    return {"time": float(time), "text": text, "kind": kind}


def _worst(result: Result) -> Iterator[Scene]:
    """Yield an event at the worst instant of each requirement."""
    for found in findings(result):
        if found.time is None or found.value is None:
            continue
        failed = found.verdict is Verdict.NOT_MET
        value = f"{found.value:.4g} {found.unit.removeprefix('1')}".strip()
        word = "not met, worst" if failed else "worst"
        about = f"{plain(found.name)}: {word} {value}"
        yield event(found.time, about, "violation" if failed else "worst")


def _violations(result: Result) -> Iterator[Scene]:
    """Yield an event at the first violation of each safety rule that is violated."""
    for found in rule_findings(of_result(result), result):
        if not found.verdict.fulfilled:
            yield event(found.violated, f"{found.name}: violated for the first time", "violation")


def _shadow(arrays: Arrays, scene: Scene) -> Iterator[Scene]:
    """Yield an event at each instant at which the bodies enter or leave the shadow of the planet,
    if the scene has a Sun and a date.
    """
    if "undated" in scene or "sun" not in scene:
        return
    dark = arrays.take(scene["sun"]["shadow"]) > DARK
    time = arrays.take(scene["time"])
    for k in np.flatnonzero(np.diff(dark)) + 1:
        yield event(time[k], "into the shadow" if dark[k] else "out of the shadow", "light")
