# SPDX-License-Identifier: BSD-2-Clause
"""Deliberate faults: draw some, and see which of them a test finds.

    .venv/bin/python -m tests.mutation --seed 1 --count 300 -o faults.jsonl
    .venv/bin/python -m tests.mutation.reached -n 2 tests/harness
    .venv/bin/python -m tests.mutation --python --seed 1 --count 300 -o python.jsonl

One line per fault that compiles. A reader evaluates the survivors: the fault has no effect, or a
test is missing.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import islice
from pathlib import Path
from typing import Any

from tests.mutation import evaluation, python_faults
from tests.mutation.evaluation import ILL, ROOT, SURVIVED, UNREAD
from tests.mutation.faults import Fault, c_files, drawn, faults, python_files

PACKAGES = ("master", "results", "ssp", "studies/campaign")
"""Folders of harness/ that faults are drawn from."""


def main() -> None:
    """Command line, see the docstring of the module."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=300, help="faults that compile")
    parser.add_argument("--jobs", type=int, default=1, help="faults evaluated at the same time")
    parser.add_argument("-o", "--output", type=Path, help="lines of JSON; goes on with it")
    parser.add_argument(
        "--again",
        action="store_true",
        help="the survivors of the file once more; Python is read anew",
    )
    parser.add_argument(
        "--python", action="store_true", help=f"in {', '.join(PACKAGES)} of harness/, not in fmus/"
    )
    parser.add_argument("files", nargs="*", help="files below fmus/ or harness/ (default: all)")
    print(_text(_campaign(parser.parse_args())))


def _campaign(a: argparse.Namespace) -> Counter[str]:
    known = _known(a.output)
    if a.again:
        known = {fault: outcome for fault, outcome in known.items() if outcome != SURVIVED}
    counts: Counter[str] = Counter()
    left = iter(_drawn(a))
    with (
        tempfile.TemporaryDirectory(prefix="faults-") as folder,
        ProcessPoolExecutor(
            a.jobs, initializer=_prepare, initargs=(folder, a.python, a.again)
        ) as workers,
    ):
        while missing := a.count - counts.total():
            if not (some := list(islice(left, missing))):
                break
            counts.update(known[fault] for fault in some if fault in known)
            for done in as_completed(workers.submit(_row, f) for f in some if f not in known):
                row = done.result()
                if row["outcome"] in (ILL, UNREAD):
                    continue
                counts[row["outcome"]] += 1
                if row["outcome"] == SURVIVED:
                    print(f"{row['fault']}  [{row['where']}]", flush=True)
                _record(a.output, row)
    return counts


def _drawn(a: argparse.Namespace) -> list[Fault]:
    root = ROOT / ("harness" if a.python else "fmus")
    files = python_files(root, PACKAGES) if a.python else c_files(root)
    find = python_faults.faults if a.python else faults
    return drawn(
        root, [f for f in files if not a.files or f in a.files], find, a.seed, 100 * a.count
    )


_EVALUATORS: list[tuple[Any, Any]] = []
"""Of this process: the function that evaluates a fault, and its tree."""


def _prepare(folder: str, python: bool, again: bool) -> None:
    place = Path(tempfile.mkdtemp(dir=folder))
    if python:
        from tests.mutation import python_evaluation  # with coverage.py, which C has no need of

        _EVALUATORS.append(
            (python_evaluation.evaluate, python_evaluation.PythonTree(place, fresh=again))
        )
    else:
        _EVALUATORS.append((evaluation.evaluate, evaluation.Tree(place)))


def _row(fault: Fault) -> dict[str, object]:
    ((evaluate, tree),) = _EVALUATORS
    shown = fault.shown((tree.sources / fault.file).read_text(encoding="utf-8"))
    outcome, where = evaluate(tree, fault)
    return {"fault": shown, "outcome": outcome, "where": where, **fault._asdict()}


def _known(file: Path | None) -> dict[Fault, str]:
    """Faults of an earlier start with their outcomes."""
    if file is None or not file.is_file():
        return {}
    rows = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return {Fault(*(row[name] for name in Fault._fields)): row["outcome"] for row in rows}


def _record(file: Path | None, row: dict[str, object]) -> None:
    if file is not None:
        with file.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(row) + "\n")


def _text(counts: Counter[str]) -> str:
    outcomes = ", ".join(f"{number} {outcome}" for outcome, number in counts.most_common())
    return f"{sum(counts.values())} faults: {outcomes}"


if __name__ == "__main__":
    main()
