# SPDX-License-Identifier: BSD-2-Clause
"""The rules of FMI 2.0 and FMI 3.0 for a .fmu: a path enters, findings leave, without any FMI call.

Errors keep an FMU from being run; oddities are what is not by the book, warnings.
"""
