# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of several runs of one system in one table. The worker pool of campaigns performs the
runs, and every run is stored as a complete results file.
"""

from __future__ import annotations

import csv
import math
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from harness.errors import HarnessError, ResultsError, RunError, UsageError
from harness.files.output import command_line, work_for, written
from harness.master.changes import apply
from harness.master.executors import FUSED, known_executor
from harness.master.isolated import PATIENCE
from harness.master.messages import logged_once
from harness.master.remainder import rest
from harness.mission import Limits
from harness.mission.fields import several
from harness.mission.library import of_result
from harness.mission.mission import Mission, apart, exceeding, measured, together
from harness.results.files import ResultFile, read
from harness.results.requirements import Finding, findings
from harness.results.result import Result
from harness.results.verdict import Verdict
from harness.spelling import one_line
from harness.ssp.library import load
from harness.studies.campaign.engine import Block, prestart, processes, worker_pool
from harness.studies.reuse import (
    ReusedSimulation,
    alike,
    compiling,
    quietly,
    rejected_before,
    retained,
)
from harness.studies.variants import Variant
from harness.system.graph import checked
from harness.system.model import System
from harness.system.values import base

ROWS = 20_000
"""Largest number of rows after the first of a results file if the user gives no `every`."""
TOGETHER = 4
"""Number of runs per task with the executor `fused`, if this gives every worker at least one task;
otherwise a task has one run.
"""
TABLE = "comparison.csv"
WIDTH = 120
"""Largest width of a table printed as text [columns]."""
Order = tuple[Variant, Path, int]
"""Run to perform: its variant, the path of its results file, and its macro steps per row."""
Metrics = Mapping[tuple[str, str], Mapping[str, float]]
"""Values of metrics: by name and unit of the metric, then by the label of the run."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of a run.

    file: its results file, a partial file if the run ended early, None if there are no results;
    failure: one line with the reason of an early end, "" if the run is complete; pace: computing
    time per macro step in the fastest part of the run [us], NaN if the run is not complete.
    """

    file: Path | None
    failure: str = ""
    pace: float = math.nan


@dataclass(frozen=True)
class ComparisonRuns:
    """Data that all runs of a comparison share, and the code that performs runs in a worker.

    executor: c, python or fused; patience: limit for one call into a third-party FMU [s]; command:
    command line that started the comparison, None in a Python program.
    """

    system: str | Path
    executor: str
    patience: float
    command: str | None

    @property
    def piece(self) -> int:
        """Return the number of runs per task of a worker."""
        return TOGETHER if self.executor == FUSED else 1

    def blocks(self, orders: Sequence[Order], workers: int) -> Iterator[Block]:
        """Yield the runs in blocks; a block is one task of a worker. It has `piece` runs if there
        are at least that many for every worker, otherwise one run.
        """
        size = self.piece if len(orders) >= self.piece * workers else 1
        for k in range(0, len(orders), size):
            yield Block(k, orders[k : k + size])

    def run(self, part: Sequence[Order]) -> list[Outcome]:
        """Perform runs and write their results files; return their outcomes in the same order."""
        work_for(self.command)
        with quietly():
            reused = retained(self, lambda: ReusedSimulation(self.system, self.executor))
            found: dict[int, Outcome] = {}
            for group in alike([variant.changes for variant, _, _ in part], lambda: reused.width):
                runs, every = [part[k][0].changes for k in group], part[group[0]][2]
                results = reused.together(runs, every, None) if len(runs) > 1 else [None]
                for k, result in zip(group, results, strict=True):
                    found[k] = _run(reused, part[k], self.patience, result)
            return [found[k] for k in sorted(found)]

    @staticmethod
    def lost(message: str) -> Outcome:
        """Return the outcome of a run whose worker crashed or was killed: a message, no results."""
        return Outcome(None, message)


def _run(reused: ReusedSimulation, order: Order, patience: float, result: Result | None) -> Outcome:
    """Write the results file of a variant and return its outcome; perform the run first if
    `result` is None.
    """
    variant, path, every = order
    file = ResultFile(path)
    try:
        if result is None:
            result = reused.run(variant.changes, every, patience)
        with suppress(OSError):  # remove the outdated table of an earlier comparison
            (path.parent / TABLE).unlink()
        file.write(result)
    except RunError as error:
        return _ended(file, error)
    except HarnessError as error:
        return Outcome(None, _as_given(variant, str(error)))
    return Outcome(path, "", reused.pace)


def _ended(file: ResultFile, error: RunError) -> Outcome:
    """Write the rows of a run that ended early to a partial results file; return its outcome."""
    if error.partial is None:
        return Outcome(None, str(error))
    try:
        file.write_partial(error.partial)
    except HarnessError as lost:
        return Outcome(None, f"{error}; {lost}")
    return Outcome(file.partial if file.partial.is_file() else None, str(error))


@dataclass(frozen=True)
class Comparison:
    """Completed comparison.

    outcomes: by label of the run; results: by label, only of runs that have results; limits:
    position and attitude errors within which metrics count an error as settled; metrics: values by
    (name, unit), then by label; mission: mission that defines the metrics; in_force: line that
    states which parameter set the comparison used, "" if none.
    """

    outcomes: Mapping[str, Outcome]
    results: Mapping[str, Result]
    limits: Limits
    metrics: Metrics
    mission: Mission
    in_force: str = ""

    def text(self, names: Sequence[str] = ()) -> str:
        """Return the comparison as text: the line `in_force`, the table of metrics, warnings,
        definitions of the metrics, and the table of requirements; names: metrics to show (default:
        all, but a metric with a limit `above` only if a run exceeds the limit).
        """
        keys = {(m.name, m.unit): m for m in self.mission.metrics}
        hidden = {
            key for key, m in keys.items()
            if not any(x > m.above for x in self.metrics.get(key, {}).values())
        }  # fmt: skip
        chosen = {
            k: c for k, c in self.metrics.items() if (k[0] in names if names else k not in hidden)
        }
        about = {key: m.about(self.limits, self.results) for key, m in keys.items() if m.about}
        words = {key: m.words for key, m in keys.items() if m.words}
        doubts = (each(self.mission.metrics, self.metrics) for each in (apart, exceeding))
        warnings = (f"warning: {line}" for lines in doubts for line in lines)
        defined = (
            text for lines in self.mission.definitions for text in several(str, lines, self.limits)
        )
        shown = table(chosen, [*self.outcomes], about, words)
        head = [self.in_force, ""] if self.in_force else []
        lines = [*head, shown, *warnings, *defined, *self.findings()]
        return "\n".join(line if "\n" in line else _wrapped(line) for line in lines)

    def findings(self) -> list[str]:
        """Return the lines of a table of runs and requirements, then one line per finding about a
        requirement that is not met or has no verdict; [] without requirements. The line of a
        finding begins with the labels of all runs with this finding.
        """
        found = {label: findings(result) for label, result in self.results.items()}
        lines: dict[str, list[str]] = {}
        for label, each in found.items():
            for text in (str(f) for f in each if f.verdict is not Verdict.MET):
                lines.setdefault(text, []).append(label)
        shown = [f"{', '.join(labels)}: {text}" for text, labels in lines.items()]
        return ["", verdicts(found), *shown] if any(found.values()) else []

    @property
    def failures(self) -> list[str]:
        """Return one line per run that ended early."""
        ended = {label: each.failure for label, each in self.outcomes.items() if each.failure}
        return [f"{label}: {failure}" for label, failure in ended.items()]


def _wrapped(line: str) -> str:
    return textwrap.fill(line, WIDTH, subsequent_indent="  ") if line.strip() else line


def compare(  # noqa: PLR0913 - options of a comparison
    system: str | Path,
    variants: Sequence[Variant],
    directory: Path,
    *,
    every: int | None = None,
    patience: float = PATIENCE,
    progress: Callable[[int], None] | None = None,
    executor: str = "c",
) -> Comparison:
    """Run all variants in parallel and compute their metrics; write the results of each run to
    `directory` as LABEL.nc, and the table to comparison.csv.

    every: record every N-th macro step (default: at most 20 000 rows after the first);
    patience: limit for one call into a third-party FMU [s]; progress: called with the number of
    completed runs; executor: as for run(). Raises the errors of the checks before the first run,
    and ResultsError. If a run fails in its initialization or later, the other runs continue.
    """
    known_executor(executor)
    workers = min(len(variants), processes(None))
    prestart(workers, __name__)
    variants, in_force = _in_force(system, variants)
    if every is not None and every < 1:
        raise UsageError(f"--every must be at least 1, not {every}")
    work = ComparisonRuns(system, executor, patience, command_line())
    steps = _check(work, variants, ResultFile(directory / "any.nc"))
    files = [ResultFile(directory / f"{variant.file}.nc").path for variant in variants]
    thinning = [_thinning(n) if every is None else every for n in steps]
    orders = list(zip(variants, files, thinning, strict=True))
    over: dict[int, Outcome] = {}
    many = sum(steps) if executor == FUSED else 0
    with compiling(system, variants[0].changes, many), worker_pool(workers) as run_blocks:
        for k, found in run_blocks(work, work.blocks(orders, workers)):
            over |= dict(enumerate(found, k))
            if progress is not None:
                progress(len(over))
    outcomes = {each.label: over[k] for k, each in enumerate(variants)}
    results = {label: read(each.file) for label, each in outcomes.items() if each.file}
    offered = together(map(of_result, results.values()))
    held = offered.limits(Limits(), results)
    paces = {label: each.pace for label, each in outcomes.items() if not each.failure}
    taken = measured(offered.metrics, results, held) | {("macro step", "us"): paces}
    comparison = Comparison(outcomes, results, held, taken, offered, in_force)
    write_csv(taken, [*outcomes], directory / TABLE)
    return comparison


def _in_force(system: str | Path, variants: Sequence[Variant]) -> tuple[Sequence[Variant], str]:
    """Return the variants with the parameter set that the system declares for comparisons, and a
    line that states this parameter set. If a variant has a parameter set of its own (`--params`),
    return the variants unchanged, and a line that states their parameter sets; if the system
    declares none, return the variants unchanged and "".
    """
    with load(system) as found:
        sets = {s.name: s for s in found.sets}
        chosen = sets.get(found.compared)
        usual = {c.name: c.parameters for c in found.components}
    if chosen is None:
        return variants, ""
    named = {str(v.changes["params"]) for v in variants if v.changes.get("params") is not None}
    if named:
        usually = f"; without --params: set {chosen.name}" if chosen.name not in named else ""
        return variants, f"parameters: values of --params {', '.join(sorted(named))}{usually}"
    own: dict[str, list[str]] = {}
    for component, given in chosen.parameters.items():
        for name, parameter in given.items():
            if usual[component].get(name) != parameter:
                own.setdefault(base(f"{component}.{name}"), []).append(str(parameter.value))
    values = ", ".join(f"{name} = {' '.join(numbers)}" for name, numbers in own.items())
    text = f"parameters: set {chosen.name}, {chosen.description}{f' ({values})' if values else ''}"
    text += "; --params default: the values of the system"
    return [replace(v, changes={**v.changes, "params": chosen.name}) for v in variants], text


def _check(work: ComparisonRuns, variants: Sequence[Variant], file: ResultFile) -> list[int]:
    """Check all variants before the first run; return the number of macro steps of each variant."""
    with load(work.system) as found, logged_once():
        systems = [_applied(found, variant) for variant in variants]
        for changed in systems:
            file.accept(changed)
        ready = [(changed, checked(changed)) for changed in systems]
        varied = variants[0].varied
        fixed = {n: value for n, value in systems[0].origin.set.items() if n not in varied}
        for error in rejected_before(ready, fixed, varied, work.patience, work.executor):
            if isinstance(error, UsageError):
                raise error
    return [each.steps for _, each in ready]


def _applied(system: System, variant: Variant) -> System:
    """Return the system with the changes of a variant. An error about a value that the user gave by
    `--vary` names `--vary`, although the value is applied as `--set`.
    """
    try:
        return rest(apply(system, **variant.changes))
    except UsageError as error:
        raise UsageError(_as_given(variant, str(error))) from error.__cause__


def _as_given(variant: Variant, text: str) -> str:
    """Return the text of an error with `--vary` in place of `--set` before each parameter that the
    user gave by `--vary`.
    """
    for name in variant.varied:
        text = re.sub(rf"--set (?={re.escape(name)}(?!\w))", "--vary ", text)
    return text


def _thinning(steps: int) -> int:
    """Return the number of macro steps per row with which a run of `steps` macro steps has at most
    ROWS rows after the first: the smallest divisor of `steps` that is less than twice the smallest
    such number, so that rows are equally spaced, or else that smallest number.
    """
    least = math.ceil(steps / ROWS)
    return next((n for n in range(least, 2 * least) if steps % n == 0), least)


# ---- table as text and as .csv


def table(
    metrics: Metrics,
    labels: Sequence[str],
    about: Mapping[tuple[str, str], str] = {},
    words: Mapping[tuple[str, str], Sequence[str]] = {},
) -> str:
    """Return the table of metrics as text, in blocks at most WIDTH characters wide, one line per
    run. Metrics without a value in any run are left out; a missing value is `-`.

    labels: labels of the runs, in the order of the lines; about: last line of the heading of a
    metric; words: texts to show instead of the values 0, 1, ... of a metric; about and words by
    (name, unit).
    """
    shown = {
        key: column for key, column in metrics.items() if any(map(math.isfinite, column.values()))
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
    return _blocks([""] * heads + list(map(one_line, labels)), columns)


def verdicts(found: Mapping[str, Sequence[Finding]]) -> str:
    """Return a table as text, with a line per run and a column per requirement: verdict and worst
    value, `-` if the run does not have the requirement. found: by the label of the run.
    """
    columns: dict[str, list[str]] = {}
    for k, each in enumerate(found.values()):
        for finding in each:
            cells = columns.setdefault(one_line(finding.name), ["-"] * len(found))
            cells[k] = " ".join(filter(None, [finding.word, finding.worst]))
    return _blocks(["", *map(one_line, found)], [[name, *cells] for name, cells in columns.items()])


def _blocks(first: Sequence[str], columns: Sequence[Sequence[str]]) -> str:
    """Return a table as text, split into blocks at most WIDTH characters wide. Each block begins
    with the column `first`.
    """
    first = [label.ljust(max(map(len, first))) for label in first]
    blocks = [[first]]
    for texts in columns:
        cells = [text.rjust(max(map(len, texts))) for text in texts]
        beside = sum(len(each[0]) + 2 for each in blocks[-1])
        if len(blocks[-1]) > 1 and beside + len(cells[0]) > WIDTH:
            blocks.append([first])
        blocks[-1].append(cells)
    return "\n\n".join(map(_block, blocks))


def _block(columns: Sequence[Sequence[str]]) -> str:
    """Return the lines of a table of text, given by its columns. All cells of a column are padded
    to the same width.
    """
    return "\n".join("  ".join(row).rstrip() for row in zip(*columns, strict=True))


def _numbers(values: Sequence[float]) -> list[str]:
    """Return the numbers of a column as text: equally many decimals, enough for four digits of the
    largest number, but at most 4; with powers of ten if the smallest number would be printed as 0;
    `-` if not finite.
    """
    sizes = [abs(v) for v in values if math.isfinite(v) and v]
    decimals = max(0, 3 - math.floor(math.log10(max(sizes, default=1.0))))
    small = bool(sizes) and min(sizes) < 0.5 * 10.0 ** -min(decimals, 4)
    form = "z.2e" if small else f"z.{min(decimals, 4)}f"  # z: zeros are printed without a sign
    return [format(v, form) if math.isfinite(v) else "-" for v in values]


def read_csv(path: Path) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Return the values in a file of write_csv(), by heading `name [unit]` and then by label of the
    run; return also the list of labels. Raise ResultsError if the file cannot be read.
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


def write_csv(metrics: Metrics, labels: Sequence[str], path: Path) -> None:
    """Write all metrics to a .csv file with all digits, one line per run; a missing value is an
    empty cell. Raise ResultsError if the file cannot be written.
    """
    with written(path) as target, target.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["run", *(one_line(f"{name} [{unit}]") for name, unit in metrics)])
        for label in labels:
            values = (column.get(label, math.nan) for column in metrics.values())
            writer.writerow([one_line(label), *("" if math.isnan(v) else repr(v) for v in values)])
