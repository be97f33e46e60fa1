# SPDX-License-Identifier: BSD-2-Clause
"""Search for the worst case: the run with the smallest margin of a requirement, in a box of the
standard normal coordinates, by the evolution strategy CMA-ES (Hansen & Ostermeier 2001). A search
does not prove that no run is worse.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np

from harness.errors import HarnessError, InterruptionError, UsageError, installed
from harness.results.files import save
from harness.results.requirements import margin
from harness.results.result import Array
from harness.studies.analyses.driver import Driver, Names, begun, prepared, report_nominal
from harness.studies.analyses.study import Study
from harness.studies.reuse import ReusedSimulation
from harness.system.tables import Count, Positive

LEAST_GENERATION = 12
"""Smallest number of runs per generation of a search."""
SEEDS = 10
"""Number of further seeds with which the worst run is repeated if the campaign has seeds."""
CLOSE = 0.1
"""Tolerance for the repetition of a worst run with the macro step of the system. The margin of
the repetition is reported if it differs from the worst margin by more than this share of the
difference between worst and nominal margin, or if only one of the two margins is negative.
"""


class Worst(msgspec.Struct):
    """Entries of the table [worst]; of: names of requirements ("": all); runs: number of runs per
    requirement; box: largest absolute coordinate in standard deviations.
    """

    of: Names = ""
    runs: Count = 200
    box: Positive = 3.0


class Found(NamedTuple):
    """Worst run that a search found: coordinates (d,), margin, number of the run in the search
    (place), and number of the first run with a negative margin (first; -1: none). Numbers of runs
    are counted from 0.
    """

    numbers: Array
    margin: float
    place: int
    first: int


def generation(d: int) -> int:
    """Return the number of runs per generation of a search in d coordinates."""
    return max(LEAST_GENERATION, 4 + int(3 * math.log(d)))


def search(
    evaluate: Callable[[Array], Array], d: int, seed: int, runs: int, box: float = 3.0
) -> Found:
    """Perform `runs` runs in search of the smallest margin, and return the worst run. The search
    has d coordinates z with |z_k| <= box. It starts at z = 0; each time it has converged, it starts
    again at a random point.

    evaluate: function from coordinates (rows, d) to the margins of a requirement (rows,).
    """
    rng = np.random.default_rng(seed)
    rows, margins = np.empty((0, d)), np.empty(0)
    wide = max(d, 2)  # cma needs two coordinates: a second without effect is added
    start = np.zeros(wide)
    while runs - len(margins) >= generation(d):
        engine = _engine(start, box, rng)
        while runs - len(margins) >= generation(d) and not engine.stop():
            z = np.array(engine.ask())
            y = _exercised(evaluate(z[:, :d]))
            engine.tell(list(z), _ranked(y))
            rows, margins = np.concatenate([rows, z[:, :d]]), np.concatenate([margins, y])
        start = rng.uniform(-box, box, wide) / 2
    if runs > len(margins):  # too few runs left for a generation: draw them near the worst
        spread = rng.standard_normal((runs - len(margins), d)) / 2
        middle = rows[np.argmin(margins)] if len(margins) else start[:d]
        z = (middle + spread).clip(-box, box)
        y = _exercised(evaluate(z))
        rows, margins = np.concatenate([rows, z]), np.concatenate([margins, y])
    place = int(np.argmin(margins))
    failed = np.flatnonzero(margins < 0)
    return Found(rows[place], float(margins[place]), place, int(failed[0]) if len(failed) else -1)


def _engine(start: Array, box: float, rng: np.random.Generator) -> Any:
    """Return a CMA-ES optimiser that draws from `rng`. Its built-in generator would change the seed
    of numpy's global generator.
    """
    import cma  # type: ignore[import-untyped]
    from threadpoolctl import ThreadpoolController

    options = {
        "bounds": [-box, box],
        "popsize": generation(len(start)),
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": math.nan,
        # one thread, because idle BLAS threads use 0.1 s of processor time after every call
        "CMA_eigenmethod": ThreadpoolController().wrap(limits=1)(np.linalg.eigh),
        "verbose": -9,
        "verb_log": 0,
        "verb_disp": 0,
    }
    return cma.CMAEvolutionStrategy(start, 1.0, options)


def _exercised(y: Array) -> Array:
    """Return the margins y with inf in place of NaN, so that a run without a verdict is never the
    worst.
    """
    return np.where(np.isnan(y), np.inf, y)


def _ranked(y: Array) -> list[float]:
    """Return the margins as finite numbers for the optimiser: failed runs (-inf) below all others,
    runs without a verdict (inf) above them.
    """
    finite = y[np.isfinite(y)]
    low = float(finite.min() - 1 - np.ptp(finite)) if len(finite) else -1.0
    high = float(finite.max() + 1) if len(finite) else 1.0
    return list(map(float, np.nan_to_num(y, nan=high, neginf=low, posinf=high)))


# ---- analysis


def worst(definition: Any, output: str | Path, **how: Any) -> Study:
    """Search for the run with the smallest margin, for each requirement. The worst runs and the
    nominal run are repeated with the macro step of the system, not the one of the campaign, and
    their results with all rows are stored as OUT_worst/REQUIREMENT.nc and OUT_worst/nominal.nc.

    definition: campaign with a table [worst], as the path of its TOML or as a dict with the content
    of the TOML; output: OUT.zarr; how: workers, lanes, resume, progress and notify as for
    campaign(). Raises UsageError, StructureError.
    """
    installed("cma", "verify")
    entry, evaluator = prepared(Worst, definition, how)
    of = evaluator.columns(entry.of, slope=True)
    if entry.runs < (least := generation(evaluator.d)):
        raise UsageError(
            f"worst.runs: expected at least {least} (one generation of {least} runs per search), "
            f"got {entry.runs}"
        )
    seeds = SEEDS if evaluator.plan.table.seeds else 0
    runs = len(of) * (entry.runs + seeds)
    found: dict[str, Any] = {}
    with begun("worst", evaluator, runs, output, how) as driver:
        report_nominal(driver, of)
        for name, k in of.items():
            found[name] = _searched(driver, k, entry)
            if seeds:
                z = np.repeat(np.array([found[name]["numbers"]]), seeds, axis=0)
                found[name]["other seeds"] = driver.evaluate(z)[:, k]
        _confirm(driver, found, Path(output))
        return driver.finish({"of": found})


def _searched(driver: Driver, column: int, entry: Worst) -> dict[str, Any]:
    """Search for the worst run of one requirement; return the entries of its estimate by name:
    margin, number of the worst run in the dataset (run) and in the search (place), coordinates
    (numbers), and others. column: index of the requirement among the margins.
    """
    first, seed, d = driver.completed, driver.evaluator.plan.table.seed, driver.evaluator.d
    worst = search(lambda z: driver.evaluate(z)[:, column], d, seed, entry.runs, entry.box)
    return {
        "margin": worst.margin,
        "run": first + worst.place,
        "first": worst.first + 1 if worst.first >= 0 else None,
        "runs": entry.runs,
        "place": worst.place,
        "numbers": worst.numbers,
        "moved": driver.evaluator.moved(worst.numbers),
        "distance": np.linalg.norm(worst.numbers),
        "nominal": driver.nominal[column],
    }


def _confirm(driver: Driver, found: dict[str, Any], output: Path) -> None:
    """Repeat the worst runs and the nominal run with the macro step of the system instead of the
    `step` of the campaign, and write their results beside `output`. Add to each estimate
    in `found` (by requirement) the margin of the repetition and whether it differs from the worst
    margin.
    """
    evaluator, folder = driver.evaluator, _folder(output)
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[tuple[Any, int]] = [(np.zeros(evaluator.d), 0)]
    rows += [(np.array(each["numbers"]), each["run"]) for each in found.values()]
    files = _files(found).items()
    with closing(ReusedSimulation(evaluator.plan.system)) as reused:
        for (name, file), (z, run) in zip(files, rows, strict=True):
            changes: Any = {k: v for k, v in evaluator.changes(z, run).items() if k != "step"}
            result: Any = None
            try:
                result = reused.run(changes, 1, evaluator.plan.table.patience)
            except InterruptionError as error:
                raise KeyboardInterrupt from error
            except HarnessError as error:  # a run with a rejected value counts as failed
                result = getattr(error, "partial", result)
            if result is not None:
                save(result, folder / file)
            if name is not None:
                text, then = evaluator.task.requirements[name], found[name]["margin"]
                own = -math.inf if result is None else margin(result, text)
                span = abs(float(then) - float(found[name]["nominal"]))
                near = own == then or abs(own - then) <= CLOSE * span < math.inf
                differs = not near or (own < 0) != (then < 0)
                found[name] |= {"own step": own, "differs": differs}


def _folder(output: Path) -> Path:
    """Return the folder for the results of the worst runs and the nominal run, beside OUT.zarr."""
    return output.with_name(f"{output.stem}_worst")


def confirmed(path: Path, requirements: Iterable[str]) -> dict[str, Path]:
    """Return the existing results files of the nominal run and of the worst run of each
    requirement, by label (`nominal`, `worst NAME`); path: OUT.zarr of the search.
    """
    labels = ("nominal", *(f"worst {name}" for name in requirements))
    files = (_folder(path) / file for file in _files(requirements).values())
    return {label: file for label, file in zip(labels, files, strict=True) if file.is_file()}


def _files(requirements: Iterable[str]) -> dict[str | None, str]:
    """Return the name of the results file of the worst run by requirement; the first entry, with
    the key None, is for the nominal run. A name has `_` in place of each character that is unsafe
    in a file name, and a number if the name would otherwise be taken.
    """
    found: dict[str | None, str] = {None: "nominal.nc"}
    for name in requirements:
        stem = "".join(c if c.isalnum() or c in "-_" else "_" for c in name)
        taken = {file.casefold() for file in found.values()}
        names = (f"{stem}{end}.nc" for end in ("", *(f"_{k}" for k in range(2, len(found) + 2))))
        found[name] = next(file for file in names if file.casefold() not in taken)
    return found
