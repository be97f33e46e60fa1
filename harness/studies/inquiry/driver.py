# SPDX-License-Identifier: BSD-2-Clause
"""A study from its file to its dataset: asks, flies, keeps, answers again.

A generation is told in the order of its rows, so who flies what changes no bit. A study that goes
on asks its generator from the start: flights that the dataset has are answered from it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from contextlib import ExitStack
from importlib.metadata import version
from importlib.util import find_spec
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.files.signals import held
from harness.spelling import one_line
from harness.studies.campaign.campaign import Progress
from harness.studies.campaign.layout import fields
from harness.studies.campaign.plan import Values
from harness.studies.campaign.store import Store, refuse_existing
from harness.studies.campaign.worker import FAILED, PENDING, Row
from harness.studies.inquiry.flights import Flights, margins_of

Array = NDArray[np.float64]
T = TypeVar("T")

LARGEST_BLOCK, BLOCK_STEPS = 200, 500_000
"""Flights of a block, which is written together, and their macro steps, at most: some seconds of
work, which is what a kill costs.
"""


class _Flight(NamedTuple):
    """A flight that waits for its block: generation, run, numbers, values of factors, record."""

    generation: int
    run: int
    numbers: Array
    values: Values
    row: Row


def answered(method: Generator[Array, Array, T], ask: Callable[[Array], Array]) -> T:
    """What a method returns whose questions are answered."""
    try:
        z = next(method)
        while True:
            z = method.send(ask(z))
    except StopIteration as end:
        found: T = end.value
        return found


class Driver:
    """The dataset of a study and the flights that go into it.

    flown: flights so far; nominal: margins of the nominal flight, which is run 0.
    """

    def __init__(
        self,
        flights: Flights,
        path: Path,
        kind: str,
        resume: bool = False,
        progress: Callable[[Progress], None] | None = None,
    ) -> None:
        self.flights, self.path, self.progress = flights, path, progress
        self.flown, self.generation, self.failed = 0, 0, 0
        self._life = ExitStack()
        self._waiting: list[_Flight] = []
        plan, task = flights.plan, flights.task
        laid = list(fields(plan, task))
        if resume and path.exists():
            self.store = Store.resumed(path, plan.digest, laid, self._life, kind)
        else:
            refuse_existing(path)
            block = max(1, min(LARGEST_BLOCK, BLOCK_STEPS // task.steps))
            self.store = Store.create(path, plan, block, laid)
            self.store.group.attrs.update({"kind": kind, "versions": _versions()})
            self._life.enter_context(self.store.alone())
        names = ("numbers", "margin", "status")
        self._numbers, self._margins, self._status = map(self.store.array, names)
        self._margins[self._status == FAILED] = -np.inf
        self.nominal = self.ask(np.zeros((1, flights.d)))[0]

    # ---- flights

    def answer(
        self,
        method: Generator[Array, Array, T],
        columns: int | list[int],
        placed: Callable[[Array], Array] = lambda z: z,
    ) -> T:
        """What a method returns that is told the margins of one requirement, or of several; placed:
        the numbers of flights that it means.
        """
        return answered(method, lambda z: self.ask(placed(z))[:, columns])

    def ask(self, numbers: Array) -> Array:
        """Margins (rows, requirements) of flights (rows, d), from the dataset or flown."""
        first, last = self.flown, self.flown + len(numbers)
        if last > self.store.runs and not self.store.decided:
            raise UsageError(f"{self.path}: asks for more than its {self.store.runs} flights")
        there = np.flatnonzero(self._status[first:last] != PENDING)
        for k in there:
            self._refuse_other(first + int(k), numbers[k])
        margins = np.full((len(numbers), len(self.flights.names)), np.nan)
        margins[there] = self._margins[first + there]
        missing = np.setdiff1d(np.arange(len(numbers)), there)
        for start in range(0, len(missing), self.store.block):
            part = missing[start : start + self.store.block]
            margins[part] = self._fly(numbers[part], [first + int(place) for place in part])
        self._say(last)
        self.flown, self.generation = last, self.generation + 1
        if len(numbers) > 1 and np.isneginf(margins).all():
            raise UsageError(f"all {len(numbers)} flights of a generation died; {self._first()}")
        return margins

    def _fly(self, numbers: Array, runs: list[int]) -> Array:
        """Margins of flights that were not there, at most a block; full blocks are kept."""
        values = list(map(self.flights.values, numbers, runs))
        rows = self.flights.fly(values)
        self.failed += sum(row.status == FAILED for row in rows)
        each = zip(runs, numbers, values, rows, strict=True)
        self._waiting += [_Flight(self.generation, *flight) for flight in each]
        self._write((runs[-1] + 1) // self.store.block * self.store.block)
        self._say(runs[-1] + 1)
        return margins_of(rows)

    def _say(self, done: int) -> None:
        if self.progress is not None:
            self.progress(Progress(done, self.store.runs, self.failed))

    def _write(self, end: int) -> None:
        """Write what waits of the runs before this one, consecutive ones together."""
        part = [flight for flight in self._waiting if flight.run < end]
        self._waiting = self._waiting[len(part) :]
        for _, each in groupby(enumerate(part), lambda placed: placed[1].run - placed[0]):
            stretch = [flight for _, flight in each]
            further: dict[str, list[Any]] = {
                "numbers": [flight.numbers for flight in stretch],
                "generation": [flight.generation for flight in stretch],
            }
            values, rows = [f.values for f in stretch], [f.row for f in stretch]
            with held():  # a block is written whole
                self.store.write(stretch[0].run, values, rows, further)

    def _refuse_other(self, run: int, z: Array) -> None:
        """UsageError if a flight of the dataset is not the one that is asked for."""
        if self._numbers[run].tobytes() != np.ascontiguousarray(z).tobytes():
            then = self.store.group.attrs.get("versions", {})
            raise UsageError(
                f"{self.path}: run {run} was asked by other versions ({then}; now {_versions()})"
            )

    def _first(self) -> str:
        messages = [f.row.message for f in self._waiting if f.row.status == FAILED]
        messages += [m for m in self.store.array("message") if m]
        return f"the first one: {one_line(messages[0])}" if messages else ""

    # ---- the end

    def finish(self, estimate: dict[str, Any]) -> Store:
        """Write what waits, forget what was not flown, keep what was found."""
        self._write(self.flown)
        if not self.store.decided:
            self.store.shorten(self.flown)
        keep(self.store, estimate)
        return self.store

    def close(self) -> None:
        """Keep what waits, let others write."""
        try:
            self._write(self.store.runs)
        finally:
            self._life.close()


def keep(store: Store, estimate: dict[str, Any]) -> None:
    """Keep what was found, numbers of numpy as plain ones."""
    store.group.attrs["estimate"] = json.dumps(estimate, default=lambda value: value.tolist())


def _versions() -> dict[str, str]:
    """Of the packages on which the questions of a method depend."""
    names = ("cma", "numpy", "scipy")
    return {name: version(name) for name in names if find_spec(name) is not None}
