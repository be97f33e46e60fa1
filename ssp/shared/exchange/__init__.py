# SPDX-License-Identifier: BSD-2-Clause
"""Exchange of orbits with other tools by CCSDS ephemerides, CZML and two-line elements.

A result is written as a file for other tools, and a file of another tool gives start values. The
inertial frame N of a result is treated as EME2000 about the Earth. For a written file, t = 0 is the
UTC that the user states, else the epoch of the run, else J2000.
"""

from __future__ import annotations

from functools import partial

from harness.mission import Exchange

from .bodies import Bodies, eclipses
from .ccsds import write_aem, write_oem
from .czml import write_czml
from .start import start_values


def orbits(names: Bodies) -> Exchange:
    """Return the Exchange of a mission: it writes results as .oem, .aem and .czml, reads start
    values from orbit files, and reports eclipses. names: names of the variables and parameters of
    the bodies of the mission.
    """
    writers = {".oem": write_oem, ".aem": write_aem, ".czml": write_czml}
    return Exchange(
        writers={ending: partial(write, names) for ending, write in writers.items()},
        start=partial(start_values, names),
        remarks=partial(eclipses, names),
    )
