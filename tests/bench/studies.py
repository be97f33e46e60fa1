# SPDX-License-Identifier: BSD-2-Clause
"""Processor time of a run of a search beside one of a plain campaign: what generating runs,
storing numbers and margins cost.

    python -m tests.bench.studies [RUNS]
"""

from __future__ import annotations

import sys
import tempfile
import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import ssp
from harness import campaign, worst

FILE = Path(ssp.__file__).parent / "sync_approach" / "campaigns" / "sync_approach_studies.toml"
STOP, ROUNDS = 20.0, 5


def spent(simulate: Any, table: dict[str, Any], **how: Any) -> float:
    """Processor time of one of them, with its dataset [ms]."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.process_time()
        simulate(table, Path(folder) / "runs.zarr", workers=0, **how)
        return 1e3 * (time.process_time() - begin)


def each(runs: int) -> tuple[float, ...]:
    """Processor time of a campaign and of a search of so many runs [ms]."""
    given = tomllib.loads(FILE.read_text())
    given["fixed"] |= {"stop": STOP}
    searched = given | {"worst": {"of": "clearance", "runs": runs}}
    return (
        spent(campaign, given | {"runs": runs}),
        spent(worst, searched, notify=silent),
    )


def silent(_: str) -> None:
    """No progress."""


def milliseconds(runs: int) -> NDArray[np.float64]:
    """Time of a run of each [ms], without the common start: least of rounds of a long and a short
    one.
    """
    short = runs // 4
    rounds = np.array([[each(n) for n in (runs, short)] for _ in range(ROUNDS)])
    many, few = rounds.min(axis=0)
    return np.asarray((many - few) / (runs - short))


def main() -> None:
    plain, search = milliseconds(int(sys.argv[1]) if len(sys.argv) > 1 else 400)
    print(f"a run of {STOP:g} s of a plain campaign: {plain:.1f} ms")
    print(f"worst: {search:.1f} ms, {search - plain:+.1f} ms")


if __name__ == "__main__":
    main()
