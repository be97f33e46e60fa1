# SPDX-License-Identifier: BSD-2-Clause
"""Where everything stands in the memory of a fused system: fused.h names the order.

layout.c prints what is known of the models; places are doubles from the beginning of the memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

PARAMETER, INPUT, OUTPUT = range(3)
CAUSALITY = ("PARAMETER_ROW", "INPUT_ROW", "OUTPUT_ROW")
RULES = (
    "ANY_VALUE", "POSITIVE_VALUE", "NONNEGATIVE_VALUE", "SWITCH_VALUE", "ANGLE_VALUE", "ALARM_VALUE"
)  # fmt: skip
KINDS = ("PLAIN_ROW", "OPTIONAL_ROW", "GRID_ROW")
MACRO_STEP_TEXT = "macro step: communication steps are whole multiples of it"
UNSETTLED = "initial values did not settle (an algebraic loop)"
CLOCK = 3
"""Doubles before the times of slow parts: start time, macro steps done, UNSETTLED."""


@dataclass(frozen=True)
class Row:
    """A row of the table of a model (struct Variable), `first` in doubles of the model."""

    causality: int
    first: int
    size: int
    columns: int
    rule: int
    kind: int
    unit: str
    name: str
    text: str

    def elements(self) -> Iterator[str]:
        """Names of the elements, as element_name() of interface.h makes them."""
        for i in range(self.size):
            place = (
                f"{i + 1}"
                if self.columns == 1
                else f"{i // self.columns + 1},{i % self.columns + 1}"
            )
            yield self.name if self.size == 1 else f"{self.name}[{place}]"


@dataclass(frozen=True)
class Model:
    """What layout.c says of a model: doubles of it, of its scratch, before its inputs, states and
    outputs; start: values of parameters and inputs.
    """

    symbol: str
    size: int
    scratch: int
    inputs: int
    states: int
    outputs: int
    start: list[float] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)


@dataclass
class Part:
    """A component in the memory of the whole: where its head (parameters, inputs) and its tail
    (states, outputs) begin, and where each output is published.
    """

    name: str
    model: Model
    values: dict[str, float]
    driven: dict[str, list[Any]]
    late: bool
    head: int = 0
    tail: int = 0
    published: dict[str, int] = field(default_factory=dict)

    def place(self, row: Row, element: int) -> int:
        """Double of an element in the memory of the whole."""
        first = row.first + element
        inside = first < self.model.states
        return self.head + first if inside else self.tail + first - self.model.states


def read_layout(text: str) -> dict[str, Model]:
    """Models by symbol from what layout.c prints."""
    models: dict[str, Model] = {}
    for line in text.splitlines():
        kind, *columns = line.split("\t")
        if kind == "model":
            model = Model(columns[0], *map(int, columns[1:]))
            models[model.symbol] = model
        elif kind == "start":
            model.start.extend(map(float.fromhex, columns))
        else:
            model.rows.append(Row(*map(int, columns[:6]), *columns[6:]))
    return models


@dataclass
class Whole:
    """The memory and the rows of the whole system."""

    parts: list[Part]
    rows: list[Row] = field(default_factory=list)
    judged: list[Row] = field(default_factory=list)
    front: list[float] = field(default_factory=list)
    times: dict[int, int] = field(default_factory=dict)
    size: int = 0


def lay_out(parts: list[Part], step: float, slow: Iterable[int]) -> Whole:
    """Places of everything: the front with its values, then clock, late outputs and tails."""
    whole = Whole(parts, front=[step])
    whole.rows.append(Row(PARAMETER, 0, 1, 1, 1, 0, "s", "macro_step", MACRO_STEP_TEXT))
    for part in parts:
        part.head = len(whole.front)
        whole.front += _head(part)
    size = len(whole.front) + CLOCK
    for i in slow:
        whole.times[i] = size
        size += 1
    for part in parts:
        buffer = size if part.late else None
        size += sum(row.size for row in _outputs(part)) if part.late else 0
        part.tail, size = size, size + part.model.size - part.model.states
        _publish(part, buffer)
    whole.size = size
    _list_rows(whole)
    return whole


def _outputs(part: Part) -> list[Row]:
    return [row for row in part.model.rows if row.causality == OUTPUT]


def _head(part: Part) -> list[float]:
    """Start values of parameters and inputs; a driven input begins as its model says."""
    values = list(part.model.start)
    for row in part.model.rows:
        for k, name in enumerate(row.elements()):
            if row.causality != OUTPUT and name not in part.driven:
                values[row.first + k] = part.values[name]
    return values


def _publish(part: Part, buffer: int | None) -> None:
    """Where its outputs are read: in its tail, or one row after the other in a buffer."""
    for row in _outputs(part):
        first = part.place(row, 0) if buffer is None else buffer
        part.published |= {name: first + k for k, name in enumerate(row.elements())}
        buffer = None if buffer is None else buffer + row.size


def _list_rows(whole: Whole) -> None:
    """The rows of the whole: parameters, open inputs, outputs; and driven inputs with a rule."""
    free = [(part, row) for part in whole.parts for row in _free(part)]
    for causality in (PARAMETER, INPUT):
        chosen = [(part, row) for part, row in free if row.causality == causality]
        whole.rows += [_named(part, row, part.place(row, 0)) for part, row in chosen]
    place = len(whole.front) + CLOCK - 1
    rule = RULES.index("ALARM_VALUE")
    whole.rows.append(Row(OUTPUT, place, 1, 1, rule, 0, "1", "unsettled", UNSETTLED))
    for part in whole.parts:
        names = {row.name for row in _free(part)}
        for row in part.model.rows:
            if row.causality == OUTPUT:
                whole.rows.append(_named(part, row, part.published[next(row.elements())]))
            elif row.causality == INPUT and row.rule and row.name not in names:
                whole.judged.append(_named(part, row, part.place(row, 0), OUTPUT))


def _named(part: Part, row: Row, first: int, causality: int | None = None) -> Row:
    """The row as one of the whole."""
    kept = row.causality if causality is None else causality
    name = f"{part.name}.{row.name}"
    return Row(kept, first, row.size, row.columns, row.rule, row.kind, row.unit, name, row.text)


def _free(part: Part) -> Iterator[Row]:
    """Parameters, and inputs that nobody drives; a row that is driven in part gives a row per
    element that is not.
    """
    for row in part.model.rows:
        names = list(row.elements())
        driven = [name in part.driven for name in names]
        if row.causality == PARAMETER or (row.causality == INPUT and not any(driven)):
            yield row
        elif row.causality == INPUT:
            for k, name in enumerate(names):
                if not driven[k]:
                    one = (row.first + k, 1, 1, row.rule, row.kind, row.unit, name, row.text)
                    yield Row(INPUT, *one)
