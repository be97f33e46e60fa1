# SPDX-License-Identifier: BSD-2-Clause
"""Pages of the missions, one each: systems with diagrams and parameter sets, figures, verdicts."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from models import writer
from text import ROOT, between, counted, table

from harness.files import paths
from harness.mission.library import mission, places, systems_in
from harness.system.model import System

SSP = ROOT / "ssp"
DOTS = 80
MOST_CASES = 8
"""Largest number of runs on the page of a mission."""


def names() -> list[str]:
    """Return the missions of the project that have a system."""
    return sorted(
        name for name, place in places().items()
        if place.folder.parent == SSP and systems_in(place.folder)
    )  # fmt: skip


LIVE = "live"
"""Folder of the pages that run their system in the browser."""
MOST_BYTES = 32e6
"""Largest size of the recorded values in a page that runs its system in the browser [bytes]."""


def facts(folder: Path) -> dict[str, Any]:
    """Run the default case of every mission and the first case of each of its papers, at most
    MOST_CASES runs. Return, by mission, a list with a record per run: command, verdicts of claims
    and requirements; in the first record also figures, live page and lesson.
    """
    found = {name: [_run(case, folder / "figures" if not i else None, name)
                    for i, case in enumerate(_cases(name))]
             for name in counted("mission", names())}  # fmt: skip
    for name in counted("live page", found):
        found[name][0]["live"] = live(name, folder / LIVE)
    for name in counted("lesson", taught()):
        found[name][0]["lesson"] = live(name, folder / LIVE, taught()[name])
    return found


def live(name: str, folder: Path, lesson: Path | None = None) -> str:
    """Write the live page of a mission, with the exercises if a lesson is given. Return the name of
    its file, or "" if the compiler of the extra `live` is not installed.
    """
    import importlib.util

    from harness import Simulation, load, run
    from harness.api import write_page
    from harness.report.live import read_lesson

    if importlib.util.find_spec("ziglang") is None:
        return ""
    folder.mkdir(parents=True, exist_ok=True)
    params = read_lesson(lesson).params if lesson else ""
    with load(name) as system:
        simulation = Simulation(system)
        numbers = 8 * simulation.steps * len(simulation.graph.slots)
        every = max(system.experiment.every, int(numbers / MOST_BYTES) + 1)
        result = run(system, every=every, **({"params": params} if params else {}))
    file = folder / f"{'lesson_' if lesson else ''}{name}.html"
    return write_page(result, file, live=True, lesson=lesson).name


LESSONS = """# Learn

Five lessons, one per published work, ten minutes each. Nothing needs to be installed: each lesson
is a page that contains its system and runs it in the browser. Move the sliders until all three
exercises are solved. Each has a hint and an answer.

"""


def taught() -> dict[str, Path]:
    """Return the file of the lesson by mission, for every mission that has a lesson."""
    return {path.parents[1].name: path for path in sorted(SSP.glob("*/lessons/*.toml"))}


def lessons(runs: Mapping[str, Any]) -> str:
    """Return the page that lists the lessons (ssp/MISSION/lessons/*.toml). runs: by mission, the
    records that facts() returns; the first record of a mission has the file name of the page that
    runs its lesson, to which the list links ("": no link).
    """
    lines = [LESSONS]
    for name in ORDER:
        found = tomllib.loads(taught()[name].read_text(encoding="utf-8"))
        page = next((run["lesson"] for run in runs.get(name, [])[:1] if run.get("lesson")), "")
        title = f"[{found['title']}]({LIVE}/{page})" if page else found["title"]
        mission = f"[equations and verdicts](reference/missions/{name}.md)"
        lines.append(f"1. **{title}**: {' '.join(found['text'].split(chr(10) * 2)[0].split())}\n")
        lines.append(f"    More: {mission}.\n")
    return "\n".join(lines)


ORDER = ("sync_approach", "ppc_tracking", "space_robot", "transposition", "relay_approach")
"""Missions with a lesson, in the order of the page that lists the lessons."""


def _cases(name: str) -> list[Any]:
    """Return the default case of a mission and the first case of each of its papers, without
    repetitions, at most MOST_CASES.
    """
    from harness.mission import Case

    cases = [Case(name), *_papers(name)]
    return list({(c.system, c.params, c.swap): c for c in cases}.values())[:MOST_CASES]


def _run(case: Any, pictures: Path | None, name: str) -> dict[str, Any]:
    from harness import run
    from harness.claims.report import judgements
    from harness.results.requirements import findings
    from harness.results.verdict import Kind

    result = run(case.system, params=case.params, swap=dict(case.swap))
    drawn = [] if pictures is None else draw_figures(result, pictures, name)
    conditions = [
        (f.name, f.text, Kind.REQUIREMENT.word(f.verdict), f.detail) for f in findings(result)
    ]
    papers = [
        {
            "title": each.paper.title,
            "deviations": list(each.deviations),
            "claims": [
                (c.text, c.where, c.criterion(c.reproduced), j.value, Kind.CLAIM.word(j.verdict))
                for c, j in each.claims
            ],
        }
        for each in judgements(result)
        if each.paper.cases
    ]
    swaps = "".join(f" --swap {c}={f}" for c, f in case.swap)
    params = "" if case.params == "default" else f" --params {case.params}"
    command = f"harness run {case.system}{params}{swaps} -o out.nc"
    return {"command": command, "figures": drawn, "requirements": conditions, "papers": papers}


def draw_figures(result: Any, folder: Path, name: str) -> list[tuple[str, str]]:
    """Draw the figures of a run, at most MOST_FIGURES; return file and title of each."""
    import io

    from PIL import Image

    from harness.figures.plots import paint
    from harness.figures.style import SCREEN
    from harness.mission.library import of_result

    drawn = []
    folder.mkdir(parents=True, exist_ok=True)
    for figure in [f for f in of_result(result).figures if f.fits(result)][:MOST_FIGURES]:
        file = io.BytesIO()
        with SCREEN.used():
            paint(figure, result).savefig(file, dpi=DOTS)
        path = folder / f"{name}_{figure.name}.png"
        Image.open(file).convert("RGB").quantize(64).save(path, "png", optimize=True)
        drawn.append((path.name, figure.title))
    return drawn


MOST_FIGURES = 12


def pages(facts: Mapping[str, Any], parts: Mapping[str, str]) -> Iterator[tuple[str, str | bytes]]:
    """Yield path and content of the pages and diagrams; facts: contents of facts.json; parts: page
    of each part of the equations by the letter of the part.
    """
    from harness.figures.diagram import painted
    from harness.ssp.library import load

    rows = []
    for name in names():
        systems = []
        for system in sorted(systems_in(places()[name].folder), key=lambda s: (s != name, s)):
            with load(paths.systems()[system]) as found:
                systems.append(found)
                yield f"reference/missions/{system}.svg", painted(found)
        rows.append((f"[`{name}`]({name}.md)", systems[0].description, str(len(systems))))
        runs = facts.get("missions", {}).get(name, ())
        yield f"reference/missions/{name}.md", page(name, systems, runs, parts)
    titles = ("Mission", "Purpose", "Systems")
    yield "reference/missions/index.md", INDEX + table(titles, rows)
    yield "learn.md", lessons(facts.get("missions", {}))


INDEX = """# Missions

A mission is a folder of `ssp/`: its systems and parameter sets, figures, metrics, claims and
campaigns. `harness list` prints the systems and their parameter sets.

"""


def page(name: str, systems: list[System], runs: Any, parts: Mapping[str, str]) -> str:
    """Return the page of one mission. runs: records of the mission that facts() returns; parts: as
    for pages().
    """
    here = f"reference/missions/{name}.md"
    equations = next((p for p in parts.values() if p.endswith(f"/{name}.md")), "")
    lines = [f"# {name}\n\n{systems[0].description}\n"]
    if equations:
        lines.append(f"Equations, corrections to the paper and results: "
                     f"[equations]({between(here, equations)}).\n")  # fmt: skip
    if runs and runs[0].get("live"):
        inside = f"../../{LIVE}/{runs[0]['live']}"
        lines.append(f"[Change parameters and run it in the browser]({inside}) "
                     "([how](../../how_to/live_page.md)).\n")  # fmt: skip
    lines += [line for run in runs for line in _verdicts(run)]
    if runs and runs[0]["figures"]:
        lines.append("## Figures\n\nOf `harness run " + name + "`, drawn by `harness plot`.\n")
        lines += [f"![{title}](figures/{file})\n" for file, title in runs[0]["figures"]]
    lines.append("## Systems\n")
    lines += [line for system in systems for line in _system(system)]
    return "\n".join(lines)


def _verdicts(run: Mapping[str, Any]) -> Iterator[str]:
    if not run["requirements"] and not run["papers"]:
        return
    yield f"## `{run['command']}`\n"
    if run["requirements"]:
        rows = [(n, f"`{t}`", verdict, detail) for n, t, verdict, detail in run["requirements"]]
        yield table(("Requirement", "Condition", "Verdict", "Closest"), rows)
    for paper in run["papers"]:
        yield f"{paper['title']}.\n"
        if paper["deviations"]:
            yield f"Not the case of the paper: {'; '.join(paper['deviations'])}.\n"
        yield table(("Claim", "Where", "Reproduced if", "Here", "Verdict"), paper["claims"])


def claims(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the tables of claims that pages quote, by the names `claims_MISSION`; facts: records
    of runs by mission.
    """
    return {f"claims_{name}": _claims(name, facts[name]) for name in claiming() if name in facts}


def claiming() -> list[str]:
    """Return the missions that have a table of claims: the first case of at least one of their
    papers runs a system in the folder of the mission.
    """
    return [name for name in names() if any(c.system in _own(name) for c in _papers(name))]


def _papers(name: str) -> list[Any]:
    """Return the first case of each paper of a mission, except papers without a case."""
    found = mission(name)
    assert found is not None
    return [paper.cases[0] for paper in found.claims if paper.cases]


def _own(name: str) -> Mapping[str, Any]:
    return systems_in(places()[name].folder)


def _claims(name: str, runs: Any) -> str:
    """Return a table of claim, place in the paper, value and verdict, run by run."""
    own = [run for run in runs if run["papers"] and run["command"].split()[2] in _own(name)]
    rows = []
    for run in own:
        changes = " ".join(run["command"].split()[3:-2])
        case = [f"`{changes}`" if changes else "default"] if len(own) > 1 else []
        rows += [
            [*case, text, where, value, verdict]
            for paper in run["papers"]
            for text, where, _, value, verdict in paper["claims"]
        ]
    titles = [*(["Run"] if len(own) > 1 else []), "Claim", "Where", "Here", "Verdict"]
    return f"\n{table(titles, rows)}"


def _system(system: System) -> Iterator[str]:
    experiment = system.experiment
    yield f"### {system.name}\n\n{system.description}\n"
    yield f"![Block diagram of {system.name}]({system.name}.svg)\n"
    yield (f"{experiment.stop:g} s in macro steps of {experiment.step:g} s, "
           f"{experiment.algorithm}.\n")  # fmt: skip
    rows = [
        (f"`{c.name}`", f"[`{Path(c.fmu).stem}`](../fmus/{Path(c.fmu).stem}.md)", _rate(c))
        for c in system.components
    ]
    yield table(("Component", "FMU", "Schedule"), rows)
    if system.sets:
        rows = [(f"`{s.name}`", s.description or "") for s in system.sets]
        yield table(("Parameter set", "Differences"), [r[:2] for r in rows])


def _rate(component: Any) -> str:
    every = "every macro step" if component.every == 1 else f"every {component.every} macro steps"
    late = f", latency {component.latency} macro step(s)" if component.latency else ""
    return every + late


def equations() -> dict[str, tuple[str, str]]:
    """Return for each part of the equations, by its letter in docs/models.md, the file in the
    repository and the page of the site.
    """
    text = (ROOT / "docs/models.md").read_text(encoding="utf-8")
    found = re.findall(
        r"^\| ([A-Z](?:\.\d+)?) \| \[[^\]]*\]\(\.\./(ssp/(\w+)/(\w+)\.md)\)", text, re.M
    )
    return {
        letter: (path, f"reference/equations/{folder if file == 'equations' else file}.md")
        for letter, path, folder, file in found
    }


def typeset(text: str) -> str:
    """Return a page of equations with its indented lines as mathematics; code must be in fences,
    because indented code would become mathematics, too.
    """
    block = writer("typeset").block
    parts = re.split(r"^(```.*?^```)", text, flags=re.MULTILINE | re.DOTALL)
    parts[::2] = [
        EQUATIONS.sub(lambda m: f"\n{block(line[4:] for line in m[0].splitlines())}\n\n", part)
        for part in parts[::2]
    ]
    return "".join(parts)


EQUATIONS = re.compile(r"^(?: {4}[^\n]*(?:\n|\Z))+", re.MULTILINE)
