# SPDX-License-Identifier: BSD-2-Clause
"""From the table of a campaign to its plan, with all that is wrong before any run."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import HarnessError, StructureError
from harness.master.changes import Changes, apply, as_in_a_file, pairs
from harness.master.executors import EXECUTORS, FUSED
from harness.master.fused import compiled
from harness.master.recorder import recorded
from harness.master.trial import always_refused
from harness.results.requirements import say_inconsistencies
from harness.results.result import Result
from harness.spelling import did_you_mean
from harness.ssp.library import load, take_mission
from harness.studies.campaign import metrics
from harness.studies.campaign.factors import SAMPLERS, factor
from harness.studies.campaign.layout import wrong_names
from harness.studies.campaign.plan import (
    CHANGES,
    ENTRIES,
    KEPT,
    MAX_RUNS,
    NUMBERS,
    Layout,
    Plan,
    Values,
    is_number,
    wrong_choices,
    wrong_entries,
    wrong_numbers,
)
from harness.studies.campaign.stopping import wrong_until
from harness.studies.campaign.worker import SUCCESS
from harness.system.graph import Checked, Graph, Slot, checked, columns, constants, say_warnings
from harness.system.model import System
from harness.system.tables import read_toml
from harness.system.values import plain

KEYS = {
    *ENTRIES, *NUMBERS, "executor", "until", "asked", "sensitivity", "probability", "tune", "map",
}  # fmt: skip


def table_of(definition: str | Path | Mapping[str, Any]) -> dict[str, Any]:
    """The table of a campaign, from its .toml or as it is given; UsageError, StructureError."""
    given = definition if isinstance(definition, Mapping) else read_toml(Path(definition))
    return {name: plain(value) for name, value in given.items()}


def read_plan(
    definition: str | Path | Mapping[str, Any], path: Path | None = None
) -> tuple[Plan, Layout]:
    """The plan of a table, or of the .toml that holds it, and the layout of its results; path: the
    file that a table comes from.

    Raises UsageError (no such file or system) or StructureError with all that is wrong.
    """
    if not isinstance(definition, Mapping):
        path = Path(definition)
    table = table_of(definition)
    name = path.name if path else "campaign"
    if not isinstance(table.get("system"), str):
        raise StructureError(
            [f"{name}: expected `system`, the name of a system or the path of an .ssp"]
        )
    plan = Plan(table, (path.parent if path else Path.cwd()).resolve())
    draft = _Draft(plan)
    draft.problems += wrong_entries(table)
    if "until" in table:
        draft.problems += wrong_until(table["until"], table)
    if not draft.problems:
        draft.read()
    if draft.problems:
        raise StructureError(f"{name}: {problem}" for problem in draft.problems)
    assert draft.layout is not None  # or there is a problem
    return draft.plan, draft.layout


class _Draft:
    """A plan on its way, and the problems met (one line each)."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.layout: Layout | None = None
        self.problems: list[str] = []

    def read(self) -> None:
        table = self.plan.definition
        self._strange("", table, KEYS, "entry")
        self.problems += wrong_numbers(table)
        self._each("expected", self._bounds)
        factors = [*table.get("factors", {})]
        seeds, keep = self.plan.seeds, self.plan.keep
        self.problems += wrong_names(table.get("metrics", {}), factors, seeds, keep)
        self._one_of("executor", self.plan.executor, EXECUTORS)
        self._one_of("sampler", self.plan.sampler, SAMPLERS)
        take_mission(self.plan.system)
        made = self._each("factors", factor)
        folder, success = self.plan.folder, self.plan.success
        found = self._each("metrics", lambda _, text: metrics.metric(str(text), folder))
        if success is not None:
            found[SUCCESS] = self._one(SUCCESS, lambda: metrics.read(SUCCESS, str(success), folder))
        known = {name: each for name, each in found.items() if each}
        self.plan = replace(self.plan, factors=tuple(made.values()), metrics=known)
        if not self.problems and self.plan.until and self.plan.listed:
            self.problems.append("until: counts draws, it cannot be beside listed values")
        if not self.problems and self.plan.runs > MAX_RUNS:
            self.problems.append(f"these are {self.plan.runs} runs, more than {MAX_RUNS}")
        with load(self.plan.system) as system:
            self._fits(system)

    def _strange(self, place: str, given: Iterable[str], known: Collection[str], what: str) -> bool:
        """Whether there are names among these that nobody knows."""
        strange = [name for name in given if name not in known]
        for name in strange:
            close = did_you_mean(name, known)
            self.problems.append(f"{place}{name}: there is no such {what}{close}")
        return bool(strange)

    def _one_of(self, name: str, given: str, known: Collection[str]) -> None:
        if given not in known:
            close = did_you_mean(given, known)
            self.problems.append(f"{name}: there is no {given}{close}, only {', '.join(known)}")

    def _each(self, name: str, make: Callable[[str, Any], Any]) -> dict[str, Any]:
        """What is made of every entry of a table, without those that make no sense."""
        table = self.plan.definition.get(name, {})
        if not isinstance(table, Mapping):
            self.problems.append(f"{name}: expected a table")
            return {}
        made = {}
        for key, given in table.items():
            found = self._one(f"{name}.{key}", partial(make, key, given))
            if found is not None:
                made[key] = found
        return made

    def _bounds(self, name: str, given: Any) -> None:
        known = self.plan.definition.get("metrics", {})
        if name not in known and name != SUCCESS:
            raise ValueError(f"there is no such metric{did_you_mean(name, known)}")
        numbers = isinstance(given, list) and len(given) == 2 and all(map(is_number, given))
        if not numbers or not given[0] <= given[1]:
            raise ValueError(f"expected [least, largest] mean of the metric, got {given}")

    def _one(self, name: str, make: Callable[[], Any]) -> Any:
        try:
            return make()
        except ValueError as error:
            self.problems.append(f"{name}: {error}")
            return None

    # ---- against the system

    def _fits(self, system: System) -> None:
        fixed = self.plan.definition.get("fixed", {})
        if self._strange("fixed.", fixed, CHANGES, "change"):
            return
        start = self._applied("fixed", system, dict(fixed))  # type: ignore[arg-type]
        further = dict(self.plan.definition.get("requirements", {}))
        if start is None or self._applied("requirements", start, {"require": further}) is None:
            return
        for each in self.plan.factors:
            if wrong := list(wrong_choices(each.name, each.choices)):
                self.problems += [f"factors.{each.name}: {line}" for line in wrong]
                continue
            if len({_shape(choice) for choice in each.choices}) > 1:
                self.problems.append(f"factors.{each.name}: its values are of several kinds")
            middle = [each.draw.value(np.full(each.draw.numbers, 0.5))] if each.draw else []
            for value in each.choices or middle:
                self._applied(f"factors.{each.name}", start, self._only({each.name: value}))
        for name in self.plan.seeds:
            self._applied(f"seeds.{name}", start, self._only({name: 1}))
        if not self.problems:
            self._flies(system)

    def _only(self, values: Values) -> Changes:
        return Plan({"system": ""}, self.plan.folder).changes(values)

    def _applied(self, name: str, system: System, changes: Changes) -> System | None:
        try:
            return apply(system, **changes)
        except HarnessError as error:
            self._complain(name, error)
            return None

    def _complain(self, name: str, error: HarnessError) -> None:
        for line in as_in_a_file(error).splitlines():
            problem = f"{name}: {line}"
            if problem not in self.problems:
                self.problems.append(problem)

    def _flies(self, system: System) -> None:
        """Every structure, and what metrics and histories need of the first."""
        structures = self._structures(system)
        ready = list(structures.values())
        if 0 in structures:
            first, found = structures[0]
            self._names(_kinds(found.graph), first.requirements)
        if not self.problems:
            self._measurable(ready)
        systems = [changed for changed, _ in ready]
        if self.plan.until and systems and not (self.plan.success or systems[0].requirements):
            self.problems.append("until: there is no success, and no requirement that makes one")
        fixed = dict(pairs("--set", self.plan.fixed.get("set", ())))
        varied = [*(f.name for f in self.plan.factors), *self.plan.seeds]
        for refusal in always_refused(systems, fixed, varied, self.plan.patience):
            self._complain("fixed", refusal)
        if not self.problems:
            say_warnings(*systems)
            say_inconsistencies(*systems)
            if self.plan.executor == FUSED:  # compiled here, and said here if it cannot be
                for changed, each in ready:
                    compiled(changed, each.graph)
            self.layout = _layout(systems[0], [each for _, each in ready])

    def _structures(self, system: System) -> dict[int, tuple[System, Checked]]:
        """What flies in every structure, by its first run."""
        ready = {}
        for run in self.plan.structures():
            try:
                changed = apply(system, **self.plan.changes(self.plan.values(run)))
                ready[run] = changed, checked(changed)
            except HarnessError as error:
                self._complain(f"run {run}", error)
        return ready

    def _names(self, result: Result, requirements: Mapping[str, str]) -> None:
        wanted = [(f"metrics.{k}", t) for k, t in self.plan.definition.get("metrics", {}).items()]
        if self.plan.success is not None:
            wanted.append(("success", self.plan.success))
        for name, text in wanted:
            for variable in metrics.variables(str(text)):
                self._known(name, variable, result)
        self._strange("keep.", self.plan.keep, KEPT, "entry")
        for key in ("histories", "bands"):
            for variable in self.plan.keep.get(key, ()):
                self._known(f"keep.{key}", str(variable), result)
        if SUCCESS in self.plan.expected and not (self.plan.success or requirements):
            self.problems.append(
                "expected.success: the campaign defines no success; add `success` or [requirements]"
            )
        if (worst := self.plan.worst.lstrip("-")) and worst not in self.plan.metrics:
            close = did_you_mean(worst, self.plan.metrics)
            self.problems.append(f"worst: there is no metric {worst}{close}")
        if self.plan.keep and any(f.name == "step" for f in self.plan.factors):
            self.problems.append("keep: histories of runs with several macro steps do not fit")

    def _measurable(self, structures: Sequence[tuple[System, Checked]]) -> None:
        """Metrics that no run can have; a success that every run has."""
        sizes = {(s.graph.slots, s.steps): (system, s) for system, s in structures}  # others alike
        results = [_blank(*found, self.plan.every) for found in sizes.values()]
        for name, each in self.plan.metrics.items():
            success = name == SUCCESS
            text = str(self.plan.success if success else self.plan.definition["metrics"][name])
            if why := metrics.refusal(text, each, results, success):
                self.problems.append(f"{name if success else f'metrics.{name}'}: {why}")

    def _known(self, name: str, variable: str, result: Result) -> None:
        if variable not in result:
            close = did_you_mean(variable, dict.fromkeys((*result.vectors, *result.columns)))
            self.problems.append(f"{name}: there is no variable {variable}{close}")


def _shape(choice: Any) -> tuple[bool, tuple[int, ...]]:
    """Whether a value is a text, and its shape; (-1,) if it has none."""
    try:
        return isinstance(choice, str), np.shape(choice)
    except ValueError:
        return False, (-1,)


def _layout(system: System, structures: Sequence[Checked]) -> Layout:
    """Of the results of these structures, the first of which is this system."""
    kinds = _kinds(structures[0].graph)
    steps = max(found.steps for found in structures)
    begin, step = system.experiment.start, system.experiment.step
    return Layout(kinds.columns, steps, begin, step or 0.0, kinds, system.requirements)


def _kinds(graph: Graph) -> Result:
    """A result of the system before anything has flown: names, units and texts, no values."""
    return _table(graph.slots, _table([slot for slot, _ in constants(graph)]))


def _blank(system: System, found: Checked, every: int) -> Result:
    """A result with as many rows as a run leaves, all values 1, for a first look at metrics."""
    given = list(constants(found.graph))
    parameters = _table([slot for slot, _ in given], values=np.array([[x for _, x in given]]))
    steps = recorded(found.steps, every)
    begin, step = system.experiment.start, system.experiment.step or 0.0
    time = begin + step * np.asarray(steps, dtype=np.float64)
    values = np.broadcast_to(1.0, (len(steps), len(found.graph.slots)))
    return replace(_table(found.graph.slots, parameters, values), time=time)


def _table(slots: Sequence[Slot], parameters: Result | None = None, values: Any = None) -> Result:
    names, units, texts = columns(slots)
    values = np.empty((1, len(slots))) if values is None else values
    time = np.arange(len(values), dtype=np.float64)
    return Result("", time, names, units, values, texts, parameters=parameters)
