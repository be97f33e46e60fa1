# SPDX-License-Identifier: BSD-2-Clause
"""Systems as plain data: components, connections, units, parameters, and what follows from them.

Tables of TOML enter, and descriptions of FMUs as FMPy reads them. A System leaves, with its Graph
(which component reads which slot of the bus) and its schedule; or else all of its problems at once.
This package reads no XML itself and calls no FMU, so a change of a system replaces immutable data.
"""
