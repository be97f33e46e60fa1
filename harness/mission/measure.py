# SPDX-License-Identifier: BSD-2-Clause
"""Numbers taken from a result: side by side with those of other runs, against limits (Measure), and
while a run goes on (Gauge).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.results.result import Result


@dataclass(frozen=True)
class Limits:
    """The limits for all runs of a comparison.

    position [m], attitude [deg]: an error has settled when it stays within this band (None: the
    mission chooses one); keep_out: smallest permitted range [m], 0: no such limit.
    """

    position: float | None = None
    attitude: float = 1.0
    keep_out: float = 0.0


@dataclass(frozen=True)
class Measure:
    """One column: heading, unit, variables and parameters that it needs, and the function of the
    result and the limits; beside: shown in a table of its own, not among the measures of a page;
    about: what the limits mean for it, the last line of its heading; words: what its values 0, 1,
    .. stand for; apart: a comparison warns where its values differ by more than this factor.
    """

    name: str
    unit: str
    needs: tuple[str, ...]
    value: Callable[[Result, Limits], float]
    parameters: tuple[str, ...] = ()
    beside: bool = False
    about: Callable[[Limits, Mapping[str, Result]], str] | None = None
    words: tuple[str, ...] = ()
    apart: float = math.inf

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


def apart(
    found: Iterable[Measure], columns: Mapping[tuple[str, str], Mapping[str, float]]
) -> Iterator[str]:
    """Measures that differ by more than their factor, a line each."""
    for measure in found:
        column = columns.get((measure.name, measure.unit), {})
        values = {label: x for label, x in column.items() if math.isfinite(x) and x > 0}
        if values and max(values.values()) > measure.apart * min(values.values()):
            most, least = (pick(values, key=values.__getitem__) for pick in (max, min))
            yield (
                f"{measure.name}: {most} {values[most]:.3g} {measure.unit}, {least} "
                f"{values[least]:.3g} {measure.unit}: more than {measure.apart:g} times apart, not "
                "the same actuators"
            )


Array = NDArray[np.float64]


class Gauge(NamedTuple):
    """A quantity of the last row: a variable, or a function of the result that needs some and gives
    a history or, "" for nothing to be shown, a text.
    """

    label: str
    unit: str
    source: str | Callable[[Result], Array | str]
    needs: tuple[str, ...] = ()
    factor: float = 1.0

    def fits(self, result: Result) -> bool:
        """Whether the result holds what it needs."""
        return result.holds(*((self.source,) if isinstance(self.source, str) else self.needs))

    def text(self, result: Result) -> str:
        """The value, with its name where the variable defines names for numbers."""
        values = result[self.source] if isinstance(self.source, str) else self.source(result)
        if isinstance(values, str):
            return values
        value = self.factor * float(np.sum(values[-1]))
        if isinstance(self.source, str) and (name := _name(result.description(self.source), value)):
            return name
        return f"{value:.4g} {self.unit}".rstrip()


def _name(description: str, value: float) -> str:
    """What a number means by a description like `0 coast, 1 align, 2 burn`; "": it does not say."""
    names = dict(re.findall(r"(?:^|, )(\d+) (\w+)", description))
    return names.get(f"{value:g}", "") if re.match(r"0 \w", description) else ""
