# SPDX-License-Identifier: BSD-2-Clause
"""Memory layout of a fused system, in the order that fused.h defines.

layout.c prints the layouts of the models. A part is a component of the system. The memory of the
whole system is an array of doubles, and a place is an index of this array.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any

PARAMETER, INPUT, OUTPUT = range(3)
CAUSALITY = ("PARAMETER_ROW", "INPUT_ROW", "OUTPUT_ROW")
RULES = (
    "ANY_VALUE", "POSITIVE_VALUE", "NONNEGATIVE_VALUE", "SWITCH_VALUE", "ANGLE_VALUE", "ALARM_VALUE"
)  # fmt: skip
KINDS = ("PLAIN_ROW", "OPTIONAL_ROW", "GRID_ROW")
MACRO_STEP_TEXT = "macro step, of which every communication step is a whole multiple"
UNSETTLED = "initial values did not settle (an algebraic loop)"
CLOCK = 3
"""Number of doubles that describe the progress of the system: start time, number of finished macro
steps, and a flag that is 1 if the initial values did not settle. In memory they are followed by the
time that each slow part, which does not step at every macro step, has reached.
"""


@dataclass(frozen=True)
class Row:
    """Variable in the table of a model (struct Variable).

    first: index of its first double in the model; size: number of doubles; columns: number of
    columns of a matrix, 1 for other variables; rule, kind: indices of RULES and KINDS; names: if
    the value is the number of a mode, names of the modes 0, 1, ..., separated by `|`, else "".
    """

    causality: int
    first: int
    size: int
    columns: int
    rule: int
    kind: int
    unit: str
    name: str
    text: str
    names: str = ""

    def elements(self) -> Iterator[str]:
        """Yield the names of the elements: v, v[3] or v[2,3] (one-based, row major)."""
        for i in range(self.size):
            place = (
                f"{i + 1}"
                if self.columns == 1
                else f"{i // self.columns + 1},{i % self.columns + 1}"
            )
            yield self.name if self.size == 1 else f"{self.name}[{place}]"

    def scalars(self) -> Iterator[Row]:
        """Yield, for each element, a row that describes the element as a scalar variable."""
        for k, name in enumerate(self.elements()):
            yield replace(self, first=self.first + k, size=1, columns=1, name=name)


@dataclass(frozen=True)
class Model:
    """Memory layout of a model, whose memory is an array of doubles: parameters, inputs, states,
    outputs.

    symbol: C name of the model; size: number of doubles; scratch: number of further doubles as
    workspace of initialization; inputs, states, outputs: index of the first input, state, output;
    start: start values of parameters and inputs; rows: variables of the model.
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
    """Component in the memory of the system.

    values: start values by element; driven: source of each connected input element, [index of part,
    output element, factor, offset]; late: whether its outputs are published not by its step but
    by a later action of the plan, which is the schedule of a macro step; head: place of its first
    parameter (parameters and inputs are stored together); tail: place of its first state (states
    and outputs are stored together); published: place at which other components read each output
    element.
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
        """Return the place of element number `element` (from 0) of a variable of this part."""
        first = row.first + element
        inside = first < self.model.states
        return self.head + first if inside else self.tail + first - self.model.states


def read_layout(text: str) -> dict[str, Model]:
    """Return the layouts of models by symbol from `text`, which layout.c has printed."""
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
    """Memory of the whole system, and the variables of its FMU.

    rows: variables of the FMU; checked: connected inputs whose values must be in a range; front:
    values at the start of the memory: macro step [s], then start values of the parameters and
    inputs of all parts; times: by index of each slow part, place of the time that the part has
    reached; size: number of doubles.
    """

    parts: list[Part]
    rows: list[Row] = field(default_factory=list)
    checked: list[Row] = field(default_factory=list)
    front: list[float] = field(default_factory=list)
    times: dict[int, int] = field(default_factory=dict)
    size: int = 0


def lay_out(parts: list[Part], step: float, slow: Iterable[int]) -> Whole:
    """Return the memory of a system of these parts. In this order it contains: the macro step,
    parameters and inputs of all parts, CLOCK doubles of progress, times of slow parts, and for each
    part the buffer of late outputs, states and outputs.

    step: macro step [s]; slow: indices of the slow parts, which do not step at every macro step.
    """
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
    """Return the start values of the parameters and inputs of a part. A connected input has the
    start value that its model declares.
    """
    values = list(part.model.start)
    for row in part.model.rows:
        for k, name in enumerate(row.elements()):
            if row.causality != OUTPUT and name not in part.driven:
                values[row.first + k] = part.values[name]
    return values


def _publish(part: Part, buffer: int | None) -> None:
    """Set the places at which other components read the outputs of a part: where the part writes
    them, or, if they are published late, in the buffer that begins at the place `buffer`.
    """
    for row in _outputs(part):
        first = part.place(row, 0) if buffer is None else buffer
        part.published |= {name: first + k for k, name in enumerate(row.elements())}
        buffer = None if buffer is None else buffer + row.size


def _list_rows(whole: Whole) -> None:
    """Fill the lists of variables of `whole`: `rows` with parameters, all outputs and unconnected
    inputs, `checked` with connected inputs that have a range.
    """
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
                whole.checked.append(_named(part, row, part.place(row, 0), OUTPUT))


def _named(part: Part, row: Row, first: int, causality: int | None = None) -> Row:
    """Return a variable of a part as a variable PART.NAME of the system; first: place of its first
    double; causality: of the new variable (None: unchanged).
    """
    own = row.causality if causality is None else causality
    name = f"{part.name}.{row.name}"
    return replace(row, causality=own, first=first, name=name)


def _free(part: Part) -> Iterator[Row]:
    """Yield the parameters and unconnected inputs of a part. Of an input array that is partly
    connected, each unconnected element is a variable of its own.
    """
    for row in part.model.rows:
        names = list(row.elements())
        driven = [name in part.driven for name in names]
        if row.causality == PARAMETER or (row.causality == INPUT and not any(driven)):
            yield row
        elif row.causality == INPUT:
            yield from (one for one in row.scalars() if one.name not in part.driven)
