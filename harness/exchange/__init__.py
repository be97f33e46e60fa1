# SPDX-License-Identifier: BSD-2-Clause
"""The field's files: ephemerides of CCSDS, CZML, two-line elements.

A result leaves as a file that other tools read, and a file of another tool gives start values.
The inertial frame N of a result has no name and is taken as EME2000 about the Earth; t = 0 is the
epoch of the run, a UTC, or, if it has none, one that the user names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from harness.errors import UsageError
from harness.exchange.bodies import EPOCH
from harness.exchange.ccsds import write_aem, write_oem
from harness.exchange.czml import write_czml
from harness.results.files import WRITERS, read, save
from harness.results.result import Result

Export = Callable[[Result, Path, str | None, str], None]

EXPORTS: Mapping[str, Export] = {".oem": write_oem, ".aem": write_aem, ".czml": write_czml}
"""Files that hold bodies, not the whole result."""


def convert(
    source: str | Path, target: str | Path, body: str | None = None, epoch: str | None = None
) -> Path:
    """Write a result into another file by its ending; returns where it is.

    body: component whose ephemeris is wanted (default: the first, for CZML all); epoch: t = 0 in
    UTC (default: that of the run, else J2000). Raises UsageError, ResultsError, HarnessError if a
    library is missing.
    """
    path = Path(target)
    if path.suffix not in (*WRITERS, *EXPORTS):
        raise UsageError(
            f"{path}: results are converted to {', '.join((*WRITERS, *EXPORTS))}, not to "
            f"'{path.suffix or path.name}'"
        )
    result = read(source)
    if path.suffix in WRITERS:
        return save(result, path)
    own = result.provenance.epoch if result.provenance else ""
    EXPORTS[path.suffix](result, path, body, (own or EPOCH) if epoch is None else epoch)
    return path
