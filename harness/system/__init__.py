# SPDX-License-Identifier: BSD-2-Clause
"""Systems as plain data: components, connections, units, parameters, and what follows from them.

Input: tables of TOML, and model descriptions of FMUs as FMPy reads them. Output: a System with its
Graph (which component reads which slot of the bus) and its schedule, or all problems of the system
at once. This package reads no XML and calls no FMU. A change of a system replaces immutable data.
"""
