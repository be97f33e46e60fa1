# SPDX-License-Identifier: BSD-2-Clause
"""Values that pages quote from runs. A page contains them as <!--=NAME-->TEXT<!---->, where NAME is
a key of VALUES, or `claims_MISSION` for the table of the claims of a mission, which the page of the
mission in the site also shows.

`make quoted-values` does these runs and writes the texts into the pages. `make site` does the runs,
too, and fails if a page of the site (no page of lab/ is) quotes another text or a name that no run
gives.
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
from text import ROOT, counted, table

QUOTE = re.compile(r"(<!--=(\w+)-->)(.*?)(<!---->)", re.DOTALL)
PROCESSOR_VALUES = ROOT / "docs/processor_figures.md"
"""Page that `make processors` writes."""


def pages() -> list[Path]:
    """Return the files that may quote values."""
    places = (("docs", "**/*.md"), ("lab", "*.md"), ("ssp", "*/*.md"))
    return sorted(p for folder, names in places for p in (ROOT / folder).glob(names))


def facts() -> dict[str, str]:
    """Return the text of every quoted value by name, from its run."""
    return {name: VALUES[name]() for name in counted("quoted value", VALUES)}


def plain(text: str, values: Mapping[str, str], source: str) -> str:
    """Return the page `text` without the comments around its quotations; raise ValueError if a
    quotation has a name that is not in `values`, or another text than the value of its name.

    values: text of each quoted value by name; source: page, for the error message.
    """

    def checked(found: re.Match[str]) -> str:
        _, name, quoted, _ = found.groups()
        if name not in values:
            raise ValueError(f"{source}: no run gives {name!r}; there are {', '.join(values)}")
        if quoted != values[name]:
            raise ValueError(
                f"{source}: {name} is {values[name]!r}, the page has {quoted!r}: "
                "run make quoted-values"
            )
        return quoted

    return QUOTE.sub(checked, text)


def fill(values: Mapping[str, str]) -> None:
    """Write the values into the pages that quote them; a quotation whose name is not in `values`
    remains unchanged.
    """
    for page in pages():
        old = page.read_text(encoding="utf-8")
        new = QUOTE.sub(lambda m: f"{m[1]}{values.get(m[2], m[3])}{m[4]}", old)
        if new != old:
            page.write_text(new, encoding="utf-8")


# ---- runs


def closest_approach() -> str:
    """Return, as text, the length by which the default run of sync_approach, the case of its
    paper, comes closer than the safe distance of 4 m [mm].
    """
    from harness import run

    least = run("sync_approach")["guidance.range"].min()
    return f"{1e3 * (4 - least):.0f} mm"


def mass_effect() -> str:
    """Run the campaign of the tutorial and return the effect of the mass on the cost, as text."""
    toml = re.search(r"^```toml\n(.*?)^```", (ROOT / "docs/tutorial.md").read_text(), re.M | re.S)
    with TemporaryDirectory() as folder:
        (Path(folder) / "mass.toml").write_text(toml[1] if toml else "")
        words = ("campaign", "mass.toml", "-o", "mass.zarr", "--workers", "0")
        text = _printed("-m", "harness", *words, cwd=folder)
    return re.search(r"cost: servicer.mass_0 \+1.00 \((.*?)\)", text)[1]  # type: ignore[index]


def new_controller() -> str:
    """Return, as text, the largest position error after five minutes in sync_approach with the
    controller that `harness new controller` writes.
    """
    import numpy as np

    from harness import run

    with TemporaryDirectory() as folder:
        for words in (("new", "controller", "my_pd"), ("build", "my_pd")):
            _printed("-m", "harness", *words, cwd=folder)
        result = run("sync_approach", swap={"controller": f"{folder}/my_pd/my_pd.fmu"})
    # the reference in a row was computed from the states of the row before
    position = result["servicer.r_SN_N"] - result["target.r_TN_N"]
    error = np.linalg.norm(position[:-1] - result["guidance.rho_ref_N"][1:], axis=1)
    return f"{1e3 * error[3000:].max():.1f} mm"


def energy_per_step() -> str:
    """Return the table that examples/stiff_contact.py prints, as Markdown."""
    with TemporaryDirectory() as folder:
        lines = _printed(str(ROOT / "examples/stiff_contact.py"), cwd=folder).splitlines()
    titles, *rows = (re.split(r" {2,}", line.strip()) for line in lines)
    return f"\n\n{table(titles, rows)}\n"


def restitution() -> str:
    """Return, as text, the errors of the coefficient of restitution in a head-on contact at
    0.03 m/s, each with the macro step of its run.
    """
    case = results.of_the_tests("docking_case")
    errors = []
    for step in (0.04, 0.02, 0.01, 0.005):
        blow = case.simulate(step=step, speed=0.03, **{"mechanism.latch_enable": 0})
        after = (blow["servicer.v_SN_N"] - blow["target.v_TN_N"])[-1, 0]
        error = f"{abs(after / 0.03 - 0.546854):.1e}".replace("e-0", "e-")
        errors.append(f"{error} at {step:g} s")
    return ", ".join(errors)


def _printed(*arguments: str, cwd: str) -> str:
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=cwd, check=True, capture_output=True, text=True).stdout


# ---- the page of the flight processors


def rows() -> Iterator[dict[str, str]]:
    """Yield the rows of the table in docs/processor_figures.md: cells by title of the column."""
    lines = PROCESSOR_VALUES.read_text(encoding="utf-8").splitlines()
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in lines if line[:1] == "|"]
    titles, _, *found = cells
    for row in found:
        yield dict(zip(titles, row, strict=True))


def row(fmu: str, processor: str) -> dict[str, str]:
    """Return the row of an FMU on a processor in the table of docs/processor_figures.md."""
    return next(r for r in rows() if (r["FMU"], r["processor"]) == (fmu, processor))


def note() -> str:
    """Return the note that a run with the controller on a processor prints at the end."""
    r = {k: v.replace("\u202f", "").replace(" ", "") for k, v in row(*NOTED).items()}
    recorded = re.search(r"\d+", r["equal bits"])
    assert recorded is not None
    steps = int(recorded[0]) - 1
    return (
        f"\n\n    harness: note: controller: on {NOTED[1]}: {steps} steps, {r['instructions']} "
        f"instructions on average, at most {r['at most']} at\n    t = {r['at t [s]']} s, "
        f"{r['stack']} bytes of stack\n\n"
    )


NOTED = ("adaptive_controller", "cortex-m7")


def compared() -> str:
    """Return a text: how many flight FMUs were compared with the simulation, bit by bit, on how
    many processors.
    """
    found = list(rows())
    assert all(r["equal bits"].startswith("yes") for r in found)
    fmus, processors = ({r[key] for r in found} for key in ("FMU", "processor"))
    assert len(found) == len(fmus) * len(processors)
    return f"{len(fmus)} flight FMUs on {len(processors)} processors"


def overloads() -> str:
    """Return a Markdown list of the FMUs whose longest step does not fit into their sample period,
    with the processor.
    """
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


VALUES: dict[str, Callable[[], str]] = {
    "closest_approach": closest_approach,
    "mass_effect": mass_effect,
    "new_controller": new_controller,
    "energy_per_step": energy_per_step,
    "restitution": restitution,
    "note": note,
    "compared": compared,
    "overloads": overloads,
}
for _mission in results.MISSIONS:
    VALUES |= importlib.import_module(f"results.{_mission}").VALUES
