# SPDX-License-Identifier: BSD-2-Clause
"""A system as plain data: components, connections, units, parameters, and what follows from them.

What enters: tables of TOML, descriptions of FMUs as FMPy reads them. What leaves: a System, its
Graph (who reads which place of the bus), its schedule, or every problem at once. Nothing in here
knows XML or calls an FMU, so a change of a system is a replacement of frozen data.
"""
