# SPDX-License-Identifier: BSD-2-Clause
"""A run repeated from its result alone, and whether the bits are the same."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.files.paths import is_file
from harness.files.sealed import sha256
from harness.master.changes import Changes, joined
from harness.results.files import read
from harness.results.provenance import Provenance, differences
from harness.results.result import Result
from harness.ssp.library import find_system, leave_python
from harness.system.swap import find_fmu

_log = logging.getLogger("harness")


@dataclass(frozen=True)
class Again:
    """What is run; model: the result that it shall repeat, None of a run of a campaign."""

    system: str | Path
    changes: Changes
    executor: str = "c"
    every: int | None = None
    model: Result | None = None


def again(text: str, system: str | Path | None, changes: Changes) -> Again:
    """The run behind a result file or `OUT.zarr#N`, with these changes over its own.

    system: where the .ssp is now, None: where it was. What is not as it was then is said in a
    warning each. Raises UsageError (nothing to repeat, the .ssp or an FMU is gone), ResultsError.
    """
    if "#" in text and not is_file(text):
        from harness.studies.campaign.campaign import like  # with Dask and zarr

        found, own = like(text, system)
        if system is None:
            leave_python(found)
        return Again(found, joined(own, changes))
    model = read(Path(text))
    if (flown := model.provenance) is None:
        raise UsageError(f"--like {text}: the file does not record what was run")
    if not (found := system or flown.source):
        raise UsageError(f"--like {text}: its system was made in Python, name an .ssp")
    if system is None:
        leave_python(found)
    both = joined(flown.changes(), changes)  # type: ignore[arg-type]
    for warning in _changed(flown, found, both):
        _log.warning("%s", warning)
    return Again(found, both, flown.executor, flown.every, model)


def _changed(flown: Provenance, system: str | Path, changes: Changes) -> Iterator[str]:
    """Files that are not what they were."""
    swaps: Any = changes.get("swap", {})
    files = [(find_system(system), flown.sha256)]
    files += [(find_fmu(swaps[s.component]), s.sha256) for s in flown.swaps]
    if flown.params_sha256 and is_file(params := str(changes.get("params"))):
        files.append((Path(params), flown.params_sha256))
    for path, then in files:
        if then and (now := sha256(path)) != then:
            yield (
                f"{path.name}: differs from the recorded file "
                f"(sha256 {now[:12]} instead of {then[:12]})"
            )


def agreement(model: Result, result: Result, asked: bool = False) -> tuple[bool, str]:
    """Whether a repeated run has the bits of its model, and that in one line.

    asked: whether the user wanted something otherwise; then a run that was changed is not held
    against its model.
    """
    if changed := differences(result.provenance, model.provenance):
        same, place = (True, "not compared") if asked else (False, "differ")
        return same, f"bits {place}: other {', '.join(changed)}"
    if wrong := next(_differing(model, result), None):
        return False, f"the bits differ{wrong}"
    return True, f"the bits agree: {len(model.time)} rows of {len(model.columns)} values"


def _differing(model: Result, result: Result) -> Iterator[str]:
    """Rows, names, parameters, times and values of a run that are not those of its model."""
    rows = len(model.time)
    if len(result.time) != rows and (model.complete or len(result.time) < rows):
        yield f": {len(result.time)} rows instead of {rows}"
        return
    if missing := [name for name in model.columns if name not in result]:
        yield f": there is no {missing[0]} any more"
        return
    known, now = model.parameters, result.parameters
    if known is not None and now is not None:
        for name in dict.fromkeys((*known.columns, *now.columns)):
            if name not in known or name not in now:
                yield f": parameter {name} is in one of them only"
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
    """Equal bits; every NaN is as good as another."""
    bits = np.ascontiguousarray(a).view(np.uint64) == np.ascontiguousarray(b).view(np.uint64)
    return np.asarray(bits | (np.isnan(a) & np.isnan(b)))
