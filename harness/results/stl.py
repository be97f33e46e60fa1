# SPDX-License-Identifier: BSD-2-Clause
"""Requirements in the notation of rtamt, signal temporal logic (STL) over named signals, and back.

A signal is a side of a comparison; a comment contains its expression. A condition that states when
other conditions apply (guard) becomes a signal of +inf where it holds and -inf elsewhere, such that
the robustness of rtamt equals the margin in the harness. The notation has scalar signals only. It
does not include `until`, whose window ends differently in rtamt.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from functools import partial

import numpy as np

from harness.errors import UsageError
from harness.results.evaluation import fitted, history
from harness.results.expressions import IMPLIES, Node
from harness.results.program import evaluate, value_of
from harness.results.result import Array, Result

NOT = "not ("
"""Beginning of the expression of a guard that is the negated premise of implies()."""

SIGNAL, GUARD = "s", "g"
"""First letters of the names of signals for sides of comparisons and for guards."""


@dataclass
class Formula:
    """Requirement in the notation of rtamt. text: formula; signals: expressions by name of the
    signal.
    """

    name: str
    text: str = ""
    signals: dict[str, str] = field(default_factory=dict)

    def __str__(self) -> str:
        lines = [f"input float {name} // {text}" for name, text in self.signals.items()]
        return "\n".join([*lines, f"output float {self.name}", f"{self.name} = {self.text}", ""])

    def traces(self, result: Result) -> dict[str, Array]:
        """Return the values of the signals in a result, with its `time`, as rtamt expects them."""
        found: dict[str, Array] = {"time": result.time}
        for name, text in self.signals.items():
            values = np.broadcast_to(value_of(result, text), result.time.shape)
            guard = np.where(values > 0, math.inf, -math.inf)
            found[name] = guard if name.startswith(GUARD) else np.asarray(values, dtype=np.float64)
        return found


def written(result: Result, name: str, text: str) -> Formula:
    """Return the requirement `text` as a formula of rtamt, in which parameters have their values in
    the result; raise ValueError if the notation cannot express the requirement.
    """
    tree = fitted(result, text)
    writer = _Writer(result, Formula(re.sub(r"\W", "_", name)), not tree.is_timing)
    formula = writer.condition(tree)
    writer.formula.text = formula if tree.has_window else f"always({formula})"
    return writer.formula


def lines(result: Result, stl: bool) -> Iterator[str]:
    """Yield the requirements of a result as text: in the notation of rtamt if `stl`, else as in the
    TOML file of a system.
    """
    own = () if result.provenance is None else result.provenance.requirements
    for name, text in own:
        if not stl:
            yield f"{name} = {text!r}"
            continue
        try:
            yield f"// {text}\n{written(result, name, text)}"
        except ValueError as error:
            yield f"// {name}: {error}\n"


class _Writer:
    """Converter of the tree of a requirement to the notation of rtamt. formula: collects the
    signals; guarded: whether conditions on time become guards.
    """

    def __init__(self, result: Result, formula: Formula, guarded: bool) -> None:
        self._result, self.formula, self._guarded = result, formula, guarded

    def condition(self, node: Node) -> str:
        """Return a condition in the notation of rtamt."""
        if self._guarded and node.is_timing and not node.has_window:
            return f"({self._signal(GUARD, node)} >= 0)"
        match node.kind:
            case "not":
                return f"not({self.condition(node.parts[0])})"
            case "join":
                return f"({f' {node.name} '.join(map(self.condition, node.parts))})"
            case "window" if node.name != "until":
                begin, end = node.value
                span = "" if math.isinf(end) else f"[{_number(begin)},{_number(end)}]"
                if span or not begin:
                    return f"{node.name}{span}({self.condition(node.parts[0])})"
            case "compare":
                left, right = (self._side(node, part) for part in node.parts)
                return f"({left} {node.name} {right})"
        raise ValueError(f"`{node.text}` has no counterpart in rtamt")

    def _side(self, node: Node, side: Node) -> str:
        if all(name.startswith("parameter ") for name in side.variables):
            return _number(float(evaluate(side, partial(history, self._result))))
        return self._signal(SIGNAL, side)

    def _signal(self, kind: str, node: Node) -> str:
        """Return the name of the signal with the value of a node; kind: its first letter."""
        text = _text(node)
        values = value_of(self._result, text)
        if np.ndim(values) > 1:
            raise ValueError(f"`{text}` is a vector; rtamt compares numbers")
        known = {given: name for name, given in self.formula.signals.items()}
        name = known.get(text) or f"{kind}{len(known) + 1}"
        self.formula.signals[name] = text
        return name


def _text(node: Node) -> str:
    """Return the text of a node, multiplied by the factor if its unit was converted."""
    if node.kind == "not" and node.name == IMPLIES:  # the source is the whole implies()
        return f"{NOT}{_text(node.parts[0])})"
    if node.kind == "operator" and node.parts[0].source is None:
        return f"{node.parts[0].value!r} * ({node.text})"
    return node.text


def _number(value: float) -> str:
    """Return a number as rtamt reads it, without an exponent."""
    return f"{Decimal(repr(value)):f}"


# ---- back


def read(text: str) -> tuple[str, str]:
    """Return name and text of a requirement from the notation of rtamt; raise UsageError.

    Names of signals are replaced by the expressions in their comments. An always() around a
    condition without windows is removed, because a requirement holds in every row anyway.
    """
    lines = [line.partition("//") for line in text.splitlines()]
    signals = {
        words[2]: about.strip() or words[2]
        for head, _, about in lines
        if len(words := head.split()) == 3 and words[:2] == ["input", "float"]
    }
    formulas = [head for head, _, _ in lines if "=" in head and not head.startswith("input")]
    if len(formulas) != 1:
        raise UsageError(f"expected one formula NAME = ..., found {len(formulas)}")
    name, _, formula = formulas[0].partition("=")
    try:
        tree = ast.parse(formula.strip(), mode="eval").body
        return name.strip(), _condition(_inside(tree), signals)
    except (SyntaxError, KeyError, ValueError) as error:
        reason = error.args[0] if error.args else error
        raise UsageError(f"{name.strip()}: this part of STL is not supported: {reason}") from error


def _inside(tree: ast.expr) -> ast.expr:
    """Return the condition inside always() over the whole run, if it contains no windows; else the
    tree.
    """
    match tree:
        case ast.Call(func=ast.Name(id="always"), args=[inner]):
            has_window = any(word in ast.unparse(inner) for word in WINDOWS)
            return tree if has_window else inner
    return tree


def _condition(tree: ast.expr, signals: Mapping[str, str]) -> str:  # noqa: PLR0911 - per kind
    match tree:
        case ast.BoolOp(op=op, values=values):
            parts = [_condition(value, signals) for value in values]
            if isinstance(op, ast.Or) and parts[0].startswith(f"({NOT}"):
                return f"implies({parts[0][len(NOT) + 1 : -2]}, {' or '.join(parts[1:])})"
            return f"({(' and ' if isinstance(op, ast.And) else ' or ').join(parts)})"
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return f"not ({_condition(operand, signals)})"
        case ast.Compare(left=ast.Name(id=name)) if name.startswith(GUARD) and name in signals:
            return f"({signals[name]})"
        case ast.Compare(left=left, ops=[_], comparators=[right]):
            sides = (_side(side, signals) for side in (left, right))
            return f" {ast.unparse(tree).split()[1]} ".join(sides)
        case ast.Call(func=ast.Name(id=name), args=[x]) if name in WINDOWS:
            return f"{name}({_condition(x, signals)})"
        case ast.Call(
            func=ast.Subscript(value=ast.Name(id=name), slice=ast.Tuple(elts=[a, b])), args=[x]
        ) if name in WINDOWS:
            return f"{name}({_condition(x, signals)}, {ast.unparse(a)} s, {ast.unparse(b)} s)"
    raise ValueError(ast.unparse(tree))


WINDOWS = ("always", "eventually")


def _side(tree: ast.expr, signals: Mapping[str, str]) -> str:
    """Return a side of a comparison, with names of signals replaced by their expressions."""
    return re.sub(
        r"[A-Za-z_]\w*",
        lambda m: f"({signals[m[0]]})" if m[0] in signals else m[0],
        ast.unparse(tree),
    )
