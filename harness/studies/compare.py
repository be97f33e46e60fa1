# SPDX-License-Identifier: BSD-2-Clause
"""Several runs of one system side by side, in parallel, measured and put into one table.

They are run by as many processes as there are processors, each with a simulation that stays warm.
A run with FMUs that are not ours has a process of its own below. Whatever an FMU does costs its own
run only.
"""

from __future__ import annotations

import csv
import logging
import math
import os
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, as_completed
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from harness.errors import HarnessError, ResultsError, RunError, UsageError
from harness.files.output import command_line, work_for, written
from harness.master.changes import apply
from harness.master.executors import FUSED, known_executor
from harness.master.fused import Whole, compiled
from harness.master.isolated import PATIENCE
from harness.master.messages import said_once
from harness.master.trial import always_refused
from harness.mission import Limits
from harness.mission.library import of_result
from harness.mission.mission import Mission, apart, measured, together
from harness.results.files import ResultFile, read
from harness.results.requirements import findings, say_inconsistencies
from harness.results.result import Result
from harness.spelling import one_line
from harness.ssp.library import load
from harness.studies.crew import CRASH, Crew, LostError, prepare
from harness.studies.variants import Variant
from harness.studies.warm import Warm
from harness.system.graph import checked, say_warnings
from harness.system.model import System
from harness.system.values import base

_log = logging.getLogger("harness")

ROWS = 20_000
"""Rows that a run has at most unless the user wants otherwise."""
TABLE = "comparison.csv"
WIDTH = 120
Measures = Mapping[tuple[str, str], Mapping[str, float]]
"""Values by (name, unit) of a measure, then by the label of a run."""


@dataclass(frozen=True)
class Outcome:
    """What came of a variant: its results file, if there are results (of a run that ended early the
    partial one), and the one line that says why it ended early ("": it did not).

    pace: time of a macro step, of the quickest tenth of a second of the run [us].
    """

    variant: Variant
    file: Path | None
    failure: str = ""
    pace: float = math.nan


@dataclass(frozen=True)
class Comparison:
    """Outcomes with their results by label, the limits they are held against, the measures of all:
    (name, unit) -> label -> value, and which actuator limits were in force, in a line.
    """

    outcomes: tuple[Outcome, ...]
    results: Mapping[str, Result]
    limits: Limits
    measures: Measures
    mission: Mission
    in_force: str = ""

    def text(self, names: Sequence[str] = ()) -> str:
        """The table for reading, with the limits in force above and the definitions of its columns
        below; names: of the measures that it shall have (default: all).
        """
        chosen = {k: c for k, c in self.measures.items() if not names or k[0] in names}
        keys = {(m.name, m.unit): m for m in self.mission.measures}
        about = {key: m.about(self.limits, self.results) for key, m in keys.items() if m.about}
        words = {key: m.words for key, m in keys.items() if m.words}
        warnings = (f"warning: {line}" for line in apart(self.mission.measures, self.measures))
        defined = (text for lines in self.mission.definitions for text in lines(self.limits))
        shown = table(chosen, self.labels, about, words)
        head = [self.in_force, ""] if self.in_force else []
        lines = [*head, shown, *warnings, *defined, *self.findings()]
        return "\n".join(line if line is shown else _wrapped(line) for line in lines)

    def findings(self) -> list[str]:
        """One line per requirement and run."""
        return [
            f"requirement {label}: {finding}"
            for label, result in self.results.items()
            for finding in findings(result)
        ]

    @property
    def labels(self) -> list[str]:
        """Labels of the variants in the order of the table."""
        return [outcome.variant.label for outcome in self.outcomes]

    @property
    def failures(self) -> list[str]:
        """One line per run that ended early."""
        return [
            f"{outcome.variant.label}: {outcome.failure}"
            for outcome in self.outcomes
            if outcome.failure
        ]


def _wrapped(line: str) -> str:
    return textwrap.fill(line, WIDTH, subsequent_indent="  ") if line.strip() else line


def compare(  # noqa: PLR0913 - what a comparison can be told
    system: str | Path,
    variants: Sequence[Variant],
    directory: Path,
    *,
    limits: Limits | None = None,
    every: int | None = None,
    patience: float = PATIENCE,
    progress: Callable[[int], None] | None = None,
    executor: str = "c",
) -> Comparison:
    """Run all variants in parallel and measure them; results go to `directory` as LABEL.nc, the
    table to comparison.csv.

    limits: bands and keep-out radius that the runs are held against; every: record every N-th
    macro step (default: as many that a run has at most 20 000 rows);
    patience: how long an FMU that is not ours may take for one call [s]; progress: called with the
    number of runs that are over; executor: as for run(). Raises what run() raises before its first
    step, and ResultsError; a run that fails under way ends early, the others go on.
    """
    known_executor(executor)
    prepare(__name__)
    variants, in_force = _in_force(system, variants)
    if every is not None and every < 1:
        raise UsageError(f"--every must be at least 1, not {every}")
    steps = _check((system, executor), variants, ResultFile(directory / "any.nc"), patience)
    files = [ResultFile(directory / f"{variant.file}.nc").path for variant in variants]
    thinning = [_thinning(n) if every is None else every for n in steps]
    flights = list(zip(variants, files, thinning, strict=True))
    outcomes = _run_all((system, executor), flights, patience, progress)
    results = {outcome.variant.label: read(outcome.file) for outcome in outcomes if outcome.file}
    offered = together(map(of_result, results.values()))
    held = offered.limits(limits or Limits(), results)
    taken = measured(offered.measures, results, held)
    labels = [outcome.variant.label for outcome in outcomes]
    paces = {outcome.variant.label: outcome.pace for outcome in outcomes if not outcome.failure}
    taken = taken | {("macro step", "us"): paces}
    comparison = Comparison(outcomes, results, held, taken, offered, in_force)
    write_csv(comparison.measures, labels, directory / TABLE)
    return comparison


def _in_force(system: str | Path, variants: Sequence[Variant]) -> tuple[Sequence[Variant], str]:
    """The variants in the set that the system has for comparisons, unless they name theirs, and the
    line that says so.
    """
    with load(system) as found:
        sets = {s.name: s for s in found.sets}
        chosen = sets.get(found.compared)
        usual = {c.name: c.parameters for c in found.components}
    if chosen is None:
        return variants, ""
    named = {str(v.changes["params"]) for v in variants if v.changes.get("params") is not None}
    if named:
        usually = f"; usually set {chosen.name}" if chosen.name not in named else ""
        return variants, f"limits: as --params {', '.join(sorted(named))} has them{usually}"
    own: dict[str, list[str]] = {}
    for component, given in chosen.parameters.items():
        for name, parameter in given.items():
            if usual[component].get(name) != parameter:
                own.setdefault(base(f"{component}.{name}"), []).append(str(parameter.value))
    values = ", ".join(f"{name} = {' '.join(numbers)}" for name, numbers in own.items())
    text = f"limits: set {chosen.name}, {chosen.description}{f' ({values})' if values else ''}"
    text += "; --params default: those of the system"
    return [replace(v, changes={**v.changes, "params": chosen.name}) for v in variants], text


def _check(
    flown: tuple[str | Path, str],
    variants: Sequence[Variant],
    file: ResultFile,
    patience: float,
) -> list[int]:
    """Find everything that is wrong with a variant before any is run; returns the macro steps of
    each.
    """
    steps = []
    system, executor = flown
    with load(system) as found, said_once():
        systems = [_applied(found, variant) for variant in variants]
        say_warnings(*systems)
        say_inconsistencies(*systems)
        wholes: list[Whole | None] = []
        for changed in systems:
            file.accept(changed)
            graph, count = checked(changed)
            steps.append(count)
            if executor == FUSED and not any(w and w.fits(changed, graph) for w in wholes):
                wholes.append(compiled(changed, graph))  # said here if it cannot be
        kinds: dict[object, System] = {}
        for variant, changed in zip(variants, systems, strict=True):
            kind = variant.changes.get("params"), *changed.origin.swaps.values()
            kinds.setdefault(kind, changed)
        varied = variants[0].varied
        fixed = {n: value for n, value in systems[0].origin.set.items() if n not in varied}
        for error in always_refused(kinds.values(), fixed, varied, patience):
            if isinstance(error, UsageError):
                raise error
    return steps


def _applied(system: System, variant: Variant) -> System:
    """The system of a variant; what is wrong with a value is told of the option that gave it."""
    try:
        return apply(system, **variant.changes)
    except UsageError as error:
        raise UsageError(_as_given(variant, str(error))) from error.__cause__


def _as_given(variant: Variant, text: str) -> str:
    """A text with the option that gave each value."""
    for name in variant.varied:
        text = re.sub(rf"--set (?={re.escape(name)}(?!\w))", "--vary ", text)
    return text


def _thinning(steps: int) -> int:
    """Macro steps per row for at most ROWS rows, with the end of the run in the last row if that is
    possible.
    """
    least = math.ceil(steps / ROWS)
    return next((n for n in range(least, 2 * least) if steps % n == 0), least)


# ---- running


def _run_all(
    flown: tuple[str | Path, str],
    variants: Sequence[tuple[Variant, Path, int]],
    patience: float,
    progress: Callable[[int], None] | None,
) -> tuple[Outcome, ...]:
    """Run as many variants at once as there are processors.

    flown: the system and the executor; variants: with the file for the results and the macro steps
    per row.
    """
    count = min(len(variants), os.cpu_count() or 1)
    with Crew(count, partial(_at_work, *flown, command_line())) as crew:
        jobs = [crew.submit(_attempt, *variant, patience) for variant in variants]
        for done, job in enumerate(as_completed(jobs), start=1):
            with suppress(LostError):
                job.result()
            if progress is not None:
                progress(done)
    return tuple(_outcome(job, v) for job, (v, *_) in zip(jobs, variants, strict=True))


def _outcome(job: Future[Outcome], variant: Variant) -> Outcome:
    try:
        return job.result()
    except LostError:
        return Outcome(variant, None, CRASH)


# ---- in the process


_warm: Warm | None = None


@contextmanager
def _at_work(system: str | Path, executor: str, command: str | None) -> Iterator[None]:
    """Leave the warnings that _check() has already logged to the parent."""
    global _warm  # noqa: PLW0603 - a process has one simulation
    _log.setLevel(logging.ERROR)
    work_for(command)
    _warm = Warm(system, executor)
    with closing(_warm):
        yield


def _attempt(variant: Variant, path: Path, every: int, patience: float) -> Outcome:
    file = ResultFile(path)
    try:
        assert _warm is not None
        result = _warm.fly(variant.changes, every, patience)
        _retire_table(path.parent)
        file.write(result)
    except RunError as error:
        return _ended(variant, file, error)
    except HarnessError as error:
        return Outcome(variant, None, _as_given(variant, str(error)))
    return Outcome(variant, path, "", _warm.pace)


def _ended(variant: Variant, file: ResultFile, error: RunError) -> Outcome:
    """What came of a run that ended early."""
    if error.partial is None:
        return Outcome(variant, None, str(error))
    try:
        file.keep(error.partial)
    except HarnessError as lost:
        return Outcome(variant, None, f"{error}; {lost}")
    return Outcome(variant, file.partial if file.partial.is_file() else None, str(error))


def _retire_table(folder: Path) -> None:
    """Remove the table of an earlier comparison when its first results are replaced."""
    with suppress(OSError):
        (folder / TABLE).unlink()


# ---- the table, for reading and as .csv


def table(
    measures: Measures,
    labels: Sequence[str],
    about: Mapping[tuple[str, str], str] = {},
    words: Mapping[tuple[str, str], Sequence[str]] = {},
) -> str:
    """The table for reading, in blocks of at most WIDTH columns; measures that no run has are left
    out, single gaps are `-`; about: last line of a heading, words: what values 0, 1, .. stand for.
    """
    shown = {
        key: column for key, column in measures.items() if any(map(math.isfinite, column.values()))
    }
    heads = 4 if any(about.get(key) for key in shown) else 3
    columns = []
    for key, column in shown.items():
        values = [column.get(label, math.nan) for label in labels]
        named = words.get(key, ())
        cells = [named[int(v)] if 0 <= v < len(named) else "-" for v in values]
        name, unit = (one_line(part) for part in key)
        bracket = "" if named else f"[{unit}]"
        head = [*(*name.split(" ", 1), "")[:2], bracket, about.get(key, "")]
        columns.append([*head[:heads], *(cells if named else _numbers(values))])
    first = ["" for _ in range(heads)] + list(map(one_line, labels))
    return "\n\n".join(_block([first, *block]) for block in _blocks(first, columns))


def _blocks(
    first: Sequence[str], columns: Sequence[Sequence[str]]
) -> Iterator[list[Sequence[str]]]:
    """Columns that fit beside the labels."""
    block: list[Sequence[str]] = []
    width = begin = max(map(len, first))
    for column in columns:
        size = 2 + max(map(len, column))
        if block and width + size > WIDTH:
            yield block
            block, width = [], begin
        block.append(column)
        width += size
    yield block


def _block(columns: Sequence[Sequence[str]]) -> str:
    """Lines of columns, the first one to the left, all others to the right."""
    labels, *others = columns
    width = max(map(len, labels))
    cells = [[label.ljust(width) for label in labels]]
    for column in others:
        width = max(map(len, column))
        cells.append([cell.rjust(width) for cell in column])
    return "\n".join("  ".join(row).rstrip() for row in zip(*cells, strict=True))


def _numbers(values: Sequence[float]) -> list[str]:
    """Numbers with the same decimals everywhere: four digits of the largest, or powers of ten where
    the smallest would vanish.
    """
    sizes = [abs(v) for v in values if math.isfinite(v) and v]
    decimals = max(0, 3 - math.floor(math.log10(max(sizes, default=1.0))))
    small = bool(sizes) and min(sizes) < 0.5 * 10.0 ** -min(decimals, 4)
    form = "z.2e" if small else f"z.{min(decimals, 4)}f"  # z: no zero has a sign
    return [format(v, form) if math.isfinite(v) else "-" for v in values]


def read_csv(path: Path) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Columns of a table of write_csv() by their heading `name [unit]`, then by the label of the
    run, and the labels; ResultsError if it cannot be read.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            (_, *heads), *rows = csv.reader(file)
        labels = [label for label, *_ in rows]
        cells = [[float(cell or "nan") for cell in row] for _, *row in rows]
        columns = zip(*cells, strict=True) if cells else ([] for _ in heads)
        found = zip(heads, columns, strict=True)
        return {head: dict(zip(labels, c, strict=True)) for head, c in found}, labels
    except (OSError, ValueError) as error:
        raise ResultsError(f"{path}: cannot be read ({error})") from error


def write_csv(measures: Measures, labels: Sequence[str], path: Path) -> None:
    """All measures with all digits, one line per run; what does not exist is empty. ResultsError if
    the file cannot be written.
    """
    with written(path) as target, target.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["run", *(one_line(f"{name} [{unit}]") for name, unit in measures)])
        for label in labels:
            values = (column.get(label, math.nan) for column in measures.values())
            writer.writerow([one_line(label), *("" if math.isnan(v) else repr(v) for v in values)])
