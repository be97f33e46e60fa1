# SPDX-License-Identifier: BSD-2-Clause
"""Tuning of gains: search for the gains with the largest worst margin. Every candidate is evaluated
with the same random draws of the factors, and with the worst runs of an earlier study (archive).
"""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import UsageError, installed
from harness.results.result import Array
from harness.studies.analyses.evaluator import Evaluator
from harness.studies.analyses.study import Study, Tune, begun, entries, where
from harness.studies.analyses.worst import generation, search
from harness.studies.campaign.draft import table_of
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import PENDING

ARCHIVED = 12
"""Number of worst runs of the archive with which every candidate is evaluated."""


class Tuned(NamedTuple):
    """Result of tuning: coordinates (d,) of the best candidate, and worst margins (requirements,)
    of the median gains (start) and of the best candidate, over the draws of the search and over
    other draws that the search has not used (unseen).
    """

    numbers: Array
    start: Array
    best: Array
    start_unseen: Array
    best_unseen: Array


def _archived(path: Path, of: list[str], evaluator: Evaluator, factors: Mapping[str, Any]) -> Array:
    """Return the coordinates (runs, d) of the worst runs in the dataset of an earlier study, with
    zeros for the gains.

    of: requirements whose margins rank the runs; factors: table of the campaign, which must be the
    same in the study. Raises UsageError.
    """
    store = Store.open(path)
    names, there = store.array("requirement").tolist(), store.array("status") != PENDING
    chosen = [names.index(n) for n in of if n in names]
    if "numbers" not in store.group or not chosen:
        raise UsageError(f"tune.archive: {path} is not the dataset of a study of {', '.join(of)}")
    then, now = store.definition()[0]["factors"], json.loads(json.dumps(factors))
    for name in {**now, **then}:
        if (here := now.get(name, "none")) != (given := then.get(name, "none")):
            raise UsageError(f"tune.archive: {path} has factor {name} = {given}, expected {here}")
    margins = np.fmin.reduce(store.array("margin")[there][:, chosen], axis=1)
    numbers = store.array("numbers")[there][np.argsort(margins, kind="stable")[:ARCHIVED]]
    rows = np.zeros((len(numbers), evaluator.d))
    places = [k for name in then for k in evaluator.groups[name]]
    rows[:, places] = numbers
    return rows


def _tuned(
    draws: Array, unseen: Array, gains: list[int], inner: Generator[Array, Array, Any]
) -> Generator[Array, Array, Tuned]:
    """Run the method of tuning, a generator as described in harness.studies.analyses.

    draws, unseen: coordinates (runs, d) with zeros for the gains; gains: indices of the coordinates
    of the gains; inner: search for the smallest negated worst margin over the gains.
    """
    start = yield draws
    best, least = yield from _best(draws, start, gains, inner)
    both = np.concatenate([unseen, unseen])
    both[len(unseen) :, gains] = best
    margins = yield both
    numbers = np.zeros(draws.shape[1])
    numbers[gains] = best
    parts = margins[: len(unseen)].min(axis=0), margins[len(unseen) :].min(axis=0)
    return Tuned(numbers, start.min(axis=0), least, *parts)


def _best(
    draws: Array, start: Array, gains: list[int], inner: Generator[Array, Array, Any]
) -> Generator[Array, Array, tuple[Array, Array]]:
    """Return the coordinates of the gains, and the worst margins (requirements,), of the best
    candidate of the search `inner`; start: margins (draws, requirements) of the median gains.

    Candidates are compared by their worst margin over all draws and requirements. The margins of a
    requirement are divided by the median of their absolute values at the start.
    """
    finite = [np.abs(y[np.isfinite(y)]) for y in start.T]
    scale = np.array([np.median(y) if y.any() else 1.0 for y in finite])
    scale[scale == 0] = 1
    best, least = np.zeros(len(gains)), start.min(axis=0)
    score = float((_finite(start) / scale).min())
    z = next(inner)
    try:
        while True:
            rows = np.tile(draws, (len(z), 1))
            rows[:, gains] = np.repeat(z, len(draws), axis=0)
            margins = (yield rows).reshape(len(z), len(draws), -1)
            scores = (_finite(margins) / scale).min(axis=(1, 2))
            if scores.max() > score:
                k = int(np.argmax(scores))
                score, best, least = float(scores[k]), z[k], margins[k].min(axis=0)
            z = inner.send(-scores)
    except StopIteration:
        return best, least


def _finite(y: Array) -> Array:
    """Return margins with -inf in place of NaN and infinite ones, so that a run without a margin
    cannot make a candidate better.
    """
    return np.where(np.isfinite(y), y, -np.inf)


# ---- analysis


def tune(definition: Any, output: str | Path, **how: Any) -> Study:
    """Search for the gains whose worst margin over all draws and requirements is largest.

    definition: path of a campaign TOML with a table [tune], or the table itself; output: OUT.zarr;
    how: options as for sensitivity(). Raises UsageError, StructureError.
    """
    installed("cma", "verify")
    table = table_of(definition)
    entry = entries(Tune, table)
    if not entry.gains:
        raise UsageError(
            "tune.gains: is empty; define gains like factors: `NAME = "
            "{uniform = {low = 1, high = 9}}`"
        )
    file = Path("campaign.toml" if isinstance(definition, Mapping) else definition)
    factors = table.get("factors", {})
    evaluator = Evaluator({**table, "factors": {**factors, **entry.gains}}, file=file, **where(how))
    of = evaluator.columns(entry.of, slope=True)
    gains = [p for n in entry.gains for p in evaluator.groups[n]]
    d, seed = evaluator.d, evaluator.plan.table.seed
    rng = np.random.default_rng([seed, 1])
    draws, unseen = rng.standard_normal((2, entry.draws, d))
    read = [file.parent / entry.archive] if entry.archive else []
    for path in read:
        draws = np.concatenate([_archived(path, list(of), evaluator, factors), draws])
    draws[:, gains] = unseen[:, gains] = 0
    candidates, least = entry.runs // len(draws), 2 * generation(len(gains))
    if candidates < least:
        raise UsageError(
            f"tune.runs: expected at least {least * len(draws)} ({least} candidates with "
            f"{len(draws)} "
            f"runs), got {entry.runs}"
        )
    runs = len(draws) * (1 + candidates) + 2 * len(unseen)
    method = _tuned(draws, unseen, gains, search(len(gains), seed, candidates, entry.box))
    with begun("tune", evaluator, runs, output, how, *read) as driver:
        found = driver.answer(method, list(of.values()))
        chosen = evaluator.values(found.numbers, 0)
        gained = {name: chosen[name] for name in entry.gains}
        numbers = found._asdict() | {"gains": gained}
        return Study(driver.path, driver.finish({"of": {", ".join(of): numbers}}))
