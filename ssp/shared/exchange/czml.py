# SPDX-License-Identifier: BSD-2-Clause
"""Writing of the bodies of a result as CZML, which Cesium shows about the Earth.

Positions are in the inertial axes N, which are taken as EME2000; Cesium treats them as ICRF, which
differs by 23 mas. Orientations are relative to the Earth-fixed axes, as CZML requires: they are
converted by the IAU 2006/2000A matrix of every instant, with UT1 = UTC and without polar motion,
which causes an error below 0.005 deg.
"""

from __future__ import annotations

import json
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import library
from harness.files.output import written
from harness.results.result import Array, Result

from .bodies import Bodies, Body, bodies, days_since_j2000, instants

ROWS = 5000
"""Largest number of rows that are written; Cesium interpolates between them."""
COLOURS = ([0, 114, 178, 255], [213, 94, 0, 255], [0, 158, 115, 255])
"""Colours (red, green, blue, opacity) of the bodies in their order: blue, vermilion and green of
Okabe & Ito.
"""
LEAP_SECONDS = 37.0
"""Difference TAI - UTC since 2017 [s]. If this value is wrong by a second, the matrix of earth() is
turned by less than 0.01 arcsec.
"""


class _Clock(NamedTuple):
    """Rows of a result that are written, their UTC instants, and seconds since the first one."""

    rows: slice
    times: NDArray[np.datetime64]
    seconds: Array

    @property
    def span(self) -> str:
        """Return the interval from the first instant to the last as ISO 8601 text."""
        return f"{_text(self.times[0])}/{_text(self.times[-1])}"

    def sampled(self, degree: int, name: str, values: Array, **about: Any) -> dict[str, Any]:
        """Return the CZML property of values (rows, n) that Cesium interpolates by polynomials of
        this degree; name: key of the list of values in CZML; about: further entries.
        """
        return {
            "epoch": _text(self.times[0]),
            "interpolationAlgorithm": "LAGRANGE",
            "interpolationDegree": degree,
            **about,
            name: np.column_stack((self.seconds, values)).ravel().tolist(),
        }


def write_czml(names: Bodies, result: Result, path: Path, body: str | None, epoch: str) -> None:
    """Write the bodies of a result into a .czml file. Raises UsageError for an unknown body or an
    invalid epoch, ResultsError if the result has no body, a body is not in an orbit about the
    Earth, or a date is out of range.

    names: names of the variables that describe a body; body: name of the only body to write (None:
    all); epoch: UTC at t = 0.
    """
    rows = slice(None, None, -(-len(result.time) // ROWS))
    times = instants(result, epoch)[rows]
    clock = _Clock(rows, times, result.time[rows] - result.time[0])
    shown = {"interval": clock.span, "currentTime": _text(times[0]), "multiplier": 10}
    head = {"id": "document", "name": result.system, "version": "1.0", "clock": shown}
    found = zip(bodies(names, result, body), cycle(COLOURS), strict=False)
    packets = [_packet(each, colour, clock) for each, colour in found]
    with written(path) as target:
        target.write_text(json.dumps([head, *packets]), encoding="utf-8")


def _packet(body: Body, colour: list[int], clock: _Clock) -> dict[str, Any]:
    rgba = {"solidColor": {"color": {"rgba": colour}}}
    position = body.r_N[clock.rows]
    packet: dict[str, Any] = {
        "id": body.name,
        "name": body.name,
        "availability": clock.span,
        "position": clock.sampled(5, "cartesian", position, referenceFrame="INERTIAL"),
        "point": {"color": {"rgba": colour}, "pixelSize": 8},
        "path": {"material": rgba, "width": 2, "resolution": 60},
        "label": {"text": body.name, "pixelOffset": {"cartesian2": [0, -16]}},
    }
    if body.q is not None:
        fixed = _fixed(body.q[clock.rows], clock.times)
        packet["orientation"] = clock.sampled(1, "unitQuaternion", fixed)
    return packet


def _fixed(q: Array, times: Any) -> Array:
    """Return the attitudes relative to the Earth-fixed axes (rows, 4), scalar last, from attitudes
    q relative to N (rows, 4), scalar first. Successive quaternions have no jump of sign.
    """
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_matrix(earth(times)) * Rotation.from_quat(q[:, [1, 2, 3, 0]])
    found = turned.as_quat()
    jumps = np.sum(found[1:] * found[:-1], axis=1) < 0
    return np.asarray(found * np.where(np.cumsum([False, *jumps]) % 2, -1.0, 1.0)[:, None])


def earth(times: NDArray[np.datetime64]) -> Array:
    """Return the matrices from inertial to Earth-fixed axes at UTC instants, (rows, 3, 3)."""
    erfa = library("erfa", "exchange")
    days = days_since_j2000(times)
    terrestrial = days + (LEAP_SECONDS + 32.184) / 86400
    return np.asarray(erfa.c2t06a(2451545.0, terrestrial, 2451545.0, days, 0.0, 0.0))


def _text(time: np.datetime64) -> str:
    return f"{np.datetime_as_string(time.astype('datetime64[ms]'))}Z"
