# SPDX-License-Identifier: BSD-2-Clause
"""Check of the table of a campaign before any run. It returns the plan of the campaign, or reports
all problems of the table at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import HarnessError, StructureError
from harness.master.changes import Changes, apply, as_in_a_file, pairs
from harness.master.recorder import recorded
from harness.mission.claim import BaseMetric
from harness.results.provenance import Provenance
from harness.results.result import Result, parameters_of
from harness.spelling import did_you_mean
from harness.ssp.library import load, take_mission
from harness.studies.campaign import metrics
from harness.studies.campaign.factors import Factor, factor
from harness.studies.campaign.layout import wrong_names
from harness.studies.campaign.plan import MAX_RUNS, SUCCESS, Plan, Table, changes_of, kind_of
from harness.studies.campaign.sources import sources
from harness.studies.campaign.worker import Task
from harness.studies.reuse import Reading, rejected_before
from harness.system.graph import Checked, Slot, checked, columns
from harness.system.model import System
from harness.system.tables import problems, read_toml
from harness.system.values import base, plain


def table_of(definition: str | Path | Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of a campaign as a dictionary; definition: path of its .toml, or the table
    itself. Raise UsageError or StructureError if the file cannot be read.
    """
    given = definition if isinstance(definition, Mapping) else read_toml(Path(definition))
    return {name: plain(value) for name, value in given.items()}


def read_plan(
    definition: str | Path | Mapping[str, Any], path: Path | None = None
) -> tuple[Plan, Task]:
    """Check the table of a campaign; return its plan, and the data that all its runs share.

    definition: path of the .toml, or the table itself; path: file that contains the table if
    `definition` is the table. Raises UsageError (no such file or system), or StructureError with
    all problems.
    """
    if not isinstance(definition, Mapping):
        path = Path(definition)
    table, name = table_of(definition), path.name if path else "campaign"
    sound, wrong = _sound(table), list(problems(table, Table))
    plan, task = Plan(sound, (path.parent if path else Path.cwd()).resolve()), None
    if "system" in sound:
        draft = _Draft(plan, wrong)
        task, wrong, plan = draft.task(), draft.problems, draft.plan
    if task is None or wrong:
        raise StructureError(f"{name}: {problem}" for problem in wrong)
    return plan, task


def _sound(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return only those entries of a table, and of the tables inside it, that have the right types,
    so that the other checks can continue after a wrong entry.
    """

    def fits(name: str, given: Any) -> bool:
        return not any(problems({"system": "", name: given}, Table))

    sound: dict[str, Any] = {}
    for name, given in table.items():
        parts = given
        if isinstance(given, Mapping) and not fits(name, given):
            parts = {k: v for k, v in given.items() if fits(name, {k: v})}
        if fits(name, parts):
            sound[name] = parts
    return sound


class _Draft:
    """Plan of a campaign whose table is being checked, with the problems found so far, one line
    each.
    """

    def __init__(self, plan: Plan, problems: list[str]) -> None:
        self.plan, self.table, self.problems = plan, plan.table, problems

    @contextmanager
    def _about(self, name: str) -> Iterator[None]:
        """Add errors raised inside the block to the problems; `name`, the name of an entry of the
        table, precedes each.
        """
        try:
            yield
        except HarnessError as error:
            self._add(name, as_in_a_file(error))
        except ValueError as error:
            self._add(name, str(error))

    def _add(self, name: str, text: str) -> None:
        lines = (f"{name}: {line}" for line in text.splitlines())
        self.problems += [line for line in lines if line not in self.problems]

    def task(self) -> Task | None:
        """Check the table against its system; add all problems found to `problems`. Return the data
        that all runs share, None if _task() returns None or an earlier check finds a problem.
        """
        table, system, declared = self.table, self.plan.system, len(self.problems)
        self.problems += wrong_names(table)
        take_mission(system)
        factors, found = [], {}
        for name, given in table.factors.items():
            with self._about(f"factors.{name}"):
                factors.append(factor(name, given))
        for name, text in table.texts.items():
            if SUCCESS not in table.metrics:
                with self._about(_place(name)):
                    found[name] = metrics.read(name, text, self.plan.folder)
        self._consistent()
        if len(self.problems) == declared and self.plan.runs > MAX_RUNS:
            self.problems.append(
                f"{self.plan.runs} runs are defined, more than the limit of {MAX_RUNS}"
            )
        with load(system) as loaded:
            self._fits(loaded, factors)
            return None if len(self.problems) > declared else self._task(loaded, found)

    def _consistent(self) -> None:
        """Check that entries of the table which refer to each other agree, such as `worst` and the
        metrics.
        """
        table = self.table
        named = {f"expected.{name}": name for name in table.expected if name != SUCCESS}
        if isinstance(table.worst, str) and table.worst:
            named["worst"] = table.worst.removeprefix("-")
        for place, name in named.items():
            if name not in (known := table.texts.keys() - {SUCCESS}):
                close = did_you_mean(name, known)
                self.problems.append(f"{place}: there is no metric {name}{close}")
        self.problems += [
            f"expected.{n}: expected [least, largest], got [{a}, {b}]"
            for n, (a, b) in table.expected.items()
            if a > b
        ]
        listed = any(f.list or f.range for f in table.factors.values())
        if table.until and (listed or "runs" in self.plan.definition):
            self.problems.append(
                "until: cannot be combined with `runs`, `list` or `range`, because it determines "
                "the number of runs"
            )
        if self.plan.definition.get("record") and "step" in table.factors:
            self.problems.append(
                "record: time series cannot be recorded if the factor `step` varies the macro step"
            )

    # ---- against the system

    def _fits(self, system: System, factors: Sequence[Factor]) -> None:
        """Check that the system accepts the fixed changes, the requirements, all listed values and
        the median of every random factor, and the seeds; add the problems found.
        """
        fixed: Any = dict(self.plan.definition.get("fixed", {}))
        start = self._applied("fixed", system, fixed)
        further = dict(self.table.requirements)
        if start is None or self._applied("requirements", start, {"require": further}) is None:
            return
        for each in factors:
            place, kind = f"factors.{each.name}", kind_of(each.name)
            if wrong := [p for c in each.choices if kind for p in problems(c, kind, place)]:
                self.problems += wrong
                continue
            if len(set(map(_shape, each.choices))) > 1:
                self.problems.append(
                    f"{place}: values must be all texts, or all numbers or lists of one shape"
                )
            middle = [each.draw.value(np.full(each.draw.numbers, 0.5))] if each.draw else []
            for value in each.choices or middle:
                self._applied(place, start, changes_of({each.name: value}))
        for name in self.table.seeds:
            self._applied(f"seeds.{name}", start, changes_of({name: 1}))

    def _applied(self, name: str, system: System, changes: Changes) -> System | None:
        """Return the system with changes; if they are not possible, add a problem of the entry
        `name` and return None.
        """
        with self._about(name):
            return apply(system, **changes)
        return None

    def _task(self, system: System, found: Mapping[str, BaseMetric]) -> Task | None:
        """Check the system in every structure (combination of swaps and other options), and the
        variables that metrics and `record` name in the first structure. Return the data that all
        runs share; None if the first structure is wrong. found: metrics by name.
        """
        structures: dict[int, tuple[System, Checked]] = {}
        for run in self.plan.structures():
            with self._about(f"run {run}"):
                changed = apply(system, **self.plan.changes(self.plan.values(run)))
                structures[run] = changed, checked(changed)
        ready, table = list(structures.values()), self.table
        if 0 not in structures:
            return None
        first, graph = structures[0][0], structures[0][1].graph
        kinds = _table(graph.slots, parameters_of("", graph))
        self._names(kinds)
        read = None if self.problems else self._measurable(ready, found)
        if not (table.success or first.requirements):
            given = {"until": table.until, "expected.success": table.expected.get(SUCCESS)}
            needed = "needs `success = ...` or [requirements], which define the success of a run"
            self.problems += [f"{name}: {needed}" for name in given if given[name]]
        fixed = dict(pairs("--set", self.plan.fixed.get("set", ())))
        if not self.problems:
            varied = [*table.factors, *table.seeds]
            for rejection in rejected_before(ready, fixed, varied, table.patience, table.executor):
                self._add("fixed", as_in_a_file(rejection))
        if not self.problems:
            files = sources(self.plan, system, (changed for changed, _ in ready))
            self.plan = replace(self.plan, sources=files)
        plan = self.plan
        steps = max(each.steps for _, each in ready)
        begin, step = first.experiment.start, first.experiment.step or 0.0
        common = plan.digest, plan.system, plan.folder, table
        return Task(*common, kinds, first.requirements, begin, step, steps, read)

    def _names(self, kinds: Result) -> None:
        """Check that the system has all variables to which metrics and the table `record` refer.
        kinds: result that has the names of all variables.
        """
        named = [(_place(n), v) for n, t in self.table.texts.items() for v in metrics.variables(t)]
        named += [("record.histories", name) for name in self.table.record.histories]
        named += [("record.bands", name) for name in self.table.record.bands]
        for place, variable in named:
            if variable not in kinds:
                close = did_you_mean(variable, dict.fromkeys((*kinds.vectors, *kinds.columns)))
                self.problems.append(f"{place}: there is no variable {variable}{close}")

    def _measurable(
        self, structures: Sequence[tuple[System, Checked]], found: Mapping[str, BaseMetric]
    ) -> frozenset[str] | None:
        """Add a problem for each metric that has a value in no structure (combination of options),
        and for the metric `success` if it has no value in at least one structure. Return the names
        of the variables that metrics, requirements and recorded time series read; None if a metric
        is a function of the user, which may read any variable.

        structures: system and outcome of its check, for each structure; found: metrics by name.
        """
        # metrics depend only on the variables and the number of steps, so of all structures with
        # the same variables and number of steps, only one is tried
        sizes = {(s.graph.slots, s.steps): (system, s) for system, s in structures}
        results = [_blank(*each, self.table.every) for each in sizes.values()]
        texts = self.table.texts
        for name, text in texts.items():
            if why := metrics.rejection(text, found[name], results, name == SUCCESS):
                self.problems.append(f"{_place(name)}: {why}")
        if any(map(metrics.file_of, texts.values())):
            return None
        conditions = (text for system, _ in structures for text in system.requirements.values())
        named = {base(name) for text in conditions for name in metrics.variables(text)}
        return frozenset(named.union(self.table.recorded, *(each.read for each in results)))


def _place(metric: str) -> str:
    """Return the name of the entry that defines a metric: `success` or `metrics.NAME`."""
    return metric if metric == SUCCESS else f"metrics.{metric}"


def _shape(choice: Any) -> tuple[bool, tuple[int, ...]]:
    """Return whether a listed value of a factor is a text, and its shape as an array; (-1,) for
    rows of unequal length.
    """
    try:
        return isinstance(choice, str), np.shape(choice)
    except ValueError:
        return False, (-1,)


def _blank(system: System, found: Checked, every: int) -> Reading:
    """Return a result with the rows and variables of a run in which all values are 1. Metrics are
    tried on it before any run. found: outcome of the check of the system.
    """
    steps = recorded(found.steps, every)
    begin, step = system.experiment.start, system.experiment.step or 0.0
    time = begin + step * np.asarray(steps, dtype=np.float64)
    slots = found.graph.slots
    values = np.broadcast_to(1.0, (len(steps), len(slots)))
    made = Provenance(system=system.name, mission=system.mission)
    parameters = parameters_of(system.name, found.graph)
    whole = replace(_table(slots, parameters, values), time=time, provenance=made)
    return Reading(whole, slots, values[-1])


def _table(slots: Sequence[Slot], parameters: Result, values: Any = None) -> Result:
    """Return a result with the names, units and descriptions of variables, before any run.

    slots: variables of a system; parameters: result with its parameters; values: (rows, slots);
    None: one row of arbitrary values.
    """
    names, units, texts, modes = columns(slots)
    values = np.empty((1, len(slots))) if values is None else values
    time = np.arange(len(values), dtype=np.float64)
    return Result("", time, names, units, values, texts, parameters=parameters, modes=modes)
