# SPDX-License-Identifier: BSD-2-Clause
"""Run the systems, draw the pictures of docs/gallery.md and README.md, and write the page.

python .ci/gallery.py docs          # make gallery
"""

from __future__ import annotations

import io
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from PIL import Image

from harness import Result, Simulation, load
from harness.figures.plots import paint, paint_overlay
from harness.figures.style import SCREEN
from tests.missions import FIGURES, OVERLAYS

DOTS, COLOURS = 80, 64
"""Dots per inch, and number of colours of the palette, with which a picture has at most 90 kB."""
HEAD = """# Gallery

`make gallery` writes this page and its pictures from runs of this tree. `harness plot` and `harness
compare` draw these figures and more, with `--style paper` for print.
"""


class Scene(NamedTuple):
    """Section of the gallery with the runs of one system.

    figures: captions by name of the figure; each figure shows all runs; runs: arguments of
    Simulation.run() for each run, by its label; every: macro steps per recorded row.
    """

    name: str
    title: str
    system: str
    command: str
    figures: Mapping[str, str]
    runs: Mapping[str, Mapping[str, object]]
    every: int = 1


def swaps(component: str, *fmus: str) -> dict[str, dict[str, object]]:
    """Return, by name of each FMU, the arguments of a run in which this FMU replaces the
    component.
    """
    return {fmu: {"swap": {component: fmu}} for fmu in fmus}


ONE: dict[str, dict[str, object]] = {"": {}}
SCENES = (
    Scene(
        "sync_approach",
        "Synchronised approach to a tumbling target",
        "sync_approach",
        "harness run sync_approach; harness plot results/sync_approach.nc",
        {
            "trajectory": "From 20 m to 4 m on the grasp axis, which tumbles with the target.",
            "inertia_estimates": "Estimates that allow tracking but differ from the true inertias.",
        },
        ONE,
    ),
    Scene(
        "controllers",
        "Four controllers on the same approach",
        "sync_approach",
        "harness compare sync_approach --swap controller=adaptive_controller,pid_controller,"
        "ppc_controller,theta_d_controller",
        {
            "compared_errors": "Distance and angle from the reference; the servicer is free to "
            "turn from 1200 s on."
        },
        swaps(
            "controller", "adaptive_controller", "pid_controller", "ppc_controller",
            "theta_d_controller",
        ),
    ),
    Scene(
        "pulsed",
        "Sixteen on-off thrusters",
        "sync_approach_thrusters",
        "harness run sync_approach_thrusters --params pulsed",
        {"firing": "Pulse-width modulation; each thruster has its number and the direction of its "
         "force."},
        {"": {"params": "pulsed"}},
    ),
    Scene(
        "navigated",
        "The approach on estimates",
        "sync_approach_navigated",
        "harness run sync_approach_navigated --params dropout",
        {"estimate_errors": "Errors of the relative motion and 3-sigma bands; no pose from 600 to "
         "660 s."},
        {"": {"params": "dropout"}},
    ),
    Scene(
        "relay",
        "Relay control of 13 engines",
        "relay_approach",
        "harness run relay_approach --every 10",
        {
            "firing": "Attitude engines, brakes, main engine over eleven hours.",
            "phase_planes": "Error and its derivative between the switching lines.",
        },
        ONE,
        10,
    ),
    Scene(
        "ppc",
        "Prescribed performance in line-of-sight coordinates",
        "ppc_tracking",
        "harness run ppc_tracking",
        {"funnel": "Generalised states within the prescribed bounds."},
        ONE,
    ),
    Scene(
        "filter",
        "A safety filter and a guidance that leads into the target",
        "sync_approach_thrusters_filtered",
        "harness compare sync_approach_thrusters_filtered --set guidance.rho_M=0.5 --set "
        "guidance.beta=0.05 --vary filter.filter=0,1,2,3",
        {"filtered_paths": "Paths in target axes: through the keep-out sphere without a filter, "
         "along it with the switching filters and with the least change."},
        {
            word: {"set": {"guidance.rho_M": 0.5, "guidance.beta": 0.05, "filter.filter": k}}
            for k, word in enumerate(("none", "explicit", "implicit", "least change"))
        },
        10,
    ),
    Scene(
        "rendezvous",
        "Rendezvous with proved safety",
        "arch_rendezvous",
        "harness run arch_rendezvous",
        {
            "approach": "From 1 km into the last metre in five hours.",
            "safety_margins": "Margins of the monitor: at the end a drift would enter the zone.",
        },
        ONE,
        5,
    ),
    Scene(
        "mission",
        "Aborts of a mission to capture",
        "servicing_mission",
        "harness run servicing_mission",
        {
            "escapes": "Closing beside the zone; drifts of an hour after an abort, with "
            "circles of the largest displacement towards the target by errors within their bounds."
        },
        ONE,
        10,
    ),
    Scene(
        "transposition",
        "Swing of a docked module below the saturation of the gyros",
        "transposition",
        "harness run transposition --params cluster",
        {
            "bodies": "Base and module over 90 minutes.",
            "momentum": "Momentum of the gyros: as predicted, below saturation.",
        },
        {"": {"params": "cluster"}},
    ),
    Scene(
        "robot",
        "Free-floating robot under gravity gradient",
        "space_robot",
        "harness compare space_robot --vary robot.e=0:0.1:0.005 --step 60 --stop 6e5",
        {"compared_sections": "From libration to tumbling: pitch once per orbit over the "
         "eccentricity."},
        {
            f"robot.e={e / 1000:g}": {"set": {"robot.e": e / 1000}, "step": 60.0, "stop": 6e5}
            for e in range(0, 101, 5)
        },
    ),
)  # fmt: skip


def simulate(scene: Scene) -> dict[str, Result]:
    """Return the results of the runs of a scene, by label."""
    with load(scene.system) as system, Simulation(system, every=scene.every) as simulation:
        return {
            label: simulation.run(**changes)  # type: ignore[arg-type]
            for label, changes in scene.runs.items()
        }


def drawn(name: str, results: Mapping[str, Result]) -> bytes:
    """Draw the figure of this name, of one run or of several runs in one picture; return it as a
    .png of COLOURS colours.
    """
    known = FIGURES if len(results) == 1 else OVERLAYS
    first, *_ = results.values()
    (figure,) = (f for f in known if f.name == name and f.fits(first))
    file = io.BytesIO()
    with SCREEN.used():
        canvas = paint(figure, first) if len(results) == 1 else paint_overlay(figure, results)
        canvas.savefig(file, dpi=DOTS)
    small = io.BytesIO()
    picture = Image.open(file).convert("RGB")
    picture.quantize(COLOURS, dither=Image.Dither.NONE).save(small, "png", optimize=True)
    return small.getvalue()


def page(folder: Path) -> Iterator[str]:
    """Yield the parts of gallery.md, and write its pictures into folder/pictures."""
    yield HEAD
    for scene in SCENES:
        results = simulate(scene)
        yield f"## {scene.title}\n\n    {scene.command}\n"
        for figure, text in scene.figures.items():
            file = folder / "pictures" / f"{scene.name}_{figure}.png"
            file.write_bytes(drawn(figure, results))
            yield f"{text}\n\n![{text}](pictures/{file.name})\n"


if __name__ == "__main__":
    docs = Path(sys.argv[1])
    (docs / "pictures").mkdir(exist_ok=True)
    (docs / "gallery.md").write_text("\n".join(page(docs)), encoding="utf-8")
