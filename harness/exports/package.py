# SPDX-License-Identifier: BSD-2-Clause
"""The run at hand as one file for others: an .ssp with everything inside, or the whole system as
one FMU, compiled of its models where all are C of this project, else a container of its FMUs.
"""

from __future__ import annotations

import logging
import shutil
from pathlib import Path
from typing import Unpack

from harness.errors import ResultsError, UsageError
from harness.exports.container import write_container
from harness.files.output import written
from harness.files.temporary import PrivateFolder
from harness.master.changes import Changes, apply
from harness.master.fused import NotFusedError, write_whole
from harness.spelling import file_stem
from harness.ssp.library import load
from harness.ssp.writer import write_ssp
from harness.system.graph import Graph, checked, say_warnings
from harness.system.model import System

_log = logging.getLogger("harness")


def export(
    system: str | Path | System,
    target: str | Path,
    fmi: int | None = None,
    ssp: int | None = None,
    **changes: Unpack[Changes],
) -> Path:
    """Write a system with all changes to a file and return its path.

    target: NAME.ssp, NAME.fmu (one FMU of the whole system), or a folder for the .ssp; fmi: version
    of FMI of an .fmu, 2 (default) or 3; ssp: version of SSP of an .ssp, 1 or 2 (default 1, with
    FMUs of FMI 3.0 2); changes: as for run(). Running the .ssp gives the bits of running the system
    with the same changes; the same changes give the same bytes. Raises the exceptions of run()
    before its first step, or ResultsError.
    """
    with load(system) as found:
        changed = apply(found, **changes)
        say_warnings(changed)
        graph = checked(changed).graph
        file = _file(Path(target), changed.name)
        for kind, given, ending in (("FMI", fmi, ".fmu"), ("SSP", ssp, ".ssp")):
            if given is not None and file.suffix != ending:
                raise UsageError(f"{file}: is no {ending}, which alone can be of {kind} {given}.0")
        try:
            if file.suffix == ".fmu":
                _write_fmu(changed, graph, file, fmi or 2)
            else:
                write_ssp(changed, file, ssp)
        except ValueError as error:  # lxml: control characters, which XML has no way to write
            raise ResultsError(f"{file}: cannot be written ({error})") from error
    return file


def _write_fmu(system: System, graph: Graph, file: Path, fmi: int) -> None:
    """One model of all models; a line says why it is a container instead, which FMI 3.0 has not."""
    with PrivateFolder() as folder:
        made = folder / file.name
        try:
            write_whole(system, graph, made, fmi)
        except NotFusedError as reason:
            if fmi != 2:
                line = f"{file}: a container of FMUs is of FMI 2.0, and nothing else can be made"
                raise UsageError(f"{line}: {reason}") from reason
            _log.warning("%s: is a container of its FMUs: %s", file.name, reason)
            write_container(system, file)
            return
        with written(file) as new:
            shutil.copyfile(made, new)


def _file(target: Path, name: str) -> Path:
    """The file itself, or NAME.ssp in a folder that is made if needed."""
    is_file = target.suffix in (".ssp", ".fmu") and not target.is_dir()
    if target.suffix in (".zip", ".ssd", ".ssv", ".xml", ".toml"):
        raise UsageError(f"{target}: a system is written to NAME.ssp, NAME.fmu, or into a folder")
    folder = target.parent if is_file else target
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultsError(f"{folder}: cannot be made a folder ({error.strerror})") from error
    return target if is_file else folder / f"{file_stem(name)}.ssp"
