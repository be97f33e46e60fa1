# SPDX-License-Identifier: BSD-2-Clause
"""Published case as data: its simulation, the published values, the tolerance, and deliberately
wrong models whose results must be outside the tolerance.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from harness.errors import UsageError
from harness.spelling import did_you_mean

FOLDER = Path(__file__).parent / "cases"


@dataclass(frozen=True)
class Case:
    """Case of cases/*.json.

    id: name of the case; tests: the property of the FMU that the case tests; source: name, place in
    the publication and licence of the values; fmu: the simulated FMU; rows: for each compared
    instant, the time `t` [s] and the expected values by quantity; tolerance, units: largest allowed
    difference and unit per quantity; why: reason for the tolerance; wrong: deliberately wrong
    models, each with a description `what` and the `change` of the setup that makes the model wrong;
    setup: all other entries, for the function that simulates the case.
    """

    id: str
    tests: str
    source: Mapping[str, str]
    fmu: str
    rows: tuple[Mapping[str, Any], ...]
    tolerance: Mapping[str, float]
    units: Mapping[str, str]
    why: str
    wrong: tuple[Mapping[str, Any], ...]
    setup: Mapping[str, Any]

    @classmethod
    def read(cls, entry: Mapping[str, Any]) -> Case:
        """Return the case that an entry of a cases/*.json file describes."""
        rest = dict(entry)
        named: dict[str, Any] = {
            name: rest.pop(name)
            for name in ("id", "tests", "source", "fmu", "tolerance", "units", "why")
        }
        return cls(
            **named, rows=tuple(rest.pop("rows")), wrong=tuple(rest.pop("wrong")), setup=rest
        )

    @property
    def simulation(self) -> str:
        """Return the name of the function that simulates the case, see simulations.SIMULATIONS."""
        return str(self.setup.get("simulation", "held_inputs"))

    def changed(self, change: Mapping[str, Any]) -> Case:
        """Return the case with some entries of its setup replaced. A table such as `parameters` is
        merged with its replacement.
        """
        setup = dict(self.setup)
        for name, value in change.items():
            old = setup.get(name)
            merges = isinstance(old, Mapping) and isinstance(value, Mapping)
            setup[name] = dict(old or {}) | dict(value) if merges else value
        return replace(self, setup=setup)


def cases(names: list[str] | None = None) -> list[Case]:
    """Return the cases with these names, or all cases (None); raise UsageError with close matches
    for an unknown name.
    """
    known = {case.id: case for case in _all()}
    if names is None:
        return list(known.values())
    for name in names:
        if name not in known:
            raise UsageError(f"{name}: there is no such case{did_you_mean(name, known)}")
    return [known[name] for name in names]


def _all() -> Iterator[Case]:
    for path in sorted(FOLDER.glob("*.json")):
        yield from map(Case.read, json.loads(path.read_text(encoding="utf-8"))["cases"])
