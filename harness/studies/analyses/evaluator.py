# SPDX-License-Identifier: BSD-2-Clause
"""Evaluator that performs one run per row of standard normal coordinates and returns the margins of
the requirements, for optimisers and analyses.

    with harness.Evaluator("my.toml", workers=4) as evaluator:
        margins = evaluator(np.zeros((1, evaluator.d)))     # (rows, requirements)

A row contains the coordinates z of all random factors of one run. A factor is drawn from numbers u
between 0 and 1, one per coordinate: u = Phi(z). A row of zeros gives the median of every factor:
the nominal run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import StructureError, UsageError
from harness.master.changes import Changes
from harness.master.messages import logged_once
from harness.results.requirements import has_slope
from harness.results.result import Array
from harness.spelling import did_you_mean
from harness.studies.campaign import worker
from harness.studies.campaign.draft import read_plan, table_of
from harness.studies.campaign.engine import Block, RunBlocks, prestart, processes, worker_pool
from harness.studies.campaign.factors import SMALLEST
from harness.studies.campaign.plan import Values
from harness.studies.campaign.worker import Row
from harness.studies.reuse import compiling

LARGEST = 50
"""Largest number of runs per task of a worker."""
UNUSED = ("record", "sampler", "until", "expected", "success")
"""Entries in the file of a campaign that analyses ignore, besides `runs`."""


class Evaluator:
    """Function from standard normal coordinates to the margins of the requirements. It performs one
    run per row of coordinates with the worker pool of a campaign.

    Attributes: d: number of coordinates of a row; groups: indices of the coordinates of each
    factor, by its name; names: requirements in the order of the columns of the margins. Arguments:
    definition: path of the .toml of a campaign, or the table itself; workers, lanes, notify: as for
    campaign().

    Raises UsageError, or StructureError with all problems of the table, before the first run.
    """

    def __init__(
        self,
        definition: str | Path | Mapping[str, Any],
        *,
        workers: int | None = None,
        lanes: bool = True,
        notify: Callable[[str], None] = lambda _: None,
    ) -> None:
        file = None if isinstance(definition, Mapping) else Path(definition)
        table = {k: v for k, v in table_of(definition).items() if k not in UNUSED}
        self.workers = workers
        prestart(workers, worker.__name__)
        with logged_once():
            self.plan, task = read_plan(table | {"runs": 1}, file)
        self.task = task.in_lanes(lanes, notify)
        if listed := [each.name for each in self.plan.factors if each.draw is None]:
            rule = (
                "a study cannot vary a list or range; move it to [fixed] or write one file "
                "per value"
            )
            raise StructureError(f"factors.{name}: {rule}" for name in listed)
        self.groups = {name: list(places) for name, places in self.plan.groups.items()}
        self.d = sum(map(len, self.groups.values()))
        if not self.d:
            raise UsageError(
                "factors: no random factor is defined; add one, such as `uniform = "
                "{low = 0, high = 1}`"
            )
        self.names = [*self.task.requirements]
        self.reserve(1)
        self.notify, self._life = notify, ExitStack()
        self._run_blocks: RunBlocks | None = None

    def reserve(self, runs: int) -> None:
        """Set the planned number of runs, which is the length of the arrays in the dataset."""
        entries = {**self.plan.definition, "runs": runs, "coordinates": self.d}
        self.plan = replace(self.plan, definition=entries)
        self.task = replace(self.task, key=self.plan.digest, table=self.plan.table)

    def columns(self, of: str | Sequence[str], slope: bool) -> dict[str, int]:
        """Return the index of the column of each requirement in the margins, by name of the
        requirement.

        of: name or names of the requirements ("": all); slope: reject requirements whose margin is
        not a number that changes gradually. Raises UsageError for an unknown or rejected
        requirement.
        """
        if not self.names:
            raise UsageError(
                "the system has no requirement; define one in [requirements] of the campaign"
            )
        names = [of] if of and isinstance(of, str) else list(of or self.names)
        for name in names:
            if name not in self.names:
                close = did_you_mean(name, self.names)
                known = ", ".join(self.names)
                raise UsageError(f"of: there is no requirement {name}{close}; expected {known}")
            text = self.task.requirements[name]
            if slope and not has_slope(text):
                raise UsageError(
                    f"of: the margin of {name} ({text}) does not change gradually, as a search "
                    "needs; compare quantities with < or >"
                )
        return {name: self.names.index(name) for name in names}

    def __enter__(self) -> Evaluator:
        plan = self.plan
        if self.task.lanes:
            steps = plan.runs * self.task.steps
            self._life.enter_context(compiling(plan.system, plan.fixed, steps))
        self._run_blocks = self._life.enter_context(worker_pool(self.workers))
        return self

    def __exit__(self, *error: object) -> None:
        self._life.close()

    def __call__(self, numbers: Array) -> Array:
        """Perform a run for each row of coordinates (rows, d); return the margins (rows,
        requirements): -inf for a failed run, NaN if not exercised or not judged.
        """
        numbers = np.asarray(numbers, dtype=np.float64)
        if numbers.ndim != 2 or numbers.shape[1] != self.d:
            raise UsageError(
                f"Evaluator: expected an array of shape (rows, {self.d}), got {numbers.shape}"
            )
        return margins_of(self.run([self.values(z, k) for k, z in enumerate(numbers)]))

    def moved(self, numbers: Array) -> str:
        """Return a text with the five coordinates of a row (d,) that are farthest from 0: name of
        the factor and coordinate in standard deviations.
        """
        names: list[str] = []
        for name, places in self.groups.items():
            elements = [f"{name}[{k + 1}]" for k in range(len(places))]
            names += elements if len(places) > 1 else [name]
        order = np.argsort(-np.abs(numbers), kind="stable")[:5]
        return ", ".join(f"{names[k]} {numbers[k]:+.1f} sigma" for k in order)

    def run(self, values: Sequence[Values]) -> list[Row]:
        """Perform a run for each dictionary of factor values; return the rows of the dataset for
        these runs, in the same order.
        """
        if self._run_blocks is None:
            raise UsageError(
                "Evaluator: use it in a with block, `with Evaluator(...) as evaluator:`"
            )
        changes = [self.plan.changes(each) for each in values]
        share = -(-len(changes) // (2 * processes(self.workers)))
        size = self.task.block(min(LARGEST, share))
        blocks = (Block(k, changes[k : k + size]) for k in range(0, len(changes), size))
        completed = dict(self._run_blocks(self.task, blocks))
        return [row for k in sorted(completed) for row in completed[k]]

    def values(self, z: Array, run: int) -> Values:
        """Return the values of all factors, by name, for a row of coordinates z (d,), including the
        seeds for the run with the number `run`.
        """
        from scipy.special import ndtr

        u = np.clip(ndtr(z), SMALLEST, 1 - SMALLEST)
        return self.plan.of_numbers(u) | self.plan.seeds_of(run)

    def changes(self, z: Array, run: int) -> Changes:
        """Return the keyword arguments of harness.run() for a row of coordinates z (d,), with the
        seeds for the run with the number `run`.
        """
        return self.plan.changes(self.values(z, run))


def margins_of(rows: list[Row]) -> Array:
    """Return the margins (rows, requirements) that the rows of a dataset record; -inf for a failed
    run.
    """
    return np.array([row.margins for row in rows], dtype=np.float64)
