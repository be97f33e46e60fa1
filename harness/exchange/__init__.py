# SPDX-License-Identifier: BSD-2-Clause
"""The field's files: ephemerides of CCSDS, CZML, two-line elements.

A result leaves as a file that other tools read, and a file of another tool gives start values.
The inertial frame N of a result has no name and is taken as EME2000 about the Earth; t = 0 is the
epoch of the run, a UTC, or, if it has none, one that the user names.
"""
