# SPDX-License-Identifier: BSD-2-Clause
"""The rules of FMI 2.0 for a .fmu: a path enters, findings leave, without any FMI call.

Errors keep an FMU from being run; warnings are what is not by the book. Every public
function of header, variables and version3 is one rule; judge lists those that are errors.
"""
