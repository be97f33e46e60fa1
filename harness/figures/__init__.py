# SPDX-License-Identifier: BSD-2-Clause
"""Pictures from the figures that a mission lists: of one run, of several runs in one, of a
campaign; and the N2 diagram of a system.

A figure is drawn if the result has the variables it needs. A result without any gets a general
figure of every component.
"""
