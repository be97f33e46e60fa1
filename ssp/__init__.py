# SPDX-License-Identifier: BSD-2-Clause
"""Missions of the project: a folder each, with systems, parameter sets, campaigns, equations, and
the Python of the mission (`mission.py`). `shared/` contains parts of several missions. Installed as
the package `ssp`.
"""
