# SPDX-License-Identifier: BSD-2-Clause
"""Checks whether an FMU conforms to FMI 2.0 or FMI 3.0: from its path to errors and warnings,
without an FMI call.

An error means that the FMU cannot be run. A warning is a deviation from the standard.
"""
