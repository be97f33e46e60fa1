# SPDX-License-Identifier: BSD-2-Clause
"""Tables of runs in the pages of the missions, one module per page.

A row is a run as `harness run` is typed, a column a measure of `harness compare`, an expression
over the results or a function of a result. FIGURES of a module are its tables by name.
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
    *("arch_rendezvous", "arm_capture", "flexible_servicer", "navigation", "ppc_tracking"),
    *("relay_approach", "safety", "servicing_mission", "sync_approach", "transposition"),
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
"""Results in memory, for the tables that share them; one of a mission takes 250 MB."""


class Column(NamedTuple):
    """Title, what is taken out of a result (one number, several, or a text), and how it is shown;
    no number is shown as a dash.
    """

    title: str
    value: str | Callable[[Any], Any]
    show: str = "{:.3g}"


def of_runs(
    head: str, runs: Mapping[str, str], columns: Sequence[Column], across: bool = False
) -> str:
    """A table with a row per run; across: with a column per run.

    head: title of the first column; runs: first cell of a row and command behind `harness run`.
    """
    lines = [[name, *(cell(c, flown(command)) for c in columns)] for name, command in runs.items()]
    lines.insert(0, [head, *(c.title for c in columns)])
    titles, *rest = zip(*lines, strict=True) if across else lines
    return f"\n{table(titles, rest)}"


@lru_cache(maxsize=HELD)
def flown(command: str) -> Any:
    """The result of `harness run COMMAND`; of a run that ends early the rows up to its end."""
    from harness import run
    from harness.errors import RunError

    try:
        return run(**options(command))
    except RunError as error:
        if error.partial is None:
            raise
        return error.partial


def options(command: str) -> dict[str, Any]:
    """Arguments of harness.run() by the text behind `harness run`."""
    return {k: v for k, v in vars(OPTIONS.parse_args(shlex.split(command))).items() if v}


def value(what: str | Callable[[Any], Any], result: Any) -> Any:
    """What a column takes out of a result."""
    from harness.studies.campaign.metrics import metric

    return what(result) if callable(what) else metric(what, ROOT)(result)


def cell(column: Column, result: Any) -> str:
    """The text of a column for a run."""
    import numpy as np

    found = value(column.value, result)
    if isinstance(found, str):
        return found
    numbers = np.atleast_1d(found)
    return column.show.format(*numbers) if np.isfinite(numbers).all() else "-"


def figure(command: str, what: str | Callable[[Any], Any], show: str) -> Callable[[], str]:
    """A single figure of a run, for a sentence."""
    return lambda: cell(Column("", what, show), flown(command))


def of_the_tests(name: str) -> Any:
    """The module tests.systems.NAME."""
    sys.path.append(str(ROOT))
    try:
        return importlib.import_module(f"tests.systems.{name}")
    finally:
        sys.path.remove(str(ROOT))
