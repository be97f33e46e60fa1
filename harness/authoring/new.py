# SPDX-License-Identifier: BSD-2-Clause
"""A new controller: a folder with a source that flies as it is, and the two commands for it.

In the place of a controller that commands a wrench it is the example of the project under another
name; anywhere else it has all the ports of the component that it replaces, and its outputs stay at
the start values of the inputs that read them until its law is written.
"""

from __future__ import annotations

import keyword
import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from harness.authoring import skeleton
from harness.errors import UsageError
from harness.files import paths
from harness.files.output import written
from harness.mission.library import everything
from harness.mission.mission import Example
from harness.ssp.library import load, of_component
from harness.studies.show import Signal, show

LANGUAGES = {"c": ".c", "python": ".py"}

NAME = re.compile(r"[\w.]+(\[\d+\])?", re.ASCII)

C_WORDS = """auto break case char const continue default do double else enum extern float for goto
if inline int long register restrict return short signed sizeof static struct switch typedef
union unsigned void volatile while main"""


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
    _refuse_name(name)
    if language not in LANGUAGES:
        raise UsageError(f"--language {language}: expected {' or '.join(LANGUAGES)}")
    place = place or next((e.place for e in everything().examples), "")
    system, component = _split(place)
    ports = _ports(place)
    target = Path(folder) / name
    if target.exists() or target.is_symlink():
        raise UsageError(f"{target}: already exists; choose another name")
    fitting = next((e for e in everything().examples if _fits(e, ports)), None)
    text = (
        _skeleton(name, language, place, ports)
        if fitting is None
        else _example(name, language, fitting)
    )
    source = target / f"{name}{LANGUAGES[language]}"
    commands = (
        f"harness build {target}",
        f"harness run {system} --swap {component}={target} -o {target / name}.nc",
    )
    _write(source, text)
    with load(system) as found:
        present = found.component(component).fmu.stem
    compare = f"harness compare {system} --swap {component}={target},{present}"
    note = f"\n{fitting.note}" if fitting and fitting.note else ""
    _write(target / "README.md", _readme(name, source.name, place, (*commands, compare), note))
    return Created(target, source, commands)


def _refuse_name(name: str) -> None:
    """UsageError for names that are no identifiers in C or Python, or taken."""
    if not re.fullmatch(r"[A-Za-z]\w{0,59}", name, re.ASCII) or keyword.iskeyword(name):
        raise UsageError(
            f"{name}: a controller is named by a letter, then letters, digits and _, as in my_pd"
        )
    if name in C_WORDS.split():
        raise UsageError(f"{name}: is a keyword of C; choose another name")
    if name in paths.fmus():
        raise UsageError(f"{name}: the project has an FMU of this name; choose another one")


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


def _example(name: str, language: str, example: Example) -> str:
    folder = paths.examples()
    if folder is None:
        raise UsageError("the examples of the project are missing: reinstall servicing-fmus")
    file = folder / example.file.with_suffix(LANGUAGES[language])
    stem = example.file.name
    text = file.read_text(encoding="utf-8").replace(stem, name)
    return text.replace(skeleton.class_name(stem), skeleton.class_name(name))


def _skeleton(name: str, language: str, place: str, ports: Sequence[Signal]) -> str:
    make = {"c": skeleton.in_c, "python": skeleton.in_python}[language]
    return make(name, place, ports)


def _readme(name: str, source: str, place: str, commands: tuple[str, str, str], note: str) -> str:
    results = commands[1].rpartition(" ")[2]
    fmu = commands[0].rpartition(" ")[2] + f"/{name}.fmu"
    return f"""# {name}

A controller in the place of `{place}`. The law is `control` in `{source}`.

    {commands[0]}
    {commands[1]}

The first command builds `{name}.fmu` here, again after every edit; the second one runs it.

    harness show {place}
    harness check {fmu} --strict
    harness report {results} -o {results.removesuffix(".nc")}.html
    {commands[2]}

The first command lists ports and units. The second one checks the FMU against the rules of FMI. The
third one writes a page with plots, replay and verdicts. The last one compares the controller with
the component that it replaces, both with the actuators of the set that the system compares with.
{note}"""


def _write(path: Path, text: str) -> None:
    with written(path) as file:
        file.write_text(text, encoding="utf-8")
