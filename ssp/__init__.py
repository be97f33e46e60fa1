# SPDX-License-Identifier: BSD-2-Clause
"""Missions of the project, installed as the package `ssp`. Each folder is a mission with systems,
parameter sets, campaigns, equations, and its Python code (`mission.py`); `shared/` contains code
for several missions.
"""
