# SPDX-License-Identifier: BSD-2-Clause
"""What a study found, for reading."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from harness.studies.campaign.plan import Plan
from harness.studies.campaign.stopping import clopper_pearson
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import FAILED


class _Of(NamedTuple):
    """One requirement: what was found of it, with the whole estimate, the dataset, its name in the
    commands, and the unit of the margins.
    """

    name: str
    found: Any
    estimate: Any
    store: Store
    shown: str
    unit: str


SHOWN = 8
"""Factors that are shown, of those that matter."""
SMALL = 0.03
"""Share of all effects below which a factor does not matter."""


def text(kind: str, estimate: Mapping[str, Any], store: Store, shown: str) -> str:
    """The summary of a study; shown: name of the dataset in the commands."""
    status = store.array("status")
    lines = [f"{len(status)} flights, {int((status == FAILED).sum())} died"]
    units = dict(zip(store.array("requirement"), store.array("margin_units"), strict=True))
    for name, found in estimate["of"].items():
        unit = str(units.get(name, ""))
        lines += ["", *LINES[kind](_Of(name, found, estimate, store, shown, unit))]
    return "\n".join(lines)


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


def _effects(of: _Of) -> Iterator[str]:
    name, found, estimate, *_, unit = of
    value = np.array(found["value"])
    share = value / value.sum() if value.sum() > 0 else value
    words = {"morris": "share of the mean effects", "sobol": "total index"}
    yield f"{name}: {words.get(estimate['method'], 'dependence R2 (HSIC of ranks)')}"
    order = np.argsort(-value, kind="stable")
    p = found.get("p")
    small = []
    for k in order:
        factor = estimate["factors"][k]
        matters = p[k] < 0.05 if p else share[k] > SMALL
        if not matters or (k in order[SHOWN:]):
            small.append(factor)
            continue
        if p:
            yield f"  {factor:32} {value[k]:.3f}  p {p[k]:.3f}"
        elif estimate["method"] == "sobol":
            interval = f"({found['low'][k]:.2f} to {found['high'][k]:.2f})"
            yield f"  {factor:32} {value[k]:.2f} {interval}  first order {found['first'][k]:.2f}"
        else:
            sign = "+" if found["signs"][k] >= 0 else "-"
            yield f"  {factor:32} {share[k]:.2f}  {sign}{of_unit(value[k], unit)[1:]}"
    nothing = [estimate["factors"][k] for k in order if value[k] == 0]
    if small:
        yield f"  hardly: {', '.join(f for f in small if f not in nothing) or 'none'}"
    if nothing and not p:
        yield f"  exactly not: {', '.join(nothing)}"
    if found["died"]:
        yield f"  {found['died']} flights died and count as the least margin"


def _worst(of: _Of) -> Iterator[str]:
    name, found, _, store, shown, unit = of
    nominal, flights = of_unit(found["nominal"], unit), found["flights"]
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
    system = store.group.attrs["system"]
    yield f"  harness run {system} --like {shown}#{found['run']}"
    yield f"  moved most: {moved(store, found['numbers'])}"
    if found.get("differs"):
        yield f"  with the system's own macro step the margin is {of_unit(found['own step'], unit)}"
    if seeds := found.get("other seeds"):
        yield f"  with {len(seeds)} other seeds: {of_unit(min(seeds), unit)} at worst"


def moved(store: Store, numbers: Any, count: int = 5) -> str:
    """The factors that a row of numbers moves most, in standard deviations."""
    z = np.array(numbers)
    names: list[str] = []
    for factor, places in _groups(store).items():
        elements = [f"{factor}[{k + 1}]" for k in range(len(places))]
        names += elements if len(places) > 1 else [factor]
    order = np.argsort(-np.abs(z), kind="stable")[:count]
    return ", ".join(f"{names[k]} {z[k]:+.1f} sigma" for k in order)


def _groups(store: Store) -> dict[str, range]:
    from harness.studies.campaign.factors import factor

    table, folder = store.definition()
    made = tuple(factor(name, given) for name, given in table.get("factors", {}).items())
    return Plan(table, folder, made).groups


def _probability(of: _Of) -> Iterator[str]:
    name, found = of.name, of.found
    interval = f"95 %: {found['low']:.2g} to {found['high']:.2g}"
    by = f"by {found['method']}, {found['flights']} flights"
    yield f"{name}: p = {found['p']:.3g} ({interval}) {by}"
    if found["parts"]:
        yield "  repeats: " + ", ".join(f"{p:.2g}" for p in found["parts"])
    if found["warning"]:
        yield f"  {found['warning']}"
    if "below" in found:
        yield f"  below {found['below']:g}: {found['verdict']}"


def _map(of: _Of) -> Iterator[str]:
    name, found, store = of.name, of.found, of.store
    names = [str(n) for n in store.array("requirement")]
    margins = store.array("margin")[:, names.index(name)]
    failed = margins < 0
    yield f"{name}: {int(failed.sum())} of {len(margins)} flights fail"
    for factor in found["factors"]:
        values = store.array(factor)
        if failed.any():
            low, high = values[failed].min(), values[failed].max()
            yield f"  fails with {factor} from {low:.6g} to {high:.6g}"


def _tuned(of: _Of) -> Iterator[str]:
    name, found = of.name, of.found
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
