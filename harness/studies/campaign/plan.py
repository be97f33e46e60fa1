# SPDX-License-Identifier: BSD-2-Clause
"""The plan of a campaign: of what kind its entries are, and every run of it by its number.

Listed values are combined as a grid, the last factor changing fastest; drawn ones differ from draw
to draw and are the same in every cell of the grid. Run i is cell i % cells of draw i // cells.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.master.changes import Changes, joined
from harness.master.isolated import PATIENCE
from harness.results.result import Result
from harness.ssp.library import find_system
from harness.studies.campaign import factors, metrics
from harness.studies.campaign.factors import Factor, run_seed
from harness.studies.campaign.stopping import Until

Values = dict[str, Any]
"""Values of all factors of a run by name."""


# ---- kinds of entries


class Kind(NamedTuple):
    """What a value must be: a test and its words."""

    holds: Callable[[Any], bool]
    words: str


def is_number(value: Any) -> bool:
    """Whether it is a number that a double holds; true and false are none."""
    return isinstance(value, float) or (is_whole(value) and abs(value) < 2**1023)


def is_whole(value: Any) -> bool:
    """Whether it is a whole number."""
    return isinstance(value, int) and not isinstance(value, bool)


def _is_text(value: Any) -> bool:
    return isinstance(value, str | Path)


def _are_texts(value: Any) -> bool:
    return isinstance(value, Sequence) and not _is_text(value) and all(map(_is_text, value))


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


TEXT = Kind(_is_text, "a text")
TEXT_OR_TABLE = Kind(lambda v: _is_text(v) or _is_table(v), "a text or a table")
TEXTS = Kind(_are_texts, "a list of texts")
TABLE = Kind(_is_table, "a table")
NUMBER = Kind(is_number, "a number")
POSITIVE = Kind(lambda v: is_number(v) and v > 0, "a number above 0")
COUNT = Kind(lambda v: is_whole(v) and v >= 1, "a whole number of at least 1")
STEPS = Kind(lambda v: is_whole(v) and v >= 0, "a whole number of at least 0")
PAIRS = Kind(lambda v: _is_table(v) or _are_texts(v), "a table, or a list of name=value")

ENTRIES = {
    "system": TEXT,
    "sampler": TEXT,
    "fixed": TABLE,
    "factors": TABLE,
    "seeds": TEXTS,
    "metrics": TABLE,
    "success": TEXT,
    "worst": TEXT_OR_TABLE,
    "keep": TABLE,
    "expected": TABLE,
    "requirements": TABLE,
}
MAX_RUNS = 10_000_000
"""Runs of one campaign; their values are drawn at once."""
NUMBERS = {"runs": COUNT, "seed": STEPS, "every": COUNT, "patience": POSITIVE}
LARGEST = {"runs": MAX_RUNS, "seed": 2**64 - 1, "every": 2**31 - 1}
CHANGES = {
    "params": TEXT,
    "set": PAIRS,
    "swap": PAIRS,
    "map": PAIRS,
    "on": PAIRS,
    "latency": PAIRS,
    "step": NUMBER,
    "stop": NUMBER,
    "algorithm": TEXT,
    "epoch": TEXT,
}
"""Changes of run() that a campaign may fix."""
KEPT = {"histories": TEXTS, "bands": TEXTS, "rows": COUNT}
NAMED = {"swap": TEXT, "latency": STEPS}
"""Changes of one component each, as factors."""


def wrong_entries(definition: Mapping[str, Any]) -> Iterator[str]:
    """Entries of a wrong kind, a line each."""
    yield from _wrong("", definition, ENTRIES)
    for name, kinds in (("fixed", CHANGES), ("keep", KEPT)):
        if _is_table(table := definition.get(name, {})):
            yield from _wrong(f"{name}.", table, kinds)
    if _is_table(metrics := definition.get("metrics", {})):
        yield from _wrong("metrics.", metrics, dict.fromkeys(metrics, TEXT))


def wrong_numbers(definition: Mapping[str, Any]) -> Iterator[str]:
    """Numbers of a wrong kind or too large, a line each."""
    yield from _wrong("", definition, NUMBERS)
    for name, most in LARGEST.items():
        given: Any = definition.get(name)
        if is_whole(given) and given > most:
            yield f"{name}: must be at most {most}, not {str(given)[:20]}"


def _wrong(place: str, table: Mapping[str, Any], kinds: Mapping[str, Kind]) -> Iterator[str]:
    for name, kind in kinds.items():
        if name in table and not kind.holds(table[name]):
            yield f"{place}{name}: must be {kind.words}, not {str(table[name])[:80]}"


def wrong_choices(name: str, choices: Sequence[Any]) -> Iterator[str]:
    """Listed values of a factor that are of a wrong kind, a line each."""
    kind = CHANGES.get(name) or NAMED.get(name.partition(".")[0])
    for choice in choices:
        if kind and not kind.holds(choice):
            yield f"must be {kind.words}, not {str(choice)[:80]}"


# ---- runs


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
        """Path of the .ssp or TOML; of a path, beside the campaign."""
        name = str(self.definition["system"])
        beside = self.folder / name
        return find_system(beside if beside.exists() else name)

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
    def executor(self) -> str:
        """Who performs the macro steps of the runs, as for run()."""
        return str(self.definition.get("executor", "c"))

    @property
    def fixed(self) -> Changes:
        """Changes common to all runs, with the requirements of the campaign."""
        changes: dict[str, Any] = dict(self.definition.get("fixed", {}))
        if further := self.definition.get("requirements"):
            changes["require"] = dict(further)
        return changes  # type: ignore[return-value]

    @property
    def asked(self) -> int:
        """Numbers per run of a study that asks on, 0 of a plain campaign."""
        return int(self.definition.get("asked", 0))

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
    def worst(self) -> str:
        """Metric that the worst runs are sorted by, after - from the smallest on; "" if none."""
        given = self.definition.get("worst", "")
        return given if isinstance(given, str) else ""

    @property
    def expected(self) -> Mapping[str, tuple[float, float]]:
        """Least and largest mean over all runs that a metric should have."""
        return {k: (low, high) for k, (low, high) in self.definition.get("expected", {}).items()}

    def with_entries(self, **entries: Any) -> Plan:
        """The plan with other entries of its table, about which nothing is asked again."""
        return replace(self, definition={**self.definition, **entries})

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
        return self.until.runs if self.until else int(self.definition.get("runs", 1))

    @property
    def until(self) -> Until | None:
        """When the campaign has flown enough, None if its runs are counted beforehand."""
        given = self.definition.get("until")
        return Until(**given) if given else None

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self.cells * self.draws

    @cached_property
    def _numbers(self) -> NDArray[np.float64]:
        width = sum(map(len, self.groups.values()))
        return factors.numbers(self.sampler, self.draws, width, self.seed)

    def values(self, run: int) -> Values:
        """Values of all factors of a run, the seeds among them."""
        draw, cell = divmod(run, self.cells)
        values: Values = dict(zip((f.name for f in self.listed), self._cell(cell), strict=True))
        return values | self.of_numbers(self._numbers[draw]) | self.seeds_of(draw)

    @property
    def groups(self) -> dict[str, range]:
        """Places of the numbers of each drawn factor in a draw."""
        places, first = {}, 0
        for each in self.drawn:
            assert each.draw is not None
            places[each.name] = range(first, first + each.draw.numbers)
            first += each.draw.numbers
        return places

    def of_numbers(self, numbers: NDArray[np.float64]) -> Values:
        """Values of the drawn factors that numbers between 0 and 1 stand for."""
        draws = {f.name: f.draw for f in self.drawn if f.draw}
        return {
            n: draws[n].value(numbers[each.start : each.stop]) for n, each in self.groups.items()
        }

    def seeds_of(self, draw: int) -> Values:
        """The seeds of a draw."""
        return {name: run_seed(self.seed, draw, k) for k, name in enumerate(self.seeds)}

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
        varied: dict[str, Any] = {}
        for name, value in values.items():
            option, _, rest = name.partition(".")
            if name in CHANGES:
                varied[name] = value
            else:
                kind, key = (option, rest) if option in NAMED else ("set", name)
                varied.setdefault(kind, {})[key] = value
        return joined(self.fixed, varied)  # type: ignore[arg-type]


def _structural(name: str) -> bool:
    """Whether a factor changes more than values of parameters."""
    return name in CHANGES or name.partition(".")[0] in NAMED


class Layout(NamedTuple):
    """What the dataset needs to know of the results: columns of a row, macro steps of the longest
    run, start [s], macro step [s]; kinds: names, units and texts of variables and parameters;
    requirements: their texts by name.
    """

    columns: tuple[str, ...]
    steps: int
    start: float
    step: float
    kinds: Result
    requirements: Mapping[str, str] = {}
