# SPDX-License-Identifier: BSD-2-Clause
"""Figures that user pages quote from runs: <!--=NAME-->TEXT<!---->, with NAME one of FIGURES or a
table of claims, which the page of the mission has, too.

`make figures` runs what they come from and writes the texts into the pages; `make site` runs it too
and fails where a page says otherwise or quotes what no run gives.
"""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import results
from text import ROOT, table

QUOTE = re.compile(r"(<!--=(\w+)-->)(.*?)(<!---->)", re.DOTALL)
TARGETS = ROOT / "docs/targets.md"
"""Written by `make targets`."""


def pages() -> list[Path]:
    """Files that may quote figures."""
    return sorted([*(ROOT / "docs").rglob("*.md"), *(ROOT / "ssp").glob("*/*.md")])


def facts() -> dict[str, str]:
    """Every figure, from its run."""
    return {name: measure() for name, measure in FIGURES.items()}


def plain(text: str, figures: Mapping[str, str], source: str) -> str:
    """A page without the marks of its quotations; ValueError for one that no run gives."""

    def checked(found: re.Match[str]) -> str:
        _, name, quoted, _ = found.groups()
        if name not in figures:
            raise ValueError(f"{source}: no run gives {name!r}; there are {', '.join(figures)}")
        if quoted != figures[name]:
            raise ValueError(
                f"{source}: {name} is {figures[name]!r}, the page has {quoted!r}: make figures"
            )
        return quoted

    return QUOTE.sub(checked, text)


def fill(figures: Mapping[str, str]) -> None:
    """Write the figures into the pages that quote them; a mark that no run knows stays."""
    for page in pages():
        old = page.read_text(encoding="utf-8")
        new = QUOTE.sub(lambda m: f"{m[1]}{figures.get(m[2], m[3])}{m[4]}", old)
        if new != old:
            page.write_text(new, encoding="utf-8")


# ---- runs


def closest_approach() -> str:
    """By how much the approach of the tutorial passes its safe distance of 4 m."""
    from harness import run

    least = run("sync_approach", params="robust")["guidance.range"].min()
    return f"{1e3 * (4 - least):.0f} mm"


def new_controller() -> str:
    """Largest position error of a new controller as it is, from the fifth minute on."""
    import numpy as np

    from harness import run

    with TemporaryDirectory() as folder:
        for words in (("new", "controller", "my_pd"), ("build", "my_pd")):
            _printed("-m", "harness", *words, cwd=folder)
        result = run("sync_approach", swap={"controller": f"{folder}/my_pd/my_pd.fmu"})
    # a row holds what the software commanded one macro step before the states beside it
    position = result["servicer.r_SN_N"] - result["target.r_TN_N"]
    error = np.linalg.norm(position[:-1] - result["guidance.rho_ref_N"][1:], axis=1)
    return f"{1e3 * error[3000:].max():.1f} mm"


def energy_per_step() -> str:
    """The table of examples/stiff_contact.py."""
    with TemporaryDirectory() as folder:
        lines = _printed(str(ROOT / "examples/stiff_contact.py"), cwd=folder).splitlines()
    titles, *rows = (re.split(r" {2,}", line.strip()) for line in lines)
    return f"\n\n{table(titles, rows)}\n"


def restitution() -> str:
    """Error of the restitution of a head-on blow at 0.03 m/s, by macro step."""
    fly = results.of_the_tests("docking_case").fly
    errors = []
    for step in (0.04, 0.02, 0.01, 0.005):
        blow = fly(step=step, speed=0.03, **{"mechanism.latch_enable": 0})
        after = (blow["servicer.v_SN_N"] - blow["target.v_TN_N"])[-1, 0]
        error = f"{abs(after / 0.03 - 0.546854):.1e}".replace("e-0", "e-")
        errors.append(f"{error} at {step:g} s")
    return ", ".join(errors)


def _printed(*arguments: str, cwd: str) -> str:
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=cwd, check=True, capture_output=True, text=True).stdout


# ---- the page of the flight processors


def rows() -> Iterator[dict[str, str]]:
    """Rows of the table in docs/targets.md, by title."""
    lines = TARGETS.read_text(encoding="utf-8").splitlines()
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in lines if line[:1] == "|"]
    titles, _, *found = cells
    for row in found:
        yield dict(zip(titles, row, strict=True))


def row(fmu: str, processor: str) -> dict[str, str]:
    """The row of an FMU on a processor."""
    return next(r for r in rows() if (r["FMU"], r["processor"]) == (fmu, processor))


def note() -> str:
    """What a run with the controller on a processor prints at the end."""
    r = {k: v.replace("\u202f", "").replace(" ", "") for k, v in row(*NOTED).items()}
    recorded = re.search(r"\d+", r["equal bits"])
    assert recorded is not None
    steps = int(recorded[0]) - 1
    return (
        f"\n\n    harness: note: controller: on {NOTED[1]}: {steps} steps, {r['instructions']} "
        f"instructions each, at most {r['at most']} at\n    t = {r['at t [s]']} s, "
        f"{r['stack']} bytes of stack\n\n"
    )


NOTED = ("adaptive_controller", "cortex-m7")


def compared() -> str:
    """How many flight FMUs have been compared, on how many processors."""
    found = list(rows())
    assert all(r["equal bits"].startswith("yes") for r in found)
    fmus, processors = ({r[key] for r in found} for key in ("FMU", "processor"))
    assert len(found) == len(fmus) * len(processors)
    return f"{len(fmus)} flight FMUs on {len(processors)} processors"


def overloads() -> str:
    """FMUs whose steps do not fit into their period, as a list."""
    lines = []
    for r in rows():
        if (share := float(r["share [%]"])) > 100:
            mean, most = (float(r[key].replace(" ", "")) for key in ("instructions", "at most"))
            where = f"`{r['FMU']}` on `{r['processor']}` of {r['clock [MHz]']} MHz"
            lines.append(
                f"* {where}: at most {share:g} % of the period (at {r['at t [s]']} s), "
                f"{share * mean / most:.0f} % on average\n"
            )
    return "\n\n" + "".join(lines) + "\n"


FIGURES: dict[str, Callable[[], str]] = {
    "closest_approach": closest_approach,
    "new_controller": new_controller,
    "energy_per_step": energy_per_step,
    "restitution": restitution,
    "note": note,
    "compared": compared,
    "overloads": overloads,
}
for _mission in results.MISSIONS:
    FIGURES |= importlib.import_module(f"results.{_mission}").FIGURES
