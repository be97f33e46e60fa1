# SPDX-License-Identifier: BSD-2-Clause
"""Requirements of the user: expressions that must hold in every recorded row, with the worst one.

A requirement is a name and a text, `guidance.range >= 4 m` or `time < 20 min or norm(controller.e)
< 5 cm`, see harness.results.expressions. A system brings its own along, the user adds others.
"""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.results.evaluation import evaluate, history, resolved, unit_in, unit_of
from harness.results.expressions import BINARY, Quantity, parsed, variables
from harness.results.provenance import Provenance
from harness.results.quantities import convert, unit
from harness.results.result import Result
from harness.results.verdict import Judged, Kind, Verdict
from harness.spelling import did_you_mean
from harness.system.graph import read_interfaces
from harness.system.model import Port, System
from harness.system.names import base

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Finding:
    """What became of a requirement.

    value, unit, time [s]: what was compared where the margin was least (None: where there is none);
    reason: why it is not exercised, or cannot be judged.
    """

    name: str
    text: str
    verdict: Verdict
    value: float | None = None
    unit: str = ""
    time: float | None = None
    reason: str = ""

    def __str__(self) -> str:
        word = Kind.REQUIREMENT.word(self.verdict)
        shown = word.upper() if self.verdict is Verdict.NOT_MET else word
        named = f"{self.name} ({self.text})" if self.name != self.text else self.text
        return f"{shown}: {named}{f'; {self.detail}' if self.detail else ''}"

    @property
    def judged(self) -> Judged:
        """What decides on the exit status."""
        return Judged(Kind.REQUIREMENT, self.name, self.verdict, str(self))

    @property
    def detail(self) -> str:
        """The worst value with its instant, or why there is none."""
        if self.value is None:
            return self.reason
        place = "" if self.time is None else f" at {self.time:g} s"
        if math.isnan(self.value):
            return f"not a number{place}"
        return f"worst {self.value:.6g} {self.unit.removeprefix('1')}".rstrip() + place


def refused(system: System, requirements: Mapping[str, Any]) -> list[str]:
    """What is wrong with requirements that are made of a system, one line each: texts that are no
    conditions, variables and parameters that nobody has, units that do not fit.
    """
    known = {f"{kind}{n}": u for kind, table in _units(system).items() for n, u in table.items()}
    return [
        f"{name}: {problem}"
        for name, text in requirements.items()
        for problem in _problems(text, {"time": "s", **known})
    ]


def _units(system: System) -> dict[str, dict[str, str]]:
    """Units of everything that an expression may name, by its name after `` or `parameter `."""
    tables: dict[str, dict[str, str]] = {"": {}, "parameter ": {}}
    for component, interface in read_interfaces(system).items():
        for kind, causality in (("", "output"), ("parameter ", "parameter")):
            for name, variable in interface.named(causality).items():
                port = str(Port(component, name))
                tables[kind] |= {port: variable.unit or "", base(port): variable.unit or ""}
    return tables


def _problems(text: Any, known: Mapping[str, str]) -> Iterator[str]:
    if not isinstance(text, str):
        yield f"must be a text, not {text!r}"
        return
    try:
        tree = parsed(text)
        _check(tree)
        unknown = [path for path in variables(tree) if path not in known]
        if not unknown:
            resolved(tree, lambda path: known[path])
    except ValueError as error:
        yield str(error)
        return
    for path in unknown:
        kind, _, name = path.rpartition(" ")
        names = [k.rpartition(" ")[2] for k in known if k.startswith("parameter ") == bool(kind)]
        yield f"there is no {kind or 'variable'} {name}{did_you_mean(name, names)}"


def _check(tree: ast.expr) -> None:
    """ValueError if a text is no condition, or a unit of it none."""
    negation = isinstance(tree, ast.UnaryOp) and isinstance(tree.op, ast.Not | ast.Invert)
    joined = isinstance(tree, ast.BinOp) and isinstance(tree.op, ast.BitAnd | ast.BitOr)
    if not (isinstance(tree, ast.Compare | ast.BoolOp) or negation or joined):
        raise ValueError("is no condition, as `component.variable >= 4 m` is one")
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, Quantity):
            unit(node.value.unit)


def demanding(result: Result, further: Mapping[str, str]) -> Result:
    """The result with further requirements beside those it has, by name."""
    before = result.provenance or Provenance(system=result.system)
    both = {**dict(before.requirements), **further}
    if not further:
        return result
    return replace(result, provenance=replace(before, requirements=tuple(both.items())))


def findings(result: Result) -> list[Finding]:
    """All requirements of a result with their verdicts."""
    own = () if result.provenance is None else result.provenance.requirements
    return [finding(result, name, text) for name, text in own]


def finding(result: Result, name: str, text: str) -> Finding:
    """Whether a requirement holds in every row of a result, and where it was closest to failing."""
    if not len(result.time):
        return Finding(name, text, Verdict.NOT_JUDGED, reason="nothing was recorded")
    try:
        tree = parsed(text)
        _check(tree)
        tree = resolved(tree, partial(unit_in, result))
        with np.errstate(all="ignore"):
            return _judged(result, Finding(name, text, Verdict.NOT_JUDGED), tree)
    except (KeyError, ValueError, IndexError, TypeError, ZeroDivisionError, OverflowError) as error:
        reason = str(error.args[0]) if error.args else type(error).__name__
        return Finding(name, text, Verdict.NOT_JUDGED, reason=reason)


def _judged(result: Result, found: Finding, tree: ast.expr) -> Finding:
    margins = _Margins(result, guarded=not _is_timing(tree))
    truth = margins.truth(tree)
    met = bool(np.all(truth == 1))
    if met and not margins.exercised(tree):
        reason = f"the run ends at {result.time[-1]:g} s, before its time"
        return replace(found, verdict=Verdict.NOT_EXERCISED, reason=reason)
    undecided = np.isnan(margins.rows_of(truth)).any(axis=1)
    least = np.where(undecided, -np.inf, margins.of(tree))
    row = int(np.argmax(undecided) if undecided.any() else np.argmin(least))
    value, unit = margins.value(margins.decisive(tree, row), row)
    instant = float(result.time[row]) if len(least) == len(result.time) else None
    value = math.nan if undecided.any() else value
    verdict = Verdict.MET if met else Verdict.NOT_MET
    return replace(found, verdict=verdict, value=value, unit=unit, time=instant)


class _Margins:
    """How far the conditions of an expression are from failing, row by row; negative: they fail.

    guarded: conditions on time alone say when the others count.
    """

    def __init__(self, result: Result, guarded: bool) -> None:
        self.result = result
        self.guarded = guarded
        self.look_up = partial(history, result)

    def truth(self, node: ast.expr) -> Array:
        """1 where a condition holds, 0 where it does not, NaN where that hangs on what is no
        number, with the rows and elements of its parts.
        """
        match node:
            case ast.Compare(left=a, ops=[op], comparators=[b]):
                sides = [evaluate(side, self.look_up) for side in (a, b)]
                known = ~(np.isnan(sides[0]) | np.isnan(sides[1]))
                return np.where(known, BINARY[type(op)](*sides), np.nan)
            case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=a):
                return 1 - self.truth(a)
            case ast.BoolOp() | ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
                parts = np.array(np.broadcast_arrays(*map(self.truth, _joined(node))))
                extreme, decides = _extreme(node), _decides(node)
                return np.where((parts == decides).any(axis=0), decides, extreme(parts, axis=0))
        value = np.asarray(evaluate(node, self.look_up), dtype=np.float64)
        return np.where(np.isnan(value), np.nan, value != 0)

    def of(self, node: ast.expr) -> Array:
        """Margin of every row, or (1,) if the rows do not matter; -inf where it is not a number."""
        match node:
            case ast.Compare():
                margin = self._elements(node).min(axis=1)
                if self.guarded and _is_timing(node):  # says when, not how well
                    margin = np.where(self._holds(node), np.inf, -np.inf)
            case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=a):
                margin = -self.of(a)
            case ast.BoolOp() | ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
                parts = np.broadcast_arrays(*map(self.of, _joined(node)))
                margin = _extreme(node)(parts, axis=0)
            case _:
                margin = np.where(self._holds(node), 1.0, -1.0)
        return np.where(np.isnan(margin), -np.inf, margin)

    def exercised(self, node: ast.expr, looked: Any = True, negated: bool = False) -> bool:
        """Whether every part that must hold was looked at in some row: where time alone does not
        decide on the whole. looked: rows (rows,) that matter; negated: below a `not`.
        """
        if _is_timing(node):
            return not self.guarded
        match node:
            case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=a):
                return self.exercised(a, looked, not negated)
            case ast.BoolOp() | ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
                when = [part for part in _joined(node) if _is_timing(part)]
                further = [part for part in _joined(node) if not _is_timing(part)]
                if bool(_decides(node)) is negated:  # all must hold
                    return all(self.exercised(part, looked, negated) for part in further)
                for part in when:
                    decided = self.rows_of(self.truth(part)) == _decides(node)
                    looked = looked & ~decided.all(axis=1)
                return any(self.exercised(part, looked, negated) for part in further)
        return bool(np.any(looked))

    def decisive(self, node: ast.expr, row: int) -> ast.expr:
        """The part of a condition that has its margin in a row."""
        match node:
            case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=a):
                return self.decisive(a, row)
            case ast.BoolOp() | ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
                parts = _joined(node)
                margins = [_at(self.of(part), row) for part in parts]
                which = int(np.argmax(margins) if _extreme(node) is np.max else np.argmin(margins))
                return self.decisive(parts[which], row)
        return node

    def value(self, node: ast.expr, row: int) -> tuple[float, str]:
        """What is compared in a row, the element with the least margin, and its unit."""
        shown, element = node, 0
        if isinstance(node, ast.Compare):
            shown = node.comparators[0] if isinstance(node.left, ast.Constant) else node.left
            element = int(np.argmin(_at(self._elements(node), row)))
        values = _at(self.rows_of(evaluate(shown, self.look_up)), row)
        value = float(values[min(element, len(values) - 1)])
        return _as_written(node, value, unit_of(shown, partial(unit_in, self.result)))

    def _elements(self, node: ast.Compare) -> Array:
        """Margins of a comparison by row and element."""
        a, b = (evaluate(side, self.look_up) for side in (node.left, node.comparators[0]))
        difference = np.asarray(a, dtype=np.float64) - np.asarray(b, dtype=np.float64)
        return self.rows_of(SIGNED[type(node.ops[0])](difference))

    def _holds(self, node: ast.expr) -> NDArray[np.bool_]:
        return np.asarray((self.rows_of(self.truth(node)) == 1).all(axis=1))

    def rows_of(self, values: Any) -> Array:
        """Values as (rows, elements), or (1, elements) where the rows do not matter."""
        array = np.asarray(values, dtype=np.float64)
        rows = len(self.result.time)
        history = array.ndim > 0 and len(array) == rows
        return array.reshape(rows if history else 1, -1)


SIGNED: Mapping[type[ast.cmpop], Callable[[Array], Array]] = {
    ast.Lt: np.negative,
    ast.LtE: np.negative,
    ast.Gt: np.positive,
    ast.GtE: np.positive,
    ast.Eq: lambda difference: -np.abs(difference),
    ast.NotEq: np.abs,
}
"""Margin of a comparison by the difference of its sides."""


def _is_timing(node: ast.expr) -> bool:
    """Whether a condition is one on time alone, beside parameters."""
    named = variables(node)
    return "time" in named and all(n == "time" or n.startswith("parameter ") for n in named)


def _joined(node: ast.expr) -> list[ast.expr]:
    if isinstance(node, ast.BoolOp):
        return node.values
    assert isinstance(node, ast.BinOp)
    return [node.left, node.right]


def _extreme(node: ast.expr) -> Callable[..., Array]:
    """The least margin of all counts, or the largest of any."""
    assert isinstance(node, ast.BoolOp | ast.BinOp)
    return np.max if isinstance(node.op, ast.Or | ast.BitOr) else np.min


def _decides(node: ast.expr) -> float:
    """The truth of one part that decides on the whole, whatever the other parts are."""
    return 1.0 if _extreme(node) is np.max else 0.0


def _as_written(node: ast.expr, value: float, given: str) -> tuple[float, str]:
    """A value in the unit that the user has compared it with."""
    sides = [node.left, *node.comparators] if isinstance(node, ast.Compare) else []
    units = [side.kind for side in sides if isinstance(side, ast.Constant) and side.kind]
    return (convert(value, given, units[0]), units[0]) if units else (value, given)


def _at(rows: Array, row: int) -> Any:
    return rows[row if len(rows) > 1 else 0]
