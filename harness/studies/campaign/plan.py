# SPDX-License-Identifier: BSD-2-Clause
"""The plan of a campaign: every run of it by its number, and all that is wrong before any is run.

Listed values are combined as a grid, the last factor changing fastest; drawn ones differ from draw
to draw and are the same in every cell of the grid. Run i is cell i % cells of draw i // cells.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError, StructureError
from harness.master.changes import Changes, apply, pairs
from harness.master.isolated import PATIENCE
from harness.master.refusals import as_typed, without
from harness.master.trial import refused
from harness.results.result import Result
from harness.spelling import did_you_mean
from harness.ssp.library import find_system, load
from harness.studies.campaign import draws, metrics
from harness.studies.campaign.factors import Factor, factor
from harness.studies.campaign.kinds import (
    CHANGES,
    KEPT,
    NAMED,
    is_number,
    is_whole,
    wrong_choices,
    wrong_entries,
)
from harness.system.graph import Graph, Slot, checked, constants, say_warnings
from harness.system.model import System
from harness.system.tables import read_toml
from harness.system.values import plain

KEYS = {
    "system", "runs", "seed", "sampler", "every", "fixed", "factors", "seeds", "metrics",
    "success", "worst", "keep", "expected", "patience",
}  # fmt: skip

MAX_RUNS = 10_000_000
"""Runs of one campaign; their values are drawn at once."""

Values = dict[str, Any]
"""Values of all factors of a run by name."""


@dataclass(frozen=True)
class Plan:
    """A campaign that makes sense. definition: the table it was read from; folder: where files that
    it names are looked for.
    """

    definition: Mapping[str, Any]
    folder: Path
    factors: tuple[Factor, ...] = ()
    metrics: Mapping[str, metrics.Metric] = field(default_factory=dict)

    # ---- what the definition says

    @property
    def system(self) -> Path:
        """Path of the .ssp."""
        beside = self.folder / str(self.definition["system"])
        return beside if beside.is_file() else find_system(str(self.definition["system"]))

    @property
    def seed(self) -> int:
        """Where all random numbers come from."""
        return int(self.definition.get("seed", 0))

    @property
    def sampler(self) -> str:
        """Name of the sampler of the draws."""
        return str(self.definition.get("sampler", "random"))

    @property
    def every(self) -> int:
        """Every N-th macro step is recorded."""
        return int(self.definition.get("every", 1))

    @property
    def patience(self) -> float:
        """How long an FMU that is not ours may take for one call [s]."""
        return float(self.definition.get("patience", PATIENCE))

    @property
    def fixed(self) -> Changes:
        """Changes common to all runs."""
        return dict(self.definition.get("fixed", {}))  # type: ignore[return-value]

    @property
    def seeds(self) -> tuple[str, ...]:
        """Parameters that receive a seed of their own in every draw."""
        return tuple(self.definition.get("seeds", ()))

    @property
    def keep(self) -> Mapping[str, Any]:
        """What histories are kept: `histories` of every run, `bands` over all, in `rows` rows."""
        found: Mapping[str, Any] = self.definition.get("keep", {})
        return found

    @property
    def success(self) -> str | None:
        """Expression that is true for a run that has succeeded."""
        return self.definition.get("success")

    @property
    def expected(self) -> Mapping[str, tuple[float, float]]:
        """Least and largest mean over all runs that a metric should have."""
        return {k: (low, high) for k, (low, high) in self.definition.get("expected", {}).items()}

    @property
    def digest(self) -> str:
        """Hash of the definition and of the system; runs of equal ones are the same runs."""
        text = json.dumps(self.definition, sort_keys=True, default=str).encode()
        return hashlib.sha256(text + self.system.read_bytes()).hexdigest()

    # ---- runs

    @property
    def listed(self) -> list[Factor]:
        """Factors of the grid."""
        return [f for f in self.factors if f.draw is None]

    @property
    def drawn(self) -> list[Factor]:
        """Factors that are drawn."""
        return [f for f in self.factors if f.draw is not None]

    @property
    def cells(self) -> int:
        """Combinations of the listed values."""
        return math.prod(len(f.choices) for f in self.listed)

    @property
    def draws(self) -> int:
        """Draws of every cell."""
        return int(self.definition.get("runs", 1))

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self.cells * self.draws

    @cached_property
    def _numbers(self) -> NDArray[np.float64]:
        width = sum(f.draw.numbers for f in self.drawn if f.draw)
        return draws.numbers(self.sampler, self.draws, width, self.seed)

    def values(self, run: int) -> Values:
        """Values of all factors of a run, the seeds among them."""
        draw, cell = divmod(run, self.cells)
        values: Values = dict(zip((f.name for f in self.listed), self._cell(cell), strict=True))
        place = 0
        for each in self.drawn:
            assert each.draw is not None
            numbers = self._numbers[draw, place : place + each.draw.numbers]
            values[each.name] = each.draw.value(numbers)
            place += each.draw.numbers
        seeds = {name: draws.run_seed(self.seed, draw, k) for k, name in enumerate(self.seeds)}
        return values | seeds

    def structures(self) -> list[int]:
        """Runs of the first draw, one for every combination of what changes more than values."""
        shape = [len(f.choices) for f in self.listed]
        ways = [range(len(f.choices)) if _structural(f.name) else (0,) for f in self.listed]
        return [int(np.ravel_multi_index(w, shape)) if shape else 0 for w in product(*ways)]

    def _cell(self, cell: int) -> tuple[Any, ...]:
        shape = [len(f.choices) for f in self.listed]
        places = np.unravel_index(cell, shape) if shape else ()
        return tuple(f.choices[int(k)] for f, k in zip(self.listed, places, strict=True))

    def whole(self, name: str) -> bool:
        """Whether all values of a factor are whole numbers."""
        listed = {f.name: f.choices for f in self.factors}
        return name in self.seeds or (
            name in listed
            and bool(listed[name])
            and all(isinstance(choice, int) for choice in listed[name])
        )

    def changes(self, values: Values) -> Changes:
        """What run() takes for a run of these values."""
        changes: dict[str, Any] = {**self.fixed}
        for name, value in values.items():
            option, _, rest = name.partition(".")
            if name in CHANGES:
                changes[name] = value
            else:
                kind, key = (option, rest) if option in NAMED else ("set", name)
                changes[kind] = {**dict(pairs(f"--{kind}", changes.get(kind, ()))), key: value}
        return changes  # type: ignore[return-value]


def read_plan(definition: Path | Mapping[str, Any]) -> Plan:
    """The plan of a table, or of the .toml that holds it.

    Raises UsageError (no such file or system) or StructureError with all that is wrong.
    """
    path = definition if isinstance(definition, Path) else None
    table: Mapping[str, Any] = read_toml(path) if path else plain(definition)
    name = path.name if path else "campaign"
    if not isinstance(table.get("system"), str):
        raise StructureError([f"{name}: wants system, its name or the path of its .ssp"])
    plan = Plan(table, (path.parent if path else Path.cwd()).resolve())
    draft = _Draft(plan)
    draft.problems += wrong_entries(table)
    if not draft.problems:
        draft.read()
    if draft.problems:
        raise StructureError(f"{name}: {problem}" for problem in draft.problems)
    return draft.plan


class _Draft:
    """A plan on its way, and the problems met (one line each)."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.problems: list[str] = []

    def read(self) -> None:
        table = self.plan.definition
        for key in table:
            if key not in KEYS:
                self.problems.append(f"{key}: there is no such entry{did_you_mean(key, KEYS)}")
        self._whole("runs", 1, MAX_RUNS)
        self._whole("seed", 0, 2**64 - 1)
        self._whole("every", 1, 2**31 - 1)
        self._each("expected", self._bounds)
        self._positive("patience")
        sampler = self.plan.sampler
        if sampler not in draws.SAMPLERS:
            close = did_you_mean(sampler, draws.SAMPLERS)
            self.problems.append(f"sampler: there is no {sampler}{close}, only {_all_samplers()}")
        factors = self._each("factors", factor)
        found = self._each("metrics", lambda _, text: metrics.metric(str(text), self.plan.folder))
        if self.plan.success is not None:
            found["success"] = self._one(
                "success", lambda: metrics.metric(str(self.plan.success), self.plan.folder)
            )
        self.plan = Plan(
            table, self.plan.folder, tuple(factors.values()), {k: m for k, m in found.items() if m}
        )
        if not self.problems and self.plan.runs > MAX_RUNS:
            self.problems.append(f"these are {self.plan.runs} runs, more than {MAX_RUNS}")
        with load(self.plan.system) as system:
            self._fits(system)

    def _whole(self, name: str, least: int, most: int) -> None:
        given = self.plan.definition.get(name, least)
        if not is_whole(given) or given < least:
            self.problems.append(f"{name}: must be a whole number of at least {least}, not {given}")
        elif given > most:
            self.problems.append(f"{name}: must be at most {most}, not {str(given)[:20]}")

    def _positive(self, name: str) -> None:
        given = self.plan.definition.get(name, 1)
        if not is_number(given) or not given > 0:
            self.problems.append(f"{name}: must be a number above 0, not {given}")

    def _each(self, name: str, make: Callable[[str, Any], Any]) -> dict[str, Any]:
        """What is made of every entry of a table, without those that make no sense."""
        table = self.plan.definition.get(name, {})
        if not isinstance(table, Mapping):
            self.problems.append(f"{name}: wants a table")
            return {}
        made = {}
        for key, given in table.items():
            found = self._one(f"{name}.{key}", partial(make, key, given))
            if found is not None:
                made[key] = found
        return made

    def _bounds(self, name: str, given: Any) -> None:
        known = self.plan.definition.get("metrics", {})
        if name not in known:
            raise ValueError(f"there is no such metric{did_you_mean(name, known)}")
        numbers = isinstance(given, list) and len(given) == 2 and all(map(is_number, given))
        if not numbers or not given[0] <= given[1]:
            raise ValueError(f"wants [least, largest] mean of the metric, not {given}")

    def _one(self, name: str, make: Callable[[], Any]) -> Any:
        try:
            return make()
        except ValueError as error:
            self.problems.append(f"{name}: {error}")
            return None

    # ---- against the system

    def _fits(self, system: System) -> None:
        fixed = self.plan.fixed
        for key in fixed:
            if key not in CHANGES:
                close = did_you_mean(key, CHANGES)
                self.problems.append(f"fixed.{key}: there is no such change{close}")
        if any(key not in CHANGES for key in fixed):
            return
        start = self._applied("fixed", system, fixed)
        if start is None:
            return
        for each in self.plan.factors:
            if wrong := list(wrong_choices(each.name, each.choices)):
                self.problems += [f"factors.{each.name}: {line}" for line in wrong]
                continue
            if len({_shape(choice) for choice in each.choices}) > 1:
                self.problems.append(f"factors.{each.name}: its values are of several kinds")
            for value in each.choices or ([_sample(each)] if each.draw else []):
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
        for line in str(error).splitlines():
            problem = f"{name}: {line.removeprefix('--set ')}"
            if problem not in self.problems:
                self.problems.append(problem)

    def _flies(self, system: System) -> None:
        """Every structure, and what metrics and histories need of the first."""
        ready = []
        for run in self.plan.structures():
            try:
                changed = apply(system, **self.plan.changes(self.plan.values(run)))
                found = checked(changed)
            except HarnessError as error:
                self._complain(f"run {run}", error)
                continue
            ready.append(changed)
            if run == 0:
                self._names(_kinds(found.graph))
        self._try(ready)

    def _try(self, systems: Sequence[System]) -> None:
        """What FMUs refuse in every run, because it is about nothing that varies."""
        fixed = dict(pairs("set", self.plan.fixed.get("set", ())))
        varied = [*(f.name for f in self.plan.factors), *self.plan.seeds]
        components = {name.partition(".")[0] for name in fixed}
        for error in refused(systems, components, self.plan.patience):
            if common := without(error, varied):
                self._complain("fixed", as_typed(common, fixed, f"{error.component}."))

    def _names(self, result: Result) -> None:
        wanted = [(f"metrics.{k}", t) for k, t in self.plan.definition.get("metrics", {}).items()]
        if self.plan.success is not None:
            wanted.append(("success", self.plan.success))
        for name, text in wanted:
            for variable in metrics.variables(str(text)):
                self._known(name, variable, result)
        for key, given in self.plan.keep.items():
            if key not in KEPT:
                self.problems.append(f"keep.{key}: there is no such entry{did_you_mean(key, KEPT)}")
            elif key != "rows":
                for variable in given:
                    self._known(f"keep.{key}", str(variable), result)
        worst = str(self.plan.definition.get("worst", "")).lstrip("-")
        if worst and worst not in self.plan.metrics:
            close = did_you_mean(worst, self.plan.metrics)
            self.problems.append(f"worst: there is no metric {worst}{close}")
        if self.plan.keep and any(f.name == "step" for f in self.plan.factors):
            self.problems.append("keep: histories of runs with several macro steps do not fit")

    def _known(self, name: str, variable: str, result: Result) -> None:
        if variable not in result:
            close = did_you_mean(variable, dict.fromkeys((*result.vectors, *result.columns)))
            self.problems.append(f"{name}: there is no variable {variable}{close}")


def _structural(name: str) -> bool:
    """Whether a factor changes more than values of parameters."""
    return name in CHANGES or name.partition(".")[0] in NAMED


def _sample(each: Factor) -> Any:
    assert each.draw is not None
    return each.draw.value(np.full(each.draw.numbers, 0.5))


def _shape(choice: Any) -> tuple[bool, tuple[int, ...]]:
    """Whether a value is a text, and its shape; (-1,) if it has none."""
    try:
        return isinstance(choice, str), np.shape(choice)
    except ValueError:
        return False, (-1,)


def _all_samplers() -> str:
    return ", ".join(draws.SAMPLERS)


class Layout(NamedTuple):
    """What the dataset needs to know of the results: columns of a row, macro steps of the longest
    run, start [s], macro step [s]; kinds: names, units and texts of variables and parameters.
    """

    columns: tuple[str, ...]
    steps: int
    start: float
    step: float
    kinds: Result


def layout(plan: Plan) -> Layout:
    """Find it out from the structures."""
    with load(plan.system) as system:
        cells = [apply(system, **plan.changes(plan.values(k))) for k in plan.structures()]
        say_warnings(*cells)
        found = [checked(cell) for cell in cells]
        first = cells[0].experiment
        kinds = _kinds(found[0].graph)
        steps = max(f.steps for f in found)
        return Layout(kinds.columns, steps, first.start, first.step or 0.0, kinds)


def _kinds(graph: Graph) -> Result:
    """A result of the system before anything has flown: names, units and texts, no values."""
    return _table(graph.slots, _table([slot for slot, _ in constants(graph)]))


def _table(slots: Sequence[Slot], parameters: Result | None = None) -> Result:
    return Result(
        "",
        np.zeros(1),
        tuple(slot.name for slot in slots),
        tuple(slot.unit for slot in slots),
        np.empty((1, len(slots))),
        tuple(slot.description for slot in slots),
        parameters=parameters,
    )
