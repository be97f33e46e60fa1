# SPDX-License-Identifier: BSD-2-Clause
"""Systems as plain data: components, connections, units, parameters, graph and schedule.

Input: tables of TOML, and model descriptions of FMUs. Output: a System with its Graph (which
component reads which outputs of other components) and its schedule, or all problems of the system
at once. This package reads no XML except the descriptions of FMUs, and calls no FMU. A System is
immutable; a change makes a new one.
"""
