# SPDX-License-Identifier: BSD-2-Clause
"""What the studies have in common: their tables, `[worst]` in the file of a campaign, with all that
is wrong with them, how they begin, and what they leave.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import StructureError, UsageError
from harness.spelling import did_you_mean
from harness.studies.campaign.campaign import Campaign
from harness.studies.campaign.draft import table_of
from harness.studies.campaign.plan import is_number
from harness.studies.inquiry.driver import Driver
from harness.studies.inquiry.flights import Flights

Array = NDArray[np.float64]
Said = Callable[[str], None]

ENTRIES: dict[str, dict[str, Any]] = {
    "sensitivity": {"of": [], "method": "morris", "flights": 130},
    "worst": {"of": [], "flights": 200, "box": 3.0, "searches": 1},
    "probability": {"of": "", "method": "subset", "flights": 20_000, "below": 0.0, "centres": ""},
    "map": {"of": "", "factors": [], "flights": 100},
    "tune": {"of": [], "gains": {}, "draws": 24, "archive": "", "flights": 2400, "box": 3.0},
}
"""Entries of the tables of studies with what they are if they are not given."""
METHODS = {
    "sensitivity": ("morris", "sobol"),
    "probability": ("subset", "random", "importance"),
}


class Study(Campaign):
    """A study that is over. estimate: what was found, by requirement, as plain data."""

    @property
    def kind(self) -> str:
        """Sensitivity, worst, probability, map, tune or given."""
        return str(self.store.group.attrs["kind"])

    @property
    def estimate(self) -> dict[str, Any]:
        """What was found, as plain data."""
        found: dict[str, Any] = json.loads(self.store.group.attrs["estimate"])
        return found

    def summary(self) -> str:
        """What was found, for reading."""
        from harness.studies.inquiry.summary import text

        return text(self.kind, self.estimate, self.store, str(self.path))

    @property
    def verdict(self) -> bool:
        """Whether nothing was found that gives the exit status 1."""
        found = self.estimate["of"].values()
        if self.kind == "worst":
            return all(each["margin"] >= 0 for each in found)
        return all(each.get("verdict", "met") == "met" for each in found)


def entries(kind: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """The table of a study with its defaults; StructureError with all that is wrong with it."""
    given = table.get(kind, {})
    if not isinstance(given, Mapping):
        raise StructureError([f"{kind}: must be a table here, not {given!r:.60}"])
    if problems := list(_wrong(kind, given)):
        raise StructureError(problems)
    return {**ENTRIES[kind], **given}


def _wrong(kind: str, given: Mapping[str, Any]) -> Iterator[str]:
    known = ENTRIES[kind]
    for name, value in given.items():
        if name not in known:
            yield f"{kind}.{name}: there is no such entry{did_you_mean(name, known)}"
        elif words := _expected(name, known[name], value):
            yield f"{kind}.{name}: expected {words}, got {value!r:.60}"
    method = given.get("method", METHODS.get(kind, ("",))[0])
    if kind in METHODS and method not in METHODS[kind]:
        close = did_you_mean(str(method), METHODS[kind])
        yield f"{kind}.method: there is no {method}{close}; expected {', '.join(METHODS[kind])}"


def _expected(name: str, wanted: Any, value: Any) -> str:
    """What an entry must be that is `wanted` where it is not given; "" if it is that."""
    if isinstance(wanted, float):
        if not is_number(value) or not value > 0:
            return "a number above 0"
        return "a probability, below 1" if name == "below" and value >= 1 else ""
    if isinstance(wanted, int):
        whole = is_number(value) and value == int(value) and value >= 1
        return "" if whole else "a whole number above 0"
    either = (str, list) if name == "of" else type(wanted)
    return "" if isinstance(value, either) else f"a {type(wanted).__name__}"


@contextmanager
def begun(
    kind: str,
    flights: Flights,
    runs: int,
    output: str | Path,
    how: Mapping[str, Any],
) -> Iterator[Driver]:
    """The driver of a study of so many flights beside the nominal one."""
    flights.reserve(1 + runs)
    with flights:
        driver = Driver(flights, Path(output), kind, how.get("resume", False), how.get("progress"))
        try:
            yield driver
        finally:
            driver.close()


def prepared(kind: str, definition: Any, how: Mapping[str, Any]) -> tuple[dict[str, Any], Flights]:
    """The entries of a study with its flights."""
    entry = entries(kind, table_of(definition))
    flights = Flights(definition, workers=how.get("workers"), said=how.get("said", lambda _: None))
    return entry, flights


def say_nominal(driver: Driver, of: Mapping[str, int], said: Said) -> None:
    """Say which requirements the nominal flight fails; UsageError if it does not exercise one."""
    for name, k in of.items():
        margin = driver.nominal[k]
        if np.isnan(margin):
            raise UsageError(f"{name}: the nominal flight does not exercise it")
        if margin < 0:
            said(f"{name}: the nominal flight fails already, with a margin of {margin:.4g}")


def plain(value: Any) -> Any:
    """Plain data that JSON holds."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [plain(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value
