# SPDX-License-Identifier: BSD-2-Clause
"""Analyses of one system by several runs, and of one FMU: comparisons, campaigns, linear models,
checks.
"""
