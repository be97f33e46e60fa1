# SPDX-License-Identifier: BSD-2-Clause
"""Yin et al. 2017: prescribed performance control in line-of-sight coordinates."""
