# SPDX-License-Identifier: BSD-2-Clause
"""The missions of the project: a folder each, with its systems, parameter sets, campaigns,
equations, and what it hands the engine (`mission.py`). `shared/` is what several missions have in
common. Installed as the package `ssp`.
"""
