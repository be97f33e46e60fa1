# SPDX-License-Identifier: BSD-2-Clause
"""Runs by the thousand: what varies, in which order it is drawn, who runs it, and what is kept.

What enters is a table (a .toml): a system, factors, metrics. What leaves is one Zarr dataset with a
line per run, which xarray opens as it is. Run i is the same whoever runs it: all it depends on is
drawn from the seed and i before anything flies.
"""
