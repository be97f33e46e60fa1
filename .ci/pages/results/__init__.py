# SPDX-License-Identifier: BSD-2-Clause
"""Tables and values of runs that pages quote, a module per mission or topic.

A row is a run, given by the text after `harness run` on the command line. A column is a metric of
`harness compare`, an expression over the results or a function of a result. VALUES of each module
has the functions that return a table or a value as text, by the name under which pages quote it.
"""

from __future__ import annotations

import argparse
import importlib
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from text import ROOT, table

MISSIONS = (
    *("arch_rendezvous", "arm_capture", "filter", "flexible_servicer", "navigation"),
    *("ppc_tracking", "relay_approach", "safety", "servicing_mission", "sync_approach"),
    "transposition",
)
"""Modules of this package."""
OPTIONS = argparse.ArgumentParser()
OPTIONS.add_argument("system")
for several in ("set", "swap", "latency"):
    OPTIONS.add_argument(f"--{several}", action="append", default=[])
for one, kind in (("params", str), ("algorithm", str), ("stop", float), ("step", float)):
    OPTIONS.add_argument(f"--{one}", type=kind)
OPTIONS.add_argument("--every", type=int)
HELD = 4
"""Number of results that stay in memory, because several tables use the same run; a result of
servicing_mission takes 250 MB.
"""


class Column(NamedTuple):
    """Column of a table: title; expression, name of a metric, or function of the result that gives
    the value (one number, several, or a text); format of numbers. The cell is a dash if one of its
    numbers is not finite.
    """

    title: str
    value: str | Callable[[Any], Any]
    show: str = "{:.3g}"


def of_runs(
    head: str, runs: Mapping[str, str], columns: Sequence[Column], across: bool = False
) -> str:
    """Return a table with a row per run, or a column per run if `across` is true.

    head: title of the first column; runs: text after `harness run`, by first cell of the row.
    """
    lines = [
        [name, *(cell(c, result_of(command)) for c in columns)] for name, command in runs.items()
    ]
    lines.insert(0, [head, *(c.title for c in columns)])
    titles, *rest = zip(*lines, strict=True) if across else lines
    return f"\n{table(titles, rest)}"


@lru_cache(maxsize=HELD)
def result_of(command: str) -> Any:
    """Return the result of `harness run COMMAND`; if the run ends early, the rows up to its end."""
    from harness import run
    from harness.errors import RunError

    try:
        return run(**options(command))
    except RunError as error:
        if error.partial is None:
            raise
        return error.partial


def options(command: str) -> dict[str, Any]:
    """Return the arguments of harness.run() for the text after `harness run`."""
    return {k: v for k, v in vars(OPTIONS.parse_args(shlex.split(command))).items() if v}


def value(what: str | Callable[[Any], Any], result: Any) -> Any:
    """Return a value of a result; what: expression, name of a metric, or function of the result."""
    from harness.studies.campaign import metrics

    return what(result) if callable(what) else metrics.value(metrics.metric(what, ROOT), result)[0]


def cell(column: Column, result: Any) -> str:
    """Return the text of the cell of a result in a column."""
    import numpy as np

    found = value(column.value, result)
    if isinstance(found, str):
        return found
    numbers = np.atleast_1d(found)
    return column.show.format(*numbers) if np.isfinite(numbers).all() else "-"


def value_of(command: str, what: str | Callable[[Any], Any], show: str) -> Callable[[], str]:
    """Return a function that gives a single value of a run as text, for a sentence."""
    return lambda: cell(Column("", what, show), result_of(command))


def of_the_tests(name: str) -> Any:
    """Return the module tests.systems.NAME."""
    sys.path.append(str(ROOT))
    try:
        return importlib.import_module(f"tests.systems.{name}")
    finally:
        sys.path.remove(str(ROOT))
