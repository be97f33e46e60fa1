# SPDX-License-Identifier: BSD-2-Clause
"""A number that is taken from a result, and the limits that runs are held against side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from harness.results.result import Result


@dataclass(frozen=True)
class Limits:
    """What all runs of a comparison are held against.

    position [m], attitude [deg]: an error has settled when it stays within this band (None: the
    mission says which); keep_out: the range must not fall below it [m], 0: no such limit.
    """

    position: float | None = None
    attitude: float = 1.0
    keep_out: float = 0.0


@dataclass(frozen=True)
class Measure:
    """One column: heading, unit, variables and parameters that it needs, and the function of the
    result and the limits; beside: shown in a table of its own, not among the measures of a page.
    """

    name: str
    unit: str
    needs: tuple[str, ...]
    value: Callable[[Result, Limits], float]
    parameters: tuple[str, ...] = ()
    beside: bool = False

    def __call__(self, result: Result, limits: Limits) -> float:
        """The value; NaN if the result does not hold what it needs, or there is no such value."""
        fits = result.holds(*self.needs, parameters=self.parameters)
        return float(self.value(result, limits)) if fits else float("nan")


def measured(
    found: Iterable[Measure], results: Mapping[str, Result], limits: Limits
) -> dict[tuple[str, str], dict[str, float]]:
    """Measures of results by (name, unit), then by the label of the run."""
    return {
        (m.name, m.unit): {label: m(result, limits) for label, result in results.items()}
        for m in found
    }
