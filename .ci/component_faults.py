# SPDX-License-Identifier: BSD-2-Clause
"""Measure the share of deliberate faults that the tests catch, per component of flight software.

    python .ci/component_faults.py FILE [--seed N] [--count N] [--jobs N] [COMPONENT...]

`make faults` runs this command.

Draws `count` faults per component, each in its C file or in a header that only this component
includes. For each fault, runs the tests of the component until one fails. tests/mutation contains
the functions that draw a fault and that run the tests. FILE is read and updated; it has a line of
JSON per fault. The faults of a component are drawn anew if its code has changed since the lines
were written, or if FILE has fewer than `count` faults of the component.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import islice
from pathlib import Path

import evidence

from fmus.core.build import flight_rules
from tests.mutation import evaluation
from tests.mutation.faults import Fault, drawn, faults

SEED, COUNT = 43, 4
_TREES: list[evaluation.Tree] = []


def prepare(folder: str) -> None:
    """Make the copy of the source tree in which this worker process tries faults."""
    _TREES.append(evaluation.Tree(Path(tempfile.mkdtemp(dir=folder))))


def outcomes(name: str, source: str, seed: int, count: int) -> list[dict[str, object]]:
    """Return the rows of FILE for a component: its first `count` faults that compile and lie
    in a file from which a tested program is compiled. A row has the keys component, sources
    (hash), seed, fault, outcome, and by (test that caught the fault, or the FMUs that contain
    it). source: hash of the sources of the component.
    """
    files = evidence.owners()[name]
    return list(islice(_outcomes(name, files, source, seed, count), count))


def _outcomes(
    name: str, files: tuple[str, ...], sources: str, seed: int, count: int
) -> Iterator[dict[str, object]]:
    (tree,) = _TREES
    for fault in drawn(tree.sources, list(files), faults, seed, 100 * count):
        shown = Fault.shown(fault, (tree.sources / fault.file).read_text(encoding="utf-8"))
        outcome, where = evaluation.evaluate(tree, fault)
        if outcome not in (evaluation.ILL, evaluation.UNREAD):
            yield {
                "component": name, "sources": sources, "seed": seed, "fault": shown,
                "outcome": outcome, "by": where,
            }  # fmt: skip


def main() -> None:
    """Run the command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--count", type=int, default=COUNT, help="faults per component")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("components", nargs="*")
    a = parser.parse_args()
    known = evidence.lines_of(a.file)
    with (
        tempfile.TemporaryDirectory(prefix="faults-") as folder,
        ProcessPoolExecutor(a.jobs, initializer=prepare, initargs=(folder,)) as workers,
    ):
        started = {}
        for source in flight_rules.sources():
            name, now = source.stem, evidence.hash_of(source)
            rows = [row for row in known.get(name, ()) if row["sources"] == now]
            if len(rows) < a.count and (not a.components or name in a.components):
                started[name] = workers.submit(outcomes, name, now, a.seed, a.count)
        for name, done in started.items():
            known[name] = done.result()
            caught = sum(row["outcome"] == evaluation.CAUGHT for row in known[name])
            print(f"{name}: {caught} of {len(known[name])} caught", flush=True)
            lines = (json.dumps(row) for name in sorted(known) for row in known[name])
            a.file.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
