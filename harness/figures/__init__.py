# SPDX-License-Identifier: BSD-2-Clause
"""Drawing of the figures that a mission defines, for one run, several runs or a campaign, and of
the N2 diagram of a system.

A figure is drawn if the result has the variables that it needs. If no figure of the mission can be
drawn, general figures show all variables that change, component by component.
"""
