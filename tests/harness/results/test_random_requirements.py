# SPDX-License-Identifier: BSD-2-Clause
"""Random requirements against an evaluator that looks at one row and one element at a time, over
variables of several units, with values that are infinite or not numbers.
"""

from __future__ import annotations

import math
import operator
import random
import re
from fractions import Fraction
from functools import partial
from itertools import product

import numpy as np

from harness.results.evaluation import fitted, unit_in
from harness.results.margins import Requirement
from harness.results.program import Program, is_per_row
from harness.results.requirements import finding, margin
from harness.results.result import Result
from harness.results.rows import RowProgram
from harness.results.verdict import Verdict
from harness.system.units import SYMBOLS
from tests.each import each

CASES = 60
"""Requirements of a seed, each over a result of its own."""
ODD = (math.nan, math.inf, -math.inf, 0.0)
WIDE = {"a.v": "m", "b.v": "cm", "parameter b.g": "km"}
UNITS = {"a.x": "m", "b.x": "km", "parameter a.k": "mm", "a.turn": "rad", "b.turn": "deg", **WIDE}
"""Variables and parameters with their units; the ones in WIDE have three elements."""
KINDS = {
    "length": [name for name in UNITS if not name.endswith("turn")],
    "angle": ["a.turn", "b.turn"],
}
LITERAL = {"length": ("m", "km", "cm", ""), "angle": ("deg", "rad", "mrad", "")}
COMBINED = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}
COMPARED = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq,
    "!=": operator.ne,
}  # fmt: skip


class Rows:
    """A result of a few rows, and the values of random expressions over it.

    An expression is a tuple: its operation, then what that takes.
    """

    def __init__(self, rng, odd):
        self.rng, self.count = rng, rng.randint(1, 5)
        self.time = np.arange(self.count, dtype=float)
        self.values = {}
        for name, unit in UNITS.items():
            rows = 1 if name.startswith("parameter") else self.count
            shape = rows, 3 if name in WIDE else 1
            self.values[name] = [[self._number(unit, odd) for _ in range(shape[1])]
                                 for _ in range(shape[0])]  # fmt: skip
        parameters = self._table("parameter ", np.zeros(1))
        self.result = self._table("", self.time, parameters=parameters)

    def _number(self, unit, odd):
        if odd and self.rng.random() < 0.12:
            return self.rng.choice(ODD)
        return self.rng.choice((-2, -1, 0.5, 1, 1, 2, 3)) / SYMBOLS[unit][0]

    def _table(self, kind, time, **more):
        columns, units, values = [], [], []
        for name, table in self.values.items():
            if name.startswith("parameter") == bool(kind):
                short = name.removeprefix(kind)
                columns += [short] if len(table[0]) == 1 else [f"{short}[{k}]" for k in (1, 2, 3)]
                units += [UNITS[name]] * len(table[0])
                values.append(table)
        return Result("r", time, (*columns,), (*units,), np.hstack(values), **more)

    # ---- numbers

    def number(self, kind, depth):
        choice = self.rng.choice
        if depth <= 0 or self.rng.random() < 0.4:
            return ("name", choice(KINDS[kind]))
        a = self.number(kind, depth - 1)
        match choice(("sum", "sum", "sum", "abs", "norm", "max", "row", "element", "twice")):
            case "sum":
                b = choice((self.number(kind, depth - 1), self.literal(kind)))
                return (choice("+-"), a, b)
            case "row" if self.has_rows(a):
                return ("at", a, choice(self.time))
            case "element" if a[0] not in ("name", "element") or self.width(a) > 1:
                return ("element", a, self.rng.randint(1, self.width(a)))
            case "row" | "element":
                return ("abs", a)
            case operation:
                return (operation, a)

    def literal(self, kind):
        unit = self.rng.choice(LITERAL[kind])
        return ("number", self.rng.choice((0, 1, 2.5, 100)), unit)

    def text(self, tree):  # noqa: PLR0911 - one per operation
        match tree:
            case ("name", name):
                kind, _, short = name.rpartition(" ")
                return f"parameter({short})" if kind else name
            case ("number", value, unit):
                return f"{value} {unit}".rstrip()
            case ("at", a, instant):
                return f"at({self.text(a)}, {instant} s)"
            case ("element", a, k):
                return f"({self.text(a)})[{k}]"
            case ("twice", a):
                return f"(2 * {self.text(a)})"
            case (("+" | "-" | "/" | "*" | "and" | "or") as sign, a, b):
                return f"({self.text(a)} {sign} {self.text(b)})"
            case ("compare", sign, a, b):
                return f"{self.text(a)} {sign} {self.text(b)}"
            case ("not", a):
                return f"(not {self.text(a)})"
        return f"{tree[0]}({self.text(tree[1])})"

    def unit(self, tree):
        """Terms of a sum meet in the unit of the first: numbers come second."""
        if tree[0] in ("name", "number"):
            return UNITS[tree[1]] if tree[0] == "name" else tree[2]
        return self.unit(tree[1])

    def width(self, tree):
        if tree[0] in ("name", "number"):
            return 3 if tree[1] in WIDE else 1
        if tree[0] in ("norm", "max", "element"):
            return 1
        return max(self.width(part) for part in tree if isinstance(part, tuple))

    def has_rows(self, tree):
        if tree[0] == "name":
            return not tree[1].startswith("parameter")
        if tree[0] in ("max", "at", "number"):
            return False
        return any(self.has_rows(part) for part in tree if isinstance(part, tuple))

    def value(self, tree, row, element):  # noqa: PLR0911 - one per operation
        """The number in a row and element."""
        match tree:
            case ("name", name):
                table = self.values[name]
                return table[row % len(table)][element % len(table[0])]
            case ("number", value, _):
                return float(value)
            case (("+" | "-" | "*" | "/") as sign, a, b):
                return float(COMBINED[sign](*map(np.float64, self.both(a, b, row, element))))
            case ("abs", a):
                return abs(self.value(a, row, element))
            case ("twice", a):
                return 2 * self.value(a, row, element)
            case ("norm", a):
                return math.sqrt(sum(self.value(a, row, k) ** 2 for k in range(self.width(a))))
            case ("at", a, instant):
                return self.value(a, int(instant), element)
            case ("element", a, k):
                return self.value(a, row, k - 1)
        every = [self.value(tree[1], r, k) for r, k in self.places(tree[1])]
        return math.nan if any(map(math.isnan, every)) else max(every)

    def both(self, a, b, row, element):
        """Two numbers in the unit of the first."""
        given, wanted = self.unit(b), self.unit(a)
        sizes = [Fraction(repr(SYMBOLS[unit or "1"][0])) for unit in (given, wanted)]
        factor = float(sizes[0] / sizes[1]) if given else 1.0
        return self.value(a, row, element), factor * self.value(b, row, element)

    def places(self, tree):
        return product(range(self.count if self.has_rows(tree) else 1), range(self.width(tree)))

    # ---- conditions

    def condition(self, depth):
        choice = self.rng.choice(("and", "or", "not")) if self.rng.random() < 0.6 else ""
        if depth <= 0 or not choice:
            kind = self.rng.choice([*KINDS])
            a, b = self.number(kind, 2), self.number(kind, 1)
            b = self.rng.choice((b, self.literal(kind)))
            if self.rng.random() < 0.2:  # the limit of a product or quotient has no unit
                limit = ("number", self.rng.choice((0, 0.5, 1, 100)), "")
                return (
                    "compare",
                    self.rng.choice([*COMPARED]),
                    (self.rng.choice("*/"), a, b),
                    limit,
                )
            return ("compare", self.rng.choice([*COMPARED]), a, b)
        parts = [self.condition(depth - 1) for _ in range(1 if choice == "not" else 2)]
        return (choice, *parts)

    def evaluate(self, tree, row, element):
        """Whether a condition holds, None where that hangs on what is no number, and its margin."""
        match tree:
            case ("compare", sign, a, b):
                x, y = self.both(a, b, row, element)
                if math.isnan(x) or math.isnan(y):
                    return None, None
                difference = 0.0 if x == y else x - y
                signed = {"=": -abs(difference), "!": abs(difference), "<": -difference}
                if sign in ("==", "!="):
                    return COMPARED[sign](x, y), signed[sign[0]]
                return COMPARED[sign](x, y), signed.get(sign[0], difference)
            case ("not", a):
                truth, margin = self.evaluate(a, row, element)
                return (None, None) if truth is None else (not truth, -margin)
        found = [self.evaluate(part, row, element) for part in tree[1:]]
        decides = tree[0] == "or"
        truths = [truth for truth, _ in found]
        if None in truths and decides not in truths:
            return None, None
        margins = [margin for truth, margin in found if truth is not None]
        every = decides in truths
        return (decides if every else not decides), (max if decides else min)(margins)


def expected(rows, tree, late):
    """Verdict, margin and time of a condition, of `time < late s or` it where late is given."""
    undecided, margins, met = {}, [], True
    for row, element in rows.places(tree) if late is None else product(
        range(rows.count), range(rows.width(tree))
    ):  # fmt: skip
        truth, margin = rows.evaluate(tree, row, element)
        if late is not None and row < late:
            truth, margin = True, math.inf
        if truth is None:
            undecided.setdefault(row, -math.inf)
        else:
            margins.append((margin, row))
        met = met and truth is True
    if late is not None and late >= rows.count and met:
        return Verdict.NOT_EXERCISED, None, None
    timed = late is not None or rows.has_rows(tree)
    margin, row = (-math.inf, min(undecided)) if undecided else min(margins)
    if not met:  # a condition that fails at its limit has the largest margin below 0
        margin = min(margin, -math.ulp(0.0))
    return Verdict.MET if met else Verdict.NOT_MET, margin, float(row) if timed else None


@np.errstate(all="ignore")
@each("odd", [False, True])
@each("seed", range(10))
def test_verdict_margin_and_instant_equal_an_evaluation_row_by_row(seed, odd):
    rng = random.Random(f"{seed} {odd}")
    verdicts = set()
    for _ in range(CASES):
        rows = Rows(rng, odd)
        tree, late = rows.condition(2), rng.choice((None, None, rng.randint(0, 6)))
        if not re.search(r"(?<!parameter\()\b[ab]\.", rows.text(tree)):
            late = None  # time and parameters alone are a condition of their own
        text = rows.text(tree) if late is None else f"time < {late} s or {rows.text(tree)}"
        found = finding(rows.result, "", text)
        assert (found.verdict, found.margin, found.time) == expected(rows, tree, late), text
        verdicts.add(found.verdict)
    assert verdicts >= {Verdict.MET, Verdict.NOT_MET}


@np.errstate(all="ignore")
@each("odd", [False, True])
@each("seed", range(1))
def test_the_least_margin_of_single_rows_is_the_margin(seed, odd):
    """The program over a row as a function of Python has the bits of the interpreted program."""
    rng, checked = random.Random(f"{seed} {odd}"), 0
    for _ in range(CASES):
        rows = Rows(rng, odd)
        result, text = rows.result, rows.text(rows.condition(2))
        program, tree = Program(), fitted(result, text)
        if not is_per_row(tree):
            continue
        wanted = Requirement(tree, partial(unit_in, result), program).margin
        if not tree.is_history:  # a constant of the run
            continue
        of_row = RowProgram(result, program, [wanted])
        constants = of_row.constants(result.parameters.values[0])
        found = [of_row(row, constants, t)[0] for row, t in zip(result.values, result.time,
                                                               strict=True)]  # fmt: skip
        expected = margin(result, text)
        assert min(found) == expected or (min(found), expected) == (0, -math.ulp(0.0)), text
        checked += 1
    assert checked > CASES / 3


@each("sign", [*COMPARED, "+", "-"])
@each("first", KINDS["length"])
@each("second", KINDS["angle"])
def test_units_that_do_not_fit_are_both_named(sign, first, second):
    rows = Rows(random.Random(0), odd=False)
    names = [rows.text(("name", name)) for name in (first, second)]
    found = finding(rows.result, "", f"{names[0]} {sign} {names[1]}" + " > 0" * (sign in "+-"))
    assert found.verdict is Verdict.NOT_JUDGED
    for name, text in zip((first, second), names, strict=True):
        assert f"`{text}` [{UNITS[name]}]" in found.reason
