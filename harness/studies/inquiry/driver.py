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
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.files.signals import held
from harness.spelling import one_line
from harness.studies.campaign.campaign import Progress
from harness.studies.campaign.store import Store, refuse_existing
from harness.studies.campaign.worker import FAILED, PENDING, Row
from harness.studies.inquiry.flights import Flights, margins_of

Array = NDArray[np.float64]
T = TypeVar("T")

LEAST_BLOCK, BLOCKS, LARGEST_BLOCK = 16, 32, 200
"""Flights of a block, which is written together: between so many, a part of the budget."""


class Kept(NamedTuple):
    """Of flights that the dataset has: numbers (runs, d), margins (runs, requirements), status."""

    numbers: Array
    margins: Array
    status: NDArray[np.int8]


class Driver:
    """The dataset of a study and the flights that go into it.

        flown: flights so far; heard: is told the numbers and margins of every generation; nominal:
    margins of the nominal flight, which is run 0.
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
        self.heard: Callable[[Array, Array], None] = lambda *_: None
        self.progress = progress
        self._life = ExitStack()
        self._rows: list[Row] = []
        self._asked: list[tuple[Array, int, int]] = []
        self.store, self._kept = self._opened(resume)
        self.nominal = self.ask(np.zeros((1, flights.d)))[0]

    def _opened(self, resume: bool) -> tuple[Store, Kept]:
        plan, task, found = self.flights.plan, self.flights.task, self.flights.found
        if resume and self.path.exists():
            store = Store.open(self.path)
            attributes = store.group.attrs
            if attributes.get("kind") != self.kind or attributes["digest"] != plan.digest:
                raise UsageError(
                    f"{self.path}: is no {self.kind} of this file and of this state of its system"
                )
            self._life.enter_context(store.alone())
            if not store.decided:
                store.mend(plan, task, found)
        else:
            refuse_existing(self.path)
            block = max(LEAST_BLOCK, min(LARGEST_BLOCK, plan.runs // BLOCKS))
            store = Store.create(self.path, plan, task, block, found)
            store.group.attrs.update({"kind": self.kind, "versions": _versions()})
            self._life.enter_context(store.alone())
        kept = Kept(*(store.array(n) for n in ("numbers", "margin", "status")))
        kept.margins[kept.status == FAILED] = -np.inf
        return store, kept

    # ---- flights

    def answer(self, method: Generator[Array, Array, T], columns: int | list[int]) -> T:
        """What a method returns that is told the margins of one requirement, or of several."""
        try:
            numbers = next(method)
            while True:
                numbers = method.send(self.ask(numbers)[:, columns])
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
        self.heard(numbers, margins)
        if len(numbers) > 1 and np.isneginf(margins).all():
            raise UsageError(f"all {len(numbers)} flights of a generation died; {self._first()}")
        return margins

    def _fly(self, numbers: Array, margins: Array, missing: NDArray[np.intp]) -> None:
        """Fly what is missing, in stretches of consecutive runs, and keep it block by block."""
        block = self.store.block
        for run in missing:
            self._asked.append((numbers[run], self.flown + int(run), self.generation))
        if len(missing):
            rows = []
            stretches = np.split(missing, np.flatnonzero(np.diff(missing) > 1) + 1)
            for part in stretches:
                rows += self.flights.rows(numbers[part], self.flown + int(part[0]))
            margins[missing] = margins_of(rows)
            self._rows += rows
            self.failed += sum(row.status == FAILED for row in rows)
        while self._asked and (n := self._full(block)):
            self._write(n)
        if self.progress is not None:
            done = self.flown + len(numbers)
            self.progress(Progress(done, self.store.runs, self.failed))

    def _full(self, block: int) -> int:
        """Flights that wait and end a block of the dataset, 0 if none do."""
        for k, (_, run, _) in enumerate(self._asked, 1):
            consecutive = k < len(self._asked) and self._asked[k][1] == run + 1
            if (run + 1) % block == 0 or (k < len(self._asked) and not consecutive):
                return k
        return 0

    def _write(self, count: int) -> None:
        part, rows = self._asked[:count], self._rows[:count]
        self._asked, self._rows = self._asked[count:], self._rows[count:]
        values = [self.flights.values(z, run) for z, run, _ in part]
        further: dict[str, list[Any]] = {
            "numbers": [z for z, _, _ in part],
            "generation": [generation for _, _, generation in part],
        }
        with held():  # a block is written whole
            self.store.write(part[0][1], values, rows, further)

    def _refuse_other(self, run: int, z: Array) -> None:
        """UsageError if a flight of the dataset is not the one that is asked for."""
        if self._kept.numbers[run].tobytes() != np.ascontiguousarray(z).tobytes():
            then = self.store.group.attrs.get("versions", {})
            raise UsageError(
                f"{self.path}: run {run} was asked by other versions ({then}; now {_versions()})"
            )

    def _first(self) -> str:
        messages = [row.message for row in self._rows if row.status == FAILED]
        messages += [m for m in self.store.array("message") if m]
        return f"the first one: {one_line(messages[0])}" if messages else ""

    # ---- the end

    def finish(self, estimate: dict[str, Any]) -> Store:
        """Write what waits, forget what was not flown, keep what was found."""
        if self._asked:
            self._write(len(self._asked))
        if not self.store.decided:
            self.store.shorten(self.flown)
        self.store.group.attrs["estimate"] = json.dumps(estimate)
        return self.store

    def close(self) -> None:
        """Keep what waits, let others write."""
        try:
            if self._asked:
                self._write(len(self._asked))
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
