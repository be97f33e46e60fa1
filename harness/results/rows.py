# SPDX-License-Identifier: BSD-2-Clause
"""Programs of expressions compiled to Python functions of a single row, for the margins, rewards
and conditions in every step of a learning environment.

harness.results.program interprets the same instructions over time series, which takes a millisecond
for one row. Here every element is a local variable, and a row takes microseconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from harness.results.evaluation import history
from harness.results.expressions import FUNCTIONS
from harness.results.program import Instruction, Program
from harness.results.result import Result
from harness.system.values import base

OPERATORS = ("+", "-", "*", "/", "<", "<=", ">", ">=", "==", "!=")
MATHS = ("abs", "cos", "degrees", "exp", "log", "sin", "sqrt")
EACH: Mapping[str, str] = {
    **{name: f"{{}} {name} {{}}" for name in OPERATORS},
    **{name: f"{name}({{}})" for name in MATHS},
    "**": "pow({}, {})", "negative": "-{}", "not": "not {}",
    "implies": "not {}", "and": "{} != 0 and {} != 0", "or": "{} != 0 or {} != 0",
    "isnan": "{0} != {0}", "where": "{1} if {0} else {2}",
    "both": "0.0 if {0} == 0 or {1} == 0 else {0} * {1}",
    "difference": "0.0 if {0} == {1} else {0} - {1}",
    "fmin": "{0} if {0} <= {1} or {1} != {1} else {1}",
    "fmax": "{0} if {0} >= {1} or {1} != {1} else {1}",
}  # fmt: skip
"""Python text of operations element by element. The braces are replaced by the elements of the
operands.
"""


def _length(x: Sequence[str]) -> str:
    return f"sqrt({' + '.join(f'({a}) * ({a})' for a in x)})"


def _angle(q: Sequence[str], p: Sequence[str]) -> str:
    """Return the text of the angle between two quaternions [rad]; q, p: texts of their elements."""
    lengths = (_length([f"{a} {sign} {b}" for a, b in zip(q, p, strict=True)]) for sign in "-+")
    return f"4 * atan2(*sorted(({', '.join(lengths)})))"


def _least(x: Sequence[str]) -> str:
    return f"min({', '.join(x)}) if {' and '.join(f'{a} == {a}' for a in x)} else nan"


ALL: Mapping[str, Callable[..., str]] = {
    "angle": _angle, "least": _least, "norm": _length, "total": " + ".join,
}  # fmt: skip
"""Operations on all elements of their operands: functions that return the Python text."""

VECTORS = {name for name, each in FUNCTIONS.items() if each.per_row} - EACH.keys() - ALL.keys()
"""Names of functions of vectors for which there is no Python text, so that numpy evaluates them."""
SAME = ("table", "positive")
"""Names of operations that change no element."""


def _of_vectors(name: str, *vectors: Sequence[float]) -> list[float]:
    return list(map(float, np.ravel(FUNCTIONS[name].value(*map(np.array, vectors)))))


_QUICK = vars(math) | {"abs": abs, "min": min, "sorted": sorted, "of_vectors": _of_vectors}
_SAFE = _QUICK | {name: getattr(np, name) for name in MATHS} | {"atan2": np.arctan2,
                                                                "pow": np.power}  # fmt: skip
"""Names that a compiled function uses, in two versions: _QUICK has Python functions, which raise an
error where they have no value, as sqrt(-1); _SAFE has numpy functions, which return infinity or
NaN.
"""


class RowProgram:
    """Compiled function that evaluates the instructions `wanted` of a program in single rows of any
    result with the columns of `result`. The value of each wanted instruction must be one number
    that depends on a single row, see is_per_row().
    """

    def __init__(self, result: Result, program: Program, wanted: Sequence[int]) -> None:
        self._program = program
        values = program.run(partial(history, result))
        rows = len(result.time)
        sizes = [np.size(x) // (rows if each.rows else 1)
                 for x, each in zip(values, program.instructions, strict=True)]  # fmt: skip
        lines = "".join(f"    {line}\n" for line in _lines(result, program, wanted, sizes))
        names: tuple[dict[str, Any], ...] = dict(_QUICK), dict(_SAFE)
        for each in names:
            exec(f"def of_row(b, p, t):\n{lines}", each)
        self._quick, self._safe = (each["of_row"] for each in names)
        read = {x.constant for x in program.instructions if x.operation == "look up" and not x.rows}
        self._columns = () if result.parameters is None else result.parameters.columns
        self._used = {i for i, name in enumerate(self._columns)
                      if {f"parameter {name}", f"parameter {base(name)}"} & read}  # fmt: skip
        self._of_used = lru_cache(maxsize=1)(self._computed)

    def constants(self, parameters: Iterable[float]) -> list[float]:
        """Return the argument `constants` of __call__(): the values of all instructions that are no
        time series, which depend on parameters alone, as one list of elements. parameters: values
        of all parameters of a run, in the order of Result.parameters.
        """
        given = enumerate(parameters) if self._used else ()
        return self._of_used(tuple(x for i, x in given if i in self._used))

    def _computed(self, used: tuple[float, ...]) -> list[float]:
        names = tuple(self._columns[i] for i in sorted(self._used))
        table = Result("", np.zeros(1), names, ("",) * len(names), np.array([used]))
        run = replace(table, parameters=table)
        values = self._program.run(partial(history, run), rows=False)
        return [float(x) for v in values if v is not None for x in np.ravel(v)]

    def __call__(self, row: Any, constants: Sequence[float], time: float) -> tuple[float, ...]:
        """Return the values of the wanted instructions in one row. row: values of all columns;
        constants: list that constants() returned for the parameters of the run; time: time of the
        row [s].
        """
        try:
            found: tuple[float, ...] = self._quick(row, constants, time)
        except (ArithmeticError, ValueError):
            with np.errstate(all="ignore"):
                found = self._safe(np.array(row), np.array(constants), np.float64(time))
        return found


def _lines(
    result: Result, program: Program, wanted: Sequence[int], sizes: Sequence[int]
) -> Iterator[str]:
    """Yield the lines of the compiled function: assignments of the elements of all instructions
    that the wanted ones need, and a return statement. sizes: number of elements by instruction.
    """
    needed = {*program.needed(wanted)}
    names: list[Sequence[str]] = []
    constants = 0
    for k, (each, size) in enumerate(zip(program.instructions, sizes, strict=True)):
        names.append([f"x{k}_{i}" for i in range(size)])
        given = [names[part] for part in each.parts]
        if not each.rows:
            names[k] = [f"p[{constants + i}]" for i in range(size)]
            constants += size
        elif each.operation in SAME or (each.operation == "least" and len(given[0]) == 1):
            names[k] = given[0]
        elif k in needed and each.operation in VECTORS:
            vectors = ", ".join(f"[{', '.join(x)}]" for x in given)
            yield f"{', '.join(names[k])}, = of_vectors({each.operation!r}, {vectors})"
        elif k in needed:
            yield from map("{} = {}".format, names[k], _texts(result, each, given))
    yield f"return {''.join(f'{names[k][0]}, ' for k in wanted)}"


def _texts(
    result: Result, instruction: Instruction, given: Sequence[Sequence[str]]
) -> Sequence[str]:
    """Return, for each element of the value of an instruction, the Python expression that computes
    the element; given: by operand of the instruction, the names of the operand's elements.
    """
    operation, _, constant, _ = instruction
    if operation == "element":
        return [given[0][constant[0]]]
    if operation == "look up":
        return ["t"] if constant == "time" else _elements(result, constant)
    if operation in ALL:
        return [ALL[operation](*given)]
    size = max(map(len, given))
    columns = zip(*(list(x) * size if len(x) == 1 else x for x in given), strict=True)
    if operation == "decided":  # the first operand, NaN if another operand is NaN
        return [f"{x} if {' and '.join(f'{y} == {y}' for y in by)} else nan" for x, *by in columns]
    return [EACH[operation].format(*elements) for elements in columns]


def _elements(result: Result, name: str) -> list[str]:
    places = result.vectors[name].flat if name in result.vectors else [result.columns.index(name)]
    return [f"b[{i}]" for i in places]
