# SPDX-License-Identifier: BSD-2-Clause
"""Plan of a campaign: the permitted contents of its file, and every run by its number.

Listed values are combined as a grid, the last factor changing fastest. Drawn values differ between
draws and are the same in every cell of the grid. Run i is cell i % cells of draw i // cells.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from harness.master.changes import Changes, joined
from harness.master.isolated import PATIENCE
from harness.ssp.library import find_system
from harness.studies.campaign.factors import Factor, Varied, factor, numbers, run_seed
from harness.studies.campaign.stopping import Until
from harness.system.tables import Count, Number, Positive, Text, Whole

MAX_RUNS = 10_000_000
"""Largest number of runs of one campaign; their values are drawn at once."""
SUCCESS = "success"
"""Name of the metric that is true for a run that has succeeded; one that failed has not."""
Values = dict[str, Any]
"""Values of all factors of a run by name."""


# ---- the file of a campaign

Pairs = Annotated[dict[str, Any] | list[Text], Meta(description="a table, or a list of name=value")]
Texts = Annotated[list[Text], Meta(description="a list of texts")]


class Fixed(Struct, frozen=True):
    """Changes of run() that a campaign may fix."""

    params: Text = ""
    set: Pairs = {}
    swap: Pairs = {}
    map: Pairs = {}
    on: Pairs = {}
    latency: Pairs = {}
    step: Number = 0.0
    stop: Number = 0.0
    algorithm: Text = ""
    epoch: Text = ""


CHANGES = {each.name: each.type for each in msgspec.structs.fields(Fixed)}
NAMED = {"swap": Text, "latency": Whole}
"""Changes of one component each, as factors."""


class Record(Struct, frozen=True):
    """Recorded histories: `histories` of every run, `bands` over all runs, in `rows` rows."""

    histories: Texts = []
    bands: Texts = []
    rows: Count = 200


class Table(Struct, frozen=True):
    """Table in the file of a campaign; expected: smallest and largest expected mean of a metric
    over all runs; coordinates: number per run of an analysis; the last entries: tables of analyses.
    """

    system: Text
    runs: Annotated[
        int, Meta(ge=1, le=MAX_RUNS, description=f"a whole number from 1 to {MAX_RUNS}")
    ] = 1
    seed: Annotated[
        int, Meta(ge=0, le=2**63 - 1, description="a whole number from 0 to 2^63 - 1")
    ] = 0
    sampler: Annotated[
        Literal["random", "latin-hypercube", "sobol"],
        Meta(description="random, latin-hypercube or sobol"),
    ] = "random"
    every: Annotated[
        int, Meta(ge=1, le=2**31 - 1, description="a whole number from 1 to 2^31 - 1")
    ] = 1
    patience: Positive = PATIENCE
    executor: Annotated[Literal["c", "python", "fused"], Meta(description="c, python or fused")] = (
        "c"
    )
    seeds: Texts = []
    fixed: Fixed = Fixed()
    factors: dict[str, Varied] = {}
    metrics: dict[str, Text] = {}
    success: Text = ""
    worst: Annotated[str | dict[str, Any], Meta(description="a text or a table")] = ""
    until: Until | None = None
    record: Record = Record()
    expected: dict[
        str,
        Annotated[
            list[Number], Meta(min_length=2, max_length=2, description="[least, largest] mean")
        ],
    ] = {}
    requirements: dict[str, Text] = {}
    coordinates: Whole = 0
    sensitivity: Any = None
    probability: Any = None
    boundary: Any = None
    tune: Any = None

    @property
    def recorded(self) -> tuple[str, ...]:
        """Return the variables with recorded histories."""
        return tuple(dict.fromkeys((*self.record.histories, *self.record.bands)))

    @property
    def texts(self) -> dict[str, str]:
        """Return the expressions of all metrics by name, including `success` if it is defined."""
        return {**self.metrics, **({SUCCESS: self.success} if self.success else {})}


# ---- runs


class Source(NamedTuple):
    """Path of a file or name of a package, and the hash of its content or its version."""

    place: str
    state: str


@dataclass(frozen=True)
class Plan:
    """Checked campaign. definition: the table of its file; folder: folder of the files that the
    table names; sources: see harness.studies.campaign.sources.
    """

    definition: Mapping[str, Any]
    folder: Path
    sources: Mapping[str, Source] = field(default_factory=dict)

    @cached_property
    def table(self) -> Table:
        """Return the table of the definition."""
        return msgspec.convert(self.definition, Table)

    @cached_property
    def system(self) -> Path:
        """Return the path of the .ssp or TOML; a relative path may start at the folder of the
        campaign.
        """
        beside = self.folder / self.table.system
        return find_system(beside if beside.exists() else self.table.system)

    @cached_property
    def digest(self) -> str:
        """Return the hash of all that decides the runs."""
        return hashlib.sha256(json.dumps(self.decisive, sort_keys=True).encode()).hexdigest()

    @cached_property
    def decisive(self) -> dict[str, str]:
        """Return what decides the runs: entries of the table as text, then the sources."""
        found = {}
        for name, given in self.definition.items():
            tables = isinstance(given, Mapping) and given
            for key, value in tables.items() if tables else [("", given)]:
                found[f"{name}.{key}".rstrip(".")] = json.dumps(value, sort_keys=True, default=str)
        return found | {name: source.state for name, source in self.sources.items()}

    @property
    def fixed(self) -> Changes:
        """Return the changes common to all runs, with the requirements of the campaign."""
        changes: dict[str, Any] = dict(self.definition.get("fixed", {}))
        if self.table.requirements:
            changes["require"] = dict(self.table.requirements)
        return changes  # type: ignore[return-value]

    def with_entries(self, **entries: Any) -> Plan:
        """Return the plan with other entries of its table, which are not checked again."""
        return replace(self, definition={**self.definition, **entries})

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """Return all factors without the seeds."""
        return tuple(factor(name, given) for name, given in self.table.factors.items())

    @cached_property
    def listed(self) -> list[Factor]:
        """Return the factors of the grid."""
        return [f for f in self.factors if f.draw is None]

    @cached_property
    def groups(self) -> dict[str, range]:
        """Return the places of the numbers of each drawn factor in a draw."""
        places, first = {}, 0
        for each in self.factors:
            if each.draw is not None:
                places[each.name] = range(first, first + each.draw.numbers)
                first += each.draw.numbers
        return places

    @property
    def cells(self) -> int:
        """Return the number of combinations of the listed values."""
        return math.prod(len(f.choices) for f in self.listed)

    @property
    def runs(self) -> int:
        """Return the number of runs."""
        until = self.table.until
        return self.cells * (until.runs if until else self.table.runs)

    @cached_property
    def _numbers(self) -> NDArray[np.float64]:
        width = sum(map(len, self.groups.values()))
        draws = self.runs // self.cells
        return numbers(self.table.sampler, draws, width, self.table.seed)

    def values(self, run: int) -> Values:
        """Return the values of all factors of a run, the seeds among them."""
        draw, cell = divmod(run, self.cells)
        return self._cell(cell) | self.of_numbers(self._numbers[draw]) | self.seeds_of(draw)

    def of_numbers(self, numbers: NDArray[np.float64]) -> Values:
        """Return the values of the drawn factors for numbers between 0 and 1."""
        draws = {f.name: f.draw for f in self.factors if f.draw}
        return {
            n: draws[n].value(numbers[each.start : each.stop]) for n, each in self.groups.items()
        }

    def seeds_of(self, draw: int) -> Values:
        """Return the seeds of a draw."""
        return {n: run_seed(self.table.seed, draw, k) for k, n in enumerate(self.table.seeds)}

    def structures(self) -> list[int]:
        """Return runs of the first draw, one per combination of factors that change more than
        values.
        """
        shape = [len(f.choices) for f in self.listed]
        ways = [range(len(f.choices)) if kind_of(f.name) else (0,) for f in self.listed]
        return [int(np.ravel_multi_index(w, shape)) if shape else 0 for w in product(*ways)]

    def _cell(self, cell: int) -> Values:
        shape = [len(f.choices) for f in self.listed]
        places = np.unravel_index(cell, shape) if shape else ()
        return {f.name: f.choices[int(k)] for f, k in zip(self.listed, places, strict=True)}

    def whole(self, name: str) -> bool:
        """Return whether all values of a factor are whole numbers."""
        choices = next((f.choices for f in self.factors if f.name == name), ())
        listed = bool(choices) and all(isinstance(choice, int) for choice in choices)
        return listed or name in self.table.seeds

    def changes(self, values: Values) -> Changes:
        """Return the arguments of run() for a run with these values."""
        return joined(self.fixed, changes_of(values))


def kind_of(name: str) -> Any:
    """Return the type of the values of a factor that changes more than values of parameters, else
    None.
    """
    return CHANGES.get(name) or NAMED.get(name.partition(".")[0])


def changes_of(values: Values) -> Changes:
    """Return the arguments of run() for values of factors alone."""
    varied: dict[str, Any] = {}
    for name, value in values.items():
        option, key = option_of(name)
        if key:
            varied.setdefault(option, {})[key] = value
        else:
            varied[option] = value
    return varied  # type: ignore[return-value]


def option_of(factor: str) -> tuple[str, str]:
    """Return the kind of change of a factor, and its target: ("swap", C), ("set", C.NAME), ("stop",
    "").
    """
    if factor in CHANGES:
        return factor, ""
    option, _, rest = factor.partition(".")
    return (option, rest) if option in NAMED else ("set", factor)
