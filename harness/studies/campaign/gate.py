# SPDX-License-Identifier: BSD-2-Clause
"""Conditions on a whole campaign, which determine the exit status of the command: conditions that
the user gives by --require, such as `lower(success) >= 99 %`, and with --strict the table
`[expected]` of its file.

A condition is evaluated like a requirement on a time series, but with a row per complete run
instead of a row per instant. `miss <= 1 m` must hold for the metric `miss` in each run, and
`percentile(miss, 95) <= 10 cm` is one value of all runs. `success` is the share of successful runs,
`met(NAME)` the share of runs that met the requirement NAME, and `lower(NAME)` the lower bound of
the 95 % interval of such a share.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from unicodedata import normalize

import numpy as np

from harness.results.evaluation import resolved
from harness.results.expressions import QUANTITY, parsed
from harness.results.requirements import Finding, condition, finding
from harness.results.result import Result
from harness.results.verdict import Kind, Outcome, Verdict, missed
from harness.spelling import did_you_mean
from harness.studies.campaign import summary
from harness.studies.campaign.plan import SUCCESS
from harness.studies.campaign.store import Store
from harness.studies.campaign.summary import Share
from harness.studies.campaign.worker import COMPLETE

TOKEN = re.compile(
    rf"{QUANTITY.pattern}|\b(?P<bound>met|lower)\(\s*(?P<share>\w+)\s*\)|(?<![\w.])(?P<name>[^\W\d]\w*)(?![\w(.])"
)
"""Regular expression for the parts of a condition: a number with its unit; a share `met(NAME)` or
`lower(NAME)`; or a name, which may be the name of a metric.
"""
MET, LOWER, METRIC = "parameter met", "parameter lower", "metric"
"""Prefixes of the names that variables have in a condition after it has been translated into a
requirement and parsed: shares of runs (`parameter met.NAME`), lower bounds of such shares, metrics.
"""


def wrong(texts: Sequence[str], shares: Collection[str], units: Mapping[str, str]) -> Iterator[str]:
    """Yield one line per condition that the campaign cannot evaluate.

    texts: conditions of the user; shares: names of requirements, and `success` if it is defined;
    units: units of the metrics by name.
    """
    for text in texts:
        try:
            _expression(text, shares, units)
        except ValueError as error:
            yield f"--require {text}: {error}"


def failures(store: Store, required: Sequence[str], strict: bool) -> list[str]:
    """Return one line per condition that is not met and therefore gives the exit status 1.

    required: conditions that the user gives by --require; strict: include the entries of
    `[expected]`, or, if there are none, the condition that every run succeeds.
    """
    shares = summary.requirements(store)
    if (found := summary.success(store)) is not None:
        shares[SUCCESS] = found
    table = _table(store, shares)
    demanded = [_demanded(text, table, shares) for text in required]
    own = [*summary.expectations(store)] or [_every_run(store, found)]
    return [*missed(demanded, strict=True), *missed(own, strict=strict)]


def _every_run(store: Store, found: Share | None) -> Outcome:
    """Return the verdict on the condition that every run succeeds, or, if the campaign does not
    define success (found is None), that every run completes.
    """
    what, found = (SUCCESS, found) if found else ("completion", summary.completion(store))
    open_ = Verdict.NOT_EXERCISED if found.unjudged else Verdict.MET
    return _outcome(f"{what} of every run", Verdict.NOT_MET if found.missed else open_, str(found))


def _table(store: Store, shares: Mapping[str, Share]) -> Result:
    """Return the metrics of all complete runs as a Result, so that conditions can be evaluated like
    requirements. It has a row per run, whose time is the number of the run, and a column per
    metric except `success`; the shares and their lower bounds are its parameters.
    """
    found = summary.metric_columns(store)
    runs = np.flatnonzero((status := store.array("status")) == COMPLETE)
    units = tuple(str(store.group[name].attrs.get("units", "")) for name in found)
    values = np.array([*found.values()]).reshape(len(found), len(status)).T[runs]
    given = {f"met.{name}": share.share for name, share in shares.items()}
    given |= {f"lower.{name}": share.interval()[0] for name, share in shares.items()}
    one = np.array([[*given.values()]])
    table = Result("", np.zeros(1), (*given,), ("1",) * len(given), one)
    names = tuple(f"{METRIC}.{normalize('NFKC', name)}" for name in found)
    return Result("", runs.astype(np.float64), names, units, values, parameters=table)


def _demanded(text: str, table: Result, shares: Mapping[str, Share]) -> Outcome:
    """Return the verdict on a condition of the user; table: result of _table(); shares: shares of
    runs that succeeded or met a requirement, by name.
    """
    units = {n.partition(".")[2]: u for n, u in zip(table.columns, table.units, strict=True)}
    expression = _expression(text, shares, units)
    parts = [name.partition(".") for name in condition(expression).variables]
    named = [shares[name] for kind, _, name in parts if kind != METRIC]
    if any(share.unjudged or not share.evaluated for share in named):
        return _outcome(text, Verdict.NOT_EXERCISED, *named)
    if len(named) == len(parts):  # only shares, which are equal in all rows: use one row
        table = replace(table, time=np.zeros(1), columns=(), units=(), values=np.empty((1, 0)))
    elif not len(table.time):
        return _outcome(text, Verdict.NOT_EXERCISED, "no run has completed")
    found = finding(table, text, expression)
    detail = _detail(found) if len(named) < len(parts) else ""
    return _outcome(text, found.verdict, *named, detail)


def _detail(found: Finding) -> str:
    """Return a text with the worst value of a condition and the number of its run, or with the
    reason why the condition has no value.
    """
    if found.value is None or found.verdict is Verdict.NOT_EXERCISED:
        unjudged = found.verdict is Verdict.NOT_JUDGED
        return found.reason if unjudged else "its condition applies in no run"
    place = "" if found.time is None else f" in run {found.time:.0f}"
    if math.isnan(found.value):
        return f"not a number{place}"
    return f"worst {found.value:.5g} {found.unit.removeprefix('1')}".rstrip() + place


def _outcome(text: str, verdict: Verdict, *details: object) -> Outcome:
    """Return the verdict on a condition, with a line that contains the condition, the verdict and
    the details.
    """
    head = f"{Kind.REQUIREMENT.word(verdict).upper()}: {text}"
    line = "; ".join(filter(None, [head, *map(str, details)]))
    return Outcome(Kind.REQUIREMENT, text, verdict, line)


def _expression(text: str, shares: Collection[str], units: Mapping[str, str]) -> str:
    """Return a condition of the user, `success >= 99 %` or `miss <= 1 m`, as a requirement on the
    table of _table(), `parameter(met.success) >= 99 %` or `metric.miss <= 1 m`. Raise ValueError if
    the campaign cannot evaluate it.
    """
    known = {f"{METRIC}.{normalize('NFKC', name)}": unit for name, unit in units.items()}
    known |= {f"{kind}.{name}": "1" for kind in (MET, LOWER) for name in shares}

    def dotted(match: re.Match[str]) -> str:
        if match["bound"]:
            if (name := match["share"]) not in shares:
                raise ValueError(f"there is no requirement {name}{did_you_mean(name, shares)}")
            return f"parameter({match['bound']}.{name})"
        if match["name"] == SUCCESS and SUCCESS in shares:
            return f"parameter(met.{SUCCESS})"
        return f"{METRIC}.{match[0]}" if f"{METRIC}.{match['name']}" in known else match[0]

    expression = TOKEN.sub(dotted, normalize("NFKC", text))
    tree = parsed(expression, (*units, SUCCESS), "metric")
    if not (tree.kind == "compare" or tree.conditions):
        raise ValueError("is not a condition; write one like `success >= 99 %`")
    condition(expression)
    for path in tree.variables:
        if path not in known:
            raise ValueError(f"{path} belongs to a single run; use a metric or a requirement")
    if tree.has_window:
        raise ValueError(
            "a window of time is valid only in a requirement; put it into [requirements]"
        )
    resolved(tree, known.__getitem__)
    return expression
