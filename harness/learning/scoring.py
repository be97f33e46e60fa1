# SPDX-License-Identifier: BSD-2-Clause
"""Rewards and ends of episodes. The expressions of requirements, reward, cost and conditions are
compiled into one program, which is evaluated at the end of each action.
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
"""Weights of violated requirements in the reward: one number for all, or numbers by requirement."""


class Scoring:
    """Scoring of an episode. `values` is a program that returns for a recorded row, in this order:
    the reward without the cost, the cost so far, whether the episode is over, the intervention of
    the shield (how much the safety filter changed the action), for each entry of `ends` whether it
    ends the episode, and the margins of `requirements`.
    """

    def __init__(
        self,
        result: Result,
        requirements: Mapping[str, str],
        worth: tuple[str, str, Weights],
        ends: tuple[Sequence[str] | None, Sequence[str]],
        intervention: str,
    ) -> None:
        """Compile the program.

        result: has the variables of the system; requirements: texts by name; worth: expression of
        the reward, expression of the cost, weights of the requirements; ends: what ends an episode,
        as two lists: requirements and conditions chosen by the user (None: all requirements), and
        further conditions; intervention: variable with the intervention of the shield ("": none).
        Raises UsageError for an expression or condition that is not valid.
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
        """Return the requirements and conditions by which the episode ends in one recorded row;
        values: values of the scoring in this row.
        """
        return [text for text, holds in zip(self.ends, values[4:], strict=False) if holds]

    def margins(self, values: Any) -> dict[str, Any]:
        """Return the margins by requirement; values: all values of one row, or of several rows with
        an array (rows,) per value.
        """
        return dict(zip(self.requirements, values[4 + len(self.ends) :], strict=True))

    def _margin(self, tree: Node) -> int:
        """Add the margin of a requirement to the program; return the number of the instruction that
        computes it.
        """
        return Requirement(tree, partial(unit_in, self._result), self._program).margin

    def _violation(self, margin: int, weight: float) -> int:
        """Add min(margin, 0) times a weight to the program, where a margin below -FAR counts as
        -FAR; return the number of the instruction that computes this product.

        margin: number of the instruction that computes the margin.
        """
        add, number = self._program.add, self._program.number
        below = add("fmin", add("fmax", margin, number(-FAR)), number(0))
        return add("*", below, number(weight))

    def _value(self, text: str) -> int:
        """Add the value of an expression to the program (of a vector, the smallest element), and
        return the number of the instruction that computes it. Raises UsageError for an invalid
        expression.
        """
        try:
            tree = fitted(self._result, text)
            if not is_per_row(tree):
                raise UsageError(f"{text}: must depend on the present row only, not on other times")
            for name in tree.variables:
                history(self._result, name)  # raises KeyError for an unknown name
            table = self._program.add("table", self._program.expression(tree))
            return self._program.add("least", table)
        except (ValueError, KeyError) as error:
            raise UsageError(f"{text}: {error.args[0]}") from error
