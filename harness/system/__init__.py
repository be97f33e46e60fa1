# SPDX-License-Identifier: BSD-2-Clause
"""Systems as plain data: components, connections, units, parameters, and what follows from them.

Tables of TOML and descriptions of FMUs as FMPy reads them enter. A System, its Graph (which
component reads which slot of the bus) and its schedule leave, or every problem at once. Nothing
here knows XML or calls an FMU, so a change of a system replaces frozen data.
"""
