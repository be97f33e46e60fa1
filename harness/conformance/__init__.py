# SPDX-License-Identifier: BSD-2-Clause
"""Checks whether an FMU conforms to FMI 2.0 or FMI 3.0, without an FMI call. Input: the path of an
FMU. Output: errors and warnings.

An error means that the FMU cannot be run. A warning is a deviation from the standard.
"""
