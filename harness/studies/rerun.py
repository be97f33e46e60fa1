# SPDX-License-Identifier: BSD-2-Clause
"""Repetition of a run from its results file, and bitwise comparison of the repeated run with the
original one.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.files.checksums import sha256
from harness.files.paths import is_file
from harness.master.changes import Changes, joined
from harness.results.files import read
from harness.results.provenance import Provenance, differences
from harness.results.result import Result
from harness.ssp.library import find_system, leave_python
from harness.system.swap import find_fmu

_log = logging.getLogger("harness")


@dataclass(frozen=True)
class Rerun:
    """Run to repeat. every: macro steps per row (None: default); model: result of the original run,
    whose bits are to be reproduced; None for a run of a campaign.
    """

    system: str | Path
    changes: Changes
    executor: str = "c"
    every: int | None = None
    model: Result | None = None


def again(text: str, system: str | Path | None, changes: Changes) -> Rerun:
    """Return the run that is recorded in a results file, or as run N of a dataset OUT.zarr.

    text: path of the results file, or `OUT.zarr#N`; system: name or present path of the system
    (None: the recorded path); changes: options of run(), applied after the recorded ones. A warning
    is logged for every file that differs from the original one. Raises UsageError (nothing to
    repeat, the system or an FMU is missing) and ResultsError.
    """
    if "#" in text and not is_file(text):
        from harness.studies.campaign.campaign import like  # with zarr

        found, own = like(text, system)
        if system is None:
            leave_python(found)
        return Rerun(found, joined(own, changes))
    model = read(Path(text))
    if (earlier := model.provenance) is None:
        raise UsageError(f"--like {text}: the file has no record of the run that wrote it")
    if not (found := system or earlier.source):
        raise UsageError(
            f"--like {text}: its system was made in Python; give the SYSTEM (name, or path of "
            "an .ssp)"
        )
    if system is None:
        leave_python(found)
    both = joined(earlier.changes(), changes)  # type: ignore[arg-type]
    for warning in _changed(earlier, found, both):
        _log.warning("%s", warning)
    return Rerun(found, both, earlier.executor, earlier.every, model)


def _changed(earlier: Provenance, system: str | Path, changes: Changes) -> Iterator[str]:
    """Yield a line per file (system, swapped FMUs, parameter set) whose hash differs from the
    recorded hash.
    """
    swaps: Any = changes.get("swap", {})
    files = [(find_system(system), earlier.sha256)]
    files += [(find_fmu(swaps[s.component]), s.sha256) for s in earlier.swaps]
    if earlier.params_sha256 and is_file(params := str(changes.get("params"))):
        files.append((Path(params), earlier.params_sha256))
    for path, then in files:
        if then and (now := sha256(path)) != then:
            yield (
                f"{path.name}: differs from the recorded file "
                f"(sha256 {now[:12]} instead of {then[:12]})"
            )


def agreement(model: Result, result: Result, changed: bool = False) -> tuple[bool, str]:
    """Return whether a repeated run has the same bits as the original run, and a line that states
    the outcome.

    model: original result; changed: whether the user changed the run. If the provenance of the two
    results differs, the bits are not compared, and the first value is `changed`.
    """
    if names := differences(result.provenance, model.provenance):
        return changed, f"bits not compared: the runs differ in {', '.join(names)}"
    if wrong := next(_differing(model, result), None):
        return False, f"the bits differ{wrong}"
    return True, f"the bits agree: {len(model.time)} rows of {len(model.columns)} values"


def _differing(model: Result, result: Result) -> Iterator[str]:
    """Yield a text for every difference of a repeated run from its original, `model`: in the
    parameters, the times, and the first value that differs; or only one text if the number of rows
    differs or a variable of the original is missing. The run may have more rows than an original
    that is not complete.
    """
    rows = len(model.time)
    if len(result.time) != rows and (model.complete or len(result.time) < rows):
        yield f": {len(result.time)} rows instead of {rows}"
        return
    if missing := [name for name in model.columns if name not in result]:
        yield f": the new run has no variable {missing[0]}"
        return
    known, now = model.parameters, result.parameters
    if known is not None and now is not None:
        for name in dict.fromkeys((*known.columns, *now.columns)):
            if name not in known or name not in now:
                yield f": parameter {name} is in one of the two runs only"
            elif not _same(now[name], known[name]).all():
                value, then = float(now[name][0]), float(known[name][0])
                yield f": parameter {name} is {value!r} instead of {then!r}"
    for row in np.flatnonzero(~_same(result.time[:rows], model.time)):
        yield f": row {row} is at {result.time[row]} s instead of {model.time[row]} s"
    ours = np.stack([result[name][:rows] for name in model.columns], axis=1)
    other = np.argwhere(~_same(ours, model.values))
    for row, column in other[:1]:
        value, then = float(ours[row, column]), float(model.values[row, column])
        yield (
            f" in {len(other)} of {ours.size} values, first at {model.time[row]:g} s: "
            f"{model.columns[column]} {value!r} instead of {then!r}"
        )


def _same(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return, by element, whether two arrays have equal bits; any two NaN count as equal."""
    bits = np.ascontiguousarray(a).view(np.uint64) == np.ascontiguousarray(b).view(np.uint64)
    return np.asarray(bits | (np.isnan(a) & np.isnan(b)))
