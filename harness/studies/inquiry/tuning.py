# SPDX-License-Identifier: BSD-2-Clause
"""Gains with the best worst margin: each candidate flies the same draws and the worst flights of an
archive.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.studies.campaign.draft import table_of
from harness.studies.inquiry.flights import Flights
from harness.studies.inquiry.study import Study, Tune, begun, earlier, entries
from harness.studies.inquiry.worst import generation, needs_cma, search

Array = NDArray[np.float64]

ARCHIVED = 12
"""Worst flights of an archive that every candidate flies."""


class Tuned(NamedTuple):
    """Numbers (d,) of the best candidate; worst margins (requirements,) of the start and of the
    best over the draws they were chosen by, and over as many others.
    """

    numbers: Array
    start: Array
    best: Array
    start_unseen: Array
    best_unseen: Array


def _archived(path: Path, of: list[str], gains: list[int], d: int) -> Array:
    """The worst flights of a study of the same factors, without gains."""
    numbers, margins = earlier("tune.archive", path, of, d - len(gains))
    chosen = numbers[np.argsort(margins.min(axis=1), kind="stable")[:ARCHIVED]]
    rows = np.zeros((len(chosen), d))
    rows[:, [k for k in range(d) if k not in gains]] = chosen
    return rows


def _tuned(
    draws: Array, unseen: Array, gains: list[int], inner: Generator[Array, Array, Any]
) -> Generator[Array, Array, Tuned]:
    """The best candidate beside the start, then both over draws that nobody has seen."""
    start = _finite((yield draws))
    best, least = yield from _best(draws, start, gains, inner)
    both = np.concatenate([unseen, unseen])
    both[len(unseen) :, gains] = best
    told = yield both
    numbers = np.zeros(draws.shape[1])
    numbers[gains] = best
    parts = told[: len(unseen)].min(axis=0), told[len(unseen) :].min(axis=0)
    return Tuned(numbers, start.min(axis=0), least, *parts)


def _best(
    draws: Array, start: Array, gains: list[int], inner: Generator[Array, Array, Any]
) -> Generator[Array, Array, tuple[Array, Array]]:
    """Gains and worst margins of the best candidate. They are compared by their worst margin over
    all draws and requirements, each in parts of the median margin that the start has.
    """
    scale = np.median(np.abs(start), axis=0)
    scale[scale == 0] = 1
    best, least = np.zeros(len(gains)), start.min(axis=0)
    score = float((start / scale).min())
    z = next(inner)
    try:
        while True:
            rows = np.tile(draws, (len(z), 1))
            rows[:, gains] = np.repeat(z, len(draws), axis=0)
            told = _finite((yield rows)).reshape(len(z), len(draws), -1)
            scores = (told / scale).min(axis=(1, 2))
            if scores.max() > score:
                k = int(np.argmax(scores))
                score, best, least = float(scores[k]), z[k], told[k].min(axis=0)
            z = inner.send(-scores)
    except StopIteration:
        return best, least


def _finite(y: Array) -> Array:
    """Margins with a very bad one for flights that died."""
    finite = np.abs(y[np.isfinite(y)])
    bad = -10 * float(finite.max()) if len(finite) else -1.0
    return np.nan_to_num(y, nan=0.0, neginf=bad)


# ---- the study


def tune(definition: Any, output: str | Path, **how: Any) -> Study:
    """Search for the gains with the largest worst margin.

    definition: path of a campaign TOML with a table [tune], or the table itself; output: OUT.zarr;
    how: as for sensitivity(). Raises UsageError, StructureError.
    """
    needs_cma()
    table = table_of(definition)
    entry = entries(Tune, table)
    if not entry.gains:
        raise UsageError("tune.gains: expected a draw per gain, as in [factors]")
    file = Path("campaign.toml" if isinstance(definition, Mapping) else definition)
    factors = {**table.get("factors", {}), **entry.gains}
    flights = Flights({**table, "factors": factors}, workers=how.get("workers"), file=file)
    of = flights.columns(entry.of, slope=True)
    gains = [p for n in entry.gains for p in flights.groups[n]]
    d, seed = flights.d, flights.plan.table.seed
    rng = np.random.default_rng([seed, 1])
    draws, unseen = rng.standard_normal((2, entry.draws, d))
    if entry.archive:
        archive = _archived(file.parent / entry.archive, list(of), gains, d)
        draws = np.concatenate([archive, draws])
    draws[:, gains] = unseen[:, gains] = 0
    candidates, least = entry.flights // len(draws), 2 * generation(len(gains))
    if candidates < least:
        raise UsageError(f"tune.flights: at least {least * len(draws)}, {least} candidates")
    runs = len(draws) * (1 + candidates) + 2 * len(unseen)
    method = _tuned(draws, unseen, gains, search(len(gains), seed, candidates, entry.box))
    with begun("tune", flights, runs, output, how) as driver:
        found = driver.answer(method, list(of.values()))
        chosen = flights.values(found.numbers, 0)
        gained = {name: chosen[name] for name in entry.gains}
        numbers = found._asdict() | {"gains": gained}
        return Study(driver.path, driver.finish({"of": {", ".join(of): numbers}}))
