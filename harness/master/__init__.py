# SPDX-License-Identifier: BSD-2-Clause
"""The master algorithm at work: the only place that calls FMUs.

What enters: a System. What leaves: a Result. In between FMUs are loaded, initialised, stepped by
one of two executors of the same schedule, recorded, and freed, whatever happens.
"""
