# SPDX-License-Identifier: BSD-2-Clause
"""Texts and tables that `harness list` and `harness show` print, without colours. The texts of
`harness show` are at most WIDEST characters wide.
"""

from __future__ import annotations

import io
import shutil
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.errors import UsageError
from harness.files import paths
from harness.master.changes import set_names
from harness.spelling import printable
from harness.ssp.library import find_system, load
from harness.studies.show import GROUPS, Difference, Nested, Part, Shown, Signal
from harness.system.interface import read_interface
from harness.system.model import Experiment

NARROWEST, WIDEST = 70, 100
GAP = 2


# ---- harness list


def listed(name: str | None = None) -> str:
    """Return a text about the system with this name or path, or about all systems and FMUs (None):
    components, parameter sets and alternatives.
    """
    if name is not None:
        return "\n".join(_system_lines(find_system(name)))
    systems, fmus = paths.systems(), paths.fmus()
    if not systems and not fmus:
        raise UsageError("no systems and FMUs found: build the project first (`make build`)")
    about = [f"  {line}" for path in systems.values() for line in _system_lines(path)]
    return "\n".join(("systems", *about, "FMUs", *_fmu_lines(fmus)))


def _fmu_lines(fmus: Mapping[str, Path]) -> Iterator[str]:
    width = max(map(len, fmus), default=0)
    for name, path in fmus.items():
        yield f"  {name:{width}}  {read_interface(path).model.description or ''}"


def _system_lines(path: Path) -> list[str]:
    with load(path) as system:
        swaps: dict[str, list[str]] = {}
        for alternative in system.alternatives:
            swaps.setdefault(alternative.component, []).append(alternative.fmu)
        return [
            f"{system.name}: {system.description}",
            f"  runs        {_time(system.experiment)}, {system.experiment.algorithm}",
            f"  components  {', '.join(f'{c.name} ({c.fmu.stem})' for c in system.components)}",
            *(f"  without     {name}" for name in system.without),
            f"  sets        {', '.join(set_names(system))}",
            *(f"    {s.name}: {s.description}" for s in system.sets if s.description),
            *(f"  swaps       {c}={','.join(fmus)}" for c, fmus in swaps.items()),
        ]


def _time(experiment: Experiment) -> str:
    """Return stop time and macro step of a system as text. For a value that the file lacks, the
    text names the option that sets it.
    """
    stop, step = experiment.stop, experiment.step
    if stop is None and step is None:
        return "with --stop and --step (the file defines neither)"
    end = "with --stop" if stop is None else f"{stop} s"
    return f"{end}, with --step" if step is None else f"{end}, macro step {step} s"


# ---- harness show


def text(shown: Shown, heads: tuple[str, str] = ("before", "after")) -> str:
    """Return the text of `harness show`: a title, then a table of components, of differences, or of
    inputs, outputs and parameters. heads: titles of the two columns of values in a table of
    differences.
    """
    parts = [row for row in shown.rows if isinstance(row, Part)]
    signals = [row for row in shown.rows if isinstance(row, Signal)]
    tables = []
    if parts:
        head = ("component", "FMU", "step [s]", "samples [s]", "description")
        rows = [(p.name, p.fmu, _number(p.step), _number(p.sample_period), p.text) for p in parts]
        tables.append(_table(head, rows))
    if different := [row for row in shown.rows if isinstance(row, Difference)]:
        cells = [
            (d.name, d.unit, value_text(d.before), value_text(d.after), d.text) for d in different
        ]
        tables.append(_table(("value", "unit", *heads, "description"), cells))
    for causality in GROUPS:
        if group := [s for s in signals if s.causality == causality]:
            tables.append(_signals(causality, group))
    title = textwrap.fill(printable(shown.title), _width(), subsequent_indent="  ")
    return "\n\n".join((title, *tables))


def _signals(causality: str, signals: Sequence[Signal]) -> str:
    """Return a table of variables of one causality, without empty columns."""
    wires = {"input": "driven by", "output": "read by", "parameter": ""}[causality]
    head = (f"{causality}s", "size", "unit", wires, "value", "default", "limits", "description")
    columns = list(zip(head, *map(_signal, signals), strict=True))
    used = [column for column in columns if column is columns[0] or any(column[1:])]
    first, *rows = zip(*used, strict=True)
    return _table(first, rows)


def _signal(s: Signal) -> tuple[str, ...]:
    size = "x".join(map(str, s.shape))
    unit = s.unit if s.type == "Real" else s.type
    value = "" if s.causality == "output" else value_text(s.value)
    default = "" if s.causality == "output" or s.wires else value_text(s.default)
    wires = ", ".join(_end(s, wire) for wire in s.wires)
    return s.name, size, unit, wires, value, default * (default != value), _limits(s), s.text


def _end(s: Signal, wire: str) -> str:
    """Return the text in the table for a variable that is connected to the signal s.

    wire: the connected variable as COMPONENT.VARIABLE. If s is an output and drives an input of the
    same name, the text is only COMPONENT.
    """
    component, _, variable = wire.rpartition(".")
    return component if s.causality == "output" and variable == s.name else wire


TIED = "\ue000"
"""Placeholder for a blank at which a line must not be broken."""


def value_text(value: Nested) -> str:
    """Return a value as text in the notation of --set, with seven significant digits."""
    if not isinstance(value, list):
        return "" if value is None else _number(value)
    inner = [value_text(each) for each in value]
    if isinstance(value[0], list):  # a line may be broken only between two rows of a matrix
        inner = [row.replace(" ", TIED) for row in inner]
    return f"[{', '.join(inner)}]"


def _number(value: Any) -> str:
    if isinstance(value, float):
        return format(value, ".7g")
    return "" if value is None else str(value).lower() if isinstance(value, bool) else str(value)


def _limits(s: Signal) -> str:
    if s.low is None and s.high is None:
        return ""
    if s.high is None:
        return f">= {_number(s.low)}"
    return f"<= {_number(s.high)}" if s.low is None else f"{_number(s.low)}..{_number(s.high)}"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table as text. If its lines would be too long, the cells of the widest columns are
    wrapped at blanks; cells in the first column are never wrapped.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    cells = [[printable(" ".join(cell.split())) for cell in row] for row in (head, *rows)]
    table = Table(box=None, pad_edge=False, padding=(0, GAP, 0, 0), show_header=False)
    for k in range(len(head)):
        table.add_column(no_wrap=not k, overflow="fold")
    for row in cells:
        table.add_row(*map(Text, row))
    page = io.StringIO()
    Console(file=page, width=_width(), no_color=True, legacy_windows=False).print(table)
    lines = page.getvalue().replace(TIED, " ").split("\n")
    return "\n".join(line.rstrip() for line in lines).rstrip()


def _width() -> int:
    """Return the number of characters per line: the width of the terminal, but at least NARROWEST
    and at most WIDEST; WIDEST if the output goes to a pipe.
    """
    return min(max(shutil.get_terminal_size((WIDEST, 24)).columns, NARROWEST), WIDEST)
