# SPDX-License-Identifier: BSD-2-Clause
"""Study: a completed analysis. Its dataset contains all runs, and also the estimate, which is the
result of the analysis.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from harness.studies.campaign.campaign import Campaign
from harness.studies.campaign.worker import FAILED


class Study(Campaign):
    """Completed study with its dataset, which contains the estimate: the result of the analysis."""

    @property
    def kind(self) -> str:
        """Return the kind of the study: sensitivity or worst."""
        return str(self.store.group.attrs["kind"])

    @property
    def estimate(self) -> dict[str, Any]:
        """Return the estimate as dictionaries, lists and numbers. `of`: by requirement, the
        effects of the factors (sensitivity) or the worst run with its repetitions (worst);
        `unjudged`: by requirement, the number of runs whose margin is NaN or +inf; further entries
        depend on the analysis.
        """
        return dict(json.loads(self.store.group.attrs["estimate"]))

    def summary(self) -> str:
        """Return the estimate as text, with the number of failed runs and, by requirement, the
        number of runs that are no evidence (`unjudged`).
        """
        status = self.store.array("status")
        lines = [f"{len(status)} runs, {int((status == FAILED).sum())} failed"]
        for name, found in self.estimate["of"].items():
            lines += ["", *(_worst if self.kind == "worst" else _effects)(name, found, self)]
        for name, count in self.estimate["unjudged"].items():
            if count:
                lines += ["", f"{name}: {count} of {len(status)} runs {UNJUDGED}"]
        return "\n".join(lines)

    def unit(self, name: str) -> str:
        """Return the unit of the margins of a requirement."""
        names = self.store.array("requirement").tolist()
        return str(self.store.array("margin_units")[names.index(name)])

    @property
    def verdict(self) -> bool:
        """Return whether the exit status of the study is 0: always for `sensitivity`; for `worst`,
        if the search has found neither a failure nor a run with a margin of NaN or +inf.
        """
        if self.kind != "worst":
            return True
        found, unjudged = self.estimate["of"], self.estimate["unjudged"]
        return all(not unjudged[name] and _no_failure(each) for name, each in found.items())


# ---- estimates as text

SHOWN = 8
"""Largest number of factors that the text of a sensitivity lists with their effects."""
SMALL = 0.03
"""Share of the sum of the effects of all factors, up to which the effect of one factor counts as
small.
"""
UNJUDGED = "are no evidence: not exercised, not judged or with an infinite margin"
"""End of the line `REQUIREMENT: N of M runs ...` about runs with a margin of NaN or +inf."""


def of_unit(value: float | None, unit: str) -> str:
    """Return a margin with its unit as text; small lengths in mm, angles in degrees."""
    if value is None or np.isnan(value):
        return "no margin"
    if np.isneginf(value):
        return "-inf (the run failed, or a value is not a number)"
    value = round(float(value), 300)  # -5e-324 (failed exactly at the limit) becomes -0
    if unit == "m" and abs(value) < 1:
        return f"{1e3 * value:+.4g} mm"
    if unit == "rad":
        return f"{np.degrees(value):+.4g} deg"
    return f"{value:+.4g} {'' if unit == '1' else unit}".rstrip()


def _effects(name: str, found: Any, study: Study) -> Iterator[str]:
    """Yield the lines of text about the effects of the factors on the margin of the requirement
    `name`; found: the estimate for this requirement.
    """
    factors, method, unit = study.estimate["factors"], study.estimate["method"], study.unit(name)
    yield f"{name}: {'total index' if method == 'sobol' else 'share of the mean effects'}"
    value, failed = np.array(found["value"]), found["failed"]
    share = value / value.sum() if value.sum() > 0 else value
    order = np.argsort(-value, kind="stable")
    shown = [k for k in order[:SHOWN] if share[k] > SMALL]
    for k in shown:
        yield f"  {factors[k]:32} {_effect(found, method, k, share[k], unit)}"
    if len(shown) < len(order):
        hardly = [factors[k] for k in order if k not in shown and (value[k] or failed)]
        yield f"  smaller effect: {', '.join(hardly) or 'none'}"
    nothing = [factors[k] for k in order if value[k] == 0]
    if nothing and not failed:
        yield f"  without any effect: {', '.join(nothing)}"
    if failed:
        yield f"  {failed} runs have no finite margin and count with the smallest finite margin"


def _effect(found: Any, method: str, k: int, share: float, unit: str) -> str:
    """Return the effect of factor k as text. Morris: its share of the sum of all effects, and the
    effect with its sign. Sobol: total index with interval, and first-order index.

    found: the estimate for a requirement.
    """
    value = found["value"][k]
    if method == "sobol":
        interval = f"({found['low'][k]:.2f} to {found['high'][k]:.2f})"
        return f"{value:.2f} {interval}  first order {found['first'][k]:.2f}"
    sign = "+" if found["signs"][k] >= 0 else "-"
    return f"{share:.2f}  {sign}{of_unit(value, unit)[1:]}"


def _worst(name: str, found: Any, study: Study) -> Iterator[str]:
    """Yield the lines of text about the worst run of the requirement `name` and its repetitions;
    found: the estimate for this requirement.
    """
    unit, runs = study.unit(name), found["runs"]
    nominal = of_unit(found["nominal"], unit)
    if found["margin"] < 0:
        yield (
            f"{name}: NOT MET, worst margin {of_unit(found['margin'], unit)} in {runs} runs "
            f"(first failure after {found['first']} runs); nominal {nominal}; "
            f"distance from nominal |z| = {found['distance']:.1f}"
        )
    else:
        p = 1 - 0.05 ** (1 / runs)
        by_chance = (
            f"; {runs} random runs without a failure would prove a failure probability below "
            f"{100 * p:.2g} % at 95 % confidence"
        )
        yield (
            f"{name}: no failure in {runs} runs, worst margin "
            f"{of_unit(found['margin'], unit)}, nominal {nominal}: "
            "a search cannot prove that no run fails"
            f"{'' if study.estimate['unjudged'][name] else by_chance}"
        )
    system = study.store.group.attrs["system"]
    yield f"  harness run {system} --like {study.path}#{found['run']}"
    yield f"  moved most: {found['moved']}"
    if found["differs"]:
        own = found["own step"]
        own_step = "with the system's own macro step the margin is"
        yield f"  {_not_met(own)}{own_step} {of_unit(own, unit)}"
    if seeds := found.get("other seeds"):
        least = float(np.min(seeds))
        yield f"  {_not_met(least)}with {len(seeds)} other seeds: margin >= {of_unit(least, unit)}"


def _not_met(margin: float) -> str:
    return "" if margin >= 0 else "NOT MET "


def _no_failure(found: Any) -> bool:
    """Return whether the requirement is met in the worst run, in its repetition with the macro step
    of the system, and in its repetitions with other seeds; found: the estimate for this
    requirement.
    """
    margins = [found["margin"], found["own step"], *found.get("other seeds", ())]
    return all(margin >= 0 for margin in margins)
