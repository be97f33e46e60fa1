# SPDX-License-Identifier: BSD-2-Clause
"""Execution of a system: the only package that calls FMUs.

A System enters, a Result leaves. In between, FMUs are loaded, initialised, stepped by one of two
executors of the same schedule, recorded, and always freed.
"""
