# SPDX-License-Identifier: BSD-2-Clause
"""Conformance checks of FMI 2.0 and FMI 3.0: a path enters, findings leave, without any FMI call.

An error means that an FMU cannot be run. A warning is a deviation from the standard.
"""
