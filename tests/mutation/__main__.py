# SPDX-License-Identifier: BSD-2-Clause
"""Deliberate faults in the C code: draw some, and see which of them a test finds.

    .venv/bin/python -m tests.mutation --seed 1 --count 300 -o faults.jsonl

One line per fault that compiles. What survives is for a reader to judge: it cannot show, or a test
is missing.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import Counter
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import islice
from pathlib import Path

from tests.mutation.faults import Fault, drawn
from tests.mutation.judge import ILL, ROOT, SURVIVED, UNREAD, Tree, judged


def main() -> None:
    """Command line, see the docstring of the module."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=300, help="faults that compile")
    parser.add_argument("--jobs", type=int, default=1, help="faults judged at the same time")
    parser.add_argument("-o", "--output", type=Path, help="lines of JSON; goes on with it")
    parser.add_argument(
        "--again", action="store_true", help="look once more at those of the file that survived"
    )
    parser.add_argument("files", nargs="*", help="files below fmus/ (default: all)")
    print(_text(_campaign(parser.parse_args())))


def _campaign(a: argparse.Namespace) -> Counter[str]:
    known = _known(a.output)
    if a.again:
        known = {fault: outcome for fault, outcome in known.items() if outcome != SURVIVED}
    counts: Counter[str] = Counter()
    left = iter(drawn(ROOT / "fmus", a.seed, 100 * a.count, a.files))
    with (
        tempfile.TemporaryDirectory(prefix="faults-") as folder,
        ProcessPoolExecutor(a.jobs, initializer=_prepare, initargs=(folder,)) as workers,
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
                _keep(a.output, row)
    return counts


_TREES: list[Tree] = []
"""Of this process."""


def _prepare(folder: str) -> None:
    _TREES.append(Tree(Path(tempfile.mkdtemp(dir=folder))))


def _row(fault: Fault) -> dict[str, object]:
    (tree,) = _TREES
    shown = fault.shown((tree.fmus / fault.file).read_text(encoding="utf-8"))
    outcome, where = judged(tree, fault)
    return {"fault": shown, "outcome": outcome, "where": where, **fault._asdict()}


def _known(file: Path | None) -> dict[Fault, str]:
    """Faults of an earlier start with their outcomes."""
    if file is None or not file.is_file():
        return {}
    rows = map(json.loads, file.read_text(encoding="utf-8").splitlines())
    return {Fault(*(row[name] for name in Fault._fields)): row["outcome"] for row in rows}


def _keep(file: Path | None, row: dict[str, object]) -> None:
    if file is not None:
        with file.open("a", encoding="utf-8") as lines:
            lines.write(json.dumps(row) + "\n")


def _text(counts: Counter[str]) -> str:
    outcomes = ", ".join(f"{number} {outcome}" for outcome, number in counts.most_common())
    return f"{sum(counts.values())} faults: {outcomes}"


if __name__ == "__main__":
    main()
