# SPDX-License-Identifier: BSD-2-Clause
"""What the studies have in common: their tables, `[worst]` in the file of a campaign, with all that
is wrong with them, how they begin, what they leave, and how it reads.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from harness.errors import StructureError, UsageError
from harness.studies.campaign.campaign import Campaign
from harness.studies.campaign.draft import table_of
from harness.studies.campaign.stopping import clopper_pearson
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import FAILED
from harness.studies.inquiry.driver import Driver
from harness.studies.inquiry.flights import Flights
from harness.system.schema import Count, Positive, Text, problems

Array = NDArray[np.float64]
T = TypeVar("T")

Names = Annotated[str | list[str], Meta(description="a name or a list of names")]
Method = Annotated[Literal["morris", "sobol"], Meta(description="morris or sobol")]
Estimator = Annotated[
    Literal["subset", "random", "importance"], Meta(description="subset, random or importance")
]
Share = Annotated[float, Meta(gt=0, lt=1, description="a probability, above 0 and below 1")]


class Sensitivity(msgspec.Struct):
    """Entries of [sensitivity]; of: requirements, in all studies."""

    of: Names = ""
    method: Method = "morris"
    flights: Count = 130


class Worst(msgspec.Struct):
    """Entries of [worst]."""

    of: Names = ""
    flights: Count = 200
    box: Positive = 3.0
    searches: Count = 1


class Probability(msgspec.Struct):
    """Entries of [probability]; below: what is required, 0: nothing."""

    of: Text = ""
    method: Estimator = "subset"
    flights: Count = 20_000
    below: Share = 0.0
    centres: Text = ""


class Map(msgspec.Struct):
    """Entries of [map]."""

    of: Text = ""
    factors: list[str] = []
    flights: Count = 100


class Tune(msgspec.Struct):
    """Entries of [tune]."""

    of: Names = ""
    gains: dict[str, Any] = {}
    draws: Count = 24
    archive: Text = ""
    flights: Count = 2400
    box: Positive = 3.0


TABLES = {each.__name__.lower(): each for each in (Sensitivity, Worst, Probability, Map, Tune)}
"""Tables of studies by their names in the file of a campaign."""


class Study(Campaign):
    """A study that is over. estimate: what was found, by requirement, as plain data."""

    @property
    def kind(self) -> str:
        """Sensitivity, worst, probability, map, tune or given."""
        return str(self.store.group.attrs["kind"])

    @property
    def estimate(self) -> dict[str, Any]:
        """What was found, as plain data."""
        found: dict[str, Any] = json.loads(self.store.group.attrs["estimate"])
        return found

    def summary(self) -> str:
        """What was found, for reading."""
        status = self.store.array("status")
        lines = [f"{len(status)} flights, {int((status == FAILED).sum())} died"]
        for name, found in self.estimate["of"].items():
            lines += ["", *LINES[self.kind](name, found, self)]
        return "\n".join(lines)

    def unit(self, name: str) -> str:
        """Unit of the margins of a requirement."""
        names = self.store.array("requirement").tolist()
        return str(self.store.array("margin_units")[names.index(name)])

    @property
    def verdict(self) -> bool:
        """Whether nothing was found that gives the exit status 1."""
        found = self.estimate["of"].values()
        if self.kind == "worst":
            return all(each["margin"] >= 0 for each in found)
        return all(each.get("verdict", "met") == "met" for each in found)


def entries(kind: type[T], table: Mapping[str, Any]) -> T:
    """The table of a study; StructureError with all that is wrong with it."""
    name = kind.__name__.lower()
    if wrong := list(problems(table.get(name, {}), kind, name)):
        raise StructureError(wrong)
    return msgspec.convert(table.get(name, {}), kind)


@contextmanager
def begun(
    kind: str, flights: Flights, runs: int, output: str | Path, how: Mapping[str, Any]
) -> Iterator[Driver]:
    """The driver of a study of so many flights beside the nominal one."""
    flights.reserve(1 + runs)
    again, show = how.get("resume", False), how.get("progress")
    with flights, closing(Driver(flights, Path(output), kind, again, show)) as driver:
        yield driver


def prepared(kind: type[T], definition: Any, how: Mapping[str, Any]) -> tuple[T, Flights]:
    """The entries of a study with its flights."""
    entry = entries(kind, table_of(definition))
    return entry, Flights(definition, workers=how.get("workers"), said=how.get("said", print))


def earlier(entry: str, path: Path, of: Iterable[str], d: int) -> tuple[Array, Array]:
    """Numbers (runs, d) of another study of the same factors, and its margins of requirements."""
    store = Store.open(path)
    names = [str(n) for n in store.array("requirement")]
    chosen = [names.index(n) for n in of if n in names]
    if "numbers" not in store.group or store.group["numbers"].shape[1] != d or not chosen:
        raise UsageError(f"{entry}: {path} is no study of {', '.join(of)} with the same factors")
    return store.array("numbers"), store.array("margin")[:, chosen]


def say_nominal(driver: Driver, of: Mapping[str, int]) -> None:
    """Say which requirements the nominal flight fails; UsageError if it does not exercise one."""
    for name, k in of.items():
        margin = driver.nominal[k]
        if np.isnan(margin):
            raise UsageError(f"{name}: the nominal flight does not exercise it")
        if margin < 0:
            driver.flights.said(f"{name}: the nominal flight fails, with a margin of {margin:.4g}")


# ---- what was found, for reading

SHOWN = 8
"""Factors that are shown, of those that matter."""
SMALL = 0.03
"""Share of all effects below which a factor does not matter."""


def of_unit(value: float | None, unit: str) -> str:
    """A margin as one reads it."""
    if value is None or np.isnan(value):
        return "no margin"
    if np.isneginf(value):
        return "died"
    if unit == "m" and abs(value) < 1:
        return f"{1e3 * value:+.4g} mm"
    if unit == "rad":
        return f"{np.degrees(value):+.4g} deg"
    return f"{value:+.4g} {'' if unit == '1' else unit}".rstrip()


def _effects(name: str, found: Any, study: Study) -> Iterator[str]:
    factors, method, unit = study.estimate["factors"], study.estimate["method"], study.unit(name)
    words = {"morris": "share of the mean effects", "sobol": "total index"}
    yield f"{name}: {words.get(method, 'dependence R2 (HSIC of ranks)')}"
    value, p = np.array(found["value"]), found.get("p")
    share = value / value.sum() if value.sum() > 0 else value
    matters = np.array(p) < 0.05 if p else share > SMALL
    order = np.argsort(-value, kind="stable")
    shown = [k for k in order[:SHOWN] if matters[k]]
    for k in shown:
        yield f"  {factors[k]:32} {_effect(found, method, k, share[k], unit)}"
    if len(shown) < len(order):
        hardly = [factors[k] for k in order if k not in shown and value[k] != 0]
        yield f"  hardly: {', '.join(hardly) or 'none'}"
    nothing = [factors[k] for k in order if value[k] == 0]
    if nothing and not p:
        yield f"  exactly not: {', '.join(nothing)}"
    if found["died"]:
        yield f"  {found['died']} flights died and count as the least margin"


def _effect(found: Any, method: str, k: int, share: float, unit: str) -> str:
    """What factor k does, in the numbers of the method."""
    value = found["value"][k]
    if found.get("p"):
        return f"{value:.3f}  p {found['p'][k]:.3f}"
    if method == "sobol":
        interval = f"({found['low'][k]:.2f} to {found['high'][k]:.2f})"
        return f"{value:.2f} {interval}  first order {found['first'][k]:.2f}"
    sign = "+" if found["signs"][k] >= 0 else "-"
    return f"{share:.2f}  {sign}{of_unit(value, unit)[1:]}"


def _worst(name: str, found: Any, study: Study) -> Iterator[str]:
    unit, flights = study.unit(name), found["flights"]
    nominal = of_unit(found["nominal"], unit)
    if found["margin"] < 0:
        yield (
            f"{name}: NOT MET, worst margin {of_unit(found['margin'], unit)} in {flights} flights "
            f"(first failure at flight {found['first']}); nominal {nominal}; "
            f"|z| = {found['distance']:.1f}"
        )
    else:
        _, p = clopper_pearson(0, flights, 0.9)
        yield (
            f"{name}: no failure in {flights} flights, worst margin "
            f"{of_unit(found['margin'], unit)}, nominal {nominal}: this is no proof; "
            f"0 of {flights} random ones would say p < {100 * p:.2g} % at 95 %"
        )
    system = study.store.group.attrs["system"]
    yield f"  harness run {system} --like {study.path}#{found['run']}"
    if "moved" in found:  # not by earlier versions
        yield f"  moved most: {found['moved']}"
    if found.get("differs"):
        yield f"  with the system's own macro step the margin is {of_unit(found['own step'], unit)}"
    if seeds := found.get("other seeds"):
        yield f"  with {len(seeds)} other seeds: {of_unit(min(seeds), unit)} at worst"


def _probability(name: str, found: Any, _: Study) -> Iterator[str]:
    interval = f"95 %: {found['low']:.2g} to {found['high']:.2g}"
    by = f"by {found['method']}, {found['flights']} flights"
    yield f"{name}: p = {found['p']:.3g} ({interval}) {by}"
    if found["parts"]:
        yield "  repeats: " + ", ".join(f"{p:.2g}" for p in found["parts"])
    if found["warning"]:
        yield f"  {found['warning']}"
    if "below" in found:
        yield f"  below {found['below']:g}: {found['verdict']}"


def _map(name: str, found: Any, study: Study) -> Iterator[str]:
    store = study.store
    margins = store.array("margin")[:, store.array("requirement").tolist().index(name)]
    failed = margins < 0
    yield f"{name}: {int(failed.sum())} of {len(margins)} flights fail"
    for factor in found["factors"]:
        values = store.array(factor)
        if failed.any():
            low, high = values[failed].min(), values[failed].max()
            yield f"  fails with {factor} from {low:.6g} to {high:.6g}"


def _tuned(name: str, found: Any, _: Study) -> Iterator[str]:
    for k, each in enumerate(name.split(", ")):
        yield (
            f"{each}: worst margin {found['start'][k]:+.4g} before, {found['best'][k]:+.4g} after; "
            f"in draws not seen {found['start_unseen'][k]:+.4g} before, "
            f"{found['best_unseen'][k]:+.4g} after"
        )
    yield "  " + " ".join(f"--set '{n}={v}'" for n, v in found["gains"].items())


LINES = {
    "sensitivity": _effects,
    "given": _effects,
    "worst": _worst,
    "probability": _probability,
    "map": _map,
    "tune": _tuned,
}
