# SPDX-License-Identifier: BSD-2-Clause
"""Execution of a system: the only package that calls FMUs.

The input is a System, the output is a Result. In between, FMUs are loaded, initialised, stepped,
recorded, and always freed. Two executors, one in Python and one in C, perform the same schedule of
steps.
"""
