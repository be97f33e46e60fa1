# SPDX-License-Identifier: BSD-2-Clause
"""Mission of Yin et al. 2017: prescribed performance control in line-of-sight coordinates."""
