# SPDX-License-Identifier: BSD-2-Clause
"""What a mission hands the engine: figures, measures, claims and so on, each as data.

A mission is a folder with `system.toml`, further systems, `campaigns/` and, if it has something to
add to the general figures, `mission.py` with

    MISSION = Mission(figures=(...), measures=(...), claims=(...))

Missions import the engine; the engine knows no mission.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, NamedTuple, Protocol

from harness.mission.claim import Paper, RuleFinding, Validation
from harness.mission.conventions import Bodies, Example
from harness.mission.figure import Drawing, Figure, Overlay, Phase
from harness.mission.measure import Gauge, Limits, Measure
from harness.results.result import Result


class Scene(NamedTuple):
    """A replay in space, of results that hold these variables and parameters; build: from the
    result and the arrays of the page; several: the same of several runs by label.
    """

    needs: tuple[str, ...]
    parameters: tuple[str, ...]
    build: Callable[[Result, Any], dict[str, Any]]
    several: Callable[[Mapping[str, Result], Any], dict[str, Any] | None] | None = None


class Plan(Protocol):
    """What a planner answers before anything is run; histories: by label, for figures."""

    @property
    def histories(self) -> Mapping[str, Result]:
        """What was planned, and what it is compared with."""

    @property
    def good(self) -> bool:
        """Whether the plan can be carried out."""

    def text(self) -> str:
        """The plan for reading."""


@dataclass(frozen=True)
class Mission:
    """The figures, measures, claims and other parts of one mission.

    figures, overlays (of several runs), phases (quantity against rate), measures (columns of a
    comparison), claims (papers with verdicts), gauges (shown while a run goes on), scene (replays),
    rules (safety rules of a result), notes (what a reader must know of a result), plans: what
    `harness plan` answers, from a system and the changes of run(); bands: the limits that runs are
    held against where the user names none, definitions: lines below the table that explain its
    columns; idle: variables with the value from which on nothing is in force; validations: numbers
    by others that the mission answers; bodies: names by which bodies in orbit are known; examples:
    sources of what may take the place of a component.
    """

    figures: tuple[Figure | Drawing, ...] = ()
    overlays: tuple[Figure | Overlay, ...] = ()
    phases: tuple[Phase, ...] = ()
    measures: tuple[Measure, ...] = ()
    claims: tuple[Paper, ...] = ()
    gauges: tuple[Gauge, ...] = ()
    scene: tuple[Scene, ...] = ()
    rules: tuple[Callable[[Result], Iterator[RuleFinding]], ...] = ()
    notes: tuple[Callable[[Result], Iterator[str]], ...] = ()
    plans: tuple[Callable[..., Plan], ...] = ()
    bands: tuple[Callable[[Limits, Mapping[str, Result]], Limits], ...] = ()
    definitions: tuple[Callable[[Limits], Iterator[str]], ...] = ()
    idle: tuple[tuple[str, float], ...] = ()
    validations: tuple[Validation, ...] = ()
    bodies: tuple[Bodies, ...] = ()
    examples: tuple[Example, ...] = ()

    def limits(self, given: Limits, results: Mapping[str, Result]) -> Limits:
        """The limits with the bands that these results suggest."""
        for band in self.bands:
            given = band(given, results)
        return given


def together(missions: Iterable[Mission]) -> Mission:
    """All that several missions offer, what they share once."""
    found = list(missions)
    offered: dict[str, Any] = {
        f.name: tuple(dict.fromkeys(x for m in found for x in getattr(m, f.name)))
        for f in fields(Mission)
    }
    return Mission(**offered)
