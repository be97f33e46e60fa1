# SPDX-License-Identifier: BSD-2-Clause
"""File formats of the field: ephemerides of CCSDS, CZML, two-line elements.

A result is written as a file for other tools, and a file of another tool gives start values. The
inertial frame N of a result has no name and is treated as EME2000 about the Earth. t = 0 is the
epoch of the run, a UTC, or, if it has none, an epoch that the user names.
"""

from __future__ import annotations

from functools import partial

from harness.mission import Exchange

from .bodies import Bodies, eclipses
from .ccsds import write_aem, write_oem
from .czml import write_czml
from .start import start_values


def orbits(names: Bodies) -> Exchange:
    """Return the files of bodies in orbit, which a mission calls by these names."""
    writers = {".oem": write_oem, ".aem": write_aem, ".czml": write_czml}
    return Exchange(
        writers={ending: partial(write, names) for ending, write in writers.items()},
        start=partial(start_values, names),
        remarks=partial(eclipses, names),
    )
