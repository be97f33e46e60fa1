# SPDX-License-Identifier: BSD-2-Clause
"""Requirements: conditions that must hold in every recorded row of a run, and their evaluation.

A requirement has a name and a text, such as `guidance.range >= 4 m`; the text is an expression, see
harness.results.expressions. Requirements are defined by the system, and further ones by the user
for a run. A requirement with a window of time, such as `eventually(guidance.range <= 4 m, 20 min)`,
must hold at the start of the run only. The margin of a requirement is its distance to failing, in
the unit of the compared quantities.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np

from harness.results.evaluation import history, resolved
from harness.results.expressions import Node, parsed
from harness.results.margins import Requirement, compared, compiled, leaves
from harness.results.program import of_rows
from harness.results.provenance import Provenance
from harness.results.result import Result, parameters_of
from harness.results.verdict import Kind, Outcome, Verdict
from harness.spelling import did_you_mean
from harness.system.graph import Graph, build_graph, read_interfaces, rebuilt
from harness.system.model import Port, System
from harness.system.units import convert, unit
from harness.system.values import base

_log = logging.getLogger("harness")
SMALL, MANY = ("cm", "mm"), 1000.0
"""Units of small lengths, and the number from which on a length in such a unit is shown in m."""


@dataclass(frozen=True)
class Finding:
    """Outcome of evaluating one requirement.

    value, unit, time [s]: the compared quantity in the row with the smallest margin (None: there is
    none); reason: why there is no value, or, for a requirement with a window, its margin as text;
    margin: distance to failing, negative if the requirement fails, -inf for a run that ended early
    (unless all windows of the requirement were over) or a value that is not a number, None for
    NOT_EXERCISED and NOT_JUDGED; margin_unit: unit of the margin, "" if quantities of several units
    are compared.
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
        named = f"{self.name} ({self.text})" if self.name != self.text else self.text
        return f"{self.word}: {named}{f'; {self.detail}' if self.detail else ''}"

    @property
    def word(self) -> str:
        """Return the verdict in one or two words, in capitals if the requirement is not met."""
        word = Kind.REQUIREMENT.word(self.verdict)
        return word.upper() if self.verdict is Verdict.NOT_MET else word

    @property
    def statement(self) -> str:
        """Return the verdict in words, with its detail."""
        return ", ".join(filter(None, [Kind.REQUIREMENT.word(self.verdict), self.detail]))

    @property
    def outcome(self) -> Outcome:
        """Return the finding as an Outcome, from which the exit status follows."""
        return Outcome(Kind.REQUIREMENT, self.name, self.verdict, str(self))

    @property
    def detail(self) -> str:
        """Return the worst value with its time; without such a value, return `reason`."""
        if self.value is None:
            return self.reason
        place = "" if self.time is None else f" at {self.time:g} s"
        return f"{'not a number' if math.isnan(self.value) else f'worst {self.worst}'}{place}"

    @property
    def worst(self) -> str:
        """Return the worst value with its unit, "" if there is no value. A value of 1000 or more in
        a small unit of length is in m.
        """
        if self.value is None:
            return ""
        value, unit = self.value, self.unit.removeprefix("1")
        if unit in SMALL and abs(value) >= MANY:
            value, unit = convert(value, unit, "m"), "m"
        return f"{value:.6g} {unit}".rstrip()


def rejected(system: System, requirements: Mapping[str, Any], fixed: bool = False) -> list[str]:
    """Return the problems of requirements of a system, one line each: texts that are not
    conditions, variables and parameters that do not exist, incompatible units. fixed: whether
    they are conditions on parameters (`consistency`), in which a variable is a problem.
    """
    known = _units(system, fixed)
    return [
        f"{name}: {problem}"
        for name, text in requirements.items()
        for problem in _problems(text, known)
    ]


def log_inconsistencies(*systems: System) -> None:
    """Log a line for each condition on parameters of the systems (`consistency`) that does not
    hold, with the values of the parameters.
    """
    known: tuple[System, Graph] | None = None
    for system in systems:
        if system.consistency:
            graph = rebuilt(system, *known) if known else build_graph(system)
            known = system, graph
            for line in _inconsistencies(system, graph):
                _log.warning("%s", line)


def _inconsistencies(system: System, graph: Graph) -> Iterator[str]:
    """Yield a line per condition on parameters (`consistency`) that does not hold. Conditions on
    parameters that a swapped FMU lacks are ignored.
    """
    table, nothing = parameters_of(system.name, graph), np.empty((1, 0))
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
    """Return units by the names that an expression may contain: variables, `time` and parameters.
    fixed: parameters only.
    """
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
    """Return the tree of a requirement; raise ValueError if the text is not a condition."""
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
    """Raise ValueError if a tree is not a condition, or contains an unknown unit."""
    if not (tree.kind == "compare" or tree.conditions):
        raise ValueError("is not a condition; write one like `component.variable >= 4 m`")
    for leaf, inside in leaves(tree):
        if not leaf.variables:
            raise ValueError(
                f"`{leaf.text}` contains no variable, so its outcome is always the same"
            )
        if leaf.has_window:
            raise ValueError(
                f"`{leaf.text}`: always(), eventually() and until() are conditions and cannot be "
                "compared"
            )
        if tree.has_window and not inside:
            raise ValueError(
                f"`{leaf.text}` is outside of every window, so it would be evaluated at the start "
                f"of the run only; write always({leaf.text})"
            )
    for node in tree.walk():
        unit(node.unit or "1")


def has_slope(text: str) -> bool:
    """Return whether the margin of a requirement changes gradually from met to not met, as the
    search for a worst run requires: it compares by <, <=, > and >= only. Flags hold or fail.
    """
    found = list(compared(parsed(text)))
    return bool(found) and all(leaf.name in ("<", "<=", ">", ">=") for leaf in found)


def margin(result: Result, text: str) -> float:
    """Return the margin of the requirement `text`, its distance to failing, negative if it fails
    (see Finding); NaN if the requirement is not exercised or not judged.
    """
    found = finding(result, text, text)
    return math.nan if found.margin is None else found.margin


def demanding(result: Result, further: Mapping[str, str]) -> Result:
    """Return the result with the requirements `further` (texts by name) added to its provenance."""
    before = result.provenance or Provenance(system=result.system)
    both = {**dict(before.requirements), **further}
    if not further:
        return result
    return replace(result, provenance=replace(before, requirements=tuple(both.items())))


def findings(result: Result) -> list[Finding]:
    """Evaluate all requirements that a result contains, and return the findings with their
    verdicts.
    """
    own = () if result.provenance is None else result.provenance.requirements
    return [finding(result, name, text) for name, text in own]


def finding(result: Result, name: str, text: str) -> Finding:
    """Evaluate a requirement: return its verdict and the row in which it was closest to failing. A
    requirement with always(), eventually() or until() is decided by the first row and has no such
    row. A requirement that cannot be evaluated gets the verdict NOT_JUDGED.
    """
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
    required = compiled(result, text)
    nothing = Finding(name, text, Verdict.NOT_JUDGED, margin_unit=required.margin_unit)
    if required.at_start:
        values = required.program.run(partial(history, result), result.complete)
        return _evaluated_at_start(result, nothing, required, values)
    found = _of_one_row(result, nothing, required) or _evaluated(result, nothing, required)
    if result.complete:
        return found
    if found.verdict is Verdict.NOT_MET:
        return replace(found, margin=-math.inf)
    return _ended_early(result, found)


def _ended_early(result: Result, found: Finding) -> Finding:
    """Return the finding for a run that ended before the requirement was decided. It is not met,
    because the rest of the run is unknown.
    """
    reason = f"the run ended early, at {result.time[-1]:g} s"
    nothing = replace(found, value=None, unit="", time=None)
    return replace(nothing, verdict=Verdict.NOT_MET, reason=reason, margin=-math.inf)


def _evaluated_at_start(
    result: Result, found: Finding, required: Requirement, values: list[Any]
) -> Finding:
    """Return the finding for a requirement with always(), eventually() or until(), which are
    conditions over windows of time: the first row, whose windows are relative to the start of the
    run, decides. found: finding to which verdict, margin and reason are added; values: value of
    each instruction of the requirement's program.
    """
    margin, sign = (float(values[k][0, 0]) for k in (required.margin, required.truth))
    if values[required.undecided]:
        return replace(found, verdict=Verdict.NOT_MET, value=math.nan, margin=-math.inf)
    if math.isnan(sign) and not result.complete:
        return _ended_early(result, found)
    if math.isnan(sign):
        reason = f"the run ends at {result.time[-1]:g} s, before its window is over"
        for window, is_empty in required.empty.items():
            if values[is_empty]:
                reason = f"no recorded row lies in a window of {window}"
        return replace(found, verdict=Verdict.NOT_EXERCISED, reason=reason)
    reason = f"margin {margin + 0.0:.6g} {found.margin_unit.removeprefix('1')}".rstrip()
    return replace(_with_margin(found, sign > 0, margin), reason=reason)


def _of_one_row(result: Result, found: Finding, required: Requirement) -> Finding | None:
    """Return the finding for a requirement with a single comparison (Requirement.single): the row
    with the least margin decides.

    Return None if only _evaluated() can state the finding: `single` or the rows from
    Limits.applying() are None, or the margin is not finite.
    """
    single = required.single
    if single is None or (rows := single.limits.applying(result)) is None:
        return None
    values = required.program.run(of_rows(partial(history, result), rows), only=single.needed)
    difference, least = values[single.difference], single.name in (">", ">=")
    place = int(np.argmin(difference) if least else np.argmax(difference))
    row, element = divmod(place, difference.shape[1])
    margin = float(difference[row, element]) if least else -float(difference[row, element])
    if not math.isfinite(margin):
        return None
    value = float(_at(_at(values[single.value], row), element))
    value, unit = _in_unit(value, *single.units)
    instant = float(result.time[rows][row]) if required.has_rows else None
    met = margin > 0 or (margin == 0 and single.name in ("<=", ">="))
    return _with_margin(replace(found, value=value, unit=unit, time=instant), met, margin)


def _in_unit(value: float, given: str, written: str) -> tuple[float, str]:
    """Return a value with its unit: converted to the unit `written` in the comparison, if there is
    one, else unchanged in the unit `given`.
    """
    return (convert(value, given, written), written) if written else (value, given)


def _evaluated(result: Result, found: Finding, required: Requirement) -> Finding:
    """Return the finding for a requirement that must hold in every row."""
    values = required.program.run(partial(history, result), result.complete)
    truth, least = values[required.truth], values[required.margin]
    met = bool(np.all(truth == 1))
    if met and not values[required.exercised]:
        reason = f"it does not apply up to the end at {result.time[-1]:g} s"
        return replace(found, verdict=Verdict.NOT_EXERCISED, reason=reason)
    undecided = np.isnan(truth).any(axis=1)
    row = int(np.argmax(undecided) if undecided.any() else np.argmin(least))
    value, unit = math.nan, ""
    if not undecided.any():
        element = int(np.argmin(_at(values[required.elements], row)))
        value, which = (
            float(_at(_at(values[k], row), element)) for k in (required.value, required.which)
        )
        value, unit = _in_unit(value, *required.units[int(which)])
    instant = float(result.time[row]) if required.has_rows else None
    worst = replace(found, value=value, unit=unit, time=instant)
    return _with_margin(worst, met, float(least[row, 0]))


def _at(rows: Any, row: int) -> Any:
    return rows[row if len(rows) > 1 else 0]


def _with_margin(found: Finding, met: bool, margin: float) -> Finding:
    """Return a finding with its verdict and margin. If the requirement is not met, a margin of 0,
    as for `x > 4` at x = 4, is replaced by the largest double below 0.
    """
    if met:
        return replace(found, verdict=Verdict.MET, margin=margin)
    return replace(found, verdict=Verdict.NOT_MET, margin=min(margin, -math.ulp(0.0)))
