# SPDX-License-Identifier: BSD-2-Clause
"""Rewards and ends of episodes: one program of the requirements, the reward, the cost and the
conditions, evaluated in the recorded row.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from harness.errors import UsageError
from harness.learning.spaces import FAR
from harness.results.evaluation import fitted, history, unit_in
from harness.results.expressions import Node
from harness.results.margins import Requirement
from harness.results.program import Program, is_per_row
from harness.results.result import Result
from harness.results.rows import RowProgram

Weights = Mapping[str, float] | float
"""Factors of violated requirements: one for all, or by name."""


class Scoring:
    """Values of a row: the reward without the cost, the cost so far, whether the episode is over,
    the intervention of a shield, whether each of the `ends` holds, and the margins of the
    `requirements`.
    """

    def __init__(
        self,
        result: Result,
        requirements: Mapping[str, str],
        worth: tuple[str, str, Weights],
        ends: tuple[Sequence[str] | None, Sequence[str]],
        intervention: str,
    ) -> None:
        """Compile what is evaluated; worth: reward, cost, weights; ends: names of requirements and
        conditions (None: all requirements), and further ones. Raises UsageError.
        """
        self._result, self._program = result, Program()
        add, zero = self._program.add, self._program.number(0)
        trees = {name: fitted(result, text) for name, text in requirements.items()}
        margins = {n: self._margin(tree) for n, tree in trees.items() if is_per_row(tree)}
        self.requirements = tuple(margins)
        given_ends, further = ends
        self.ends = (*further, *(self.requirements if given_ends is None else given_ends))
        reward, cost, weights = worth
        given = weights if isinstance(weights, Mapping) else dict.fromkeys(margins, weights)
        earned = self._value(reward or "0")
        for name, margin in margins.items():
            if weight := given.get(name, 0.0):
                earned = add("+", earned, self._violation(margin, weight))
        over = [
            add("<", margins[text], zero) if text in margins else add("!=", self._value(text), zero)
            for text in self.ends
        ]
        any_over = self._program.fold("or", [zero, *over])
        spent, changed = self._value(cost or "0"), self._value(intervention or "0")
        wanted = [earned, spent, any_over, changed, *over, *margins.values()]
        self.values = RowProgram(result, self._program, wanted)

    def ended(self, values: Sequence[float]) -> list[str]:
        """Return which of the ends hold."""
        return [text for text, holds in zip(self.ends, values[4:], strict=False) if holds]

    def margins(self, values: Any) -> dict[str, Any]:
        """Return the margins of the requirements by name; values of one row, or a column each."""
        return dict(zip(self.requirements, values[4 + len(self.ends) :], strict=True))

    def _margin(self, tree: Node) -> int:
        return Requirement(tree, partial(unit_in, self._result), self._program).margin

    def _violation(self, margin: int, weight: float) -> int:
        """Return the margin below 0 times the weight; a row without evidence counts as FAR."""
        add, number = self._program.add, self._program.number
        below = add("fmin", add("fmax", margin, number(-FAR)), number(0))
        return add("*", below, number(weight))

    def _value(self, text: str) -> int:
        """Return the number of the value of an expression, the least element of a vector."""
        try:
            tree = fitted(self._result, text)
            if not is_per_row(tree):
                raise UsageError(f"{text}: depends on other rows than the present one")
            for name in tree.variables:
                history(self._result, name)  # raises KeyError with close names
            table = self._program.add("table", self._program.expression(tree))
            return self._program.add("least", table)
        except (ValueError, KeyError) as error:
            raise UsageError(f"{text}: {error.args[0]}") from error
