# SPDX-License-Identifier: BSD-2-Clause
"""Export of a changed system as one file: an .ssp with all FMUs and parameters, or one FMU compiled
from the models of all components, if each FMU contains C sources in the form of this project.
"""

from __future__ import annotations

import shutil
from collections.abc import Collection
from pathlib import Path
from typing import Unpack

from harness.errors import ResultsError, UsageError
from harness.files.output import PrivateFolder, written
from harness.master.changes import Changes, apply
from harness.master.fused import NotFusedError, write_whole
from harness.master.isolated import guarded
from harness.master.remainder import remainder, rest
from harness.spelling import file_stem
from harness.ssp.library import load
from harness.ssp.writer import write_ssp
from harness.system.graph import Graph, checked, log_warnings
from harness.system.model import System


def export(  # noqa: PLR0913 - one argument per option
    system: str | Path | System,
    target: str | Path,
    fmi: int | None = None,
    ssp: int | None = None,
    *,
    hints: bool = False,
    scalars: bool = False,
    without: Collection[str] = (),
    **changes: Unpack[Changes],
) -> Path:
    """Write a system with all changes to a file and return its path.

    target: NAME.ssp, NAME.fmu (one FMU of the whole system), or a folder for the .ssp;
    fmi: version of FMI of an .fmu, 2 (default) or 3;
    ssp: version of an .ssp, 1 (default if all FMUs are of FMI 2.0) or 2 (default otherwise);
    hints: write the step sizes of slow components into an .ssp for libcosim and ecos, which
    otherwise step every component at every macro step; OMSimulator rejects such a file;
    scalars: write an .fmu of FMI 3.0 without arrays, for tools that cannot read arrays;
    without: components to leave out, since another tool runs them; the inputs that their outputs
    drive become inputs of the exported system;
    changes: as for run().

    A run of the .ssp has the same bits as a run of the system with these changes. Equal changes
    give equal bytes of the file. Raises the exceptions that run() raises before the first step, or
    ResultsError.
    """
    with load(system) as found:
        changed = rest(apply(found, **changes))
        if without:
            changed = remainder(changed, without)
        log_warnings(changed)
        graph = checked(changed).graph
        file = _file(Path(target), changed.name)
        for option, given, ending in (
            ("--fmi", fmi, ".fmu"), ("--ssp", ssp, ".ssp"), ("--hints", hints, ".ssp")
        ):  # fmt: skip
            if given and file.suffix != ending:
                raise UsageError(f"{file}: {option} applies only to {ending} output")
        if ssp not in (None, 1, 2):
            raise UsageError(f"--ssp: expected 1 or 2, got {ssp}")
        if scalars and (file.suffix != ".fmu" or fmi != 3):
            raise UsageError(f"{file}: --scalars applies only to .fmu output with --fmi 3")
        try:
            if file.suffix == ".fmu":
                _write_fmu(changed, graph, file, fmi or 2, scalars)
            else:
                write_ssp(changed, file, ssp, hints=hints)
        except ValueError as error:  # raised by lxml: XML cannot contain a control character
            raise ResultsError(f"{file}: cannot be written ({error})") from error
    return file


def _write_fmu(system: System, graph: Graph, file: Path, fmi: int, scalars: bool) -> None:
    """Write a system as one FMU; raise UsageError with the reason if its models cannot be compiled
    into one.
    """
    with PrivateFolder() as folder:
        made = folder / file.name
        try:
            guarded(
                [c.fmu for c in system.components], write_whole, system, graph, made, fmi, scalars
            )
        except NotFusedError as reason:
            line = f"{file}: the system cannot be one FMU, export it as .ssp: {reason}"
            raise UsageError(line) from reason
        with written(file) as new:
            shutil.copyfile(made, new)


def _file(target: Path, name: str) -> Path:
    """Return the path of the file to write: `target` if it ends in .ssp or .fmu, else NAME.ssp in
    the folder `target`. Missing folders are created. Raises UsageError for .zip, .xml and similar.
    """
    is_file = target.suffix in (".ssp", ".fmu") and not target.is_dir()
    if target.suffix in (".zip", ".ssd", ".ssv", ".xml", ".toml"):
        raise UsageError(f"{target}: a system is written to NAME.ssp, NAME.fmu, or into a folder")
    folder = target.parent if is_file else target
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultsError(f"{folder}: cannot be created as a folder ({error.strerror})") from error
    return target if is_file else folder / f"{file_stem(name)}.ssp"
