# SPDX-License-Identifier: BSD-2-Clause
"""What is the worst: a search for the least margin in a box of the numbers, by the evolution
strategy CMA-ES (Hansen & Ostermeier 2001). What it finds is a bound, and no proof that there is
nothing worse.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterable
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import RunError, UsageError
from harness.results.files import save
from harness.results.requirements import margin
from harness.studies.inquiry.driver import Driver
from harness.studies.inquiry.flights import exercised
from harness.studies.inquiry.study import Study, Worst, begun, prepared, say_nominal
from harness.studies.warm import Warm

Array = NDArray[np.float64]
Ask = Generator[Array, Array, "Found"]

LEAST_GENERATION = 12
SEEDS = 10
"""Further seeds of sensors that the worst flight is flown with."""
CLOSE = 0.1
"""Part of the distance to the nominal margin by which the own macro step may change the worst."""


class Found(NamedTuple):
    """The worst flight of a search: its numbers (d,), its margin, its place and that of the first
    failure (-1: none) among the flights.
    """

    numbers: Array
    margin: float
    place: int
    first: int


def needs_cma() -> None:
    """UsageError if a package is not there."""
    for name in ("cma", "threadpoolctl"):
        if find_spec(name) is None:
            raise UsageError(f"this needs the package {name}: pip install 'servicing-fmus[verify]'")


def generation(d: int) -> int:
    """Flights of a generation of a search in d numbers."""
    return max(LEAST_GENERATION, 4 + int(3 * math.log(d)))


def search(d: int, seed: int, flights: int, box: float = 3.0, sigma: float = 1.0) -> Ask:
    """The least margin that so many flights find within |z| <= box, from the middle on; a search
    that has converged begins again elsewhere.
    """
    rng = np.random.default_rng(seed)
    rows, margins = np.empty((0, d)), np.empty(0)
    wide = max(d, 2)  # the package knows no search in one number: a second one means nothing
    start = np.zeros(wide)
    while flights - len(margins) >= generation(d):
        engine = _engine(start, sigma, box, rng)
        while flights - len(margins) >= generation(d) and not engine.stop():
            z = np.array(engine.ask())
            y = exercised((yield z[:, :d]))
            engine.tell(list(z), _ranked(y))
            rows, margins = np.concatenate([rows, z[:, :d]]), np.concatenate([margins, y])
        start = rng.uniform(-box, box, wide) / 2
    if flights > len(margins):  # too few for a generation: about the best so far
        spread = rng.standard_normal((flights - len(margins), d)) * sigma / 2
        middle = rows[np.argmin(margins)] if len(margins) else start[:d]
        z = (middle + spread).clip(-box, box)
        y = exercised((yield z))
        rows, margins = np.concatenate([rows, z]), np.concatenate([margins, y])
    place = int(np.argmin(margins))
    failed = np.flatnonzero(margins < 0)
    return Found(rows[place], float(margins[place]), place, int(failed[0]) if len(failed) else -1)


def _engine(start: Array, sigma: float, box: float, rng: np.random.Generator) -> Any:
    """CMA-ES with a generator of its own: its seed would be numpy's for everybody."""
    import cma  # type: ignore[import-untyped]
    from threadpoolctl import ThreadpoolController

    options = {
        "bounds": [-box, box],
        "popsize": generation(len(start)),
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": math.nan,
        # threads of a BLAS spin for 0.1 s of processor time after every use
        "CMA_eigenmethod": ThreadpoolController().wrap(limits=1)(np.linalg.eigh),
        "verbose": -9,
        "verb_log": 0,
        "verb_disp": 0,
    }
    return cma.CMAEvolutionStrategy(start, sigma, options)


def _ranked(y: Array) -> list[float]:
    """Margins with those of flights that died below all others."""
    finite = y[np.isfinite(y)]
    low = float(finite.min() - 1 - np.ptp(finite)) if len(finite) else -1.0
    high = float(finite.max() + 1) if len(finite) else 1.0
    ranked: list[float] = np.nan_to_num(y, nan=high, neginf=low, posinf=high).tolist()
    return ranked


# ---- the study


def worst(definition: Any, output: str | Path, **how: Any) -> Study:
    """Search for the smallest margin of each requirement.

    definition: path of a campaign TOML with a table [worst], or the table itself; output: OUT.zarr;
    the worst runs and the nominal one are repeated with all rows into OUT_worst/NAME.nc; how: as
    for sensitivity(). Raises UsageError, StructureError.
    """
    needs_cma()
    entry, flights = prepared(Worst, definition, how)
    of = flights.columns(entry.of, slope=True)
    each, least = entry.flights // entry.searches, generation(flights.d)
    if each < least:
        raise UsageError(f"worst.flights: at least {least}, one generation, for each search")
    seeds = SEEDS if flights.plan.table.seeds else 0
    runs = len(of) * (each * entry.searches + seeds)
    found: dict[str, Any] = {}
    with begun("worst", flights, runs, output, how) as driver:
        say_nominal(driver, of)
        for name, k in of.items():
            found[name] = _searched(driver, k, entry)
            if seeds:
                z = np.repeat(np.array([found[name]["numbers"]]), seeds, axis=0)
                found[name]["other seeds"] = driver.ask(z)[:, k]
        _confirm(driver, found, Path(output))
        return Study(driver.path, driver.finish({"of": found, "box": entry.box}))


def _searched(driver: Driver, column: int, entry: Worst) -> dict[str, Any]:
    """The worst flight of a requirement, by searches of equal length from one seed each."""
    first, seed, d = driver.flown, driver.flights.plan.table.seed, driver.flights.d
    each = entry.flights // entry.searches
    results = [
        driver.answer(search(d, seed + 1000 * n, each, entry.box), column)
        for n in range(entry.searches)
    ]
    k = int(np.argmin([r.margin for r in results]))
    failed = [n * each + r.first + 1 for n, r in enumerate(results) if r.first >= 0]
    place = k * each + results[k].place
    return {
        "margin": results[k].margin,
        "run": first + place,
        "first": failed[0] if failed else None,
        "flights": each * entry.searches,
        "place": place,
        "numbers": results[k].numbers,
        "moved": driver.flights.moved(results[k].numbers),
        "distance": np.linalg.norm(results[k].numbers),
        "nominal": driver.nominal[column],
        "converged": [r.margin for r in results],
    }


def _confirm(driver: Driver, found: dict[str, Any], output: Path) -> None:
    """The worst flights and the nominal one with the own macro step of the system, to files."""
    flights, folder = driver.flights, _folder(output)
    folder.mkdir(parents=True, exist_ok=True)
    rows = {"nominal": (np.zeros(flights.d), 0)}
    rows |= {n: (np.array(each["numbers"]), each["run"]) for n, each in found.items()}
    with closing(Warm(flights.plan.system)) as warm:
        for name, (z, run) in rows.items():
            changes: Any = {k: v for k, v in flights.changes(z, run).items() if k != "step"}
            try:
                result = warm.fly(changes, 1, flights.plan.table.patience)
            except RunError as error:  # of one that died there may be nothing
                if (result := error.partial) is None:
                    continue
            save(result, folder / f"{_file(name)}.nc")
            if name in found:
                own = margin(result, flights.task.requirements[name])
                found[name]["own step"] = own
                limit = CLOSE * abs(found[name]["margin"] - found[name]["nominal"])
                found[name]["differs"] = not abs(own - found[name]["margin"]) <= limit


def _folder(output: Path) -> Path:
    """Where the flights of _confirm are."""
    return output.with_name(f"{output.stem}_worst")


def confirmed(path: Path, requirements: Iterable[str]) -> dict[str, Path]:
    """Files of the nominal flight and of the worst one of each requirement, beside the dataset of a
    search, as far as they are there.
    """
    files = {"nominal": "nominal"} | {f"worst {n}": _file(n) for n in requirements}
    found = {label: _folder(path) / f"{name}.nc" for label, name in files.items()}
    return {label: file for label, file in found.items() if file.is_file()}


def _file(name: str) -> str:
    return "".join(c if c.isalnum() or c in "-_" else "_" for c in name)
