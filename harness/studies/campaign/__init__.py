# SPDX-License-Identifier: BSD-2-Clause
"""Campaigns of thousands of runs: factors, samplers, execution, and the stored dataset.

The input is a table (a .toml) that names a system, factors and metrics. The output is one Zarr
dataset with a line per run, which xarray opens directly. Run i is the same for any number of
workers, because all its random values are drawn before the first run, from the table alone.
"""
