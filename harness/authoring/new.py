# SPDX-License-Identifier: BSD-2-Clause
"""New controllers and missions: folders that work as they are, filled from `templates/`.

In the place of a controller that commands a wrench a new one is the example of the project under
another name; anywhere else it has all the ports of the component that it replaces, and its outputs
stay at the start values of the inputs that read them until its law is written. A new mission
extends a system and has a figure, a measure and a claim of its own.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import NamedTuple

from harness.authoring import skeleton
from harness.authoring.skeleton import filled
from harness.errors import UsageError
from harness.files import paths
from harness.files.output import written
from harness.mission.library import FILE, SYSTEM, everything, places
from harness.mission.mission import Example
from harness.ssp.library import load, of_component
from harness.studies.show import Signal, show
from harness.system.graph import read_interfaces
from harness.system.model import System

LANGUAGES = {"c": ".c", "python": ".py"}

NAME = re.compile(r"[\w.]+(\[\d+\])?", re.ASCII)


def _new_folder(kind: str, name: str, folder: str | Path, taken: Collection[str]) -> Path:
    """Where something new goes; UsageError if it cannot be called so, or is there."""
    if not re.fullmatch(r"[A-Za-z]\w{0,59}", name, re.ASCII) or keyword.iskeyword(name):
        raise UsageError(
            f"{name}: a {kind} is named by a letter, then letters, digits and _, as in my_{kind}"
        )
    if name in taken:
        raise UsageError(f"{name}: the name is taken; choose another one")
    target = Path(folder) / name
    if target.exists() or target.is_symlink():
        raise UsageError(f"{target}: already exists; choose another name")
    return target


def _write(path: Path, text: str) -> None:
    with written(path) as file:
        file.write_text(text, encoding="utf-8")


# ---- controllers


class Created(NamedTuple):
    """A new controller: its folder and source, and the commands that build and fly it."""

    folder: Path
    source: Path
    commands: tuple[str, str]


def new_controller(
    name: str, language: str = "c", place: str | None = None, folder: str | Path = "."
) -> Created:
    """Create `folder`/NAME with a controller that takes the place of SYSTEM.component.

    language: c or python; place: None: that of the first example. Nothing that exists is
    overwritten. Raises UsageError, and what show() raises for the place.
    """
    target = _new_folder("controller", name, folder, paths.fmus())
    if language not in LANGUAGES:
        raise UsageError(f"--language {language}: expected {' or '.join(LANGUAGES)}")
    place = place or next((e.place for e in everything().examples), "")
    system, component = _split(place)
    ports = _ports(place)
    fitting = next((e for e in everything().examples if _fits(e, ports)), None)
    source = target / f"{name}{LANGUAGES[language]}"
    text = skeleton.made(name, LANGUAGES[language], place, ports)
    _write(source, _example(name, source.suffix, fitting) if fitting else text)
    swap = f"{system} --swap {component}={target}"
    commands = f"harness build {target}", f"harness run {swap} -o {target / name}.nc"
    with load(system) as found:
        compare = f"harness compare {swap},{found.component(component).fmu.stem}"
    words = {"name": name, "place": place, "source": source.name, "folder": target}
    words |= dict(zip(("build", "run"), commands, strict=True)) | {"compare": compare}
    note = f"\n{fitting.note}" if fitting and fitting.note else ""
    readme = filled("controller.md", note=note, **words)
    _write(target / "README.md", readme)
    return Created(target, source, commands)


def _split(place: str) -> tuple[str, str]:
    """System and component of a place as they were written."""
    found = of_component(place)
    if found is None or not found[1]:
        raise UsageError(f"--for {place}: expected SYSTEM.component")
    return place.removesuffix(f".{found[1]}"), found[1]


def _ports(place: str) -> list[Signal]:
    """Inputs that are driven and outputs that are read, in the place of a component."""
    ports = [s for s in show(place).rows if isinstance(s, Signal) and s.wires]
    if odd := [s.name for s in ports if s.type != "Real" or not re.fullmatch(NAME, s.name)]:
        raise UsageError(
            f"--for {place}: {', '.join(odd)}: only ports of type Real with plain names can be made"
        )
    if not any(s.causality == "output" for s in ports):
        raise UsageError(f"--for {place}: nothing reads from it")
    system, _ = _split(place)
    return [_with_start(s, system) if s.causality == "output" else s for s in ports]


def _with_start(port: Signal, system: str) -> Signal:
    """An output with the start value of the first input that reads it: what that input takes."""
    component, _, variable = port.wires[0].rpartition(".")
    readers = [s for s in show(f"{system}.{component}").rows if isinstance(s, Signal)]
    default = next((s.default for s in readers if s.name == variable), None)
    return port._replace(default=default)


def _fits(example: Example, ports: Sequence[Signal]) -> bool:
    """Whether an example has the inputs that it needs and all outputs that are read."""
    inputs = {s.name for s in ports if s.causality == "input"}
    return inputs >= example.inputs and {s.name for s in ports} - inputs <= example.outputs


def _example(name: str, ending: str, example: Example) -> str:
    folder = paths.examples()
    if folder is None:
        raise UsageError("the examples of the project are missing: reinstall servicing-fmus")
    stem = example.file.name
    file = folder / example.file.with_suffix(ending)
    text = file.read_text(encoding="utf-8").replace(stem, name)
    return text.replace(skeleton.class_name(stem), skeleton.class_name(name))


# ---- missions


def new_mission(name: str, base: str | None = None, folder: str | Path = ".") -> Path:
    """Create `folder`/NAME, a mission that extends a system; returns its folder.

    base: name of the system (None: that of the first example of the missions at hand). Nothing that
    exists is overwritten. Raises UsageError, and what load() raises for the base.
    """
    target = _new_folder("mission", name, folder, {**paths.systems(), **places()})
    chosen = base or next((e.place.partition(".")[0] for e in everything().examples), "")
    with load(chosen) as system:
        words = _words(system) | {"name": name, "base": chosen}
    for file in (SYSTEM, FILE, "README.md"):
        _write(target / file, filled(f"mission{Path(file).suffix}", **words))
    return target


def _words(system: System) -> dict[str, str]:
    """What the templates name of the base: its mission, and a variable of its last component."""
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
        "mission": system.mission,
    }
