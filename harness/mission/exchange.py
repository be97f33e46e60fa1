# SPDX-License-Identifier: BSD-2-Clause
"""Exchange of files with other tools: writes results to files that these tools read, and reads
start values from files that they write. Only missions know the file formats, so this module calls
functions of missions.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from harness.errors import StructureError, UsageError
from harness.mission.fields import several
from harness.mission.library import everything, mission, of_result
from harness.mission.mission import Exchange, Mission, Start
from harness.results.result import Result
from harness.system.instants import J2000, epoch_of, start_note, written
from harness.system.model import System


def _offered(own: Mission | None) -> tuple[Exchange, ...]:
    """Return the file exchanges of a mission or, if it has none, of all available missions."""
    return (own.exchange if own else ()) or everything().exchange


def convert(
    source: str | Path, target: str | Path, body: str | None = None, epoch: str | None = None
) -> Path:
    """Convert a results file to another file, whose ending selects the format, and return its path.

    body: component whose motion is written (default: chosen by the format); epoch: UTC date of
    t = 0, such as 2026-01-31T12:00:00 (default: from the run, else J2000). Raises UsageError,
    ResultsError, and HarnessError if a library is missing.
    """
    from harness.results.files import FORMATS, read, save

    path, result = Path(target), read(source)
    if path.suffix in FORMATS:
        return save(result, path)
    writers = {k: w for each in _offered(of_result(result)) for k, w in each.writers.items()}
    if path.suffix not in writers:
        raise UsageError(
            f"{path}: results are converted to {', '.join((*FORMATS, *writers))}, not to "
            f"'{path.suffix or path.name}'"
        )
    own = result.provenance.epoch if result.provenance else ""
    writers[path.suffix](result, path, body, (own or written(J2000)) if epoch is None else epoch)
    return path


def start_values(
    system: System,
    files: Mapping[str, str | Path],
    epoch: str | None = None,
    **changes: Any,
) -> Start:
    """Return start values of components from files, for the system with `changes` (see
    harness.master.changes.Changes).

    files: file by component, in addition to the files in the `[start]` of the system, which they
    override; epoch: UTC date of t = 0, such as 2026-01-31T12:00:00 (default: from the system, else
    the first instant that all files cover). Raises UsageError (no such component, no such file, an
    epoch outside the files), and HarnessError if a library is missing.
    """
    own = mission(system.mission) if system.mission else None
    for each in _offered(own):
        if each.start is not None:
            return each.start(system, files, epoch, **changes)
    if {**system.starts, **files}:
        raise UsageError(f"--start: no mission reads start values for {system.name}")
    instant = epoch_of(system.experiment.epoch if epoch is None else epoch)
    return Start({}, (start_note(instant),), written(instant))


def of_system(system: System) -> Start:
    """Return start values and epoch from the `[start]` in the TOML of a system; raise
    StructureError if they cannot be read.
    """
    try:
        return start_values(system, {})
    except UsageError as error:
        text = str(error).replace("--start ", "[start] ").replace("--start: ", "[start] ")
        raise StructureError(text.splitlines()) from error


def remarks(result: Result) -> Iterator[str]:
    """Yield the lines, for example about eclipses, that `Exchange.remarks` adds to the report page
    of a result, without the mission's notes. If the mission of the result has no Exchange, the
    functions `remarks` of all available missions are called.
    """
    for each in _offered(of_result(result)):
        if each.remarks is not None:
            yield from several(str, each.remarks, result)
