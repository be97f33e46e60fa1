# SPDX-License-Identifier: BSD-2-Clause
"""Sources with the ports of any component: the rows are made from its interface, the law is left to
the user.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from string import Template

import numpy as np
from numpy.typing import NDArray

from harness.studies.show import Signal
from harness.system.values import Name

TEMPLATES = Path(__file__).parent / "templates"


def filled(template: str, **words: object) -> str:
    """A template with its words."""
    text = (TEMPLATES / f"{template}.template").read_text(encoding="utf-8")
    return Template(text).substitute(words)


def class_name(name: str) -> str:
    """A name as that of a class: my_pd becomes MyPd."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_")) or name


def made(name: str, ending: str, place: str, ports: Sequence[Signal]) -> str:
    """A file in C (.c), or in Python for PythonFMU (.py), with these ports."""
    outputs = [s for s in ports if s.causality == "output"]
    inputs = [s for s in ports if s not in outputs]
    words = {"name": name, "class_name": class_name(name), "place": _plain(place)}
    if ending == ".py":
        return filled("controller.py", **words, inputs=_listed(inputs), outputs=_listed(outputs))
    return filled(
        "controller.c",
        **words,
        inputs="\n".join(map(_declaration, inputs)) or "    double unused;",
        outputs="\n".join(map(_declaration, outputs)),
        starts=_starts(inputs, outputs),
        rows="\n".join(map(_row, (*inputs, *outputs))),
    )


def _start(s: Signal) -> NDArray[np.float64]:
    """The finite start values of a signal, in its shape; 0 where it has none."""
    values = np.array(s.default, dtype=np.float64)
    fits = values.shape == s.shape
    return np.nan_to_num(values, posinf=0, neginf=0) if fits else np.zeros(s.shape)


def _plain(text: str) -> str:
    """A text that ends no string and no comment of C or Python."""
    return re.sub(r"[^\w .,;:()/+-]", "_", text.replace("*/", "*_"), flags=re.ASCII)


# ---- Python


def _listed(group: Sequence[Signal]) -> str:
    return "\n".join(f'    "{name}": {value},' for s in group for name, value in _vectors(s))


def _vectors(s: Signal) -> Iterator[tuple[str, object]]:
    """A signal with its start value as scalars and vectors; a matrix element by element."""
    if len(s.shape) < 2:
        yield s.name, _start(s).tolist()
    else:
        for (i, j), value in np.ndenumerate(_start(s)):
            yield str(Name(s.name, (i + 1, j + 1))), float(value)


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
        starts = ((_member(s.name), _start(s).ravel()) for s in group)
        given = [f".{m} = {{{', '.join(map(repr, x.tolist()))}}}" for m, x in starts if x.any()]
        if given:
            parts.append(f".{part} = {{{', '.join(given)}}}")
    return "\n".join(
        textwrap.fill(f"{p},", 100, initial_indent="    ", subsequent_indent="          ")
        for p in parts
    )


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
