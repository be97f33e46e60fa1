# SPDX-License-Identifier: BSD-2-Clause
"""What the numbers of a campaign are: the CF attributes `units` and `long_name` of its dataset."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from harness.results.requirements import margin_unit
from harness.results.result import Result
from harness.studies.campaign import metrics
from harness.studies.campaign.plan import Plan
from harness.studies.campaign.worker import VERDICTS

Labels = Mapping[str, Any]

STATUS: Labels = {
    "long_name": "what became of the run",
    "flag_values": [0, 1, 2],
    "flag_meanings": "pending complete failed",
}
VERDICT: Labels = {
    "long_name": "what became of a requirement",
    "flag_values": [*range(len(VERDICTS))],
    "flag_meanings": " ".join(v.name.lower() for v in VERDICTS),
}
MARGIN: Labels = {"long_name": "distance of a requirement to failing, negative where it fails"}
NUMBERS: Labels = {"units": "1", "long_name": "independent normal numbers that were asked for"}
GENERATION: Labels = {"long_name": "generation of flights that were asked for together"}
TIME: Labels = {"units": "s", "long_name": "time"}
END: Labels = {"units": "s", "long_name": "time of the last row"}
EXPERIMENT = {
    "step": {"units": "s", "long_name": "macro step"},
    "stop": {"units": "s", "long_name": "stop time"},
}


def of_factor(name: str, kinds: Result) -> Labels:
    """Those of a parameter or start value; kinds: what names, units and texts are taken from."""
    if name in EXPERIMENT:
        return EXPERIMENT[name]
    if kinds.parameters is not None and name in kinds.parameters:
        return of_variable(name, kinds.parameters)
    return of_variable(name, kinds)


def of_variable(name: str, kinds: Result) -> Labels:
    """Those of a variable of a result, none if it has no such variable."""
    if name not in kinds:
        return {}
    return _known({"units": kinds.unit(name), "long_name": kinds.description(name)})


def of_metric(name: str, plan: Plan, kinds: Result) -> Labels:
    """The unit that follows from its text, and the text itself."""
    if name == "success":
        return {"units": "1", "long_name": plan.success or "all requirements are met"}
    text = str(plan.definition["metrics"][name])
    return _known({"units": metrics.unit(text, kinds), "long_name": text})


def of_margin(text: str, kinds: Result) -> str:
    """Unit of the margin of a requirement, "" if it is not known."""

    def unit(name: str) -> str:
        table = kinds.parameters if name.startswith("parameter ") else kinds
        plain = name.removeprefix("parameter ")
        return table.unit(plain) if table is not None and plain in table else ""

    return margin_unit(text, unit)


def _known(labels: Mapping[str, str]) -> Labels:
    return {name: text for name, text in labels.items() if text}
