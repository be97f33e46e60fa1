# SPDX-License-Identifier: BSD-2-Clause
"""A new mission: a folder with a system that extends another one and a mission.py with a figure, a
measure and a claim of its own, so that it runs, plots and reports at once.
"""

from __future__ import annotations

import keyword
import re
from pathlib import Path
from string import Template

from harness.errors import UsageError
from harness.files import paths
from harness.files.output import written
from harness.mission.library import FILE, SYSTEM, everything, places
from harness.ssp.library import load
from harness.system.graph import read_interfaces
from harness.system.model import System

SYSTEM_TEXT = Template("""\
# The mission $name: what it changes of $base. An entry of [components], [connections],
# [parameters], [sets] or [requirements] here overrides the entry of $base.
extends = "$base"
name = "$name"
description = "$name, made from $base"

# [requirements]
# largest = "norm($variable) <= 1e9"

# [components]
# controller = "my_controller.fmu"      # a path from this file, or the name of an FMU

# [parameters.$component]
# parameter = 1.0                       # harness show $name.$component lists them
""")
MISSION_TEXT = Template('''\
"""What $name hands the engine: its own figures, measures and claims, and the ones of $mission."""

from __future__ import annotations

import numpy as np

from harness.mission import (
    Claim,
    Curve,
    Figure,
    Limits,
    Measure,
    Mission,
    Panel,
    Paper,
    at_least,
    inherit,
)
from harness.results.result import Result

VARIABLE = "$variable"


def largest(result: Result, limits: Limits) -> float:
    """Largest magnitude of an element [$unit]."""
    return float(np.abs(result[VARIABLE]).max())


def end(result: Result) -> tuple[float, ...]:
    """Time that the run reaches [s]."""
    return (float(result.time[-1]),)


OWN = Mission(
    figures=(Figure("own", "A figure of my own", (Panel("$axis", (Curve(VARIABLE),)),)),),
    measures=(Measure("my largest", "$unit", (VARIABLE,), largest),),
    claims=(
        Paper(
            title="Claims of $name",
            needs=(VARIABLE,),
            claims=(
                Claim(
                    name="end",
                    text="the run reaches its end",
                    where="system.toml",
                    needs=(VARIABLE,),
                    measure=end,
                    figure="{0:g} s",
                    unit="s",
                    reproduced=at_least($stop),
                ),
            ),
        ),
    ),
)
MISSION = inherit($inherited, OWN)
''')
README_TEXT = Template("""\
# $name

`system.toml` defines the system. `mission.py` adds figures, measures and claims to those of
`$base`.

    harness run $folder -o $folder.nc
    harness plot $folder.nc --mission $folder
    harness report $folder.nc --mission $folder -o $folder.html
""")


def new_mission(name: str, base: str | None = None, folder: str | Path = ".") -> Path:
    """Create `folder`/NAME, a mission that extends a system; returns its folder.

    base: name of the system (None: that of the first example of the missions at hand). Nothing that
    exists is overwritten. Raises UsageError, and what load() raises for the base.
    """
    if not re.fullmatch(r"[A-Za-z]\w{0,59}", name, re.ASCII) or keyword.iskeyword(name):
        raise UsageError(
            f"{name}: a mission is named by a letter, then letters, digits and _, as in my_mission"
        )
    if name in {**paths.systems(), **places()}:
        raise UsageError(f"{name}: there is a mission or system of this name; choose another one")
    target = Path(folder) / name
    if target.exists() or target.is_symlink():
        raise UsageError(f"{target}: already exists; choose another name")
    chosen = base or next((e.place.partition(".")[0] for e in everything().examples), "")
    with load(chosen) as system:
        words = _words(system) | {"name": name, "base": chosen, "folder": name}
    for file, text in ((SYSTEM, SYSTEM_TEXT), (FILE, MISSION_TEXT), ("README.md", README_TEXT)):
        with written(target / file) as path:
            path.write_text(text.substitute(words), encoding="utf-8")
    return target


def _words(system: System) -> dict[str, str]:
    """What the texts say of the base: its mission, and a variable of its last component."""
    component = system.components[-1].name
    interface = read_interfaces(system)[component]
    output = next(iter(interface.outputs()))
    unit = (interface.variables[output].unit or "").removeprefix("1")
    variable = f"{component}.{output.partition('[')[0]}"
    return {
        "component": component,
        "variable": variable,
        "unit": unit,
        "axis": f"{variable} [{unit}]" if unit else variable,
        "stop": repr(float(system.experiment.stop or 0.0)),
        "mission": system.mission or system.name,
        "inherited": f'"{system.mission}"',
    }
