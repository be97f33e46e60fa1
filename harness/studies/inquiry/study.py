# SPDX-License-Identifier: BSD-2-Clause
"""The studies by name: sensitivity, worst, probability, map, tune, each from the file of a campaign
and a small table of its own, `[worst]`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import StructureError, UsageError
from harness.results.files import save
from harness.spelling import did_you_mean
from harness.studies.campaign.campaign import Progress
from harness.studies.campaign.draft import table_of
from harness.studies.campaign.store import Store
from harness.studies.inquiry import probability as methods
from harness.studies.inquiry import sensitivity as effects
from harness.studies.inquiry import worst as searches
from harness.studies.inquiry.boundary import COARSE, boundary
from harness.studies.inquiry.driver import Driver
from harness.studies.inquiry.flights import Flights, asked, column
from harness.studies.inquiry.given import of_dataset
from harness.studies.inquiry.tuning import tuned
from harness.studies.warm import Warm

Array = NDArray[np.float64]
Said = Callable[[str], None]

ENTRIES: dict[str, dict[str, Any]] = {
    "sensitivity": {"of": [], "method": "morris", "flights": 130},
    "worst": {"of": [], "flights": 200, "box": 3.0, "searches": 1},
    "probability": {"of": "", "method": "subset", "flights": 20_000, "below": 0.0, "centres": ""},
    "map": {"of": "", "factors": [], "flights": 100},
    "tune": {"of": [], "gains": {}, "draws": 24, "archive": "", "flights": 2400, "box": 3.0},
}
"""Entries of the tables of studies with what they are if they are not given."""
METHODS = {
    "sensitivity": ("morris", "sobol"),
    "probability": ("subset", "random", "importance"),
}
SEEDS = 10
"""Further seeds of sensors that the worst flight is flown with."""
CLOSE = 0.1
"""Part of the distance to the nominal margin by which the own macro step may change the worst."""


@dataclass(frozen=True)
class Study:
    """A study that is over. estimate: what was found, by requirement, as plain data."""

    path: Path
    store: Store

    @property
    def kind(self) -> str:
        """Sensitivity, worst, probability, map, tune or given."""
        return str(self.store.group.attrs["kind"])

    @property
    def estimate(self) -> dict[str, Any]:
        """What was found, as plain data."""
        found: dict[str, Any] = json.loads(self.store.group.attrs["estimate"])
        return found

    @property
    def data(self) -> Any:
        """The dataset as xarray has it: flights with numbers, factors and margins."""
        import xarray

        return xarray.open_zarr(self.path, consolidated=False, chunks=None)

    def summary(self) -> str:
        """What was found, for reading."""
        from harness.studies.inquiry.summary import text

        return text(self.kind, self.estimate, self.store, str(self.path))

    @property
    def verdict(self) -> bool:
        """Whether nothing was found that gives the exit status 1."""
        found = self.estimate["of"].values()
        if self.kind == "worst":
            return all(each["margin"] >= 0 for each in found)
        return all(each.get("verdict", "met") == "met" for each in found)


def entries(kind: str, table: Mapping[str, Any]) -> dict[str, Any]:
    """The table of a study with its defaults; StructureError with all that is wrong with it."""
    known = ENTRIES[kind]
    given = table.get(kind, {})
    if not isinstance(given, Mapping):
        raise StructureError([f"{kind}: must be a table here, not {given!r:.60}"])
    problems = list(_wrong(kind, given))
    if problems:
        raise StructureError(problems)
    return {**known, **given}


def _wrong(kind: str, given: Mapping[str, Any]) -> Iterator[str]:
    known = ENTRIES[kind]
    for name, value in given.items():
        if name not in known:
            yield f"{kind}.{name}: there is no such entry{did_you_mean(name, known)}"
            continue
        wanted = known[name]
        either = (str, list) if name == "of" else type(wanted)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if isinstance(wanted, float):
            if not number or not value > 0:
                yield f"{kind}.{name}: expected a number above 0, got {value!r:.60}"
        elif isinstance(wanted, int):
            if not number or value != int(value) or value < 1:
                yield f"{kind}.{name}: expected a whole number above 0, got {value!r:.60}"
        elif not isinstance(value, either):
            yield f"{kind}.{name}: expected a {type(wanted).__name__}, got {value!r:.60}"
    method = given.get("method", METHODS.get(kind, ("",))[0])
    if kind in METHODS and method not in METHODS[kind]:
        close = did_you_mean(str(method), METHODS[kind])
        yield f"{kind}.method: there is no {method}{close}; expected {', '.join(METHODS[kind])}"


@contextmanager
def _begun(
    kind: str,
    flights: Flights,
    runs: int,
    output: str | Path,
    how: Mapping[str, Any],
) -> Iterator[Driver]:
    """The driver of a study of so many flights beside the nominal one."""
    flights.reserve(1 + runs)
    with flights:
        driver = Driver(flights, Path(output), kind, how.get("resume", False), how.get("progress"))
        try:
            yield driver
        finally:
            driver.close()


def _read(kind: str, definition: Any, how: Mapping[str, Any]) -> tuple[dict[str, Any], Flights]:
    table = table_of(definition if isinstance(definition, Mapping) else Path(definition))
    entry = entries(kind, table)
    flights = Flights(definition, workers=how.get("workers"), said=how.get("said", lambda _: None))
    return entry, flights


# ---- sensitivity


def sensitivity(definition: Any, output: str | Path | None = None, **how: Any) -> Study:
    """What matters: by Morris or Sobol from the file of a campaign, into the dataset `output`; or,
    where definition is the dataset of a campaign that has flown, by HSIC without a further flight.

    how: workers, resume, progress, said as of campaign(). Raises UsageError, StructureError.
    """
    if not isinstance(definition, Mapping) and Path(definition).suffix == ".zarr":
        return Study(Path(definition), of_dataset(Path(definition)))
    entry, flights = _read("sensitivity", definition, how)
    of = {name: column(flights, name, slope=False) for name in asked(entry["of"], flights)}
    groups, seed, said = [*flights.groups.values()], flights.plan.seed, how.get("said", print)
    per = len(groups) + (1 if entry["method"] == "morris" else 2)
    count = max(1, int(entry["flights"]) // per)
    if entry["method"] == "sobol":
        count = 1 << (count - 1).bit_length()
        method: Any = effects.sobol(groups, flights.d, count, seed)
    else:
        if count < 2:
            raise UsageError(f"sensitivity.flights: at least {2 * per}, two paths of {per} flights")
        method = effects.morris(groups, flights.d, count, seed)
    if count * per != entry["flights"]:
        said(f"{entry['method']}: {count} x {per} = {count * per} flights")
    with _begun("sensitivity", flights, count * per, output or _missing(), how) as driver:
        _say_nominal(driver, of, said)
        (numbers, margins) = _at_once(driver, method)
        found = {}
        for name, k in of.items():
            again = (
                effects.sobol(groups, flights.d, count, seed)
                if entry["method"] == "sobol"
                else effects.morris(groups, flights.d, count, seed)
            )
            next(again)
            result = _told(again, margins[:, k])
            found[name] = _plain(result._asdict()) | {
                "signs": _signs(groups, numbers, margins[:, k])
            }
        factors = [*flights.groups]
        store = driver.finish({"of": found, "factors": factors, "method": entry["method"]})
    return Study(Path(output or ""), store)


def _missing() -> str:
    raise UsageError("-o OUT.zarr is missing")


def _at_once(driver: Driver, method: Any) -> tuple[Array, Array]:
    """Numbers and margins of a method that asks once."""
    numbers = next(method)
    return numbers, driver.ask(numbers)


def _told(method: Any, y: Array) -> Any:
    try:
        method.send(y)
    except StopIteration as end:
        return end.value
    raise AssertionError("asks once")


def _signs(groups: list[list[int]], numbers: Array, y: Array) -> list[float]:
    """Rank correlation of a margin with the number of each factor that it hangs on most."""
    from harness.studies.campaign.summary import rank_correlation

    signs = []
    for group in groups:
        each = np.nan_to_num([rank_correlation(numbers[:, k], y) for k in group])
        signs.append(float(each[np.argmax(np.abs(each))]))
    return signs


# ---- worst


def worst(definition: Any, output: str | Path, **how: Any) -> Study:
    """What is the worst: a search for the least margin of each requirement, one after the other.

    The worst flights and the nominal one fly once more with the system's own macro step and all
    rows, to OUT_worst/NAME.nc. how: as of sensitivity().
    """
    searches.needs_cma()
    entry, flights = _read("worst", definition, how)
    of = {name: column(flights, name, slope=True) for name in asked(entry["of"], flights)}
    each, generation = (
        int(entry["flights"]) // int(entry["searches"]),
        searches.generation(flights.d),
    )
    if each < generation:
        raise UsageError(f"worst.flights: at least {generation}, one generation, for each search")
    seeds = SEEDS if flights.plan.seeds else 0
    runs = len(of) * (each * int(entry["searches"]) + seeds)
    found: dict[str, Any] = {}
    with _begun("worst", flights, runs, output, how) as driver:
        _say_nominal(driver, of, how.get("said", print))
        for name, k in of.items():
            first = driver.flown
            seen = _Best(driver, k)
            results = [
                driver.answer(
                    searches.search(flights.d, flights.plan.seed + 1000 * s, each, entry["box"]),
                    k,
                )
                for s in range(int(entry["searches"]))
            ]
            found[name] = seen.summary(first) | {"nominal": driver.nominal[k]}
            found[name]["converged"] = [r.margin for r in results]
            if seeds:
                z = np.repeat(np.array([found[name]["numbers"]]), seeds, axis=0)
                found[name]["other seeds"] = driver.ask(z)[:, k]
        _confirm(driver, found, Path(output))
        store = driver.finish({"of": _plain(found), "box": entry["box"]})
    return Study(Path(output), store)


class _Best:
    """What was asked for one requirement, as it comes in."""

    def __init__(self, driver: Driver, column: int) -> None:
        self.rows: list[tuple[Array, Array]] = []
        self.column = column
        self.driver = driver
        driver.heard = self._hear

    def _hear(self, numbers: Array, margins: Array) -> None:
        self.rows.append((numbers, margins[:, self.column]))

    def summary(self, first: int) -> dict[str, Any]:
        self.driver.heard = lambda *_: None
        numbers = np.concatenate([z for z, _ in self.rows])
        y = np.nan_to_num(np.concatenate([y for _, y in self.rows]), nan=np.inf)
        place, failed = int(np.argmin(y)), np.flatnonzero(y < 0)
        return {
            "margin": y[place],
            "run": first + place,
            "first": int(failed[0]) + 1 if len(failed) else None,
            "flights": len(y),
            "place": place,
            "numbers": numbers[place],
            "distance": np.linalg.norm(numbers[place]),
        }


def _confirm(driver: Driver, found: dict[str, Any], output: Path) -> None:
    """The worst flights and the nominal one with the own macro step of the system, to files."""
    flights, folder = driver.flights, _folder(output)
    folder.mkdir(parents=True, exist_ok=True)
    warm = Warm(flights.plan.system)
    try:
        rows = {"nominal": (np.zeros(flights.d), 0)}
        rows |= {n: (np.array(each["numbers"]), each["run"]) for n, each in found.items()}
        for name, (z, run) in rows.items():
            changes: Any = {k: v for k, v in flights.changes(z, run).items() if k != "step"}
            result = _flown(warm, changes, flights.plan.patience)
            if result is None:
                continue
            save(result, folder / f"{_file(name)}.nc")
            if name in found:
                own = _margin(result, flights.found.requirements[name])
                found[name]["own step"] = own
                limit = CLOSE * abs(found[name]["margin"] - found[name]["nominal"])
                found[name]["differs"] = not abs(own - found[name]["margin"]) <= limit
    finally:
        warm.close()


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


def _flown(warm: Warm, changes: Any, patience: float) -> Any:
    """The result of a flight, what there is of one that died, None if it left nothing."""
    from harness.errors import RunError

    try:
        return warm.fly(changes, 1, patience)
    except RunError as error:
        return error.partial


def _margin(result: Any, text: str) -> float:
    from harness.results.requirements import margin

    return margin(result, text)


# ---- probability


def probability(definition: Any, output: str | Path, **how: Any) -> Study:
    """How probable is a failure of one requirement; how: as of sensitivity()."""
    entry, flights = _read("probability", definition, how)
    budget, d, seed = int(entry["flights"]), flights.d, flights.plan.seed
    name = next(asked(entry["of"], flights))
    method: Any
    k = column(flights, name, slope=entry["method"] != "random")
    if entry["method"] == "random":
        method = methods.random(d, seed, budget)
    elif entry["method"] == "subset":
        if methods.per_level(budget) < 50:
            raise UsageError("probability.flights: at least 1400, five repeats of 50 per level")
        method = methods.subset(d, seed, budget)
    elif entry["centres"]:
        centres = _centres(Path(entry["centres"]), name, d)
        method = methods.importance(d, seed, budget, centres)
    else:
        if methods.per_level(budget // 2) < 50:
            raise UsageError("probability.flights: at least 2800, half of them to find the centres")
        method = methods.centred(d, seed, budget)
    with _begun("probability", flights, budget, output, how) as driver:
        _say_nominal(driver, {name: k}, how.get("said", print))
        if driver.nominal[k] <= 0 and entry["method"] != "random":
            raise UsageError(
                f"{name}: the nominal flight fails, with a margin of {driver.nominal[k]:.4g}"
            )
        estimate = driver.answer(method, k)
        found = _plain(estimate._asdict()) | {"method": entry["method"]}
        if below := entry["below"]:
            met, missed = estimate.high < below, estimate.low > below
            word = "met" if met and not estimate.warning else "NOT MET" if missed else "undecided"
            found |= {"below": below, "verdict": word}
        store = driver.finish({"of": {name: found}})
    return Study(Path(output), store)


def _centres(path: Path, name: str, d: int) -> Array:
    """Means of the failures that the dataset of another study of the same factors has."""
    store = Store.open(path)
    names = [str(n) for n in store.array("requirement")]
    if "numbers" not in store.group or name not in names:
        raise UsageError(f"probability.centres: {path} is of no study of {name}")
    numbers, margins = store.array("numbers"), store.array("margin")[:, names.index(name)]
    failed = numbers[margins <= 0]
    if not len(failed) or numbers.shape[1] != d:
        raise UsageError(f"probability.centres: {path} has no failure of {name} in {d} numbers")
    return methods.regions(failed)


# ---- map


def boundary_map(definition: Any, output: str | Path, **how: Any) -> Study:
    """Where a requirement fails, over two factors of one number each; all others are nominal."""
    entry, flights = _read("map", definition, how)
    name = next(asked(entry["of"], flights))
    k, chosen = column(flights, name, slope=False), entry["factors"]
    small = [f for f, places in flights.groups.items() if len(places) == 1]
    chosen = chosen or small
    if len(chosen) != 2 or any(f not in small for f in chosen):
        raise UsageError(f"map.factors: expected two of one number each, of {', '.join(small)}")
    if entry["flights"] < COARSE**2:
        raise UsageError(f"map.flights: at least {COARSE**2}, a coarse grid")
    places = [flights.groups[f][0] for f in chosen]

    def whole(method: Generator[Array, Array, Any]) -> Generator[Array, Array, Any]:
        z = next(method)
        try:
            while True:
                numbers = np.zeros((len(z), flights.d))
                numbers[:, places] = z
                z = method.send((yield numbers))
        except StopIteration as end:
            return end.value

    with _begun("map", flights, int(entry["flights"]), output, how) as driver:
        driver.answer(whole(boundary(int(entry["flights"]))), k)
        store = driver.finish({"of": {name: {"factors": chosen}}})
    return Study(Path(output), store)


# ---- tune


def tune(definition: Any, output: str | Path, **how: Any) -> Study:
    """Gains with the best worst margin over draws and over the worst flights of an archive."""
    searches.needs_cma()
    table = dict(table_of(definition if isinstance(definition, Mapping) else Path(definition)))
    entry = entries("tune", table)
    if not entry["gains"]:
        raise UsageError("tune.gains: expected a draw per gain, as in [factors]")
    folder = Path.cwd() if isinstance(definition, Mapping) else Path(definition).parent
    factors = {**table.get("factors", {}), **entry["gains"]}
    flights = Flights(
        {**table, "factors": factors}, workers=how.get("workers"), folder=folder.resolve()
    )
    of = {n: column(flights, n, slope=True) for n in asked(entry["of"], flights)}
    gains = [p for n in entry["gains"] for p in flights.groups[n]]
    archive = Store.open(folder / entry["archive"]) if entry["archive"] else None
    method, runs = tuned(flights, gains, entry, archive, list(of))
    with _begun("tune", flights, runs, output, how) as driver:
        found = driver.answer(method, list(of.values()))
        chosen = flights.plan.of_numbers(_uniform(found.numbers))
        gained = {n: chosen[n] for n in entry["gains"]}
        numbers = _plain(found._asdict()) | {"gains": _plain(gained)}
        store = driver.finish({"of": {", ".join(of): numbers}})
    return Study(Path(output), store)


def _uniform(z: Array) -> Array:
    from scipy.special import ndtr

    return np.asarray(ndtr(z))


# ---- what they have in common


def _say_nominal(driver: Driver, of: Mapping[str, int], said: Said) -> None:
    for name, k in of.items():
        margin = driver.nominal[k]
        if np.isnan(margin):
            raise UsageError(f"{name}: the nominal flight does not exercise it")
        if margin < 0:
            said(f"{name}: the nominal flight fails already, with a margin of {margin:.4g}")


def _plain(value: Any) -> Any:
    """Plain data that JSON holds."""
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [_plain(v) for v in value]
    return value.item() if isinstance(value, np.generic) else value


PROGRESS = Callable[[Progress], None]
STUDIES: dict[str, Callable[..., Study]] = {
    "sensitivity": sensitivity,
    "worst": worst,
    "probability": probability,
    "map": boundary_map,
    "tune": tune,
}
"""Studies by the name of their table."""
