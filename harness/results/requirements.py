# SPDX-License-Identifier: BSD-2-Clause
"""Requirements of the user: expressions that must hold in every recorded row, with the worst one.

A requirement is a name and a text, `guidance.range >= 4 m` or `time < 20 min or norm(controller.e)
< 5 cm`, see harness.results.expressions. A system brings its own along, the user adds others. One
with windows, `eventually(always(guidance.range <= 4 m, 60 s), 20 min)`, holds at the start of the
run. Its margin says how far it is from failing, in the unit of what it compares.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from harness.results.evaluation import fitted, resolved, unit_in
from harness.results.expressions import Node, parsed
from harness.results.margins import Margins, by_row, compared, leaves, unit_of_margin
from harness.results.provenance import Provenance
from harness.results.result import Result
from harness.results.verdict import Judged, Kind, Verdict
from harness.spelling import did_you_mean
from harness.system.graph import Graph, build_graph, columns, constants, read_interfaces, rebuilt
from harness.system.model import Port, System
from harness.system.units import unit
from harness.system.values import base

_log = logging.getLogger("harness")


@dataclass(frozen=True)
class Finding:
    """What became of a requirement.

    value, unit, time [s]: what was compared where the margin was least (None: where there is none);
    reason: why it is not exercised, or cannot be judged; margin, margin_unit: distance to failing,
    negative where it fails, -inf of a run that ended early or of what is not a number, None where
    there is no verdict ("": several units are compared).
    """

    name: str
    text: str
    verdict: Verdict
    value: float | None = None
    unit: str = ""
    time: float | None = None
    reason: str = ""
    margin: float | None = None
    margin_unit: str = ""

    def __str__(self) -> str:
        word = Kind.REQUIREMENT.word(self.verdict)
        shown = word.upper() if self.verdict is Verdict.NOT_MET else word
        named = f"{self.name} ({self.text})" if self.name != self.text else self.text
        return f"{shown}: {named}{f'; {self.detail}' if self.detail else ''}"

    @property
    def told(self) -> str:
        """The verdict in words, with its detail."""
        return ", ".join(filter(None, [Kind.REQUIREMENT.word(self.verdict), self.detail]))

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


def refused(system: System, requirements: Mapping[str, Any], fixed: bool = False) -> list[str]:
    """What is wrong with requirements that are made of a system, one line each: texts that are no
    conditions, variables and parameters that nobody has, units that do not fit; fixed: they are
    conditions on parameters alone.
    """
    known = _units(system, fixed)
    return [
        f"{name}: {problem}"
        for name, text in requirements.items()
        for problem in _problems(text, known)
    ]


def say_inconsistencies(*systems: System) -> None:
    """Where parameters of systems contradict each other, in the log: a line with their values."""
    known: tuple[System, Graph] | None = None
    for system in systems:
        if system.consistency:
            graph = rebuilt(system, *known) if known else build_graph(system)
            known = system, graph
            for line in _inconsistencies(system, graph):
                _log.warning("%s", line)


def _inconsistencies(system: System, graph: Graph) -> Iterator[str]:
    """A line per condition on parameters that does not hold; conditions on what a swapped FMU does
    not have say nothing.
    """
    given = list(constants(graph))
    names, units, texts = columns([slot for slot, _ in given])
    values = np.array([[value for _, value in given]])
    table = Result(system.name, np.zeros(1), names, units, values, texts)
    nothing = np.empty((1, 0))
    result = Result(system.name, np.zeros(1), (), (), nothing, parameters=table)
    for name, text in system.consistency.items():
        if finding(result, name, text).verdict is Verdict.NOT_MET:
            paths = [path.rpartition(" ")[2] for path in condition(text).variables]
            shown = (f"{path} = {_written(table, path)}" for path in paths)
            yield f"{name}: {', '.join(shown)}; expected {text}"


def _written(table: Result, path: str) -> str:
    numbers = np.asarray(table[path][0]).reshape(-1)
    unit = table.unit(path)
    return f"{' '.join(f'{x:g}' for x in numbers)} {'' if unit == '1' else unit}".rstrip()


def _units(system: System, fixed: bool) -> dict[str, str]:
    """Units of everything that an expression may name, of parameters alone if fixed."""
    known = {} if fixed else {"time": "s"}
    for component, interface in read_interfaces(system).items():
        tables = {"parameter ": interface.named("parameter")}
        tables |= {} if fixed else {"": interface.named("output")}
        for kind, table in tables.items():
            for name, variable in table.items():
                port = f"{kind}{Port(component, name)}"
                known |= dict.fromkeys((port, base(port)), variable.unit or "")
    return known


@lru_cache(maxsize=256)
def condition(text: str) -> Node:
    """The tree of a requirement; ValueError if it is none."""
    tree = parsed(text)
    _check(tree)
    return tree


def _problems(text: Any, known: Mapping[str, str]) -> Iterator[str]:
    if not isinstance(text, str):
        yield f"must be a text, not {text!r}"
        return
    try:
        tree = condition(text)
        unknown = [path for path in tree.variables if path not in known]
        if not unknown:
            resolved(tree, lambda path: known[path])
    except ValueError as error:
        yield str(error)
        return
    yield from (_unknown(path, known) for path in unknown)


def _unknown(path: str, known: Iterable[str]) -> str:
    kind, _, name = path.rpartition(" ")
    names = [k.rpartition(" ")[2] for k in known if k.startswith("parameter ") == bool(kind)]
    return f"there is no {kind or 'variable'} {name}{did_you_mean(name, names)}"


def _check(tree: Node) -> None:
    """ValueError if a text is no condition, or a unit of it none."""
    if not (tree.kind == "compare" or tree.conditions):
        raise ValueError("is not a condition; write one like `component.variable >= 4 m`")
    for leaf, inside in leaves(tree):
        if leaf.has_window:
            raise ValueError(f"`{leaf.text}`: a window is a condition, not a number")
        if tree.has_window and not inside:
            raise ValueError(
                f"`{leaf.text}` beside a window is evaluated at the start of the run only; "
                f"write always({leaf.text})"
            )
    for node in tree.walk():
        unit(node.unit or "1")


def has_slope(text: str) -> bool:
    """Whether the margin of a requirement changes steadily, as a search needs it: not that of an
    equation or of a flag, which is met or not.
    """
    found = list(compared(parsed(text)))
    return bool(found) and all(leaf.name in ("<", "<=", ">", ">=") for leaf in found)


def margin(result: Result, text: str) -> float:
    """Distance of a requirement to failing, see Finding; NaN where there is no verdict."""
    found = finding(result, text, text)
    return math.nan if found.margin is None else found.margin


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
        with np.errstate(all="ignore"):
            return _found(result, name, text)
    except (KeyError, ValueError, IndexError, TypeError, ZeroDivisionError, OverflowError) as error:
        reason = str(error.args[0]) if error.args else type(error).__name__
        return Finding(name, text, Verdict.NOT_JUDGED, reason=reason)


def _found(result: Result, name: str, text: str) -> Finding:
    condition(text)
    tree = fitted(result, text)
    unit = unit_of_margin(tree, partial(unit_in, result))
    nothing = Finding(name, text, Verdict.NOT_JUDGED, margin_unit=unit)
    if tree.has_window:
        return _judged_at_start(result, nothing, tree)
    found = _judged(result, nothing, tree)
    if result.complete:
        return found
    if found.verdict is Verdict.NOT_MET:
        return replace(found, margin=-math.inf)
    return _ended_early(result, found)


def _ended_early(result: Result, found: Finding) -> Finding:
    """A run that ended early meets nothing: what it did not live to see is open."""
    reason = f"the run ended early, at {result.time[-1]:g} s"
    nothing = replace(found, value=None, unit="", time=None)
    return replace(nothing, verdict=Verdict.NOT_MET, reason=reason, margin=-math.inf)


def _judged_at_start(result: Result, found: Finding, tree: Node) -> Finding:
    """Of a requirement with windows."""
    margins = Margins(result, guarded=not tree.is_timing)
    margin, sign = (float(each[0]) for each in margins.over_windows(tree))
    if margins.undecided:
        return replace(found, verdict=Verdict.NOT_MET, value=math.nan, margin=-math.inf)
    if math.isnan(sign) and not result.complete:
        return _ended_early(result, found)
    if math.isnan(sign):
        reason = f"the run ends at {result.time[-1]:g} s, before its window is over"
        return replace(found, verdict=Verdict.NOT_EXERCISED, reason=reason)
    reason = f"margin {margin + 0.0:.6g} {found.margin_unit.removeprefix('1')}".rstrip()
    verdict = Verdict.MET if sign > 0 else Verdict.NOT_MET
    return replace(found, verdict=verdict, margin=margin, reason=reason)


def _judged(result: Result, found: Finding, tree: Node) -> Finding:
    margins = Margins(result, guarded=not tree.is_timing)
    met = bool(np.all(margins.truth(tree) == 1))
    if met and not margins.exercised(tree):
        reason = f"the run ends at {result.time[-1]:g} s, before it applies"
        return replace(found, verdict=Verdict.NOT_EXERCISED, reason=reason)
    undecided = by_row(np.any, np.isnan(margins.rows_of(margins.truth(tree))))
    least = np.where(undecided, -np.inf, margins.of(tree))
    row = int(np.argmax(undecided) if undecided.any() else np.argmin(least))
    value, unit = margins.value(margins.decisive(tree, row), row)
    value = math.nan if undecided.any() else value
    instant = float(result.time[row]) if len(least) == len(result.time) else None
    worst = replace(found, value=value, unit=unit, time=instant, margin=float(least[row]))
    return replace(worst, verdict=Verdict.MET if met else Verdict.NOT_MET)
