# SPDX-License-Identifier: BSD-2-Clause
"""Build one FMU that contains a whole system, from the unpacked sources of the system's FMUs.

Usage: fuse.py SYSTEM.json -o FILE.fmu [--fmi 2|3] [--cc COMMAND] [--adapter FOLDER]

SYSTEM.json: {"name", "text", "start" [s], "stop" [s], "step" (macro step [s]), "parts": [{"name",
"fmu" (path), "sources": [C files of the unpacked archive, the file of the model first], "values":
{element: start value}, "driven": {connected input element: [part, output element, factor, offset]},
"late": true if its outputs are published not by its step but by a later action "get"}, ...],
"plan": [[verb, part, every, phase], ...]}. A part is a component of the system; "driven" and "plan"
contain its index. The plan is the schedule of a macro step: the action of a part (verb "set": set
its inputs; "step"; "get": publish its late outputs) is performed in macro step k if k % every ==
phase.
Optional: "version" and "date" of the FMU; "provenance", which is written into the folder extra/
of the FMU; "scalars", true for an FMU without arrays. The program writes system.c, the model
interface of the whole system (described in fused.h), and packs it as build_fmu.py packs a model.
"""

import argparse
import hashlib
import json
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import build_fmu
import shared_variables
from fused_layout import Model, Part, Whole, lay_out, read_layout
from fused_source import system_c

PART = """/* part_{copy} - the model of {file} as {symbol}, and its step as a function. */
#define FMU_MODEL_SYMBOL {symbol}
#include "{copy}"

extern const size_t {symbol}_inputs;
const size_t {symbol}_inputs = offsetof(Model, u) / sizeof(double);

void {symbol}_step(const void *p, const void *u, void *x, void *y, double t, double h);
void {symbol}_step(const void *p, const void *u, void *x, void *y, double t, double h)
{{
    step(p, u, x, y, t, h);
}}
"""


class NotFusibleError(Exception):
    """Error: the sources of an FMU cannot be part of a system. Each line of the message begins with
    the name of the FMU, followed by the reason or by a line that the compiler has printed.
    """


def output_of(command: list[Any], fmu: str) -> str:
    """Return what a command prints to stdout; raise NotFusibleError if it fails, with the name of
    the FMU in front of every line that the command has printed to stderr.
    """
    streams: dict[str, Any] = {"capture_output": True, "encoding": "utf-8", "errors": "replace"}
    done = subprocess.run(command, check=False, **streams)
    if done.returncode:
        ended = f"{Path(command[0]).name} ended with status {done.returncode}"
        lines = done.stderr.splitlines() or [ended]
        raise NotFusibleError("\n".join(f"{fmu}: {line}" for line in lines))
    return done.stdout


# ---- sources ----
def gather(parts: list[dict[str, Any]], folder: Path) -> list[str]:
    """Copy the sources of all FMUs into one folder, and return the C symbol of the model of each
    part (entry of `parts` in SYSTEM.json). Raises NotFusibleError if sources are missing or if two
    files of the same name, models excepted, differ.
    """
    symbols: dict[str, str] = {}
    for part in parts:
        if part["fmu"] not in symbols:
            sources = [Path(source) for source in part["sources"]]
            fmu = Path(part["fmu"]).name
            symbols[part["fmu"]] = _gathered(fmu, sources, folder, set(symbols.values()))
    return [symbols[part["fmu"]] for part in parts]


def _gathered(fmu: str, sources: list[Path], folder: Path, taken: set[str]) -> str:
    inside = sources[0].parent.iterdir() if sources else ()
    files = {path.name: path for path in inside if path.is_file()}
    if not {"fmu.h", *(source.name for source in sources)} <= files.keys():
        raise NotFusibleError(f"{fmu} does not contain the C sources of a model of this project")
    model = files.pop(sources[0].name)
    files.pop("buildDescription.xml", None)
    ours = {path.name: path for headers in build_fmu.HEADERS for path in headers.iterdir()}
    for name, path in files.items():
        known = ours.get(name) or folder / name
        if known.exists() and known.read_bytes() != path.read_bytes():
            raise NotFusibleError(
                f"{fmu}: its file {name} differs from {name} of the harness or of another FMU: "
                "build the FMU anew"
            )
        if name not in ours:
            shutil.copyfile(path, folder / name)
    symbol = next(s for s in _names(f"{model.stem}_model") if s not in taken)
    copy = symbol.removesuffix("_model") + ".c"
    shutil.copyfile(model, folder / copy)
    (folder / f"part_{copy}").write_text(
        PART.format(file=model.name, copy=copy, symbol=symbol),
        encoding="utf-8",
    )
    return symbol


def _names(name: str) -> Iterator[str]:
    yield name
    number = 2
    while True:
        yield f"{name.removesuffix('_model')}_{number}_model"
        number += 1


# ---- build ----
class Build:
    """Build of a fused FMU in an empty folder: it compiles the models, lays out the memory, writes
    system.c, links the library, writes the model description and packs the archive.
    """

    def __init__(
        self,
        spec: dict[str, Any],
        folder: Path,
        compiler: list[str],
        fmi: str,
        adapter: Path | None,
    ) -> None:
        self.spec, self.folder, self.fmi, self.name = spec, folder, fmi, spec["name"]
        self.adapter = adapter
        include = [f"-I{f}" for f in (folder, *build_fmu.HEADERS)]
        include += ["-isystem", str(build_fmu.FMI_HEADERS)]
        self.compile = [*compiler, *build_fmu.FLAGS, *include]

    def run(self, output: Path) -> None:
        """Write the FMU to the path `output`; raise NotFusibleError if the sources cannot be
        compiled into one FMU.
        """
        parts = self.spec["parts"]
        symbols = gather(parts, self.folder)
        fmus = {s: Path(p["fmu"]).name for s, p in zip(symbols, parts, strict=True)}
        stems = [symbol.removesuffix("_model") for symbol in fmus]
        models = [self.folder / f"part_{stem}.c" for stem in stems]
        objects = self._objects(models, list(fmus.values()))
        for model, fmu in zip(models, fmus.values(), strict=True):
            if shared := shared_variables.problems(self.compile, model):
                raise NotFusibleError("\n".join(f"{fmu}: {text}" for text in shared))
        whole = self._laid_out(symbols, self._models(fmus, objects))
        if self.spec.get("scalars"):
            whole.rows = [one for row in whole.rows for one in row.scalars()]
        system = self.folder / "system.c"
        digest = hashlib.sha256(json.dumps(self._structure()).encode()).hexdigest()
        system.write_text(system_c(self.spec, whole, digest), encoding="utf-8")
        shared = build_fmu.ADAPTER[self.fmi]
        new = [system, *(() if self.adapter else shared)]
        own, *adapter = self._objects(new, [self.name] * len(new))
        adapter = build_fmu.compiled_adapter(self.adapter, self.fmi) if self.adapter else adapter
        library = self.folder / f"{self.name}{build_fmu.LIBRARY}"
        self._link("-shared", own, *objects, *adapter, output=library)
        self._pack([system, *models, *shared], [own, *objects], library, output)

    def _objects(self, sources: list[Path], fmus: list[str]) -> list[Path]:
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            return list(pool.map(self._object, sources, fmus))

    def _object(self, source: Path, fmu: str) -> Path:
        made = self.folder / f"{source.stem}.o"
        output_of([*self.compile, "-c", source, "-o", made], fmu)
        return made

    def _link(self, *what: str | Path, output: Path, fmu: str = "") -> Path:
        output_of([*self.compile, *what, "-o", output, "-lm"], fmu or self.name)
        return output

    def _models(self, fmus: dict[str, str], objects: list[Path]) -> dict[str, Model]:
        """Return the memory layouts of the models by their C symbols; fmus: name of the FMU by
        symbol; objects: compiled models. If the program that prints all layouts fails, one program
        per model is built, so that the NotFusibleError names the first FMU that fails.
        """
        try:
            return self._described(list(fmus), objects, self.name)
        except NotFusibleError:
            for (symbol, fmu), made in zip(fmus.items(), objects, strict=True):
                self._described([symbol], [made], fmu)
            raise

    def _described(self, symbols: list[str], objects: list[Path], fmu: str) -> dict[str, Model]:
        lines = [f"MODEL({symbol})" for symbol in symbols]
        (self.folder / "parts.inc").write_text("\n".join(lines) + "\n", encoding="utf-8")
        source, tool = build_fmu.CORE / "build/layout.c", self.folder / "layout"
        self._link(*build_fmu.RUN_ONCE, source, *objects, output=tool, fmu=fmu)
        try:
            models = read_layout(output_of([tool], fmu))
            return {symbol: models[symbol] for symbol in symbols}
        except (ValueError, TypeError, NameError, LookupError, ArithmeticError) as error:
            raise NotFusibleError(
                f"{fmu}: the memory layout of its model cannot be read; the program that prints "
                "it contains the sources of the FMU, which must print nothing themselves"
            ) from error

    def _laid_out(self, symbols: list[str], models: dict[str, Model]) -> Whole:
        parts = [
            Part(part["name"], models[symbol], part["values"], part["driven"], part["late"])
            for part, symbol in zip(self.spec["parts"], symbols, strict=True)
        ]
        steps = [(i, every) for verb, i, every, _ in self.spec["plan"] if verb == "step"]
        return lay_out(parts, self.spec["step"], sorted(i for i, every in steps if every > 1))

    def _structure(self) -> list[Any]:
        """Return the connections and the schedule as data for JSON. system.c contains their hash,
        because systems with the same variables but other connections need different GUIDs.
        """
        parts = self.spec["parts"]
        wires = [[part["name"], sorted(part["driven"].items()), part["late"]] for part in parts]
        return [wires, self.spec["plan"]]

    def _pack(self, sources: list[Path], own: list[Path], library: Path, output: Path) -> None:
        names = (("startTime", "start"), ("stopTime", "stop"), ("stepSize", "step"))
        span = " ".join(f'{name}=\\"{self.spec[key]:.17g}\\"' for name, key in names)
        tool = build_fmu.CORE / "build/describe.c"
        options = (*build_fmu.RUN_ONCE, f'-DEXPERIMENT="{span}"')
        describe = self._link(*options, tool, *own, output=self.folder / "describe")
        xml = self.folder / "modelDescription.xml"
        listed = [path.name for path in sources]
        about = (self.spec.get("version", "0"), self.spec.get("date", build_fmu.DATE))
        text = output_of([describe, self.fmi, *about, *listed], self.name)
        xml.write_text(text, encoding="utf-8")
        package = [sys.executable, build_fmu.CORE / "build/package_fmu.py"]
        files = [f"--fmi{self.fmi}", output, xml, "--license", build_fmu.LICENSE]
        binary = ["--binary", f"{build_fmu.PLATFORM}={library}"]
        texts = ["--source", *sources, "--include", self.folder, *build_fmu.HEADERS]
        output_of([*package, *files, *binary, *texts, *self._provenance()], self.name)

    def _provenance(self) -> list[str | Path]:
        """Write the provenance of the system to a file, and return the option of package_fmu.py for
        this file; [] without provenance.
        """
        if "provenance" not in self.spec:
            return []
        file = self.folder / "provenance.json"
        file.write_text(json.dumps(self.spec["provenance"], indent=1) + "\n", encoding="utf-8")
        return ["--provenance", file]


def build(
    spec: dict[str, Any], output: Path, compiler: list[str], fmi: str, adapter: Path | None = None
) -> None:
    """Write the FMU of a system for FMI `fmi` ("2" or "3"); raise NotFusibleError if its sources
    cannot be compiled into one FMU.

    spec: content of SYSTEM.json; compiler: command; adapter: folder with the compiled C files that
    implement the FMI functions (None: compile them).
    """
    with tempfile.TemporaryDirectory() as folder:
        Build(spec, Path(folder), compiler, fmi, adapter).run(output)


def main() -> None:
    """Run the command line that the docstring of this module describes; exit with status 3 for a
    NotFusibleError, whose message is printed.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("system", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument(
        "--fmi", choices=tuple(build_fmu.ADAPTER), default="2", help="version of FMI"
    )
    parser.add_argument(
        "--cc", type=shlex.split, default=["cc"], help="compiler with its arguments"
    )
    parser.add_argument("--adapter", type=Path, help="folder with the compiled FMI functions")
    a = parser.parse_args()
    try:
        build(json.loads(a.system.read_text(encoding="utf-8")), a.output, a.cc, a.fmi, a.adapter)
    except NotFusibleError as reason:
        print(reason)
        sys.exit(3)
    except OSError as error:
        sys.exit(f"fuse.py: {error}")


if __name__ == "__main__":
    main()
