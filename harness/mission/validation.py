# SPDX-License-Identifier: BSD-2-Clause
"""Numbers made by others that a mission answers with its own, and how they are compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple


@dataclass(frozen=True)
class Row:
    """One quantity of one case: the largest difference over its rows, in `unit`.

    case: its name; tests: what it tests; source: name, where, licence of the numbers.
    """

    case: str
    tests: str
    source: Mapping[str, str]
    quantity: str
    difference: float
    tolerance: float
    unit: str

    @property
    def within(self) -> bool:
        """Whether we agree; a difference that is not a number does not."""
        return self.difference <= self.tolerance


class Validation(NamedTuple):
    """Cases: names: of all; answer: rows of the case of a name."""

    names: Callable[[], Sequence[str]]
    answer: Callable[[Sequence[str]], Sequence[Row]]
