# SPDX-License-Identifier: BSD-2-Clause
"""Analyses of a system by one or many runs (comparisons, campaigns, adaptive studies, least
impulse) and of a single FMU (linear models, cost on a flight processor), and checks of both.
"""
