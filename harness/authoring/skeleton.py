# SPDX-License-Identifier: BSD-2-Clause
"""Sources with the ports of any component: the rows are made from its interface, the law is left to
the user.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Sequence
from string import Template

from harness.studies.show import Nested, Signal
from harness.system.values import Name

IN_C = Template("""\
/* $name.c - in the place of $place.
 *
 * The outputs keep their start values until control() computes them. */
#include "attitude.h"
#include "fmu.h"
#include "time_grid.h"

typedef struct { double sample_period; } Parameters;
typedef struct {
$inputs
} Input;
typedef struct { double unused; } State;
typedef struct {
$outputs
} Output;
MODEL_STRUCT;

static const Model start = {
$starts
};

static const Variable variables[] = {
    SAMPLE_PERIOD,
$rows
};

static void check(const Parameters *p, Problems *problems) { (void)p, (void)problems; }

/* the law: *y from *u */
static void control(const Parameters *p, const Input *u, Output *y)
{
    (void)p, (void)u, (void)y;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)x, (void)t;
    control(p, u, y);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    (void)x;
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        control(p, u, y);
}

FMU_MODEL("$name", "In the place of $place");
""")

IN_PYTHON = Template('''\
"""In the place of $place."""

import numpy as np
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

# names with start values: a list is a vector
INPUTS = {
$inputs
}
OUTPUTS = {
$outputs
}


class $class_name(Fmi2Slave):
    description = "In the place of $place"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u = {name: np.atleast_1d(value).astype(float) for name, value in INPUTS.items()}
        self.y = {name: np.atleast_1d(value).astype(float) for name, value in OUTPUTS.items()}
        for ports, starts, causality in (
            (self.u, INPUTS, Fmi2Causality.input),
            (self.y, OUTPUTS, Fmi2Causality.output),
        ):
            for name, values in ports.items():
                for i in range(len(values)):
                    element = f"{name}[{i + 1}]" if isinstance(starts[name], list) else name
                    self.register_variable(self.port(element, values, i, causality))

    def port(self, name, values, i, causality):
        def get():
            return float(values[i])

        def put(value):
            values[i] = value

        return Real(name, causality=causality, getter=get, setter=put)

    def control(self):
        """The law: self.y[...][:] from self.u[...]; until then they stay at the start."""

    def exit_initialization_mode(self):
        self.control()

    def do_step(self, current_time, step_size):
        self.control()
        return True
''')


def class_name(name: str) -> str:
    """A name as that of a class: my_pd becomes MyPd."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_")) or name


def in_c(name: str, place: str, ports: Sequence[Signal]) -> str:
    """A C file with these ports."""
    inputs, outputs = _by_causality(ports)
    return IN_C.substitute(
        name=name,
        place=_plain(place),
        inputs="\n".join(map(_declaration, inputs)) or "    double unused;",
        outputs="\n".join(map(_declaration, outputs)),
        starts=_starts(inputs, outputs),
        rows="\n".join(map(_row, (*inputs, *outputs))),
    )


def in_python(name: str, place: str, ports: Sequence[Signal]) -> str:
    """A Python file with these ports, for PythonFMU."""
    inputs, outputs = (
        "\n".join(f'    "{name}": {value},' for s in group for name, value in _vectors(s))
        for group in _by_causality(ports)
    )
    return IN_PYTHON.substitute(
        class_name=class_name(name), place=_plain(place), inputs=inputs, outputs=outputs
    )


def _by_causality(ports: Sequence[Signal]) -> tuple[list[Signal], list[Signal]]:
    outputs = [s for s in ports if s.causality == "output"]
    return [s for s in ports if s not in outputs], outputs


def _vectors(s: Signal) -> Iterator[tuple[str, Nested]]:
    """A signal with its start value as scalars and vectors; a matrix element by element."""
    values = [float(v) if isinstance(v, int | float) else 0.0 for v in _flat(s.default)]
    values = [v if math.isfinite(v) else 0.0 for v in values]
    values = values if len(values) == math.prod(s.shape) else [0.0] * math.prod(s.shape)
    if len(s.shape) < 2:
        yield s.name, list[Nested](values) if s.shape else values[0]
        return
    places = [(i + 1, j + 1) for i in range(s.shape[0]) for j in range(s.shape[1])]
    yield from ((str(Name(s.name, at)), v) for at, v in zip(places, values, strict=True))


# ---- C


def _member(name: str) -> str:
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _declaration(s: Signal) -> str:
    kinds = {(): "double {}", (3,): "vec3 {}", (3, 3): "mat3 {}"}
    array = "double {}" + "".join(f"[{n}]" for n in s.shape)
    kind = "quat {}" if s.shape == (4,) and s.name.startswith("q_") else kinds.get(s.shape, array)
    return f"    {kind.format(_member(s.name))};"


def _starts(inputs: Sequence[Signal], outputs: Sequence[Signal]) -> str:
    """The initializer of the model: its ports that do not start at zero."""
    parts = [".p = {.sample_period = 0}"]
    for part, group in (("u", inputs), ("y", outputs)):
        given = [f".{_member(s.name)} = {{{value}}}" for s in group if (value := _start(s))]
        if given:
            parts.append(f".{part} = {{{', '.join(given)}}}")
    return "\n".join(
        textwrap.fill(f"{p},", 100, initial_indent="    ", subsequent_indent="          ")
        for p in parts
    )


def _start(s: Signal) -> str:
    """Start values for the braces of an initializer; "" where all are zero."""
    values = [float(v) for v in _flat(s.default) if isinstance(v, int | float)]
    return ", ".join(map(repr, values)) if any(values) and all(map(math.isfinite, values)) else ""


def _flat(value: Nested) -> Iterator[Nested]:
    if isinstance(value, list):
        for each in value:
            yield from _flat(each)
    else:
        yield value


def _row(s: Signal) -> str:
    causality, part = ("INPUT_ROW", "u") if s.causality == "input" else ("OUTPUT_ROW", "y")
    unit, text = _plain(s.unit or "1"), _plain(s.text or s.name)
    member = _member(s.name)
    if member == s.name and len(s.shape) < 2:
        return f'    {causality.removesuffix("_ROW")}({member}, "{unit}", "{text}"),'
    columns = s.shape[1] if len(s.shape) == 2 else 1
    name = _plain(s.name)
    return (
        f'    ROW_AS({causality}, {part}, "{name}", {member}, {columns}, "{unit}", "{text}", '
        "ANY_VALUE),"
    )


def _plain(text: str) -> str:
    """A text that ends no string and no comment of C or Python."""
    return re.sub(r"[^\w .,;:()/+-]", "_", text.replace("*/", "*_"), flags=re.ASCII)
