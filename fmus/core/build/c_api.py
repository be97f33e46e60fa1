# SPDX-License-Identifier: BSD-2-Clause
"""Write the C interface of models without FMI: sources, parameter tables, reference vectors, test.

Usage: c_api.py SPEC.json -o FOLDER [--cc COMMAND] [--flight]

SPEC.json: a list of {"name", "text" (description), "sources": [C files of the unpacked FMU, the
file of the model first], "tables": [{"label", "text", "values": {element: value}}], "runs":
[{"table": label, "text", "step", "names": [element], "rows": [[t, value, ...]]}]}. A row contains
the time at which a step begins [s], then the values of the named elements: inputs in this step,
outputs at its end. The first row is not a step: it contains the start time, then inputs and outputs
after initialization.

The C file of the model and its headers are copied unedited. --flight writes only flight software:
it leaves out FMUs without C sources of this project, and models that integrate (parameter
`max_step`) or include headers of the physics. The names of the written models are printed.
Templates are in c_api_text.py.
"""

import argparse
import json
import math
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import build_fmu
import c_api_text as text
from fused_layout import INPUT, OUTPUT, PARAMETER, RULES, Model, Row, read_layout
from package_fmu import headers_of

FIRST = "interface.h"
"""Header that the C interface needs besides the headers of the model."""
RANGES = {"POSITIVE_VALUE": "> 0", "NONNEGATIVE_VALUE": ">= 0", "SWITCH_VALUE": "0 or 1",
          "ANGLE_VALUE": "0 .. pi", "ALARM_VALUE": "0 or 1"}  # fmt: skip
STRUCTS = {PARAMETER: "Parameters", INPUT: "Input", OUTPUT: "Output"}


class RejectedError(Exception):
    """Error: a model has no C interface; str() names the model and the reason."""


class Member:
    """Member of a struct of the C interface: a variable (row of the model's table), or doubles that
    belong to no variable (row None). first: index of its first double in the model; size: number of
    its doubles.
    """

    def __init__(self, first: int, size: int, row: Row | None) -> None:
        self.first, self.size, self.row = first, size, row
        self.name = row.name.replace(".", "_") if row else f"reserved_{first}"

    def declaration(self) -> str:
        """Return the C declaration of the member, with unit, range and description as comment."""
        shape, columns = "", self.row.columns if self.row else 1
        if columns > 1:
            shape = f"[{self.size // columns}][{columns}]"
        elif self.size > 1:
            shape = f"[{self.size}]"
        about = "belongs to no variable"
        if self.row:
            limits = RANGES.get(RULES[self.row.rule])
            about = f"[{self.row.unit}]{f' {limits};' if limits else ''} {self.row.text}"
        return text.commented(f"    double {self.name}{shape};", about)


def members(model: Model, causality: int) -> list[Member]:
    """Return the members of the C struct that contains the variables of a causality (PARAMETER,
    INPUT or OUTPUT), in the order of memory. Doubles that belong to no variable are members too, so
    that there are no gaps.
    """
    begin, end = {
        PARAMETER: (0, model.inputs),
        INPUT: (model.inputs, model.states),
        OUTPUT: (model.outputs, model.size),
    }[causality]
    found, at = [], begin
    rows = sorted((r for r in model.rows if r.causality == causality), key=lambda row: row.first)
    for row in rows:
        if row.first > at:
            found.append(Member(at, row.first - at, None))
        found.append(Member(row.first, row.size, row))
        at = row.first + row.size
    if end > at:
        found.append(Member(at, end - at, None))
    return found


def layouts(names: Iterable[str], folder: Path, compiler: list[str]) -> dict[str, Model]:
    """Return the memory layout of each named model, by name.

    folder: contains the C files of the models; compiler: command of the C compiler. Raises
    RejectedError with the message of the compiler if a file does not compile.
    """
    names = list(names)
    with tempfile.TemporaryDirectory() as place:
        listed = "".join(f"MODEL({name}_model)\n" for name in names)
        (Path(place) / "parts.inc").write_text(listed, encoding="utf-8")
        for name in names:
            part = text.PART.format(name=name)
            (Path(place) / f"part_{name}.c").write_text(part, encoding="utf-8")
        parts = [Path(place) / f"part_{name}.c" for name in names]
        tool, layout = build_fmu.CORE / "build" / "layout.c", Path(place) / "layout"
        flags = [*build_fmu.SAME_BITS, *build_fmu.RUN_ONCE, f"-I{place}", f"-I{folder}"]
        command = [*compiler, *flags, *parts, tool, "-o", layout, "-lm"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise RejectedError(done.stderr)
        printed = subprocess.run([layout], capture_output=True, text=True, check=True).stdout
    found = read_layout(printed)
    return {name: found[f"{name}_model"] for name in names}


# ---- sources


def gather(component: dict[str, Any], folder: Path) -> None:
    """Copy the C file of a model and its headers into a folder; component: entry of SPEC.json.
    Raises RejectedError if the sources are missing or the folder has a different file with the same
    name.
    """
    model = Path(component["sources"][0]) if component["sources"] else Path()
    inside = model.parent
    if model.stem != component["name"] or not (inside / FIRST).is_file():
        raise RejectedError(
            f"{component['name']}: contains no C sources of a model of this project"
        )
    for source in (model, inside / FIRST, *headers_of([model, inside / FIRST], [inside])):
        copy = folder / source.name
        if copy.exists() and copy.read_bytes() != source.read_bytes():
            line = f"{component['name']}: {source.name} differs from the file in {folder}"
            raise RejectedError(f"{line}: build the FMU anew, or name another folder")
        shutil.copyfile(source, copy)


def is_flight(component: dict[str, Any]) -> bool:
    """Return whether an entry of SPEC.json is flight software: it has C sources, includes no header
    of the physics, and has no parameter `max_step` of an integration.
    """
    if not component["sources"]:
        return False
    there = {path.name for path in Path(component["sources"][0]).parent.iterdir()}
    physics = {path.name for path in (build_fmu.CORE / "physics").glob("*.h")}
    integrates = any("max_step" in table["values"] for table in component["tables"])
    return "fmu.h" in there and not there & physics and not integrates


# ---- files


def header(name: str, model: Model, about: str, scratch: bool) -> str:
    """Return the text of NAME.h, the public header of a model; about: description of the model;
    scratch: whether its initialization needs working memory.
    """
    structs = "\n".join(
        text.STRUCT.format(
            name=name,
            struct=STRUCTS[causality],
            members="\n".join(m.declaration() for m in members(model, causality)),
        )
        for causality in STRUCTS
    )
    work = text.SCRATCH.format(name=name, count=model.scratch) if scratch else ""
    return text.wrapped(text.HEADER.format(
        name=name, guard=name.upper(), about=about, structs=structs, work=work,
        states=model.outputs - model.states,
        scratch=f",\n                {name}_Scratch *scratch" if scratch else "",
        call=", &scratch" if scratch else "",
    ))  # fmt: skip


def values_of(member: Member, values: dict[str, float], start: list[float]) -> str:
    """Return the C initializer of a member of the parameter struct. values: value of each element
    by name; start: start values of all parameters and inputs of the model, for elements without an
    entry in `values`.
    """
    names = list(member.row.elements()) if member.row else []
    found = [values.get(element, start[member.first + i]) for i, element in enumerate(names)]
    found = found or start[member.first : member.first + member.size]
    if member.size == 1:
        return text.number(found[0])
    columns = member.row.columns if member.row else 1
    if columns == 1:
        return text.braced(map(text.number, found))
    rows = (found[i : i + columns] for i in range(0, member.size, columns))
    return text.braced(text.braced(map(text.number, row)) for row in rows)


def tables(component: dict[str, Any], model: Model) -> tuple[str, str]:
    """Return the texts of the header and the C file with the parameter tables of a component, one C
    struct per parameter set.
    """
    name = component["name"]
    listed, defined = [], []
    for table in component["tables"]:
        lines = (
            f"    .{m.name} = {values_of(m, table['values'], model.start)},"
            for m in members(model, PARAMETER)
        )
        label = re.sub(r"\W", "_", table["label"])
        declared = f"const {name}_Parameters {name}_parameters_{label}"
        listed.append(f"extern {declared}; /* {text.safe(table['text'])} */")
        defined.append(f"{declared} = {{\n" + "\n".join(lines) + "\n};\n")
    head = text.TABLES_HEADER.format(name=name, guard=name.upper(), tables="\n".join(listed))
    return head, text.TABLES_SOURCE.format(name=name, tables="\n".join(defined))


def places(names: list[str], model: Model) -> Iterator[int]:
    """Yield, for every named input or output element, its index among the doubles of Input followed
    by the doubles of Output.
    """
    inputs = model.states - model.inputs
    known = {}
    for row in model.rows:
        before = -model.inputs if row.causality == INPUT else inputs - model.outputs
        if row.causality != PARAMETER:
            known |= {n: before + row.first + i for i, n in enumerate(row.elements())}
    return (known[name] for name in names)


def vectors(component: dict[str, Any], model: Model) -> str:
    """Return the text of the header with the reference vectors of a component, the recorded inputs
    and outputs of its runs. Elements that the runs do not contain have their start value (inputs)
    or NAN (outputs).
    """
    name, parts, runs = component["name"], [], []
    width = model.states - model.inputs + model.size - model.outputs
    first = model.start[model.inputs : model.states]
    for number, run in enumerate(component["runs"]):
        at = list(places(run["names"], model))
        rows = []
        for t, *values in run["rows"]:
            row = first + [math.nan] * (width - len(first))
            for place, value in zip(at, values, strict=True):
                row[place] = value
            rows.append(f"    {{{', '.join(map(text.bits, (float(t), *row)))}}},")
        title = text.safe(run["text"])
        parts.append(text.ROWS.format(number=number, text=title, rows="\n".join(rows)))
        label = re.sub(r"\W", "_", run["table"])
        rows_of = f"rows_{number}, COUNT(rows_{number})"
        runs.append(f"    {{&{name}_parameters_{label}, {text.number(run['step'])}, {rows_of}}},")
    return text.VECTORS.format(
        name=name, width=width + 1, rows="\n".join(parts), runs="\n".join(runs)
    )


def write(component: dict[str, Any], model: Model, folder: Path) -> None:
    """Write all files of the C interface of one component, an entry of SPEC.json, into a folder."""
    name, scratch = component["name"], model.scratch > 0
    head, source = tables(component, model)
    about = component["text"]
    files = {
        f"{name}.h": header(name, model, about, scratch),
        f"{name}_api.c": text.SOURCE.format(
            name=name,
            scratch=f", {name}_Scratch *scratch" if scratch else "",
            work=", (void *)scratch" if scratch else "",
        ),
        f"{name}_parameters.h": head,
        f"{name}_parameters.c": source,
        f"{name}_vectors.h": vectors(component, model),
        f"{name}_test.c": text.TEST.format(
            name=name,
            scratch=f"    static {name}_Scratch scratch;\n" if scratch else "",
            work=", &scratch" if scratch else "",
        ),
    }
    for file, content in files.items():
        (folder / file).write_text(content, encoding="utf-8")


def main() -> None:
    """Run the command line that the docstring of this module describes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("spec", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--cc", type=shlex.split, default=["cc"], help="compiler")
    parser.add_argument("--flight", action="store_true", help="flight software only")
    a = parser.parse_args()
    spec = json.loads(a.spec.read_text(encoding="utf-8"))
    chosen = [c for c in spec if not a.flight or is_flight(c)]
    try:
        if not chosen:
            raise RejectedError("the system has no flight software with C sources")
        a.output.mkdir(parents=True, exist_ok=True)
        for component in chosen:
            gather(component, a.output)
        found = layouts((c["name"] for c in chosen), a.output, a.cc)
        for component in chosen:
            write(component, found[component["name"]], a.output)
        names = " ".join(sorted(c["name"] for c in chosen))
        for file, content in text.BUILDS.items():
            (a.output / file).write_text(content.replace("@names@", names), encoding="utf-8")
    except (RejectedError, OSError) as error:
        sys.exit(str(error))
    print(*sorted(c["name"] for c in chosen))


if __name__ == "__main__":
    main()
