# SPDX-License-Identifier: BSD-2-Clause
"""Campaigns of thousands of runs: factors, samplers, execution, and the stored dataset.

A table (a .toml) enters: a system, factors, metrics. One Zarr dataset with a line per run leaves,
which xarray opens directly. Run i is the same for any number of workers: everything that it depends
on is drawn from the seed and i before the first run.
"""
