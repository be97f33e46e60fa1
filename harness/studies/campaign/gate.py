# SPDX-License-Identifier: BSD-2-Clause
"""What a campaign is held to: `[expected]` of its file, and conditions of the user on shares and
metrics, `lower(success) >= 99 %`. Both decide on the exit status by harness.results.verdict.

A condition is an expression. `success` is the share of the runs that have succeeded, `met(NAME)`
that of a requirement, `lower(NAME)` the lower bound of the interval of 95 % of either; a metric is
its values in all runs, `percentile(miss, 95) <= 10 cm`, and alone must hold in each.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from harness.results.evaluation import evaluate, resolved, unit_of
from harness.results.expressions import QUANTITY, Node, parsed
from harness.results.verdict import Judged, Kind, Verdict, missed
from harness.spelling import did_you_mean
from harness.studies.campaign.plan import SUCCESS
from harness.studies.campaign.store import Store
from harness.studies.campaign.summary import expectations, metric_columns, requirements, success

TOKEN = re.compile(
    rf"{QUANTITY.pattern}|\b(?P<bound>met|lower)\(\s*(?P<share>\w+)\s*\)|(?<![\w.])(?P<name>[^\W\d]\w*)(?![\w(.])"
)
"""A quantity, a share of the runs, or the name of a metric."""
MET, LOWER, METRIC = "met", "lower", "metric"
"""First parts of the variables that stand for them."""


def wrong(texts: Sequence[str], shares: Collection[str], units: Mapping[str, str]) -> Iterator[str]:
    """Conditions that a campaign cannot be held to, a line each; shares: success and names of
    requirements; units: those of the metrics by name.
    """
    for text in texts:
        try:
            _tree(text, shares, units)
        except ValueError as error:
            yield f"--require {text}: {error}"


def failures(store: Store, required: Sequence[str], strict: bool) -> list[str]:
    """Lines of what gives the exit status 1; strict: also what the campaign expects, or, if it
    expects nothing, that every run succeeds.
    """
    own = [*expectations(store)] or [*_every_run(store)]
    return [*missed(_held(store, required), strict=True), *missed(own, strict=strict)]


def _every_run(store: Store) -> Iterator[Judged]:
    if (found := success(store)) is not None:
        open_ = Verdict.NOT_EXERCISED if found.unjudged else Verdict.MET
        yield _judged(
            f"{SUCCESS} of every run", Verdict.NOT_MET if found.missed else open_, str(found)
        )


def _held(store: Store, texts: Sequence[str]) -> Iterator[Judged]:
    """Conditions on a campaign with their verdicts."""
    shares = requirements(store)
    if (found := success(store)) is not None:
        shares[SUCCESS] = found
    columns = metric_columns(store)
    units = {name: str(store.group[name].attrs.get("units", "")) for name in columns}
    complete = store.array("status") == 1
    for text in texts:
        tree = _tree(text, shares, units)
        asked = [shares[name] for kind, name in map(_split, tree.variables) if kind != METRIC]

        def value(path: str) -> Any:
            kind, name = _split(path)
            if kind == METRIC:
                return columns[name][complete]
            return shares[name].interval()[0] if kind == LOWER else shares[name].share

        if any(share.unjudged or not share.judged for share in asked):
            yield _judged(text, Verdict.NOT_EXERCISED, "; ".join(map(str, asked)))
            continue
        with np.errstate(all="ignore"):
            met = bool(np.all(evaluate(tree, value)))
            told = [*map(str, asked), *_compared(tree, value, units)]
        yield _judged(text, Verdict.MET if met else Verdict.NOT_MET, "; ".join(told))


def _judged(text: str, verdict: Verdict, detail: str) -> Judged:
    word = Kind.REQUIREMENT.word(verdict)
    line = "; ".join(part for part in (f"{word.upper()}: {text}", detail) if part)
    return Judged(Kind.REQUIREMENT, text, verdict, line)


def _compared(tree: Node, value: Any, units: Mapping[str, str]) -> Iterator[str]:
    """Numbers that come of metrics."""
    for node in tree.walk():
        side = node.parts[0] if node.kind == "compare" else node
        if side is not node and any(_split(path)[0] == METRIC for path in side.variables):
            number = evaluate(side, value)
            if np.ndim(number) == 0:
                text = side.text.replace(f"{METRIC}.", "")
                unit = unit_of(side, partial(_unit, units)).removeprefix("1")
                yield f"{text} is {number:.5g} {unit}".rstrip()


def _tree(text: str, shares: Collection[str], units: Mapping[str, str]) -> Node:
    """The expression of a condition, with `met.success`, `lower.success` and `metric.miss` in it;
    ValueError.
    """

    def dotted(match: re.Match[str]) -> str:
        if match["bound"]:
            if (name := match["share"]) not in shares:
                raise ValueError(f"no requirement {name}{did_you_mean(name, shares)}")
            return f"{match['bound']}.{match['share']}"
        if match["name"] == SUCCESS and SUCCESS in shares:
            return f"{MET}.{SUCCESS}"
        return f"{METRIC}.{match['name']}" if match["name"] in units else match[0]

    tree = parsed(TOKEN.sub(dotted, text), [*units, SUCCESS], "metric")
    if not (tree.kind == "compare" or tree.conditions):
        raise ValueError("is not a condition; write one like `success >= 99 %`")
    for path in tree.variables:
        if _split(path)[0] not in (MET, LOWER, METRIC):
            raise ValueError(f"{path} varies within a run: only a requirement or metric can ask")
    return resolved(tree, partial(_unit, units))


def _split(path: str) -> tuple[str, str]:
    kind, _, name = path.partition(".")
    return kind, name


def _unit(units: Mapping[str, str], path: str) -> str:
    kind, name = _split(path)
    return units[name] if kind == METRIC else "1"
