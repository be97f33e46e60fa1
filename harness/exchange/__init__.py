# SPDX-License-Identifier: BSD-2-Clause
"""The field's files: ephemerides of CCSDS, CZML, two-line elements.

A result leaves as a file that other tools read, and a file of another tool gives start values.
Results have no date and an inertial frame N without a name; here both get one: N is taken as
EME2000 about the Earth, and t = 0 as an epoch in UTC that the user names.
"""
