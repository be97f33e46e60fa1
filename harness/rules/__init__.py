# SPDX-License-Identifier: BSD-2-Clause
"""The rules of FMI 2.0 for a .fmu: a path enters, findings leave, without any FMI call.

Errors keep an FMU from being run; warnings are what is not by the book. Rules stand in tables
(judge.py), one function per rule, by subject: the file, its header, units and types, variables, and
the model structure.
"""
