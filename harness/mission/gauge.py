# SPDX-License-Identifier: BSD-2-Clause
"""A quantity that is shown while a run goes on."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.results.result import Result

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
        """The value, with its name where the variable says what numbers mean."""
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
