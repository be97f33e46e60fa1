# SPDX-License-Identifier: BSD-2-Clause
"""The one kind of number that is taken from a result: columns of a comparison, metrics of a
campaign, gauges of a run and figures of claims are such numbers.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from harness.results.evaluation import evaluate, fitted, history
from harness.results.expressions import parsed
from harness.results.result import Result


@dataclass(frozen=True)
class Number:
    """A number, or its history, taken from a result.

    name, unit: for the reader; needs, parameters: what the result must hold, variables and
    parameters of the run; measure: function of the result, or an expression
    (`max(norm(servicer.v_SN_N))`), whose variables need not be listed.
    """

    name: str
    unit: str
    needs: tuple[str, ...]
    measure: Callable[..., Any] | str
    parameters: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Variables of an expression; TypeError where there is neither function nor expression."""
        if isinstance(self.measure, str):
            names = parsed(self.measure).variables
            needs = [n for n in names if n != "time" and not n.startswith("parameter ")]
            held = [n.partition(" ")[2] for n in names if n.startswith("parameter ")]
            object.__setattr__(self, "needs", tuple(dict.fromkeys((*self.needs, *needs))))
            object.__setattr__(self, "parameters", (*self.parameters, *held))
        elif not callable(self.measure):
            raise TypeError(f"{self.name}: {self.measure!r:.40} is no function and no expression")

    def lacks(self, result: Result) -> list[str]:
        """What it needs and the result does not hold."""
        fixed = [n for n in self.parameters if not result.holds(parameters=(n,))]
        return [name for name in self.needs if name not in result] + fixed

    def __call__(self, result: Result, *further: Any) -> Any:
        """The value; further: what the function takes beside the result."""
        if callable(self.measure):
            return self.measure(result, *further)
        return evaluate(fitted(result, self.measure), partial(history, result))
