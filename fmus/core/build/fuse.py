# SPDX-License-Identifier: BSD-2-Clause
"""Build one FMU of a whole system from the sources in its FMUs.

Usage: fuse.py SYSTEM.json -o FILE.fmu [--fmi 2|3] [--cc COMMAND]

SYSTEM.json: {"name", "text", "start", "stop", "step": [s], "parts": [{"name", "fmu", "values":
{element: start value}, "driven": {input element: [part, output element, factor, offset]}, "late":
whether its outputs are published later than they are computed}, ...], "plan": [[verb, part, every,
phase], ...]}; parts are counted from 0. It writes system.c, which is the interface of the whole as
fused.h explains it, and packs it as build_fmu.py packs a model.
"""

import argparse
import hashlib
import json
import os
import shlex
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import build_fmu
import fmpy
from fused_layout import Part, Whole, lay_out, read_layout
from fused_source import system_c
from package_fmi3 import listed_sources

PART = """/* part_{copy} - the model of {file} under a name of its own, in two pieces. */
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
    """An FMU has no sources that can be one of the parts; str() says which and why."""


# ---- sources ----
def unpack(parts: list[dict[str, Any]], folder: Path) -> list[str]:
    """The sources of all FMUs in one folder, each model under a symbol of its own; the symbols of
    the parts. NotFusibleError.
    """
    symbols: dict[str, str] = {}
    for part in parts:
        if part["fmu"] not in symbols:
            symbols[part["fmu"]] = _unpack(Path(part["fmu"]), folder, set(symbols.values()))
    return [symbols[part["fmu"]] for part in parts]


def _unpack(fmu: Path, folder: Path, taken: set[str]) -> str:
    with zipfile.ZipFile(fmu) as archive:
        files = {
            name.removeprefix("sources/"): archive.read(name)
            for name in archive.namelist()
            if name.startswith("sources/") and not name.endswith("/")
        }
        build = files.pop("buildDescription.xml", None)
        model = ElementTree.fromstring(archive.read("modelDescription.xml"))
        listed = listed_sources(model, build)
    if not listed or not {*listed, "fmu.h"} <= files.keys():
        raise NotFusibleError(f"{fmu.name} holds no sources of a model in C of this project")
    ours = {path.name: path for room in build_fmu.HEADERS for path in room.iterdir()}
    for name in files.keys() - {listed[0]}:
        known = ours.get(name) or folder / name
        if known.exists() and known.read_bytes() != files[name]:
            raise NotFusibleError(
                f"{fmu.name} has another {name} than the other parts: build it anew"
            )
        if name not in ours:
            (folder / name).write_bytes(files[name])
    stem = Path(listed[0]).stem
    symbol = next(s for s in _names(f"{stem}_model") if s not in taken)
    copy = symbol.removesuffix("_model") + ".c"
    (folder / copy).write_bytes(files[listed[0]])
    (folder / f"part_{copy}").write_text(
        PART.format(file=listed[0], copy=copy, symbol=symbol),
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
    """One build in a folder: models, layout, system.c, library, description, archive."""

    def __init__(self, spec: dict[str, Any], folder: Path, compiler: list[str], fmi: str) -> None:
        self.spec, self.folder, self.fmi = spec, folder, fmi
        include = [f"-I{f}" for f in (folder, *build_fmu.HEADERS)]
        include += ["-isystem", str(Path(fmpy.__file__).parent / "c-code")]
        self.compile = [*compiler, *build_fmu.FLAGS, *include]

    def run(self, output: Path) -> None:
        """Write the FMU; NotFusibleError, or CalledProcessError if the compiler fails."""
        symbols = unpack(self.spec["parts"], self.folder)
        stems = [symbol.removesuffix("_model") for symbol in dict.fromkeys(symbols)]
        models = [self.folder / f"part_{stem}.c" for stem in stems]
        parts = self._objects(models)
        whole = self._laid_out(symbols, parts)
        system = self.folder / "system.c"
        digest = hashlib.sha256(json.dumps(self._structure()).encode()).hexdigest()
        system.write_text(system_c(self.spec, whole, digest), encoding="utf-8")
        shared = build_fmu.ADAPTER[self.fmi]
        own, *adapter = self._objects([system, *shared])
        library = self.folder / f"{self.spec['name']}{fmpy.sharedLibraryExtension}"
        self._link("-shared", own, *parts, *adapter, output=library)
        self._pack([system, *models, *shared], [own, *parts], library, output)

    def _objects(self, sources: list[Path]) -> list[Path]:
        with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
            return list(pool.map(self._object, sources))

    def _object(self, source: Path) -> Path:
        made = self.folder / f"{source.stem}.o"
        subprocess.run([*self.compile, "-c", source, "-o", made], check=True)
        return made

    def _link(self, *what: str | Path, output: Path) -> Path:
        subprocess.run([*self.compile, *what, "-o", output, "-lm"], check=True)
        return output

    def _laid_out(self, symbols: list[str], objects: list[Path]) -> Whole:
        lines = [f"MODEL({symbol})" for symbol in dict.fromkeys(symbols)]
        (self.folder / "parts.inc").write_text("\n".join(lines) + "\n", encoding="utf-8")
        source = build_fmu.CORE / "build/layout.c"
        tool = self._link(*build_fmu.RUN_ONCE, source, *objects, output=self.folder / "layout")
        text = subprocess.run([tool], check=True, capture_output=True, encoding="utf-8").stdout
        models = read_layout(text)
        parts = [
            Part(part["name"], models[symbol], part["values"], part["driven"], part["late"])
            for part, symbol in zip(self.spec["parts"], symbols, strict=True)
        ]
        steps = [(i, every) for verb, i, every, _ in self.spec["plan"] if verb == "step"]
        return lay_out(parts, self.spec["step"], sorted(i for i, every in steps if every > 1))

    def _structure(self) -> list[Any]:
        """What tells systems with equal rows apart."""
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
        with xml.open("wb") as file:
            listed = [path.name for path in sources]
            subprocess.run(
                [describe, self.fmi, "0", build_fmu.DATE, *listed], check=True, stdout=file
            )
        package = [sys.executable, build_fmu.CORE / "build/package_fmu.py"]
        files = [f"--fmi{self.fmi}", output, xml, "--license", build_fmu.LICENSE]
        binary = ["--binary", f"{fmpy.platform}={library}"]
        texts = ["--source", *sources, "--include", self.folder, *build_fmu.HEADERS]
        subprocess.run([*package, *files, *binary, *texts], check=True)


def build(spec: dict[str, Any], output: Path, compiler: list[str], fmi: str) -> None:
    """Write the FMU of a system in a version of FMI; raises what Build.run() raises."""
    with tempfile.TemporaryDirectory() as folder:
        Build(spec, Path(folder), compiler, fmi).run(output)


def main() -> None:
    """Command line, see the docstring of the module; status 3: an FMU has no sources of ours."""
    parser = argparse.ArgumentParser()
    parser.add_argument("system", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument(
        "--fmi", choices=tuple(build_fmu.ADAPTER), default="2", help="version of FMI"
    )
    parser.add_argument("--cc", type=shlex.split, default=["cc"], help="with its arguments")
    a = parser.parse_args()
    try:
        build(json.loads(a.system.read_text(encoding="utf-8")), a.output, a.cc, a.fmi)
    except NotFusibleError as reason:
        print(reason)
        sys.exit(3)
    except (subprocess.CalledProcessError, OSError) as error:
        sys.exit(f"fuse.py: {error}" if isinstance(error, OSError) else 1)


if __name__ == "__main__":
    main()
