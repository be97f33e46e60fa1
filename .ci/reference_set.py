# SPDX-License-Identifier: BSD-2-Clause
"""Write reference-ssps.zip for makers of tools: every system as SSP 1.0, as SSP 2.0, and as SSP 2.0
with FMUs of FMI 3.0; the trace that a tool must give for each; tolerances with their reasons; the
script that compares the rows of a tool with a trace; and the specimens, small FMUs of FMI 3.0.

python .ci/reference_set.py dist        # make release
"""

from __future__ import annotations

import csv
import io
import sys
import tempfile
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness import load
from harness.master.simulation import Simulation
from harness.results.result import Result
from harness.ssp.writer import write_ssp
from harness.system.model import System
from harness.system.values import base

sys.path.insert(0, str(Path(__file__).parent))  # for the import of specimens

import specimens

ENDING = ".fmi3.ssp"
"""End of the names of the copies with FMUs of FMI 3.0, which reference_systems.py writes."""
STEPS, EVERY = 200, 10
"""Macro steps of a trace, and macro steps per row."""
DIGITS = 1e-11
"""Tolerance of a vector, as a share of the largest absolute value of its elements in the trace."""
# reason of a tolerance, by whether any value of the vector in the trace differs from zero
REASONS = {
    True: "bits should be equal at every instant; the tolerance suits a CSV file of twelve digits",
    False: "the trace is zero at every instant, so only zero is right",
}
FIXED_DATE = (1980, 1, 1, 0, 0, 0)
README = """Reference systems of servicing-fmus

ssp1/NAME.ssp        SSP 1.0, FMUs of FMI 2.0
ssp2/NAME.ssp        SSP 2.0, FMUs of FMI 2.0
ssp2-fmi3/NAME.ssp   SSP 2.0, FMUs of FMI 3.0 (SSP 1.0 cannot hold them)
traces/NAME.csv      values that each of the three files must give: order Jacobi (all FMUs read,
                     then all step), every FMU steps at every macro step, {steps} macro steps, a
                     row every {every} macro steps
traces/tolerances.csv  per trace and variable: tolerance and its reason
compare.py           python compare.py traces/NAME.csv ROWS_OF_YOUR_TOOL.csv
specimens/           FMUs of FMI 3.0 with Event Mode and early return, clocks, a table of vectors, a
                     binary port: NAME.fmu, its source, and NAME.csv, the trace a tool must give

The page "Test your tool in ten minutes" of the documentation has the steps.
"""


def traced(system: System) -> Result:
    """Simulate the first STEPS macro steps of a system and return the result. The order is Jacobi;
    every component steps at every macro step, without latency.
    """
    start, step = system.experiment.start, system.experiment.step or 0.0
    components = tuple(replace(c, every=1, latency=0) for c in system.components)
    times = replace(system.experiment, stop=start + STEPS * step, algorithm="jacobi", every=EVERY)
    with Simulation(replace(system, components=components, experiment=times)) as simulation:
        simulation.advance()
        return simulation.result()


def table(rows: list[tuple[object, ...]]) -> bytes:
    """Return rows as CSV."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def trace_csv(result: Result) -> bytes:
    """Return a trace as CSV; a number is the shortest text that reads back as the same double."""
    head: tuple[object, ...] = ("time", *result.columns)
    values = np.column_stack((result.time, result.values)).tolist()
    return table([head, *(tuple(map(repr, row)) for row in values)])


def tolerances(result: Result) -> list[tuple[object, ...]]:
    """Return a row per column of a trace: trace, variable, tolerance and reason. All elements of a
    vector have the same tolerance.
    """
    largest: dict[str, float] = {}
    for name, column in zip(result.columns, np.abs(result.values).T, strict=True):
        largest[base(name)] = max(largest.get(base(name), 0.0), float(column.max()))
    return [
        (result.system, name, repr(DIGITS * largest[base(name)]), REASONS[largest[base(name)] > 0])
        for name in result.columns
    ]


def contents(folder: Path, fmus: Path) -> dict[str, bytes]:
    """Return the contents of the files in the archive, by path in the archive. folder: folder of
    the release, with the systems in ssp/; fmus: folder with the FMUs of the specimens.
    """
    limits: list[tuple[object, ...]] = [("trace", "variable", "tolerance", "reason")]
    files = {"README.txt": README.format(steps=STEPS, every=EVERY).encode()}
    files["compare.py"] = Path(__file__).with_name("compare.py").read_bytes()
    for path in sorted((folder / "ssp").glob("*.ssp")):
        if path.name.endswith(ENDING):
            files[f"ssp2-fmi3/{path.name.removesuffix(ENDING)}.ssp"] = path.read_bytes()
            continue
        with load(path) as system, tempfile.TemporaryDirectory() as place:
            second = Path(place) / path.name
            write_ssp(system, second, 2)
            files[f"ssp2/{path.name}"] = second.read_bytes()
            result = traced(system)
        files[f"ssp1/{path.name}"] = path.read_bytes()
        files[f"traces/{path.stem}.csv"] = trace_csv(result)
        limits += tolerances(result)
    return files | {"traces/tolerances.csv": table(limits)} | specimen_files(fmus)


def specimen_files(folder: Path) -> dict[str, bytes]:
    """Return the contents of the files of the specimens, by path in the archive: the FMUs of a
    folder, with sources, traces and tolerances.
    """
    limits: list[tuple[object, ...]] = [("trace", "variable", "tolerance", "reason")]
    paths = (*folder.glob("*.fmu"), *specimens.SOURCES.glob("*.[ch]"))
    files = {path.name: path.read_bytes() for path in paths}
    for name in specimens.TRACES:
        files[f"{name}.csv"] = table(specimens.trace(name))
        limits += specimens.limits(name)
    files["tolerances.csv"] = table(limits)
    return {f"specimens/{name}": content for name, content in files.items()}


def write(folder: Path, fmus: Path) -> Path:
    """Write reference-ssps.zip and return its path; fmus: folder of the specimens. The same systems
    and specimens give the same bytes.
    """
    output = folder / "reference-ssps.zip"
    with zipfile.ZipFile(output, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in sorted(contents(folder, fmus).items()):
            entry = zipfile.ZipInfo(name, FIXED_DATE)
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, content)
    return output


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        specimens.write(Path(place))
        print(write(Path(sys.argv[1]), Path(place)))
