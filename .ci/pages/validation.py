# SPDX-License-Identifier: BSD-2-Clause
"""Pages of the validation cases, one page per family of sources of published values (TITLES), with
plots of the differences between the FMUs and these values.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from models import case_fmus
from text import table

from ssp.validation.case import FOLDER, Case, cases
from ssp.validation.library import Library
from ssp.validation.simulations import difference, expected, simulate

TITLES = {
    "jeod": "NASA JEOD",
    "basilisk": "Basilisk",
    "nyx": "GMAT and nyx",
    "textbooks": "Textbooks and other tools",
    "spre": "ARCH-COMP rendezvous",
    "detest": "DETEST",
    "farrenkopf": "Farrenkopf",
}


def facts() -> list[dict[str, Any]]:
    """Run every validation case; return the description of each case that measured() returns."""
    families = {
        case.id: path.stem for path in sorted(FOLDER.glob("*.json")) for case in _of(path.stem)
    }
    with Library() as library:
        return [measured(case, families[case.id], library) for case in cases()]


def _of(family: str) -> list[Case]:
    import json

    text = (FOLDER / f"{family}.json").read_text(encoding="utf-8")
    return [Case.read(entry) for entry in json.loads(text)["cases"]]


def measured(case: Case, family: str, library: Library) -> dict[str, Any]:
    """Run one case; return its description, and by quantity the differences between simulated and
    published values with their times [s].
    """
    answer = simulate(case, library)
    quantities: dict[str, Any] = {
        name: {"time": [], "difference": [], "tolerance": limit, "unit": case.units[name]}
        for name, limit in case.tolerance.items()
    }
    for row, ours in zip(case.rows, answer, strict=True):
        for name in expected(row):
            quantities[name]["time"].append(row["t"])
            quantities[name]["difference"].append(float(difference(name, ours[name], row[name])))
    return {
        "name": case.id, "family": family, "tests": case.tests, "source": dict(case.source),
        "why": case.why, "wrong": [w["what"] for w in case.wrong], "fmus": case_fmus(case),
        "quantities": quantities,
    }  # fmt: skip


def pages(facts: Mapping[str, Any]) -> Iterator[tuple[str, str | bytes]]:
    """Yield a page per family and a plot per case."""
    found = facts.get("validation", [])
    for family in sorted(path.stem for path in FOLDER.glob("*.json")):
        mine = [case for case in found if case["family"] == family]
        yield f"validation/{family}.md", "\n".join([_head(family), *map(_section, mine)])
        for case in mine:
            yield f"validation/{case['name']}.svg", plot(case)


def _head(family: str) -> str:
    return (
        f"# {TITLES.get(family, family)}\n\nDifference between the FMUs and published numbers."
        " Dashed: the tolerance. Differences of vectors are Euclidean norms; differences of"
        " the attitude matrix `C` are rotation angles. If a limit is published, the difference"
        " is the amount by which it is violated. Each case also names wrong models; a test"
        " shows that every one of them exceeds the tolerance.\n"
    )


def _section(case: Mapping[str, Any]) -> str:
    rows = [
        (
            f"`{name}`",
            f"{max(q['difference']):.2g} {q['unit']}",
            f"{q['tolerance']:.2g} {q['unit']}",
        )
        for name, q in case["quantities"].items()
    ]
    source = case["source"]
    return "\n".join(
        [
            f"## {case['name']} {{ #{case['name']} }}\n",
            f"{case['tests'][:1].upper()}{case['tests'][1:]}.\n",
            f"![Difference over time of {case['name']}]({case['name']}.svg)\n",
            table(("Quantity", "Largest difference", "Tolerance"), rows),
            f"* Computed by: {source['name']} ({source['licence']}). Where: {source['where']}.",
            f"* Reason for the tolerance: {case['why']}.",
            f"* Wrong models that exceed it: {'; '.join(case['wrong'])}.",
            f"* Repeat it: `harness validate {case['name']}`\n",
        ]
    )


def plot(case: Mapping[str, Any]) -> bytes:
    """Return a plot as .svg, a panel per quantity: difference over time, the tolerance dashed."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    quantities = case["quantities"]
    mpl.rcParams["svg.hashsalt"] = "servicing-fmus"
    figure = Figure(figsize=(7, 0.6 + 1.3 * len(quantities)), layout="constrained")
    for axes, (name, q) in zip(
        np.ravel(figure.subplots(len(quantities), sharex=True)), quantities.items(), strict=True
    ):
        floor = q["tolerance"] * 1e-9
        shown = np.maximum(q["difference"], floor)
        axes.set_yscale("log")
        axes.set_ylim(shown.min() / 3, 3 * max(shown.max(), q["tolerance"]))
        axes.plot(q["time"], shown, marker=".", linewidth=1, color="#204a87")
        axes.axhline(q["tolerance"], linestyle="--", color="#a40000")
        axes.set_ylabel(f"{name} [{q['unit']}]")
        axes.grid(True, alpha=0.3)
    axes.set_xlabel("t [s]")
    file = io.BytesIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()
