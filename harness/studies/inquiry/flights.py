# SPDX-License-Identifier: BSD-2-Clause
"""Flights of independent normal numbers: what optimisers and methods of studies ask.

    with harness.Flights("my.toml", workers=4) as flights:
        margins = flights(np.zeros((1, flights.d)))         # (rows, requirements)

Number k of a row stands for a draw of its factor, z = Phi^-1(u); zeros are the medians of all
draws, the nominal flight.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import StructureError, UsageError
from harness.master.changes import Changes
from harness.master.messages import said_once
from harness.results.requirements import has_slope
from harness.spelling import did_you_mean
from harness.studies.campaign import worker
from harness.studies.campaign.clusters import Workers
from harness.studies.campaign.draft import read_plan, table_of
from harness.studies.campaign.engine import Block, Fly, crew, get_ready
from harness.studies.campaign.factors import SMALLEST
from harness.studies.campaign.plan import Values
from harness.studies.campaign.worker import FAILED, Row

Array = NDArray[np.float64]

LARGEST = 50
"""Flights that are handed to a worker at once, at most."""
UNUSED = ("keep", "sampler", "until", "expected", "success")
"""Entries of a campaign that mean nothing to a study that asks on."""


class Flights:
    """Flights by rows of independent normal numbers, with the crew of a campaign.

    d: numbers of a row; groups: their places by factor; names: requirements, in the order of the
    columns of margins. definition: path of the .toml of a campaign, or the table itself; workers:
    as of campaign(); file: where a table is from, beside which files that it names lie.

    Raises UsageError and StructureError with all that is wrong before the first flight.
    """

    def __init__(
        self,
        definition: str | Path | Mapping[str, Any],
        *,
        workers: int | None = None,
        file: Path | None = None,
        said: Callable[[str], None] = lambda _: None,
    ) -> None:
        if file is None and not isinstance(definition, Mapping):
            file = Path(definition)
        table = {k: v for k, v in table_of(definition).items() if k not in UNUSED}
        self.workers = Workers(workers)
        get_ready(self.workers, worker.__name__)
        with said_once():
            self.plan, self.task = read_plan(table | {"runs": 1}, file)
        if listed := [each.name for each in self.plan.factors if each.draw is None]:
            rule = "listed values cannot be asked about; one file per value, or [fixed]"
            raise StructureError(f"factors.{name}: {rule}" for name in listed)
        self.groups = {name: list(places) for name, places in self.plan.groups.items()}
        self.d = sum(map(len, self.groups.values()))
        if not self.d:
            raise UsageError("factors: nothing is drawn, so there is nothing to ask about")
        self.names = [*self.task.requirements]
        self.reserve(1)
        self.said, self._life = said, ExitStack()
        self._fly: Fly | None = None

    def reserve(self, runs: int) -> None:
        """Reserve this number of runs in a dataset."""
        self.plan = self.plan.with_entries(runs=runs, asked=self.d)
        self.task = replace(self.task, key=self.plan.digest, table=self.plan.table)

    def columns(
        self, of: str | Sequence[str], slope: bool, most: int | None = None
    ) -> dict[str, int]:
        """Places among the margins of the requirements that a study is about, at most so many:
        those named, or all.

        UsageError if one is none, or has no slope although the method needs one.
        """
        if not self.names:
            raise UsageError("there is no requirement to ask about: [requirements] makes one")
        names = [of] if of and isinstance(of, str) else list(of or self.names)
        for name in names[:most]:
            if name not in self.names:
                close = did_you_mean(name, self.names)
                known = f"there are: {', '.join(self.names)}"
                raise UsageError(f"of: there is no requirement {name}{close}; {known}")
            text = self.task.requirements[name]
            if slope and not has_slope(text):
                raise UsageError(
                    f"of: {name} ({text}) is met or not, without a slope that leads there; compare "
                    f'quantities with < or >, or use method = "random"'
                )
        return {name: self.names.index(name) for name in names[:most]}

    def __enter__(self) -> Flights:
        self._fly = self._life.enter_context(crew(self.workers, self.said))
        return self

    def __exit__(self, *error: object) -> None:
        self._life.close()

    def __call__(self, numbers: Array) -> Array:
        """Margins (rows, requirements) of flights of numbers (rows, d): -inf of one that died, NaN
        of a requirement that was not exercised.
        """
        numbers = np.asarray(numbers, dtype=np.float64)
        if numbers.ndim != 2 or numbers.shape[1] != self.d:
            raise UsageError(f"flights: expected numbers (rows, {self.d}), got {numbers.shape}")
        return margins_of(self.fly([self.values(z, k) for k, z in enumerate(numbers)]))

    def moved(self, numbers: Array, count: int = 5) -> str:
        """The factors that a row of numbers moves most, in standard deviations."""
        names: list[str] = []
        for name, places in self.groups.items():
            elements = [f"{name}[{k + 1}]" for k in range(len(places))]
            names += elements if len(places) > 1 else [name]
        order = np.argsort(-np.abs(numbers), kind="stable")[:count]
        return ", ".join(f"{names[k]} {numbers[k]:+.1f} sigma" for k in order)

    def fly(self, values: Sequence[Values]) -> list[Row]:
        """Records of flights of values of the factors, in their order."""
        if self._fly is None:
            raise UsageError("Flights: use them in a with block")
        changes = [self.plan.changes(each) for each in values]
        size = min(LARGEST, -(-len(changes) // (2 * self.workers.processes)))
        blocks = (Block(k, changes[k : k + size]) for k in range(0, len(changes), size or 1))
        flown = dict(self._fly(self.task, blocks))
        return [row for k in sorted(flown) for row in flown[k]]

    def values(self, z: Array, run: int) -> Values:
        """Values of all factors for a row of numbers, and the seeds of the run."""
        from scipy.special import ndtr

        u = np.clip(ndtr(z), SMALLEST, 1 - SMALLEST)
        return self.plan.of_numbers(u) | self.plan.seeds_of(run)

    def changes(self, z: Array, run: int) -> Changes:
        """The keyword arguments of run() for a row of numbers."""
        return self.plan.changes(self.values(z, run))


def exercised(y: Array) -> Array:
    """Margins that are never the worst where there is none."""
    return np.where(np.isnan(y), np.inf, y)


def margins_of(rows: list[Row]) -> Array:
    """Margins (rows, requirements); -inf of all of a flight that died."""
    margins = np.array([row.margins for row in rows], dtype=np.float64)
    died = np.array([row.status == FAILED for row in rows], dtype=bool)
    margins[died] = -np.inf
    return margins
