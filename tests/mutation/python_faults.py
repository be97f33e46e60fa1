# SPDX-License-Identifier: BSD-2-Clause
"""Deliberate faults in Python: one operator, constant, condition, argument or statement at a time.

Texts, types, docstrings and what only a type checker reads stay as they are.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from itertools import accumulate, pairwise
from typing import Any

from tests.mutation.faults import Fault

COMPARISONS = {
    ast.Lt: ("<", "<=", ">"), ast.LtE: ("<=", "<", ">="), ast.Gt: (">", ">=", "<"),
    ast.GtE: (">=", ">", "<="), ast.Eq: ("==", "!="), ast.NotEq: ("!=", "=="),
    ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"), ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
}  # fmt: skip
OPERATORS = {
    ast.Add: ("+", "-"), ast.Sub: ("-", "+"), ast.Mult: ("*", "/"), ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "/"), ast.Mod: ("%", "//"), ast.Pow: ("**", "*"), ast.BitOr: ("|", "&"),
    ast.BitAnd: ("&", "|"),
}  # fmt: skip
"""Each with its text and its replacements."""
CALLS = {"min": "max", "max": "min", "any": "all", "all": "any", "sorted": "list"}
STATEMENTS = (ast.AugAssign, ast.Raise, ast.Break, ast.Continue, ast.Delete)
"""Statements that may be left out, as may a call by itself."""


def faults(file: str, source: str) -> Iterator[Fault]:
    """All faults of a source."""
    yield from _Faults(file, source).found()


class _Faults:
    def __init__(self, file: str, source: str) -> None:
        self.file, self.source, self.tree = file, source, ast.parse(source)
        lines = source.splitlines(keepends=True)
        self.lines, self.begins = lines, [0, *accumulate(map(len, lines))]

    def found(self) -> Iterator[Fault]:
        """In the order of the tree."""
        waiting: list[ast.AST] = [self.tree]
        while waiting:
            node = waiting.pop()
            yield from self._of(node)
            waiting += reversed(list(_parts(node)))

    def _of(self, node: ast.AST) -> Iterator[Fault]:
        for kinds, find in FINDERS.items():
            if isinstance(node, kinds):
                yield from find(self, node)

    def _first(self, node: ast.expr | ast.stmt) -> int:
        return self._place(node.lineno, node.col_offset)

    def _last(self, node: ast.expr | ast.stmt) -> int:
        return self._place(node.end_lineno or 0, node.end_col_offset or 0)

    def _place(self, line: int, column: int) -> int:
        """Of a character; the tree counts bytes."""
        within = self.lines[line - 1].encode()[:column].decode()
        return self.begins[line - 1] + len(within)

    def _text(self, node: ast.expr | ast.stmt) -> str:
        return self.source[self._first(node) : self._last(node)]

    def _instead(self, kind: str, node: ast.expr | ast.stmt, text: str) -> Fault:
        return Fault(self.file, kind, self._first(node), self._last(node), text)

    def _between(
        self, kind: str, left: ast.expr, right: ast.expr, old: str, new: str
    ) -> Iterator[Fault]:
        """The operator between two operands, which may be in brackets."""
        first, last = self._last(left), self._first(right)
        found = self.source.find(old, first, last)
        if found >= 0:
            yield Fault(self.file, kind, found, found + len(old), new)

    # ---- expressions

    def comparison(self, node: ast.Compare) -> Iterator[Fault]:
        operands = [node.left, *node.comparators]
        for left, op, right in zip(operands[:-1], node.ops, operands[1:], strict=True):
            old, *others = COMPARISONS[type(op)]
            for new in others:
                yield from self._between("comparison", left, right, old, new)

    def junction(self, node: ast.BoolOp) -> Iterator[Fault]:
        old, new = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in pairwise(node.values):
            yield from self._between("condition", left, right, old, new)

    def operator(self, node: ast.BinOp) -> Iterator[Fault]:
        if texts := OPERATORS.get(type(node.op)):
            yield from self._between("operator", node.left, node.right, *texts)

    def sign(self, node: ast.UnaryOp) -> Iterator[Fault]:
        if isinstance(node.op, (ast.Not, ast.USub)):
            yield self._instead("sign", node, f"({self._text(node.operand)})")

    def constant(self, node: ast.Constant) -> Iterator[Fault]:
        value = node.value
        if isinstance(value, bool):
            yield self._instead("constant", node, repr(not value))
        elif isinstance(value, int):
            yield self._instead("constant", node, repr(value + 1))
            if value > 0:
                yield self._instead("constant", node, repr(value - 1))
        elif isinstance(value, float):
            yield self._instead("constant", node, repr(2 * value if value else 1.0))

    def call(self, node: ast.Call) -> Iterator[Fault]:
        if isinstance(node.func, ast.Name) and node.func.id in CALLS:
            yield self._instead("function", node.func, CALLS[node.func.id])
        plain = [a for a in node.args if not isinstance(a, ast.Starred)]
        if len(plain) > 1 and plain[:2] == node.args[:2]:
            one, two = map(self._text, plain[:2])
            if one != two:
                first, last = self._first(plain[0]), self._last(plain[1])
                yield Fault(self.file, "swapped arguments", first, last, f"{two}, {one}")
        for keyword in node.keywords:
            if keyword.arg is not None:
                yield self._without(keyword)

    def _without(self, keyword: ast.keyword) -> Fault:
        """An argument with a name and the comma behind it are left out."""
        first = self._place(keyword.lineno, keyword.col_offset)
        last = self._last(keyword.value)
        rest = self.source[last:]
        last += len(rest) - len(rest.lstrip()) + 1 if rest.lstrip().startswith(",") else 0
        return Fault(self.file, "dropped argument", first, last, "")

    # ---- statements

    def condition(self, node: ast.If | ast.While | ast.IfExp) -> Iterator[Fault]:
        yield self._instead("condition", node.test, f"not ({self._text(node.test)})")

    def filters(self, node: ast.comprehension) -> Iterator[Fault]:
        for test in node.ifs:
            yield self._instead("condition", test, f"not ({self._text(test)})")

    def result(self, node: ast.Return) -> Iterator[Fault]:
        if node.value is not None and not isinstance(node.value, ast.Constant):
            yield self._instead("result", node.value, "None")

    def statement(self, node: ast.stmt) -> Iterator[Fault]:
        call = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
        if call or isinstance(node, STATEMENTS):
            yield self._instead("dropped statement", node, "pass")


FINDERS: dict[Any, Callable[[_Faults, Any], Iterator[Fault]]] = {
    ast.Compare: _Faults.comparison, ast.BoolOp: _Faults.junction, ast.BinOp: _Faults.operator,
    ast.UnaryOp: _Faults.sign, ast.Constant: _Faults.constant, ast.Call: _Faults.call,
    (ast.If, ast.While, ast.IfExp): _Faults.condition, ast.comprehension: _Faults.filters,
    ast.Return: _Faults.result, ast.stmt: _Faults.statement,
}  # fmt: skip


def _parts(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes inside, except types, texts with values, and parts for type checkers."""
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test):
        return
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "type_params"):
            continue
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, ast.AST) and not isinstance(part, ast.JoinedStr):
                yield part
