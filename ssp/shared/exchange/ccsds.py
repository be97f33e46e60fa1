# SPDX-License-Identifier: BSD-2-Clause
"""Writing of orbit and attitude ephemeris messages as key-value text: CCSDS 502.0-B-2 (OEM 2.0) and
504.0-B-1 (AEM 1.0).

Positions are in km, velocities in km/s, with all digits of the doubles. The quaternion (scalar
last) turns EME2000 into the body axes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.errors import ResultsError, UsageError
from harness.files.output import written
from harness.results.result import Array, Result

from .bodies import Bodies, bodies, instants

ORIGINATOR = "SERVICING-FMUS"
ASSUMED = (
    "N of the simulation is taken as EME2000; t = 0 is the date given to the conversion, else the "
    "epoch of the run, else J2000"
)


OEM = {"CENTER_NAME": "EARTH", "REF_FRAME": "EME2000", "TIME_SYSTEM": "UTC"}
AEM = {
    "CENTER_NAME": "EARTH",
    "REF_FRAME_A": "EME2000",
    "REF_FRAME_B": "SC_BODY_1",
    "ATTITUDE_DIR": "A2B",
    "TIME_SYSTEM": "UTC",
}
"""Centre, frames and time system of the orbit message (OEM) and the attitude message (AEM)."""


def write_oem(names: Bodies, result: Result, path: Path, body: str | None, epoch: str) -> None:
    """Write the orbit of one body (None: the first) of a result into an .oem file; raise UsageError
    for an unknown body or an invalid epoch, ResultsError if the result has less than two rows, no
    body, a body that is not in an orbit about the Earth, or a date out of range. epoch: UTC at
    t = 0.
    """
    one = bodies(names, result, body)[0]
    data = np.hstack((one.r_N, one.v_N)) / 1000
    meta = _meta(one.name, result, epoch, OEM)
    meta |= {"INTERPOLATION": "HERMITE", "INTERPOLATION_DEGREE": "3"}
    _write(path, result, "OEM_VERS = 2.0", meta, _rows(result, epoch, data))


def write_aem(names: Bodies, result: Result, path: Path, body: str | None, epoch: str) -> None:
    """Write the attitude of one body (None: the first with an attitude) of a result into an .aem
    file; raise UsageError for an unknown body, a body without attitude or an invalid epoch,
    ResultsError if the result has less than two rows, no body, a body that is not in an orbit about
    the Earth, or a date out of range. epoch: UTC at t = 0.
    """
    found = bodies(names, result, body)
    one = next((body for body in found if body.q is not None), found[0])
    if one.q is None:
        raise UsageError(f"{one.name}: the result does not contain the attitude of this body")
    meta = _meta(one.name, result, epoch, AEM)
    meta |= {"ATTITUDE_TYPE": "QUATERNION", "QUATERNION_TYPE": "LAST"}
    rows = ["DATA_START", *_rows(result, epoch, one.q[:, [1, 2, 3, 0]]), "DATA_STOP"]
    _write(path, result, "AEM_VERS = 1.0", meta, rows)


def _meta(name: str, result: Result, epoch: str, frames: Mapping[str, str]) -> dict[str, str]:
    """Return the metadata of a message: object, frames, time system and time span."""
    times = _texts(instants(result, epoch))
    if len(times) < 2:
        raise ResultsError(f"{result.system}: an ephemeris needs two rows at least")
    named = {"OBJECT_NAME": name.upper(), "OBJECT_ID": "UNKNOWN"}
    return {**named, **frames, "START_TIME": times[0], "STOP_TIME": times[-1]}


def _rows(result: Result, epoch: str, data: Array) -> Iterator[str]:
    for time, row in zip(_texts(instants(result, epoch)), data.tolist(), strict=True):
        yield f"{time} {' '.join(map(repr, row))}"


def _texts(times: NDArray[np.datetime64]) -> list[str]:
    """Return instants as texts: with microseconds, which every reader accepts, if they are exact,
    else with nanoseconds (in a microsecond a body moves by 8 mm).
    """
    short = times.astype("datetime64[us]")
    exact = bool((short == times).all())
    return [str(text) for text in np.datetime_as_string(short if exact else times)]


def _write(
    path: Path, result: Result, kind: str, meta: Mapping[str, str], rows: Iterable[str]
) -> None:
    block = ["META_START", *(f"{name} = {value}" for name, value in meta.items()), "META_STOP"]
    with written(path) as target, target.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines(f"{line}\n" for line in chain(_head(result, kind), block, rows))


def _head(result: Result, kind: str) -> Iterator[str]:
    provenance = result.provenance
    created = provenance.date.removesuffix("Z") if provenance else ""
    yield f"CCSDS_{kind}"
    yield from (
        f"COMMENT {line}" for line in [ASSUMED, *(provenance.lines() if provenance else [])]
    )
    yield f"CREATION_DATE = {created or datetime.now(UTC).strftime('%Y-%m-%dT%H:%M:%S')}"
    yield f"ORIGINATOR = {ORIGINATOR}"
