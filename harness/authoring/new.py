# SPDX-License-Identifier: BSD-2-Clause
"""New components and missions: folders whose content runs unchanged, filled from `templates/`.

A new sensor or plant that replaces no component is a copy of the example of its kind, with a system
that extends another system by the new component. A new controller is a copy of the example of the
project if the example fits the connected ports of the replaced one. Any other new component has the
connected ports of the component that it replaces; until the user writes its law, its outputs have
the start values of the inputs that they drive. A new mission extends a system and has its own
figure, metric and claim.
"""

from __future__ import annotations

import keyword
import re
import textwrap
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from string import Template
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.files import paths
from harness.files.output import written
from harness.mission.library import FILE, SYSTEM, everything, places
from harness.mission.mission import Example
from harness.ssp.library import load, of_component
from harness.studies.show import Signal, show
from harness.system.graph import read_interfaces
from harness.system.model import System
from harness.system.values import Name

KINDS = ("controller", "sensor", "plant")

NAME = re.compile(r"[\w.]+(\[\d+\])?", re.ASCII)


def _new_folder(kind: str, name: str, folder: str | Path, taken: Collection[str]) -> Path:
    """Return the path of a new folder for a component or mission; raise UsageError if the name is
    not permitted, is among the `taken` names, or is a file or folder already.
    """
    if not re.fullmatch(r"[A-Za-z]\w{0,59}", name, re.ASCII) or keyword.iskeyword(name):
        raise UsageError(
            f"{name}: a {kind} is named by a letter, then up to 59 letters, digits, _; no keyword"
        )
    if name in taken:
        raise UsageError(f"{name}: the name is taken by an FMU, system or mission; choose another")
    target = Path(folder) / name
    if target.exists() or target.is_symlink():
        raise UsageError(f"{target}: already exists; choose another name")
    return target


def _write(path: Path, text: str) -> None:
    with written(path) as file:
        file.write_text(text, encoding="utf-8")


# ---- components


class Created(NamedTuple):
    """New component: its folder and source file, and the commands that build and run it."""

    folder: Path
    source: Path
    commands: tuple[str, str]


def new_component(
    name: str,
    kind: str = "controller",
    language: str = "c",
    place: str | None = None,
    folder: str | Path = ".",
) -> Created:
    """Create `folder`/NAME with a controller, a sensor or a plant.

    kind: "controller", "sensor" or "plant"; language: "c" or "python"; place: SYSTEM.component that
    it replaces. Without a place, a controller replaces the same component as the first example
    controller, and a sensor or plant is added to a system in the new folder. Existing files are
    never overwritten. Raises UsageError, and the errors of harness.studies.show.show() for the
    place.
    """
    target = _new_folder(kind, name, folder, paths.fmus())
    examples = [e for e in everything().examples if e.kind == kind]
    if place is None and examples and kind != "controller":
        return _added(name, language, target, examples[0])
    place = place or next((e.place for e in examples), "")
    return _replacing(name, ".py" if language == "python" else ".c", place, target)


def _added(name: str, language: str, target: Path, example: Example) -> Created:
    """Create a sensor or plant from an example of the same kind, and the TOML file of a system that
    contains it.
    """
    if language != "c":
        raise UsageError(
            f"new {example.kind} --language {language}: needs --for SYSTEM.component, "
            "because the example is in C"
        )
    source = target / f"{name}.c"
    _write(source, _example(name, ".c", example))
    _write(target / SYSTEM, _example(name, ".toml", example))
    run = f"harness run {target} {example.options} -o {target / name}.nc"
    words = {"kind": example.kind, "source": source.name, "folder": target, "run": run}
    readme = filled("added.md", name=name, place=example.place, **words)
    _write(target / "README.md", readme)
    return Created(target, source, (f"harness build {target}", run))


def _replacing(name: str, ending: str, place: str, target: Path) -> Created:
    """Create a component for the place SYSTEM.component: a copy of the first example that has
    fitting ports, or else a component with the ports of that place and an empty law.
    """
    system, component = _split(place)
    ports = _ports(place)
    examples = (e for e in everything().examples if e.kind == "controller")
    fitting = next((e for e in examples if _fits(e, ports)), None)
    source = target / f"{name}{ending}"
    text = _made(name, ending, place, ports)
    _write(source, _example(name, ending, fitting) if fitting else text)
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
    """Return the system (name or path, as the user wrote it) and the component in the text
    SYSTEM.component; raise UsageError if the text has another form.
    """
    found = of_component(place)
    if found is None or not found[1]:
        raise UsageError(f"--for {place}: expected SYSTEM.component")
    return place.removesuffix(f".{found[1]}"), found[1]


def _ports(place: str) -> list[Signal]:
    """Return the connected inputs and outputs of the component at a place, SYSTEM.component; raise
    UsageError if a new component cannot have these ports.
    """
    ports = [s for s in show(place).rows if isinstance(s, Signal) and s.wires]
    if odd := [s.name for s in ports if s.type != "Real" or not re.fullmatch(NAME, s.name)]:
        raise UsageError(
            f"--for {place}: {', '.join(odd)}: a new component supports only ports of type Real "
            "with names of letters, digits, _ and points, such as x or a.x[1]"
        )
    if not any(s.causality == "output" for s in ports):
        raise UsageError(f"--for {place}: none of its outputs is connected; choose another place")
    system, _ = _split(place)
    return [_with_start(s, system) if s.causality == "output" else s for s in ports]


def _with_start(port: Signal, system: str) -> Signal:
    """Return an output with the start value of the first input that it drives, because that value
    is permitted for this input.
    """
    component, _, variable = port.wires[0].rpartition(".")
    readers = [s for s in show(f"{system}.{component}").rows if isinstance(s, Signal)]
    default = next((s.default for s in readers if s.name == variable), None)
    return port._replace(default=default)


def _fits(example: Example, ports: Sequence[Signal]) -> bool:
    """Return whether an example fits the connected ports of a component: all inputs of the example
    are among the ports, and all outputs among the ports are outputs of the example.
    """
    inputs = {s.name for s in ports if s.causality == "input"}
    return inputs >= example.inputs and {s.name for s in ports} - inputs <= example.outputs


def _example(name: str, ending: str, example: Example) -> str:
    folder = paths.examples()
    if folder is None:
        raise UsageError("the examples of the project are missing: reinstall servicing-fmus")
    stem = example.file.name
    file = folder / example.file.with_suffix(ending)
    text = file.read_text(encoding="utf-8").replace(stem, name)
    return text.replace(class_name(stem), class_name(name))


# ---- missions


def new_mission(name: str, base: str | None = None) -> Path:
    """Create the folder NAME, a mission that extends a system, and return its folder.

    base: name of the extended system (None: the system to which the first example of the project
    belongs). Existing files are never overwritten. Raises UsageError, and the errors of loading
    this system.
    """
    target = _new_folder("mission", name, ".", {**paths.systems(), **places()})
    chosen = base or next((e.place.partition(".")[0] for e in everything().examples), "")
    with load(chosen) as system:
        words = _words(system) | {"name": name, "base": chosen}
    for file in (SYSTEM, FILE, "README.md"):
        _write(target / file, filled(f"mission{Path(file).suffix}", **words))
    return target


def _words(system: System) -> dict[str, str]:
    """Return the words that replace $NAME in the templates of a mission, by NAME: properties of the
    extended system, such as its mission and the first output of its last component.
    """
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


TEMPLATES = Path(__file__).parent / "templates"


def filled(template: str, **words: object) -> str:
    """Return the text of a template, with $NAME replaced by the word of that name."""
    text = (TEMPLATES / f"{template}.template").read_text(encoding="utf-8")
    return Template(text).substitute(words)


def class_name(name: str) -> str:
    """Return a name in the form of a class name: my_pd becomes MyPd."""
    return "".join(part[:1].upper() + part[1:] for part in name.split("_")) or name


def _made(name: str, ending: str, place: str, ports: Sequence[Signal]) -> str:
    """Return the source of a component with these ports and an empty law, in C (ending .c) or in
    Python for PythonFMU (.py).
    """
    outputs = [s for s in ports if s.causality == "output"]
    inputs = [s for s in ports if s not in outputs]
    words = {"name": name, "class_name": class_name(name), "place": _plain(place)}
    if ending == ".py":
        return filled("controller.py", **words, inputs=_listed(inputs), outputs=_listed(outputs))
    return filled(
        "controller.c",
        **words,
        inputs="\n".join(map(_declaration, inputs)) or "    double unused;",
        outputs="\n".join(map(_declaration, outputs)),
        starts=_starts(inputs, outputs),
        rows="\n".join(map(_row, (*inputs, *outputs))),
    )


def _start(s: Signal) -> NDArray[np.float64]:
    """Return the start values of a signal as an array in the shape of the signal; 0 for elements
    without a finite start value.
    """
    values = np.array(s.default, dtype=np.float64)
    fits = values.shape == s.shape
    return np.nan_to_num(values, posinf=0, neginf=0) if fits else np.zeros(s.shape)


def _plain(text: str) -> str:
    """Return a text without characters that could end a string or a comment of C or Python."""
    return re.sub(r"[^\w .,;:()/+-]", "_", text.replace("*/", "*_"), flags=re.ASCII)


# ---- Python


def _listed(group: Sequence[Signal]) -> str:
    return "\n".join(f'    "{name}": {value},' for s in group for name, value in _vectors(s))


def _vectors(s: Signal) -> Iterator[tuple[str, object]]:
    """Yield pairs of name and start value for the Python source: one for a scalar or vector, one
    per element for a matrix.
    """
    if len(s.shape) < 2:
        yield s.name, _start(s).tolist()
    else:
        for (i, j), value in np.ndenumerate(_start(s)):
            yield str(Name(s.name, (i + 1, j + 1))), float(value)


# ---- C


def _member(name: str) -> str:
    return re.sub(r"\W", "_", name, flags=re.ASCII)


def _declaration(s: Signal) -> str:
    kinds = {(): "double {}", (3,): "vec3 {}", (3, 3): "mat3 {}"}
    array = "double {}" + "".join(f"[{n}]" for n in s.shape)
    kind = "quat {}" if s.shape == (4,) and s.name.startswith("q_") else kinds.get(s.shape, array)
    return f"    {kind.format(_member(s.name))};"


def _starts(inputs: Sequence[Signal], outputs: Sequence[Signal]) -> str:
    """Return the lines of the C initializer of the model: start values that are not all zero."""
    parts = [".p = {.sample_period = 0}"]
    for part, group in (("u", inputs), ("y", outputs)):
        starts = ((_member(s.name), _start(s).ravel()) for s in group)
        given = [f".{m} = {{{', '.join(map(repr, x.tolist()))}}}" for m, x in starts if x.any()]
        if given:
            parts.append(f".{part} = {{{', '.join(given)}}}")
    return "\n".join(
        textwrap.fill(f"{p},", 100, initial_indent="    ", subsequent_indent="          ")
        for p in parts
    )


def _row(s: Signal) -> str:
    causality, part = ("INPUT_ROW", "u") if s.causality == "input" else ("OUTPUT_ROW", "y")
    unit, text = _plain(s.unit or "1"), _plain(s.text or s.name)
    member = _member(s.name)
    if member == s.name and len(s.shape) < 2:
        return f'    {causality.removesuffix("_ROW")}({member}, "{unit}", "{text}"),'
    columns = s.shape[1] if len(s.shape) == 2 else 1
    name = _plain(s.name)
    return (
        f'    ROW_AS({causality}, {part}, "{name}", {member}, {columns}, "{unit}", "{text}", '
        "ANY_VALUE),"
    )
