# SPDX-License-Identifier: BSD-2-Clause
"""A study from its file to its dataset: asks, flies, keeps, answers again.

A generation is told in the order of its rows, so who flies what changes no bit. A study that goes
on asks its generator from the start: flights that the dataset has are answered from it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator
from contextlib import ExitStack
from importlib.metadata import PackageNotFoundError, version
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


class Kept(NamedTuple):
    """Of flights that the dataset has: numbers (runs, d), margins (runs, requirements), status."""

    numbers: Array
    margins: Array
    status: NDArray[np.int8]


class _Flight(NamedTuple):
    """A flight that waits for its block: generation, run, numbers, values of factors, record."""

    generation: int
    run: int
    numbers: Array
    values: Values
    row: Row


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
        self.flights, self.kind, self.path = flights, kind, path
        self.flown, self.generation, self.failed = 0, 0, 0
        self.progress = progress
        self._life = ExitStack()
        self._waiting: list[_Flight] = []
        self.store, self._kept = self._opened(resume)
        self.nominal = self.ask(np.zeros((1, flights.d)))[0]

    def _opened(self, resume: bool) -> tuple[Store, Kept]:
        plan, task = self.flights.plan, self.flights.task
        laid = list(fields(plan, task))
        if resume and self.path.exists():
            store = Store.resumed(self.path, plan.digest, laid, self._life, self.kind)
        else:
            refuse_existing(self.path)
            block = max(1, min(LARGEST_BLOCK, BLOCK_STEPS // task.steps))
            store = Store.create(self.path, plan, block, laid)
            store.group.attrs.update({"kind": self.kind, "versions": _versions()})
            self._life.enter_context(store.alone())
        kept = Kept(*(store.array(n) for n in ("numbers", "margin", "status")))
        kept.margins[kept.status == FAILED] = -np.inf
        return store, kept

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
        try:
            z = next(method)
            while True:
                z = method.send(self.ask(placed(z))[:, columns])
        except StopIteration as end:
            found: T = end.value
            return found

    def ask(self, numbers: Array) -> Array:
        """Margins (rows, requirements) of flights (rows, d), from the dataset or flown."""
        first, last = self.flown, self.flown + len(numbers)
        if last > self.store.runs and not self.store.decided:
            raise UsageError(f"{self.path}: asks for more than its {self.store.runs} flights")
        there = np.flatnonzero(self._kept.status[first:last] != PENDING)
        for k in there:
            self._refuse_other(first + int(k), numbers[k])
        margins = np.full((len(numbers), len(self.flights.names)), np.nan)
        margins[there] = self._kept.margins[first + there]
        missing = np.setdiff1d(np.arange(len(numbers)), there)
        self._fly(numbers, margins, missing)
        self.flown, self.generation = last, self.generation + 1
        if len(numbers) > 1 and np.isneginf(margins).all():
            raise UsageError(f"all {len(numbers)} flights of a generation died; {self._first()}")
        return margins

    def _fly(self, numbers: Array, margins: Array, missing: NDArray[np.intp]) -> None:
        """Fly what is missing, at most a block at once, and keep it block by block."""
        block = self.store.block
        for k in range(0, len(missing), block):
            part = missing[k : k + block]
            runs = [self.flown + int(place) for place in part]
            values = list(map(self.flights.values, numbers[part], runs))
            rows = self.flights.fly(values)
            margins[part] = margins_of(rows)
            self.failed += sum(row.status == FAILED for row in rows)
            each = zip(runs, numbers[part], values, rows, strict=True)
            self._waiting += [_Flight(self.generation, *flight) for flight in each]
            self._write((runs[-1] + 1) // block * block)
            self._say(runs[-1] + 1)
        self._say(self.flown + len(numbers))

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
        if self._kept.numbers[run].tobytes() != np.ascontiguousarray(z).tobytes():
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
        self.store.group.attrs["estimate"] = json.dumps(estimate)
        return self.store

    def close(self) -> None:
        """Keep what waits, let others write."""
        try:
            self._write(self.store.runs)
        finally:
            self._life.close()


def _versions() -> dict[str, str]:
    """Of the packages on which the questions of a method depend."""
    found = {}
    for name in ("cma", "numpy", "scipy"):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
