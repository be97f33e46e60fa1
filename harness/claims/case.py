# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of a result with the cases of a paper, which are the systems and parameter sets for
which the paper states its claims.

The settings of the run are compared with the settings that the system of the case has now: FMUs,
parameters, time span, macro step, order of execution. If a result with deviations does not
reproduce a claim, this does not contradict the paper. A second part of the module compares FMUs
with published reference values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from harness.errors import HarnessError, UsageError
from harness.files import paths
from harness.master.simulation import Simulation
from harness.mission import Case, Paper
from harness.mission.claim import Row
from harness.mission.library import everything
from harness.results.provenance import Provenance, Slot, run_provenance
from harness.results.result import Result
from harness.spelling import columns, did_you_mean, number
from harness.ssp.library import load
from harness.system.values import base

SHOWN = 4
"""Largest number of deviations that a line lists."""
ROUNDING = 1e-12
"""Largest relative difference at which two values of a parameter count as equal."""


def unlike(paper: Paper, result: Result) -> list[str]:
    """Return one text per deviation of a result from the case of the paper, [] without deviations.
    If the paper has several cases, the case with the fewest deviations is used.
    """
    if paper.cases and result.parameters is None:
        return ["the file does not contain the parameters of the run"]
    known = (_deviations(result, case) for case in paper.cases)
    nearest = min((each for each in known if each is not None), key=len, default=[])
    return [*nearest, *(paper.differs(result) if len(result.time) else ())]


def _deviations(result: Result, case: Case) -> list[str] | None:
    """Return one text per deviation of a result from a case; None if its system is missing or
    cannot be loaded. For a result of another system, return one text SHOWN + 1 times, so that other
    cases are nearer.
    """
    path = paths.systems().get(case.system)
    if path is None:
        return None
    if result.system != case.system:
        return [f"system {result.system} instead of {case.system}"] * (SHOWN + 1)
    try:
        about, parameters = _settings(case, path, path.stat().st_mtime_ns)
    except HarnessError:
        return None
    found = list(_schedule_differences(result, about, case.free))
    return found + list(_parameter_differences(result, parameters, case.free))


@lru_cache(maxsize=64)
def _settings(case: Case, path: Path, _modified: int) -> tuple[Provenance, Result]:
    """Return the provenance and the parameters that a run of a case would have, without this run.
    path: file of the system of the case; _modified: time of the last change of this file, only a
    key of the lru_cache: after a change the file is read again.
    """
    with load(path) as system:
        simulation = Simulation(system, params=case.params, swap=dict(case.swap))
        return run_provenance(simulation.system, "c", 1), simulation.parameters()


def _schedule_differences(result: Result, wanted: Provenance, free: Sequence[str]) -> Iterator[str]:
    """Yield one text per difference in time span, macro step, order of execution and FMUs.

    wanted: provenance that a run of the case would have; free: names that may differ, such as
    "stop".
    """
    ours = result.provenance
    end = float(result.time[-1]) if len(result.time) else np.nan
    if "stop" not in free and not np.isclose(end, wanted.stop or 0.0, rtol=1e-9):
        yield f"the run ends at {end:g} s instead of {wanted.stop:g} s"
    if ours is None:
        return
    if ours.step != wanted.step:
        yield f"macro step {ours.step:g} s instead of {wanted.step:g} s"
    if ours.algorithm != wanted.algorithm:
        yield f"{ours.algorithm} instead of {wanted.algorithm}"
    yield from _component_differences(ours.schedule, wanted.schedule)


def _component_differences(ours: Sequence[Slot], wanted: Sequence[Slot]) -> Iterator[str]:
    given = {slot.component: slot for slot in ours}
    for slot in wanted:
        own = given.get(slot.component)
        if own is None:
            yield f"without {slot.component}"
        elif own.fmu != slot.fmu:
            yield f"{slot.component} {own.fmu} instead of {slot.fmu}"
        elif own != slot:
            yield f"{slot.component} (period, latency) {own[2:]} instead of {slot[2:]} macro steps"


def _parameter_differences(result: Result, wanted: Result, free: Sequence[str]) -> Iterator[str]:
    """Yield a text for every parameter that exists in both runs with different values.

    wanted: parameters that a run of the case would have; free: names of parameters that may differ.
    """
    ours = result.parameters
    assert ours is not None
    for name in dict.fromkeys(map(base, wanted.columns)):
        if name in free or name not in ours or name not in wanted:
            continue
        value, right = ours[name][0], wanted[name][0]
        if value.shape != right.shape or not np.allclose(value, right, ROUNDING, 0, equal_nan=True):
            unit = wanted.unit(name).removeprefix("1")
            yield f"{name} {number(value)} instead of {number(right)} {unit}".rstrip()


def listed(texts: Sequence[str]) -> str:
    """Return the first SHOWN texts in one line, and how many more there are."""
    unlike = list(dict.fromkeys(texts))
    more = f"; and {len(unlike) - SHOWN} more" if len(unlike) > SHOWN else ""
    return "; ".join(unlike[:SHOWN]) + more


# ---- published reference values of all available missions


def validate(names: Sequence[str] | None = None) -> list[Row]:
    """Compare FMUs with published reference values; return one row per compared quantity.

    names: names of the cases to compare (None: all cases). Raises UsageError for an unknown name.
    """
    offered = everything().validations
    known = {name: each for each in offered for name in each.names()}
    for name in names or ():
        if name not in known:
            raise UsageError(f"{name}: no such case{did_you_mean(name, known)}")
    wanted = list(known) if names is None else names
    return [row for each in offered for row in each.answer([n for n in wanted if known[n] is each])]


def table(rows: Sequence[Row]) -> str:
    """Return the compared quantities as plain text, one line per row; the last line states how many
    cases agree.
    """
    head = ("case", "quantity", "difference", "tolerance", "unit", "verdict")
    cells = [
        (r.case, r.quantity, f"{r.difference:.2g}", f"{r.tolerance:.2g}", r.unit, r.verdict)
        for r in rows
    ]
    return "\n".join([*columns([head, *cells]), "", agreement(rows)])


def agreement(rows: Sequence[Row]) -> str:
    """Return a text that states in how many cases all quantities are within tolerance."""
    cases = {row.case for row in rows}
    agree = cases - {row.case for row in rows if not row.within}
    return f"{len(agree)} of {len(cases)} cases agree"
