# SPDX-License-Identifier: BSD-2-Clause
"""Plan of a campaign: the permitted entries of its file, and the values of the factors in each run.

Factors with listed values form a grid of all combinations (cells), the last factor changing
fastest. For each draw, the random factors get new values, and the whole grid is run with them. Run
i is cell i % cells of draw i // cells.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
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
"""Largest number of runs of one campaign, because the values of all runs are drawn at once."""
SUCCESS = "success"
"""Name of the metric that is 1 for a run that succeeded, 0 for a run that did not, and NaN for a
run without a verdict or without a recorded row.
"""
Values = dict[str, Any]
"""Values of all factors of a run by name."""


# ---- the file of a campaign

Pairs = Annotated[dict[str, Any] | list[Text], Meta(description="a table, or a list of name=value")]
Texts = Annotated[list[Text], Meta(description="a list of texts")]


class Fixed(Struct, frozen=True):
    """Table `[fixed]` of a campaign: options of run() that are the same in all runs."""

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
"""Types of the options of run() in `[fixed]`, by name of the option."""
NAMED = {"swap": Text, "latency": Whole}
"""Types of the options that can be a factor for one component, such as `swap.COMPONENT`."""


class Record(Struct, frozen=True):
    """Table `[record]` of a campaign: variables whose time series are recorded in every run
    (histories), variables whose percentile bands over all runs are recorded (bands), and the
    largest number of rows of a time series or band, to which the last row of the run may be added.
    """

    histories: Texts = []
    bands: Texts = []
    rows: Count = 200


class Table(Struct, frozen=True):
    """All entries of the file of a campaign.

    runs: number of draws; every: macro steps per row; patience: limit for one call into a
    third-party FMU [s]; seeds: parameters that get a different seed in each draw; worst: metric by
    which the worst runs are listed, or table of the analysis `worst`; sensitivity: table of the
    analysis `sensitivity`; until: stopping rule in place of `runs`; expected: smallest and largest
    expected mean of a metric over all runs; coordinates: number of standard normal coordinates per
    run, which an analysis sets.
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

    @property
    def recorded(self) -> tuple[str, ...]:
        """Return the variables whose time series are recorded, permanently or until their
        percentile bands are computed.
        """
        return tuple(dict.fromkeys((*self.record.histories, *self.record.bands)))

    @property
    def texts(self) -> dict[str, str]:
        """Return the definitions of all metrics, as the texts in the table, by name of the metric;
        `success` is included if the table defines it.
        """
        return {**self.metrics, **({SUCCESS: self.success} if self.success else {})}


# ---- runs


class Source(NamedTuple):
    """File or package that influences the results of the runs: `place` is the path of the file or
    the name of the package, `state` the hash of the file or the version of the package.
    """

    place: str
    state: str


@dataclass(frozen=True)
class Plan:
    """Campaign whose table has been checked, with the values of the factors in each run.

    definition: the table; folder: folder of the files that the table names; sources: files and
    packages that influence the results of the runs, by name.
    """

    definition: Mapping[str, Any]
    folder: Path
    sources: Mapping[str, Source] = field(default_factory=dict)

    @cached_property
    def table(self) -> Table:
        """Return the definition as a Table, in which missing entries have their default values."""
        return msgspec.convert(self.definition, Table)

    @cached_property
    def system(self) -> Path:
        """Return the path of the file of the system (.ssp or TOML). A relative path is searched in
        the folder of the campaign first.
        """
        beside = self.folder / self.table.system
        return find_system(beside if beside.exists() else self.table.system)

    @cached_property
    def digest(self) -> str:
        """Return the hash of all data that determine the runs, see `decisive`."""
        return hashlib.sha256(json.dumps(self.decisive, sort_keys=True).encode()).hexdigest()

    @cached_property
    def decisive(self) -> dict[str, str]:
        """Return all data that determine the runs, as texts by name: the entries of the table as
        JSON, and the hashes of files and versions of packages.
        """
        found = {}
        for name, given in self.definition.items():
            tables = isinstance(given, Mapping) and given
            for key, value in tables.items() if tables else [("", given)]:
                found[f"{name}.{key}".rstrip(".")] = json.dumps(value, sort_keys=True, default=str)
        return found | {name: source.state for name, source in self.sources.items()}

    @property
    def fixed(self) -> Changes:
        """Return the changes that are the same in all runs: the table `[fixed]` and the
        requirements of the campaign.
        """
        changes: dict[str, Any] = dict(self.definition.get("fixed", {}))
        if self.table.requirements:
            changes["require"] = dict(self.table.requirements)
        return changes  # type: ignore[return-value]

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """Return all listed and random factors, without the seeds."""
        return tuple(factor(name, given) for name, given in self.table.factors.items())

    @cached_property
    def listed(self) -> list[Factor]:
        """Return the factors with listed values, which form the grid."""
        return [f for f in self.factors if f.draw is None]

    @cached_property
    def groups(self) -> dict[str, range]:
        """Return, by name of a random factor, the indices of the numbers that it uses. A draw is a
        row of random numbers between 0 and 1 for all factors.
        """
        places, first = {}, 0
        for each in self.factors:
            if each.draw is not None:
                places[each.name] = range(first, first + each.draw.numbers)
                first += each.draw.numbers
        return places

    @property
    def cells(self) -> int:
        """Return the number of cells of the grid: combinations of the listed values."""
        return math.prod(len(f.choices) for f in self.listed)

    @property
    def runs(self) -> int:
        """Return the planned number of runs: cells of the grid times draws."""
        until = self.table.until
        return self.cells * (until.runs if until else self.table.runs)

    @cached_property
    def _numbers(self) -> NDArray[np.float64]:
        width = sum(map(len, self.groups.values()))
        draws = self.runs // self.cells
        return numbers(self.table.sampler, draws, width, self.table.seed)

    def values(self, run: int) -> Values:
        """Return the values of all factors in the run with the number `run` by name, including the
        seeds.
        """
        draw, cell = divmod(run, self.cells)
        return self._cell(cell) | self.of_numbers(self._numbers[draw]) | self.seeds_of(draw)

    def of_numbers(self, numbers: NDArray[np.float64]) -> Values:
        """Return the values of all random factors by name, for the row of numbers between 0 and 1
        of one draw.
        """
        draws = {f.name: f.draw for f in self.factors if f.draw}
        return {
            n: draws[n].value(numbers[each.start : each.stop]) for n, each in self.groups.items()
        }

    def seeds_of(self, draw: int) -> Values:
        """Return the seeds in a draw, by the name of the parameter that is set to the seed."""
        return {n: run_seed(self.table.seed, draw, k) for k, n in enumerate(self.table.seeds)}

    def structures(self) -> list[int]:
        """Return the number of one run for each combination of values of those listed factors
        that are options, such as swaps. These runs belong to the first draw, and listed parameters
        have their first values in them.
        """
        shape = [len(f.choices) for f in self.listed]
        ways = [range(len(f.choices)) if kind_of(f.name) else (0,) for f in self.listed]
        return [int(np.ravel_multi_index(w, shape)) if shape else 0 for w in product(*ways)]

    def _cell(self, cell: int) -> Values:
        shape = [len(f.choices) for f in self.listed]
        places = np.unravel_index(cell, shape) if shape else ()
        return {f.name: f.choices[int(k)] for f, k in zip(self.listed, places, strict=True)}

    def whole(self, name: str) -> bool:
        """Return whether a factor is a seed, or lists only whole numbers."""
        choices = next((f.choices for f in self.factors if f.name == name), ())
        listed = bool(choices) and all(isinstance(choice, int) for choice in choices)
        return listed or name in self.table.seeds

    def changes(self, values: Values) -> Changes:
        """Return the keyword arguments of run() for a run with these values of the factors."""
        return joined(self.fixed, changes_of(values))


def kind_of(name: str) -> Any:
    """Return the type of the values of a factor that is an option of run(), such as `step` or
    `swap.COMPONENT`; None for a factor that is a parameter.
    """
    return CHANGES.get(name) or NAMED.get(name.partition(".")[0])


def changes_of(values: Values) -> Changes:
    """Return the keyword arguments of run() for values of factors, without the fixed changes."""
    varied: dict[str, Any] = {}
    for name, value in values.items():
        option, key = option_of(name)
        if key:
            varied.setdefault(option, {})[key] = value
        else:
            varied[option] = value
    return varied  # type: ignore[return-value]


def option_of(factor: str) -> tuple[str, str]:
    """Return the option of run() that a factor changes, and the name of the changed entry in this
    option: ("set", "component.parameter"), ("swap", "component"); ("stop", "") for an option
    without entries.
    """
    if factor in CHANGES:
        return factor, ""
    option, _, rest = factor.partition(".")
    return (option, rest) if option in NAMED else ("set", factor)
