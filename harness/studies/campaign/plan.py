# SPDX-License-Identifier: BSD-2-Clause
"""The plan of a campaign: what its file may say, and every run of it by its number.

Listed values are combined as a grid, the last factor changing fastest; drawn ones differ from draw
to draw and are the same in every cell of the grid. Run i is cell i % cells of draw i // cells.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from harness.master.changes import Changes, joined
from harness.master.isolated import PATIENCE
from harness.ssp.library import find_system
from harness.studies.campaign.factors import Factor, Varied, factor, numbers, run_seed
from harness.studies.campaign.stopping import Until
from harness.system.schema import Count, Number, Positive, Text, Whole

MAX_RUNS = 10_000_000
"""Runs of one campaign; their values are drawn at once."""
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


class Keep(Struct, frozen=True):
    """What histories are kept: `histories` of every run, `bands` over all, in `rows` rows."""

    histories: Texts = []
    bands: Texts = []
    rows: Count = 200


class Table(Struct, frozen=True):
    """The file of a campaign; expected: least and largest mean over all runs that a metric should
    have; asked: numbers per run of a study that asks on; the last ones: tables of such studies.
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
    keep: Keep = Keep()
    expected: dict[
        str,
        Annotated[
            list[Number], Meta(min_length=2, max_length=2, description="[least, largest] mean")
        ],
    ] = {}
    requirements: dict[str, Text] = {}
    asked: Whole = 0
    sensitivity: Any = None
    probability: Any = None
    map: Any = None
    tune: Any = None

    @property
    def kept(self) -> tuple[str, ...]:
        """Variables whose histories are wanted."""
        return tuple(dict.fromkeys((*self.keep.histories, *self.keep.bands)))

    @property
    def texts(self) -> dict[str, str]:
        """Texts of all metrics by name, with the success."""
        return {**self.metrics, **({SUCCESS: self.success} if self.success else {})}


# ---- runs


@dataclass(frozen=True)
class Plan:
    """A campaign that makes sense. definition: the table it was read from; folder: where files that
    it names are looked for.
    """

    definition: Mapping[str, Any]
    folder: Path

    @cached_property
    def table(self) -> Table:
        """What the definition says."""
        return msgspec.convert(self.definition, Table)

    @cached_property
    def system(self) -> Path:
        """Path of the .ssp or TOML; of a path, beside the campaign."""
        beside = self.folder / self.table.system
        return find_system(beside if beside.exists() else self.table.system)

    @cached_property
    def digest(self) -> str:
        """Hash of the definition and of the system; runs of equal ones are the same runs."""
        text = json.dumps(self.definition, sort_keys=True, default=str).encode()
        return hashlib.sha256(text + self.system.read_bytes()).hexdigest()

    @property
    def fixed(self) -> Changes:
        """Changes common to all runs, with the requirements of the campaign."""
        changes: dict[str, Any] = dict(self.definition.get("fixed", {}))
        if self.table.requirements:
            changes["require"] = dict(self.table.requirements)
        return changes  # type: ignore[return-value]

    def with_entries(self, **entries: Any) -> Plan:
        """The plan with other entries of its table, about which nothing is asked again."""
        return replace(self, definition={**self.definition, **entries})

    @cached_property
    def factors(self) -> tuple[Factor, ...]:
        """All that varies, but for the seeds."""
        return tuple(factor(name, given) for name, given in self.table.factors.items())

    @cached_property
    def listed(self) -> list[Factor]:
        """Factors of the grid."""
        return [f for f in self.factors if f.draw is None]

    @cached_property
    def groups(self) -> dict[str, range]:
        """Places of the numbers of each drawn factor in a draw."""
        places, first = {}, 0
        for each in self.factors:
            if each.draw is not None:
                places[each.name] = range(first, first + each.draw.numbers)
                first += each.draw.numbers
        return places

    @property
    def cells(self) -> int:
        """Combinations of the listed values."""
        return math.prod(len(f.choices) for f in self.listed)

    @property
    def runs(self) -> int:
        """Number of runs."""
        until = self.table.until
        return self.cells * (until.runs if until else self.table.runs)

    @cached_property
    def _numbers(self) -> NDArray[np.float64]:
        width = sum(map(len, self.groups.values()))
        draws = self.runs // self.cells
        return numbers(self.table.sampler, draws, width, self.table.seed)

    def values(self, run: int) -> Values:
        """Values of all factors of a run, the seeds among them."""
        draw, cell = divmod(run, self.cells)
        return self._cell(cell) | self.of_numbers(self._numbers[draw]) | self.seeds_of(draw)

    def of_numbers(self, numbers: NDArray[np.float64]) -> Values:
        """Values of the drawn factors that numbers between 0 and 1 stand for."""
        draws = {f.name: f.draw for f in self.factors if f.draw}
        return {
            n: draws[n].value(numbers[each.start : each.stop]) for n, each in self.groups.items()
        }

    def seeds_of(self, draw: int) -> Values:
        """The seeds of a draw."""
        return {n: run_seed(self.table.seed, draw, k) for k, n in enumerate(self.table.seeds)}

    def structures(self) -> list[int]:
        """Runs of the first draw, one for every combination of what changes more than values."""
        shape = [len(f.choices) for f in self.listed]
        ways = [range(len(f.choices)) if kind_of(f.name) else (0,) for f in self.listed]
        return [int(np.ravel_multi_index(w, shape)) if shape else 0 for w in product(*ways)]

    def _cell(self, cell: int) -> Values:
        shape = [len(f.choices) for f in self.listed]
        places = np.unravel_index(cell, shape) if shape else ()
        return {f.name: f.choices[int(k)] for f, k in zip(self.listed, places, strict=True)}

    def whole(self, name: str) -> bool:
        """Whether all values of a factor are whole numbers."""
        choices = next((f.choices for f in self.factors if f.name == name), ())
        listed = bool(choices) and all(isinstance(choice, int) for choice in choices)
        return listed or name in self.table.seeds

    def changes(self, values: Values) -> Changes:
        """What run() takes for a run of these values."""
        return joined(self.fixed, changes_of(values))


def kind_of(name: str) -> Any:
    """Type of the values of a factor that changes more than values of parameters, else None."""
    return CHANGES.get(name) or NAMED.get(name.partition(".")[0])


def changes_of(values: Values) -> Changes:
    """What run() takes for values of factors alone."""
    varied: dict[str, Any] = {}
    for name, value in values.items():
        option, key = option_of(name)
        if key:
            varied.setdefault(option, {})[key] = value
        else:
            varied[option] = value
    return varied  # type: ignore[return-value]


def option_of(factor: str) -> tuple[str, str]:
    """The change that a factor is, and of what: ("swap", C), ("set", C.NAME), ("stop", "")."""
    if factor in CHANGES:
        return factor, ""
    option, _, rest = factor.partition(".")
    return (option, rest) if option in NAMED else ("set", factor)
